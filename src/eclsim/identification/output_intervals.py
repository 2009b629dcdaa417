"""How far the measurements of a fit determine its outputs, measured or not.

The fitted patient has a value for every output. Where few measurements were made it is one of many: another
patient meets them as well with a cardiac output ten times as large. The interval of an output holds its
first-order 90 % interval and the values of all other fits, by other starts of the search or with a parameter
held elsewhere, that meet the measurements within 90 %. A wider one may exist. It ends where no beat can be:
derivatives know no bounds, and led to diastolic pressures below 0 and systolic ones below the mean.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from eclsim.identification.held_parameters import KEY_OUTPUTS
from eclsim.identification.objective import NORMAL_90
from eclsim.identification.quantities import possible_range, unit_of
from eclsim.identification.verdict import Aspect, Level, Reason
from eclsim.outputs.uncertainty import DEFAULTS, Uncertainty, measurement_errors

WIDEST_DETERMINED = 2.0
"""Width of the interval of a determined output, relative to the 90 % interval of a measurement of it."""
FIRST = KEY_OUTPUTS[0]
"""Output without which most others of a patient are not known."""
READ_OFF = ("SP", "DP", "MAP", "MPAP", "PCWP", "CVP", "CO")
"""Outputs that every reader takes off a fitted patient, so that a fit that leaves one open is not good."""
ASCENDING = ("DP", "MAP", "SP")
"""Lowest, mean and highest pressure of one vessel: in every beat none is above the next."""
ONE_OF_MANY = "in the fitted patient, one of many who meet the measurements"


class OutputInterval(NamedTuple):
    """90 % interval of an output of a fitted patient, in its unit.

    Attributes:
        low: lower end.
        high: upper end.
        determined: whether it was measured, or follows from what was.
    """

    low: float
    high: float
    determined: bool

    def __str__(self) -> str:
        return f"{self.low:.3g} to {self.high:.3g}"


def output_intervals(
    fitted: Mapping[str, float],
    deviations: np.ndarray,
    others: np.ndarray,
    measured: Collection[str],
    uncertainties: Mapping[str, Uncertainty],
) -> dict[str, OutputInterval]:
    """Compute the intervals of all outputs of a fit.

    Args:
        fitted: value of each output.
        deviations: first-order standard deviation of each output, shape (outputs,).
        others: outputs of other fits that meet the measurements as well, shape (fits, outputs).
        measured: names of the outputs that were measured.
        uncertainties: standard uncertainties of measurements that differ from the defaults.
    """
    free, possible = {}, {}
    for k, (name, value) in enumerate(fitted.items()):
        reach = NORMAL_90 * (deviations[k] if np.isfinite(deviations[k]) else 0.0)
        ends = np.array([value - reach, value + reach])
        met = np.array([value, *others[:, k][np.isfinite(others[:, k])]])
        lowest, highest = _range_of(name, value)
        free[name] = _span((*ends, *met))
        possible[name] = _span((*np.clip(ends, lowest, highest), *met))
    possible = _in_order(possible)
    result = {
        name: OutputInterval(
            *possible[name], _follows(name, value, free[name], name in measured, uncertainties)
        )
        for name, value in fitted.items()
    }
    return _with_the_flow(result, measured)


def widened(
    intervals: Mapping[str, OutputInterval],
    reaches: Mapping[str, tuple[float, float]],
    fitted: Mapping[str, float],
    measured: Collection[str],
    uncertainties: Mapping[str, Uncertainty],
) -> dict[str, OutputInterval]:
    """Return intervals that reach at least to given ends, by output."""
    result = dict(intervals)
    for name, (low, high) in reaches.items():
        own = intervals[name]
        ends = min(low, own.low), max(high, own.high)
        follows = _follows(name, fitted[name], ends, name in measured, uncertainties)
        result[name] = OutputInterval(*ends, own.determined and follows)
    return _with_the_flow(result, measured)


def _with_the_flow(
    intervals: Mapping[str, OutputInterval], measured: Collection[str]
) -> dict[str, OutputInterval]:
    """Intervals in which the pressures of the lungs are not determined where the flow through them is not."""
    result = dict(intervals)
    if FIRST in result and not result[FIRST].determined:
        for name in result.keys() & {*KEY_OUTPUTS} - {*measured}:
            result[name] = result[name]._replace(determined=False)
    return result


def _range_of(name: str, value: float) -> tuple[float, float]:
    """Values that an output can have beside the fitted one, whose flow runs in one direction."""
    lowest, highest = possible_range(name)
    return max(lowest, 0.0) if unit_of(name) == "L/min" and value >= 0.0 else lowest, highest


def _span(values: Iterable[float]) -> tuple[float, float]:
    """Smallest and largest of some values."""
    known = np.array([*values])
    return float(known.min()), float(known.max())


def _in_order(ends: Mapping[str, tuple[float, float]]) -> dict[str, tuple[float, float]]:
    """Ends of intervals without pressures that would be above the next of `ASCENDING`, or below the last."""
    result = dict(ends)
    present = [name for name in ASCENDING if name in result]
    for lower, higher in pairwise(present):
        low, high = result[higher]
        result[higher] = max(low, result[lower][0]), high
    for lower, higher in reversed([*pairwise(present)]):
        low, high = result[lower]
        result[lower] = low, min(high, result[higher][1])
    return result


def _follows(
    name: str,
    value: float,
    ends: tuple[float, float],
    measured: bool,
    uncertainties: Mapping[str, Uncertainty],
) -> bool:
    """Whether an output was measured, or follows from what was: its ends, not cut at a bound, are near."""
    if measured or name not in DEFAULTS or not np.isfinite(value):
        return measured
    of_measurement = 2.0 * NORMAL_90 * measurement_errors({name: value}, uncertainties)[name]
    return ends[1] - ends[0] <= WIDEST_DETERMINED * of_measurement


def undetermined_reasons(
    intervals: Mapping[str, OutputInterval], fitted: Mapping[str, float], named: Collection[str]
) -> list[Reason]:
    """A reason that names the outputs which were not measured and do not follow: a doubt for `READ_OFF`.

    Args:
        intervals: interval of each output.
        fitted: value of each output.
        named: outputs that another reason names.
    """
    open_ones = {n: each for n, each in intervals.items() if not each.determined and n not in named}
    if not open_ones:
        return []
    each = ", ".join(f"{n} {fitted[n]:.3g} ({reach} {unit_of(n)})" for n, reach in open_ones.items())
    chief = FIRST in open_ones
    measure = FIRST if chief else " or ".join(open_ones)
    sentence = (
        f"not measured, and not determined by what was measured (90 %): {each}. The fitted patient is one of "
        f"many who meet the measurements: do not read {'these' if len(open_ones) > 1 else 'it'}, or what "
        f"depends on {'them' if len(open_ones) > 1 else 'it'}, off this fit; measure {measure}"
    )
    level = Level.DOUBTFUL if open_ones.keys() & {*READ_OFF} else Level.GOOD
    return [Reason(Aspect.AGREEMENT, level, FIRST if chief else "", sentence)]
