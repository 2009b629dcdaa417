"""Fitting cases: a patient's own model from the measurements, and how far it can be relied on."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from eclsim.cases.fitting import common_policy
from eclsim.cases.mistakes import CaseError
from eclsim.files import finite
from eclsim.identification.alternatives import alternatives
from eclsim.identification.measurement_errors import measurement_errors
from eclsim.identification.multi_start import FitStatus, Optimum, identify
from eclsim.identification.objective import OUTPUTS, Box, Objective, Target
from eclsim.identification.precision import correlation, covariance, in_unit, interval, prior_deviations
from eclsim.identification.settings import FitSettings, checked_fit
from eclsim.identification.shared_fit import together
from eclsim.identification.verdict import (
    Aspect,
    FitVerdict,
    Level,
    Reason,
    agreement,
    goodness_of,
    plausibility,
    search,
)
from eclsim.parameters.adult_ranges import AdultRange, adult_ranges
from eclsim.sensitivity.identifiability import ScaledSensitivities
from eclsim.sensitivity.proposal import propose

if TYPE_CHECKING:
    from eclsim.cases.case import Case

AT_BOUND = 1e-6
LEARNT = 0.5
"""Largest standard error of a parameter that counts as determined, as a share of what the bounds leave."""
SAME_PARAMETER = 0.05
"""Fits that agree but differ in a parameter by more than this share show that it is not determined."""
PUSHED = 1.0
"""A bound holds a parameter back if the sum of squared standard differences would fall by more beyond it."""
NOT_FROM_A_POOR_FIT = "the fit is poor, so neither its value nor its interval is to be used"
HELD_BACK = 6.0
"""Likewise by so much that the bound spoils the fit."""


@dataclass(frozen=True)
class FittedParameter:
    """A parameter with its 90 % interval, in its unit.

    Args:
        value: the estimate.
        lower: of the interval, which ends at the bounds.
        upper: likewise.
        at_bound: whether the estimate sits at a bound.
        identifiable: whether the measurements tell it from the others.
        reason: why they do not; empty where they do.
    """

    value: float
    lower: float
    upper: float
    at_bound: bool
    identifiable: bool
    reason: str


@dataclass(frozen=True)
class Fit:
    """What was found for one data point.

    Args:
        name: of the point.
        case: with the fitted parameters; as it was if nothing was found.
        measured: what was fitted to [mmHg, L/min].
        scales: what differences were divided by.
        simulated: all outputs of the fitted model.
        parameters: free parameters.
        correlation: of their estimates, shape (parameters, parameters).
        objective: what was minimised.
        box: bounds.
        optimum: where and how it was found.
        number: of the data point in the objective.
        uncertainties: standard uncertainty of each measurement [mmHg, L/min].
        verdict: whether it is to be used, and why (not).
        implied: outputs of the fitted patient that ranges of adults are known of, in their units.
        profile: 90 % interval of each parameter by its profile likelihood; empty where it was not computed.
        seconds: wall time; points fitted side by side share theirs evenly.
    """

    name: str
    case: Case
    measured: Mapping[str, float]
    scales: Mapping[str, float]
    simulated: Mapping[str, float]
    parameters: Mapping[str, FittedParameter]
    correlation: np.ndarray
    objective: Objective
    box: Box
    optimum: Optimum
    number: int
    uncertainties: Mapping[str, float]
    verdict: FitVerdict
    implied: Mapping[str, float] = field(default_factory=dict)
    profile: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    seconds: float = 0.0

    @property
    def status(self) -> FitStatus:
        """How it ended."""
        return self.optimum.status

    @property
    def ranges(self) -> dict[str, AdultRange]:
        """Ranges of adults of the patient's sex, by output."""
        return adult_ranges(self.case.patient.sex)

    def judged(self, more: Iterable[Reason]) -> Fit:
        """The fit when more is known; what a doubt rules out counts as determined no longer."""
        verdict = self.verdict.with_reasons(more)
        disagreeing = {r.about: r.sentence for r in verdict.doubts if r.aspect is Aspect.INTERVALS}
        parameters = {}
        for name, p in self.parameters.items():
            reason = NOT_FROM_A_POOR_FIT if verdict.level is Level.POOR else disagreeing.get(name, "")
            keep = not reason or not p.identifiable
            parameters[name] = p if keep else replace(p, identifiable=False, reason=reason)
        return replace(self, verdict=verdict, parameters=parameters)

    def as_object(self) -> dict[str, Any]:
        """As plain data for JSON; null for what is not known."""
        names = dict.fromkeys([*self.measured, *self.simulated])
        return {
            "id": self.name,
            "verdict": self.verdict.as_object(),
            "cost": finite(self.optimum.cost),
            "outputs": {
                n: {"measured": self.measured.get(n), "simulated": finite(self.simulated.get(n))}
                for n in names
            },
            "uncertainties": dict(self.uncertainties),
            "implied": {
                n: {
                    "value": finite(self.implied[n]), "words": r.words, "unit": r.unit,
                    "healthy": list(r.healthy), "source": r.source,
                }
                for n, r in self.ranges.items() if n in self.implied
            },
            "parameters": {
                n: {
                    "value": finite(p.value), "lower": finite(p.lower), "upper": finite(p.upper),
                    "profile": None if n not in self.profile else list(self.profile[n]),
                    "at_bound": p.at_bound, "identifiable": p.identifiable, "reason": p.reason,
                }
                for n, p in self.parameters.items()
            },
            "correlation": {
                a: dict(zip(self.parameters, map(finite, row), strict=True))
                for a, row in zip(self.parameters, self.correlation.tolist(), strict=True)
            },
            "starts_agreeing": self.optimum.agreeing,
            "starts_refined": len(self.optimum.starts.agreeing),
            "explored": self.optimum.explored,
            "explored_without_steady_beat": self.optimum.dropped,
            "seconds": round(self.seconds, 3),
            "status": str(self.status),
            "message": self.status.message,
        }  # fmt: skip


def fit_cases(
    cases: Sequence[tuple[str, Case]],
    settings: FitSettings | None = None,
    report: Callable[[str], None] | None = None,
) -> list[Fit]:
    """Fit cases that have the same circuit, side by side.

    Args:
        cases: name and case of each data point.
        settings: what is free, how it is weighted, how widely to look.
        report: called with what is being done.

    Raises:
        CaseError: A case without measurements, bounds that cannot be, or cases of several volume policies.
    """
    settings = settings or FitSettings()
    started = time.perf_counter()
    targets, box = [], None
    for _, case in cases:
        checked = checked_fit(case, settings)
        if checked.mistakes:
            raise CaseError(checked.mistakes)
        targets.append(_target(case, checked.targets, checked.fixed, settings))
        box = box or Box.of(checked.free)
    if box is None:
        return []
    policy = common_policy([case for _, case in cases], settings.policy)
    objective = Objective(targets, box.names, policy)
    found = identify(objective, box, settings.multi_start, report)
    if settings.shared and len(cases) > 1:
        found = together(objective, box, found, [_errors(t, settings) for t in objective.targets], settings)
    fits = [
        _fit(name, case, objective, k, box, optimum, settings)
        for k, ((name, case), optimum) in enumerate(zip(cases, found, strict=True))
    ]
    fits = [_plausible(fit) for fit in _doubted(fits, objective, box)]
    seconds = (time.perf_counter() - started) / len(cases)
    return [replace(fit, seconds=seconds) for fit in fits]


def fit_case(
    case: Case, settings: FitSettings | None = None, report: Callable[[str], None] | None = None
) -> Fit:
    """Fit one case."""
    return fit_cases([(case.patient.id, case)], settings, report)[0]


def _target(
    case: Case, measured: Mapping[str, float], fixed: Mapping[str, float], settings: FitSettings
) -> Target:
    from eclsim.orbit.model import model_of

    errors = measurement_errors(measured, settings.uncertainties)
    scales = {
        n: abs(v) if settings.weights == "relative" and v != 0.0 else errors[n] for n, v in measured.items()
    }
    return Target(model_of(case).with_values(dict(fixed)), dict(measured), scales)


def _errors(target: Target, settings: FitSettings) -> np.ndarray:
    """Standard uncertainties of what was measured, shape (measured,)."""
    return np.array(list(measurement_errors(target.measured, settings.uncertainties).values()))


def _fit(
    name: str, case: Case, objective: Objective, number: int, box: Box, optimum: Optimum,
    settings: FitSettings,
) -> Fit:  # fmt: skip
    target = objective.targets[number]
    known = measurement_errors(target.measured, settings.uncertainties)
    if optimum.status is FitStatus.NO_STEADY_BEAT:
        nothing = FittedParameter(np.nan, np.nan, np.nan, False, False, optimum.status.message)
        return Fit(
            name, case, target.measured, target.scales, {}, dict.fromkeys(box.names, nothing),
            np.full((len(box.names),) * 2, np.nan), objective, box, optimum, number, known,
            FitVerdict(None, tuple(search(optimum.status))),
        )  # fmt: skip
    rows = [objective.outputs.index(o) for o in target.measured]
    errors = np.array(list(known.values()))
    scaled = ScaledSensitivities(tuple(target.measured), box.names, optimum.jacobian[rows] / errors[:, None])
    spread = covariance(scaled.matrix, prior_deviations(box.lower, box.upper))
    if optimum.joint is not None:
        spread = optimum.joint.covariance
    simulated = dict(zip(objective.outputs, optimum.outputs.tolist(), strict=True))
    goodness = goodness_of(target.measured, simulated, known, scaled.matrix, spread)
    gains = _gains_beyond_bounds(objective, number, optimum, box, goodness.chi_square)
    parameters = _parameters(optimum, box, scaled, np.sqrt(np.diag(spread)), gains)
    fitted = {n: p.value for n, p in parameters.items()}
    fixed = {n: target.model.values[n] for n in settings.names if n not in fitted}
    changed = case.model_copy(
        update={
            "parameters": {**case.parameters, **fixed, **fitted},
            "blood_volume_policy": objective.policy,
        }
    )
    reasons = [
        *agreement(target.measured, simulated, goodness, settings.weights), *search(optimum.status),
        *_held_back(parameters, gains),
    ]  # fmt: skip
    return Fit(
        name, changed, target.measured, target.scales, {o: simulated[o] for o in OUTPUTS if o in simulated},
        parameters, correlation(spread), objective, box, optimum, number, known,
        FitVerdict(goodness, ()).with_reasons(reasons),
    )  # fmt: skip


def _gains_beyond_bounds(
    objective: Objective, number: int, optimum: Optimum, box: Box, chi_square: float
) -> np.ndarray:
    """By how much the sum of squared standard differences would fall if a parameter at its bound left it.

    Foreseen by the derivatives with the other parameters held, shape (parameters,); 0 inside the bounds.
    """
    low, high = optimum.x <= box.lower + AT_BOUND, optimum.x >= box.upper - AT_BOUND
    gains = np.zeros(len(box.names))
    if optimum.joint is not None or not optimum.cost > 0.0:
        return gains
    weights = objective.weights[number]
    residuals = (optimum.outputs - objective.measured[number]) * weights
    columns = optimum.jacobian * weights[:, None]
    slopes, lengths = residuals @ columns, np.maximum(np.sum(columns**2, axis=0), 1e-300)
    outward = (low & (slopes > 0.0)) | (high & (slopes < 0.0))
    gains[outward] = (slopes**2 / lengths)[outward] / optimum.cost * chi_square
    return gains


def _held_back(parameters: Mapping[str, FittedParameter], gains: np.ndarray) -> list[Reason]:
    """Doubts of a fit that a bound spoils."""
    return [
        Reason(
            Aspect.AGREEMENT, Level.DOUBTFUL, name,
            f"{name} {p.reason}; with wider --bounds the measurements would be met more nearly, "
            "if such a value is possible",
        )
        for (name, p), gain in zip(parameters.items(), gains, strict=True)
        if gain > HELD_BACK
    ]  # fmt: skip


def _plausible(fit: Fit) -> Fit:
    """The fit with the volumes and pressures of the fitted patient held against those of adults."""
    if not fit.simulated:
        return fit
    from eclsim.orbit.model import model_of
    from eclsim.outputs.alarms import findings
    from eclsim.outputs.dataset import simulate

    beat = simulate(model_of(fit.case), fit.objective.policy)
    if not beat.attrs["converged"]:
        sentence = f"`eclsim simulate` of the fitted case: {beat.attrs['message']}"
        return fit.judged([Reason(Aspect.PLAUSIBILITY, Level.DOUBTFUL, "", sentence)])
    outputs = {str(n): float(v) for n, v in beat.items() if v.ndim == 0}
    extremes = {str(n): (float(v.min()), float(v.max())) for n, v in beat.items() if v.dims == ("phase",)}
    collapsed = [f.sentence for f in findings(outputs, extremes) if f.kind == "collapse"]
    implied = {n: outputs[n] for n in fit.ranges if n in outputs}
    reasons = plausibility(implied, fit.ranges, fit.measured, collapsed)
    return replace(fit, implied=implied).judged(reasons)


def _parameters(
    optimum: Optimum, box: Box, scaled: ScaledSensitivities, errors: np.ndarray, gains: np.ndarray
) -> dict[str, FittedParameter]:
    """Values, intervals and what the measurements tell apart."""
    low, high = optimum.x <= box.lower + AT_BOUND, optimum.x >= box.upper - AT_BOUND
    excluded = propose(scaled).excluded if optimum.joint is None else optimum.joint.excluded
    agreed = optimum.starts.end[optimum.starts.agreeing]
    differ = np.expm1(np.ptp(agreed, axis=0)) if len(agreed) else np.zeros(len(box.names))
    before = prior_deviations(box.lower, box.upper)
    found = {}
    for k, name in enumerate(box.names):
        reason = excluded.get(name, "")
        if low[k] or high[k]:
            reason = _at_bound("lower" if low[k] else "upper", bool(gains[k] > PUSHED))
        elif not reason and differ[k] > SAME_PARAMETER:
            reason = f"starts that fit equally well differ by {100 * differ[k]:.0f} %"
        elif not reason and errors[k] > LEARNT * before[k]:
            reason = f"fitted with the others, its standard error is a factor of {np.exp(errors[k]):.2g}"
        lower, upper = interval(optimum.x[k], errors[k], box.lower[k], box.upper[k])
        value = in_unit(optimum.x[k])
        found[name] = FittedParameter(value, lower, upper, bool(low[k] or high[k]), not reason, reason)
    return found


def _at_bound(side: str, pushed: bool) -> str:
    """What a value at a bound says: pushed against it, the bound is the nearest that the fit could come."""
    beyond, limit = ("smaller", "upper") if side == "lower" else ("larger", "lower")
    if pushed:
        return f"at its {side} bound: the measurements ask for a {beyond} value, so take it as {limit} limit"
    return f"at its {side} bound, and the measurements hardly tell {beyond} values apart"


def _doubted(fits: Sequence[Fit], objective: Objective, box: Box) -> list[Fit]:
    """The fits with parameters that follow undetermined ones named as not determined themselves."""
    open_ones = [
        [k for k, p in enumerate(f.parameters.values()) if not p.identifiable]
        if f.simulated and f.optimum.joint is None
        else []
        for f in fits
    ]
    others = alternatives(objective, box, [f.optimum.x for f in fits], open_ones)
    found = []
    for fit, other in zip(fits, others, strict=True):
        moved, followed = other.followers(fit.optimum.x)
        parameters = dict(fit.parameters)
        for k, (name, p) in enumerate(fit.parameters.items()):
            if p.identifiable and moved[k] > np.log1p(SAME_PARAMETER):
                reason = (
                    f"follows {box.names[followed[k]]}, which the measurements do not determine: with it "
                    f"elsewhere, {100.0 * np.expm1(moved[k]):.0f} % apart at the same outputs"
                )
                parameters[name] = replace(p, identifiable=False, reason=reason)
        found.append(replace(fit, parameters=parameters))
    return found
