"""Warnings about a followed patient's beat, from draws of the whole estimate.

The median of each parameter by itself is no patient that the measurements allow: the parameters depend on one
another. So limits are compared with the draws, and each warning says how probable it is.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, ndtri

from eclsim.devices.description import CAUTION, Finding, Limit
from eclsim.identification.density import PosteriorDensity, beats_of_members
from eclsim.identification.points import SHARES, Interval
from eclsim.identification.quantities import unit_of
from eclsim.orbit.model import Model
from eclsim.orbit.steady import Batch
from eclsim.outputs.alarms import gravest_first, sentences
from eclsim.outputs.limits import applied_limits, broken_limits, group_of
from eclsim.outputs.registry import first_name, output
from eclsim.outputs.second_beat import findings_of_second_beat
from eclsim.outputs.signals import output_names, parameters_read, watched_waveforms
from eclsim.outputs.steady_beat import SteadyBeat, steady_beat
from eclsim.reporting.numbers import significant

DRAWN = 64
"""Draws with which limits are compared."""
LIKELY, POSSIBLE = 0.5, 0.25
"""Probabilities from which on a broken limit is reported: any limit, and an alarm."""
CERTAIN = 0.99
_MOST_DIGITS = 8
SPREADS_OF_90 = float(2.0 * ndtri(SHARES[-1]))
"""Width of a 90 % interval in standard deviations."""


@dataclass(frozen=True)
class _Drawn:
    """Beats of draws, and what the followed patient's outputs are."""

    beat: SteadyBeat
    members: tuple[int, ...]
    nearest: int
    outputs: Mapping[str, Interval]
    measured: Mapping[str, float]

    def interval(self, name: str) -> Interval:
        """Median and interval of an output: of the estimate if it is there, else of the draws."""
        known = self._estimate(name)
        if known is not None:
            return known
        return Interval(*np.quantile(self._of_draws(name), SHARES).tolist())

    def probability(self, limit: Limit) -> float:
        """Probability that an output is beyond a limit: the smaller of the draws' and the interval's.

        The interval is of first order, and where the model bends it may reach beyond a limit alone.
        """
        values = self._of_draws(limit.quantity).tolist() if self.members else []
        by_draws = float(np.mean([limit.broken_by(value) for value in values])) if values else None
        known = self._estimate(limit.quantity)
        if known is None or not known.upper > known.lower:
            return by_draws or 0.0
        beyond = (known.median - limit.value) * SPREADS_OF_90 / (known.upper - known.lower)
        by_interval = float(ndtr(beyond if limit.side == "above" else -beyond))
        return by_interval if by_draws is None else min(by_draws, by_interval)

    def _of_draws(self, name: str) -> np.ndarray:
        """Values of the draws that have one: without a steady gas state there is none of gases."""
        values = self.beat.output(name)[list(self.members)]
        return values[np.isfinite(values)]

    def _estimate(self, name: str) -> Interval | None:
        return next((i for n, i in self.outputs.items() if first_name(n) == first_name(name)), None)

    def sentence(self, limit: Limit, probability: float) -> str:
        """Sentence on a limit with the interval, the probability, and what was measured."""
        entry, interval = output(limit.quantity), self.interval(limit.quantity)
        unit = "" if entry.unit == "1" else f" {entry.unit}"
        low, high = (significant(v, 3) for v in (interval.lower, interval.upper))
        middle = _told_from(limit.value, interval.median)
        verb = "is" if probability >= LIKELY else "may be"
        group = group_of(limit.quantity)
        alike = {n: v for n, v in self.measured.items() if group_of(first_name(n)) == group}
        listed = ", ".join(f"{n} {significant(v, 3)} {unit_of(n)}".strip() for n, v in alike.items())
        same = [v for n, v in alike.items() if first_name(n) == first_name(limit.quantity)]
        contrary = same and not any(map(limit.broken_by, same)) and probability >= LIKELY
        beside = f"; {'but ' if contrary else ''}measured: {listed}" if alike else ""
        return (
            f"{entry.long_name} {middle}{unit} (90 %: {low} to {high}) {verb} {limit.side} "
            f"{limit.value:g}{unit} ({_probable(probability)}): {limit.meaning} ({limit.source}){beside}"
        )


def estimate_warnings(
    density: PosteriorDensity, z: np.ndarray, outputs: Mapping[str, Interval], measured: Mapping[str, float]
) -> tuple[str, ...]:
    """Warnings about the beat of a followed patient, the gravest first.

    Args:
        density: model, with devices and heart rate of the time, and prior.
        z: draws of the latent variables from the estimate, shape (draws, parameters).
        outputs: estimates of the outputs.
        measured: what was measured at this time.
    """
    model, values = density.model, density.values(density.prior.x_of(z))
    start = density.numbers(z.mean(axis=0))
    names, watched = output_names(model.circuit), watched_waveforms(model.circuit)
    beat = beats_of_members(model, values, len(z), names, density.policy, start, watched)
    members = tuple(np.flatnonzero(beat.determined).tolist())
    if not members:
        return (*model.doubts, beat.message())
    nearest = _nearest(beat, members, outputs)
    drawn = _Drawn(beat, members, nearest, outputs, measured)
    found = [*_of_limits(drawn), *_of_findings(drawn, _second_beats(density, z[nearest]))]
    every = gravest_first(Finding.without_limit(kind, "", np.nan, text) for kind, text in found)
    return (*model.doubts, *sentences(every))


def _nearest(beat: SteadyBeat, members: Sequence[int], outputs: Mapping[str, Interval]) -> int:
    """The draw whose outputs are nearest to their estimates, in widths of the intervals."""
    distances = np.zeros(len(members))
    for name, interval in outputs.items():
        width = interval.upper - interval.lower
        values = beat.output(name)[list(members)] if name in beat.names else np.full(len(members), np.nan)
        if width > 0.0:
            distances += np.nan_to_num(((values - interval.median) / width) ** 2)
    return members[int(np.argmin(distances))]


def _of_limits(drawn: _Drawn) -> Iterator[tuple[str, str]]:
    """Kind and sentence of limits that are probably broken, and of alarms that may be.

    Of equivalent outputs one is reported, and no limit that is less grave than one probably broken.
    """
    beat, nearest = drawn.beat, drawn.nearest
    likely: set[tuple[str, str]] = set()
    named: set[tuple[str, str, str]] = set()
    for limit in applied_limits(beat.outputs(nearest), beat.batch.all_values_of(nearest)):
        key = group_of(limit.quantity), limit.side
        if key in likely or (*key, limit.kind) in named:
            continue
        probability = drawn.probability(limit)
        if probability >= (LIKELY if limit.kind == "warning" else POSSIBLE):
            named.add((*key, limit.kind))
            likely |= {key} if probability >= LIKELY else set()
            yield limit.kind, drawn.sentence(limit, probability)


def _of_findings(drawn: _Drawn, further: Iterable[Finding]) -> Iterator[tuple[str, str]]:
    """Kind and sentence of findings that are no limits of outputs, as of a device, if they are probable.

    Cautions about outputs that are not estimated are left out.
    """
    beat = drawn.beat
    found: dict[tuple[str, str], list[Finding]] = {}
    order = sorted(drawn.members, key=lambda member: member != drawn.nearest)
    for member in order:
        broken = broken_limits(beat.outputs(member), beat.batch.all_values_of(member))
        of_limits = {(limit.quantity, limit.value) for limit in broken}
        keys = set()
        for finding in beat.findings(member):
            key = finding.kind, finding.quantity
            if (finding.quantity, finding.limit) not in of_limits and key not in keys:
                keys.add(key)
                found.setdefault(key, []).append(finding)
    for (kind, _), findings in found.items():
        probability, first = len(findings) / len(order), findings[0]
        least = LIKELY if kind in ("warning", CAUTION) else POSSIBLE
        if probability < least or not first.is_about(drawn.outputs):
            continue
        certain = kind == CAUTION or probability > CERTAIN
        text = first.sentence if certain else f"{first.sentence} ({_probable(probability)})"
        yield kind, text
    for finding in further:
        if finding.is_about(drawn.outputs):
            yield finding.kind, finding.sentence


def _second_beats(density: PosteriorDensity, z: np.ndarray) -> list[Finding]:
    """Findings on a second beat of one draw."""
    model: Model = density.model
    read = parameters_read(model.circuit)
    numbers = {n: v for n, v in density.numbers(z).items() if n in read and n in density.prior.names}
    beat = steady_beat(
        Batch.of(model.with_values(numbers), density.policy), waveforms=watched_waveforms(model.circuit)
    )
    return findings_of_second_beat(beat) if beat.converged[0] else []


def _told_from(limit: float, value: float) -> str:
    """Format a value with three digits, or as many as it takes to tell it from a limit."""
    digits = 3
    while float(significant(value, digits)) == limit and digits < _MOST_DIGITS:
        digits += 1
    return significant(value, digits)


def _probable(probability: float) -> str:
    if probability > CERTAIN:
        return f"probability above {100.0 * CERTAIN:.0f} %"
    return f"probability {100.0 * probability:.0f} %"
