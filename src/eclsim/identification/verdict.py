"""Verdict on a fit: agreement with the measurements, and plausibility of the fitted patient.

The same verdict is used in the terminal, JSON, report, tables of cohorts and the bedside page. Thresholds are
conventions: by chance, one measurement in 80 differs by 2.5 standard uncertainties and one in 16,000 by 4.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from typing import Any

import numpy as np

from eclsim.cases.checking import contradicted_wedge
from eclsim.cases.quantities import quantity
from eclsim.identification.multi_start import FitStatus
from eclsim.identification.quantities import Scale, relative_scale
from eclsim.identification.settings import CLOTTED, INFORMATIVE_MEASUREMENTS
from eclsim.parameters.adult_ranges import AdultRange
from eclsim.reporting.numbers import significant

DOUBTFUL_DIFFERENCE = 2.5
"""Largest difference from a measurement in a good fit, in standard uncertainties."""
POOR_DIFFERENCE = 4.0
"""Largest difference in a fit that is not poor, in standard uncertainties."""
DOUBTFUL_PROBABILITY = 1e-2
"""A fit is doubtful if measurement error alone gives as large a chi-square with a smaller probability."""
POOR_PROBABILITY = 1e-4
"""A fit is poor if measurement error alone gives as large a chi-square with a smaller probability."""
LARGEST_WIDTH_RATIO = 3.0
"""Intervals of a parameter disagree if their widths (in coordinates) differ by more than this factor."""
PO2_BEHIND = "PpostO2"
TRANSFER = "ecmo.oxygenator.oxygen_transfer"
SIDES = ("lower", "upper")
LARGEST_END_DISTANCE = 2.0
"""Intervals of a parameter disagree if one of their ends differs by more than this factor."""


class Level(StrEnum):
    """How far a fit can be relied on."""

    GOOD = "good"
    DOUBTFUL = "doubtful"
    POOR = "poor"


_ORDER = tuple(Level)


class Aspect(StrEnum):
    """Subject of a reason."""

    AGREEMENT = "agreement with the measurements"
    SEARCH = "search"
    PLAUSIBILITY = "plausibility of the fitted patient"
    INTERVALS = "agreement of the intervals"
    HELD = "what is held"


@dataclass(frozen=True, slots=True)
class Reason:
    """One finding about a fit.

    Args:
        aspect: subject of the finding.
        level: verdict that this finding alone would give; `Level.GOOD` for a remark.
        about: name of the output or parameter concerned; empty if it concerns the fit as a whole.
        sentence: the finding in words, with numbers and advice.
    """

    aspect: Aspect
    level: Level
    about: str
    sentence: str

    def as_object(self) -> dict[str, str]:
        """Plain data for JSON."""
        return {name: str(value) for name, value in asdict(self).items()}


@dataclass(frozen=True)
class Goodness:
    """Agreement with the measurements.

    Args:
        differences: (fitted - measured) / standard uncertainty of each measurement.
        chi_square: sum of the squares of the differences.
        degrees: degrees of freedom: measurements less the parameters that they determine, at least 0.
        probability: probability that measurement error alone gives as large a sum; None without a degree of
            freedom.
    """

    differences: Mapping[str, float]
    chi_square: float
    degrees: float
    probability: float | None


@dataclass(frozen=True)
class FitVerdict:
    """Whether a fit can be used, with reasons.

    Args:
        goodness: agreement with the measurements; None if nothing was fitted.
        reasons: findings, the worst first.
    """

    goodness: Goodness | None
    reasons: tuple[Reason, ...]

    @property
    def level(self) -> Level:
        """The worst level of all reasons."""
        return max((r.level for r in self.reasons), key=_ORDER.index, default=Level.GOOD)

    @property
    def doubts(self) -> tuple[Reason, ...]:
        """Reasons with a level worse than good."""
        return tuple(r for r in self.reasons if r.level is not Level.GOOD)

    @property
    def remarks(self) -> tuple[Reason, ...]:
        """Reasons with the level good."""
        return tuple(r for r in self.reasons if r.level is Level.GOOD)

    @property
    def advice(self) -> tuple[str, ...]:
        """What to set if a measurement is out of the model's reach."""
        return tuple(r.sentence for r in self.doubts if r.about == TRANSFER)

    @property
    def headline(self) -> str:
        """The verdict in one sentence."""
        return headline(self.as_object())

    def with_reasons(self, more: Iterable[Reason]) -> FitVerdict:
        """Return the verdict with further reasons."""
        reasons = dict.fromkeys([*self.reasons, *more])
        return replace(self, reasons=tuple(sorted(reasons, key=lambda r: -_ORDER.index(r.level))))

    def as_object(self) -> dict[str, Any]:
        """Plain data for JSON."""
        g = self.goodness
        return {
            "level": str(self.level),
            "reasons": [reason.as_object() for reason in self.reasons],
            "goodness": None if g is None else {
                "differences": dict(g.differences), "chi_square": g.chi_square,
                "degrees_of_freedom": g.degrees, "probability": g.probability,
            },
        }  # fmt: skip


_HEADLINES = {
    Level.GOOD: "GOOD FIT: {agreement}, and the fitted patient is plausible",
    Level.DOUBTFUL: "DOUBTFUL FIT{agreement}; read the reasons before you use it",
    Level.POOR: "POOR FIT, not to be used: {agreement}",
}
_MET = 0.05
"""Differences below this, which are written as 0.0, are no differences."""


def headline(verdict: Mapping[str, Any]) -> str:
    """The verdict in one sentence, from its plain data."""
    level = Level(verdict["level"])
    others = level is Level.DOUBTFUL and not any(
        reason["aspect"] == Aspect.AGREEMENT and reason["level"] == level for reason in verdict["reasons"]
    )
    agreement = "nothing was fitted"
    if verdict["goodness"] is not None:
        agreement = _agreement_in_words(verdict["goodness"]["differences"], others)
        if verdict["goodness"]["probability"] is None and level != Level.POOR:
            agreement += ", which is no test of the model with so few measurements"
    if level is Level.DOUBTFUL:
        agreement = f", although {agreement}" if others else f": {agreement}"
    return _HEADLINES[level].format(agreement=agreement)


def _agreement_in_words(differences: Mapping[str, float], met: bool) -> str:
    """The largest difference from a measurement; with `met`, as the least that all are met within."""
    worst = max(differences, key=lambda n: abs(differences[n]))
    if abs(differences[worst]) < _MET:
        return "all measurements are met"
    size = f"{abs(differences[worst]):.1f} standard uncertainties ({worst})"
    if met:
        return f"no measurement is missed by more than {size}"
    return f"the largest difference from a measurement is {size}"


def signed(difference: float) -> str:
    """A difference in standard uncertainties as text, with sign; +0.0 if it rounds to zero."""
    return f"{round(difference, 1) + 0.0:+.1f}"


def goodness_of(
    measured: Mapping[str, float],
    simulated: Mapping[str, float],
    uncertainties: Mapping[str, float],
    scaled: np.ndarray,
    spread: np.ndarray,
) -> Goodness:
    """Compute the agreement of a fit with its measurements.

    Args:
        measured: measured values by output [mmHg, L/min].
        simulated: values of the fitted model.
        uncertainties: standard uncertainty of each measurement.
        scaled: d output / d coordinate in standard uncertainties, shape (measured, parameters).
        spread: covariance of the coordinates of the parameters.
    """
    from scipy.stats import chi2

    differences = {n: (simulated[n] - value) / uncertainties[n] for n, value in measured.items()}
    total = float(sum(d * d for d in differences.values()))
    determined = float(np.trace(scaled @ spread @ scaled.T))
    degrees = max(len(measured) - determined, 0.0)
    probability = float(chi2.sf(total, degrees)) if degrees >= 1.0 else None
    return Goodness(differences, total, degrees, probability)


def agreement(
    measured: Mapping[str, float], simulated: Mapping[str, float], goodness: Goodness, weights: str
) -> list[Reason]:
    """Reasons from the differences between fit and measurements.

    Args:
        measured: measured values by output [mmHg, L/min].
        simulated: values of the fitted model.
        goodness: agreement of the fit.
        weights: weights of the fit, "relative" or "uncertainty".
    """
    reasons = [
        Reason(
            Aspect.AGREEMENT, Level.POOR if abs(off) > POOR_DIFFERENCE else Level.DOUBTFUL, name,
            f"{name} {significant(simulated[name])} fitted against {significant(measured[name])} measured: "
            f"{abs(off):.1f} standard uncertainties off",
        )
        for name, off in sorted(goodness.differences.items(), key=lambda item: -abs(item[1]))
        if abs(off) > DOUBTFUL_DIFFERENCE
    ]  # fmt: skip
    if reasons:
        advice = "; or weigh them by uncertainty (--weights uncertainty)" if weights == "relative" else ""
        sentence = (
            "no values of the free parameters were found that reproduce all measurements: check these for a "
            f"wrong value, zero level or unit, or free other parameters{advice}"
        )
        reasons.append(Reason(Aspect.AGREEMENT, reasons[0].level, "", sentence))
    chance = goodness.probability
    if chance is None:
        several = (
            f"the {len(measured)} measurements determine about the same number of combinations of parameters"
        )
        what = several if len(measured) > 1 else "one measurement determines one combination of parameters"
        sentence = f"{what}: a close fit is therefore no test of the model"
        reasons.append(Reason(Aspect.AGREEMENT, Level.GOOD, "", sentence))
    elif chance < DOUBTFUL_PROBABILITY:
        level = Level.POOR if chance < POOR_PROBABILITY else Level.DOUBTFUL
        one_of = "more than a million" if chance < 1e-6 else f"{1.0 / chance:,.0f}"
        sentence = (
            f"all differences together (chi-square {goodness.chi_square:.1f} at {goodness.degrees:.1f} "
            "degrees of freedom) are so large that measurement error alone would cause them in only one of "
            f"{one_of} fits"
        )
        reasons.append(Reason(Aspect.AGREEMENT, level, "", sentence))
    return reasons


def stronger_membrane(
    measured: Mapping[str, float],
    simulated: Mapping[str, float],
    goodness: Goodness,
    free: Collection[str],
    values: Mapping[str, float],
) -> list[Reason]:
    """A reason, with advice, where a PO2 behind the oxygenator is higher than even a new membrane gives.

    Args:
        measured: measured values by output.
        simulated: values of the fitted model.
        goodness: agreement of the fit.
        free: names of the fitted parameters.
        values: parameters of the model.
    """
    missed = goodness.differences.get(PO2_BEHIND, 0.0)
    as_new = CLOTTED in free or values.get(CLOTTED, 0.0) == 0.0
    if missed >= -DOUBTFUL_DIFFERENCE or TRANSFER in free or TRANSFER not in values or not as_new:
        return []
    sentence = (
        f"{PO2_BEHIND} {significant(measured[PO2_BEHIND])} mmHg is above the "
        f"{significant(simulated[PO2_BEHIND])} mmHg that the model's membrane gives, even without a clot: "
        f"check FdO2; if it is right, set {TRANSFER} in [parameters] above {values[TRANSFER]:g} until the "
        f"{PO2_BEHIND} of eclsim simulate is that of a day on which the membrane was good, or free it "
        "(--parameters)"
    )
    level = Level.POOR if missed < -POOR_DIFFERENCE else Level.DOUBTFUL
    return [Reason(Aspect.AGREEMENT, level, TRANSFER, sentence)]


def single_start(agreeing: int, refined: int) -> list[Reason]:
    """A remark if one start alone of several ended in the optimum."""
    if agreeing != 1 or refined < 2:
        return []
    sentence = (
        f"1 of {refined} starts of the search ended at this optimum: it may not be the best, or the "
        "measurements may fit about as well with other parameters; repeat it with another seed (--seed), and "
        "free fewer parameters if the values change"
    )
    return [Reason(Aspect.SEARCH, Level.GOOD, "", sentence)]


def search(status: FitStatus, beat: str = "") -> list[Reason]:
    """Reasons from the end of the search; `beat` tells how the search for the fitted patient's beat ended."""
    if status is FitStatus.FITTED:
        return []
    level = Level.DOUBTFUL if status is FitStatus.NOT_SETTLED else Level.POOR
    sentence = f"{status.message} ({beat})" if beat else status.message
    return [Reason(Aspect.SEARCH, level, "", sentence)]


def plausibility(
    outputs: Mapping[str, float],
    ranges: Mapping[str, AdultRange],
    measured: Iterable[str],
    broken_limits: Sequence[str],
) -> list[Reason]:
    """Reasons from volumes and pressures of the fitted patient, except measured ones.

    Args:
        outputs: outputs of the fitted patient.
        ranges: adult reference ranges for the patient's sex.
        measured: names of measured outputs, which are judged by their agreement instead.
        broken_limits: sentences about limits that the beat violates, as in `eclsim simulate`.
    """
    skipped, reasons = set(measured), []
    for name, span in ranges.items():
        value = outputs.get(name)
        if value is None or name in skipped or span.plausible[0] <= value <= span.plausible[1]:
            continue
        low, high = span.healthy
        number = f"{value:.3g} {span.unit}".strip()
        sentence = (
            f"{span.description} {number}, which is implausible even in severe illness "
            f"(healthy: {low:.3g} to {high:.3g}): do not use it, or anything that depends on it, from this "
            "fit"
        )
        reasons.append(Reason(Aspect.PLAUSIBILITY, Level.DOUBTFUL, name, sentence))
    return reasons + [Reason(Aspect.PLAUSIBILITY, Level.DOUBTFUL, "", s) for s in broken_limits]


def interval_agreement(
    fitted: Mapping[str, Mapping[str, Any]],
    other: Mapping[str, Mapping[str, Any]],
    source: str,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    ends_without_beat: Mapping[str, Sequence[str]] | None = None,
) -> list[Reason]:
    """Reasons where Gaussian 90 % intervals of determined parameters disagree with other intervals.

    Args:
        fitted: "value", "lower", "upper" and "identifiable" of each parameter, as in the JSON of a fit.
        other: "lower" and "upper" of each parameter.
        source: source of the other intervals, such as "posterior".
        bounds: bounds of the parameters, if the other intervals may end at them.
        ends_without_beat: ends ("lower", "upper") of the other intervals beyond which there is no steady
            beat.
    """
    reasons = []
    for name, estimate in fitted.items():
        interval = other.get(name)
        if interval is None or not estimate["identifiable"] or None in (interval["lower"], interval["upper"]):
            continue
        level, verdict = Level.DOUBTFUL, ""
        at_bounds = [] if bounds is None else _at_bounds(name, interval, bounds[name])
        if estimate["upper"] < interval["lower"] or interval["upper"] < estimate["lower"]:
            level = Level.POOR
            verdict = (
                "they do not overlap, so use neither; the measurements contradict the model, or the "
                "weights determine the fit (--weights uncertainty)"
            )
        elif not interval["lower"] <= estimate["value"] <= interval["upper"]:
            verdict = f"the fitted value {estimate['value']:.3g} is outside the second"
        elif len(at_bounds) > 1:
            verdict = "the second fills the bounds, so the measurements do not determine the parameter"
        elif at_bounds:
            (side,) = at_bounds
            verdict = f"the second ends at the {side} bound, so the measurements give no {side} limit"
        elif sides := (ends_without_beat or {}).get(name):
            verdict = (
                f"no steady heartbeat was found beyond the {' and the '.join(sides)} end of the second, but "
                "the true value may lie there"
            )
        elif intervals_differ(_ends(name, interval), _ends(name, estimate)):
            verdict = "use the wider of the two"
        if verdict:
            sentence = (
                f"{name}: 90 % interval {estimate['lower']:.3g} to {estimate['upper']:.3g} by the Gaussian "
                f"approximation, {interval['lower']:.3g} to {interval['upper']:.3g} by the "
                f"{source}: {verdict}"
            )
            reasons.append(Reason(Aspect.INTERVALS, level, name, sentence))
    return reasons


def _at_bounds(name: str, interval: Mapping[str, Any], bounds: tuple[float, float]) -> list[str]:
    """Ends of an interval at a bound, except bounds of 0 and 1 of a fraction, which are physical limits."""
    return [
        side
        for side, bound in zip(SIDES, bounds, strict=True)
        if np.isclose(interval[side], bound, rtol=1e-6) and bound not in possible_limits(name)
    ]


def possible_limits(name: str) -> tuple[float, ...]:
    """Physical limits of a parameter, 0 and 1 for a fraction, which are no restriction as bounds."""
    known = quantity(name)
    return () if known is None or known.unit not in ("", "1") or not known.is_linear else (0.0, 1.0)


def intervals_differ(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether one of two intervals is much wider than the other, or their ends are far apart.

    Args:
        one: coordinates of the ends of one interval.
        other: coordinates of the ends of the other interval.
    """
    widths = [max(float(np.ptp(each)), 1e-12) for each in (one, other)]
    far = float(np.max(np.abs(one - other))) > np.log(LARGEST_END_DISTANCE)
    return far or max(widths) > LARGEST_WIDTH_RATIO * min(widths)


def _ends(name: str, interval: Mapping[str, Any]) -> np.ndarray:
    ends = np.array([[interval["lower"]], [interval["upper"]]])
    return Scale.of([name]).coordinates(ends)[:, 0]


def informative_but_fixed(goodness: Goodness, free: Sequence[str]) -> list[Reason]:
    """Return doubts where a measurement does not fit and the parameter that it determines is held."""
    missed = [name for name, off in goodness.differences.items() if abs(off) > DOUBTFUL_DIFFERENCE]
    reasons = []
    for key, (meaning, informative) in INFORMATIVE_MEASUREMENTS.items():
        names = [name for name in missed if name in informative]
        if names and key not in free:
            tells = "tell" if len(names) > 1 else "tells"
            sentence = (
                f"{', '.join(names)} {tells} {meaning}, which this fit does not vary: free {key} as well "
                "(--free)"
            )
            reasons.append(Reason(Aspect.AGREEMENT, Level.DOUBTFUL, "", sentence))
    return reasons


def held_but_missed(moved_by: Mapping[str, Sequence[str]], free: Sequence[str]) -> list[Reason]:
    """Return a doubt for each missed measurement that parameters move which the fit holds.

    Args:
        moved_by: by missed measurement, the held parameters that move it most.
        free: names of the fitted parameters.
    """
    return [
        Reason(
            Aspect.AGREEMENT, Level.DOUBTFUL, "",
            f"{name} depends on {' and '.join(held)} as well, held at usual values by this fit: before you "
            f"doubt the measurement, free {' and '.join(held)} as well (--free {','.join((*free, *held))})",
        )
        for name, held in moved_by.items()
        if held
    ]  # fmt: skip


def contradictory_measurements(measured: Mapping[str, float]) -> list[Reason]:
    """Return a doubt where measurements contradict each other, whatever the fit."""
    sentence = contradicted_wedge(measured)
    if not sentence:
        return []
    text = f"the measured PCWP {significant(measured['PCWP'])} mmHg is {sentence}"
    return [Reason(Aspect.AGREEMENT, Level.DOUBTFUL, "PCWP", text)]


def not_used_as_weights(
    measured: Mapping[str, float], uncertainties: Collection[str], weights: str
) -> list[Reason]:
    """Return a remark on stated uncertainties that do not weight the measurements of a fit.

    Args:
        measured: measured values by output.
        uncertainties: names of the outputs whose uncertainties were stated.
        weights: weights of the fit; values of size 0 are always weighted by their uncertainties.
    """
    names = [n for n in measured if n in uncertainties and relative_scale(n, measured[n])]
    if weights != "relative" or not names:
        return []
    sentence = (
        f"the stated uncertainties of {', '.join(names)} judge the fit and give its intervals, but do not "
        'weight the measurements, whose relative differences are minimised: weights="uncertainty" '
        "(--weights uncertainty) does"
    )
    return [Reason(Aspect.AGREEMENT, Level.GOOD, "", sentence)]


def set_points_not_given(set_points: Mapping[str, float]) -> list[Reason]:
    """Return doubts about reflex set points that neither the case nor a measurement gives."""
    return [
        Reason(
            Aspect.PLAUSIBILITY, Level.DOUBTFUL, "",
            f"{key} is the start value ({value:.4g}), so that reflexes are active in the patient as "
            "measured: give it, measure it, or fit without [regulation]",
        )
        for key, value in set_points.items()
    ]  # fmt: skip
