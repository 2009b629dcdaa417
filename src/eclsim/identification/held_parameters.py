"""Range of outputs of a fit if parameters that it holds at usual values were free as well.

Blood gases, or few measurements, are often fitted with some of the seven parameters held, since their effects
cannot be told from those of others. Their usual values are then taken as known. A failing heart may then be
fitted as a healthy one with wide vessels, with narrow intervals. The derivatives at the fit show whether this
is possible. Further fits show the extent, with all parameters free and the output in question held at other
values (profile likelihood). First-order analysis is not enough: its interval excluded the cardiac output of 3
L/min of such a heart.

The same applies to an oxygen consumption that was not measured but computed by the formula. Arterial gases
alone depend on consumption and shunt together, so an error of the consumption changes the shunt.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eclsim.cases.quantities import stated, with_values
from eclsim.cases.sections import MEASURED_GASES
from eclsim.devices.description import GASES as VO2
from eclsim.identification.least_squares import refine
from eclsim.identification.objective import NORMAL_90, RISE_90, Box, Objective, Target
from eclsim.identification.profiles import REFITTING, interval_90
from eclsim.identification.quantities import Scale, unit_of
from eclsim.identification.settings import SHUNT
from eclsim.orbit.model import Model, model_of
from eclsim.orbit.status import NoDerivativesError
from eclsim.outputs.results import derivatives
from eclsim.outputs.signals import parameters_read
from eclsim.parameters.regulation import EXTRA_VOLUME
from eclsim.parameters.thiel2025 import BOUNDS

if TYPE_CHECKING:
    from eclsim.cases.case import Case

KEY_OUTPUTS = ("CO", "PCWP", "MPAP")
"""Outputs of a fit that matter most, in order of importance."""
CONSUMPTION_SPREAD = 0.25
"""Standard deviation of the logarithm of the ratio of a critically ill patient's
consumption to the formula's; an assumption that covers cooled to septic patients."""
WIDENING_RATIO = 1.3
"""Ratio of 90 % upper end to value, or of interval widths, above which a quantity is undetermined."""
PROFILE_SHARES = (1.0, *np.geomspace(1.0 / 6.0, 4.0, 10).tolist())
"""Values at which an output is held in further fits, relative to the fitted value."""
PROFILE_UNCERTAINTY = 0.01
"""Standard uncertainty of a held output value, relative to the value."""
PROFILE_RETRIES = 2
"""Number of times that a fit which missed its value is repeated from another start."""


USUAL_CHANGE = float(np.log(2.0))
"""Change of a held parameter, in the logarithm, that an ill patient may well have."""
MOST_NAMED = 2
"""Largest number of held parameters named for a missed measurement."""


class AdmissibleRange(NamedTuple):
    """Range of an output or parameter within which the measurements are met.

    Attributes:
        low: smallest value, in the unit of the quantity.
        high: largest value.
        open_below: whether no smaller value was tried.
        open_above: whether no larger value was tried.
    """

    low: float
    high: float
    open_below: bool = False
    open_above: bool = False

    def __str__(self) -> str:
        low, high = f"{self.low:.3g}", f"{self.high:.3g}"
        return f"{low}{' or less' * self.open_below} to {high}{' or more' * self.open_above}"


@dataclass(frozen=True)
class Compensation:
    """Free parameters that compensate for errors in what a fit holds, so that their intervals are too narrow.

    Attributes:
        sentence: the finding in words, with advice.
        why: reason why these parameters are not determined.
        intervals: 90 % interval of each of them with the held values unknown, in its unit.
        outputs: 90 % range of each output that is undetermined as well, in its unit.
    """

    sentence: str
    why: str
    intervals: Mapping[str, tuple[float, float]]
    outputs: Mapping[str, AdmissibleRange] = field(default_factory=dict)


def consumption_uncertainty(
    fitted: Case,
    free: Mapping[str, tuple[float, float, float]],
    errors: Mapping[str, float],
    policy: str,
) -> Compensation | None:
    """Find free parameters whose intervals are too narrow because a consumption is the formula's.

    Returns None if there are no such parameters or the beat has no derivatives.

    Args:
        fitted: the case with its fitted values; its consumption is the formula's.
        free: value, lower and upper bound of each free parameter, in its unit.
        errors: standard uncertainty of each measurement.
        policy: blood volume policy.
    """
    model = model_of(fitted)
    if VO2 not in model.values:
        return None
    consumed = model.values[VO2]
    reach = np.exp(CONSUMPTION_SPREAD * np.sqrt(3.0))
    more = {VO2: (consumed, consumed / reach, consumed * reach)}
    linear = _linearised_fit(model, free, more, errors, (), policy)
    if linear is None:
        return None
    own, narrow = linear.own, np.sqrt(np.diag(linear.covariance))
    wide = np.sqrt(np.diag(linear.covariance_with_more))
    intervals = {
        name: own.interval(k, own.start[k], wide[k])
        for k, name in enumerate(own.names)
        if wide[k] > WIDENING_RATIO * narrow[k]
    }
    if not intervals:
        return None
    gases, names = (", ".join(each) for each in ((n for n in errors if n in MEASURED_GASES), intervals))
    ends = ", ".join(f"{name} {low:.3g} to {high:.3g}" for name, (low, high) in intervals.items())
    sentence = (
        f"the oxygen consumption is held at {consumed:.0f} mL/min, a formula's value, and {names} "
        f"compensate{'s' if len(intervals) == 1 else ''} for errors in it, which {gases} alone cannot show: "
        f"if it is known to {100 * CONSUMPTION_SPREAD:.0f} %, these measurements give {ends} (90 %); measure "
        f"SvO2 or SpreO2, or give {VO2}"
    )
    why = "compensates for errors in the oxygen consumption, which is held at a formula's value"
    return Compensation(sentence, why, intervals)


def undetermined_outputs(
    fitted: Case,
    free: Mapping[str, tuple[float, float, float]],
    measured: Mapping[str, float],
    errors: Mapping[str, float],
    policy: str,
) -> Compensation | None:
    """Find outputs that are undetermined because a fit holds parameters; None if there are none.

    Args:
        fitted: the case with its fitted values.
        free: value, lower and upper bound of each free parameter, in its unit.
        measured: value of each measurement.
        errors: standard uncertainty of each measurement.
        policy: blood volume policy.
    """
    model = model_of(fitted)
    held = {
        name: (model.values[name], bounds.lower, bounds.upper)
        for name, bounds in BOUNDS.items()
        if name not in free and stated(fitted, name) is None and name in model.values
    }
    read = [name for name in KEY_OUTPUTS if name not in errors]
    if not held or not read:
        return None
    linear = _linearised_fit(model, free, held, errors, read, policy)
    if linear is None:
        return None
    suspected = _widened_outputs(read, linear)
    if not suspected:
        return None
    curves = _profile_outputs(suspected, Target(model, measured, errors), Box.of({**free, **held}), policy)
    outputs = {name: curve.reach(name) for name, curve in zip(suspected, curves, strict=True)}
    within = np.concatenate([curve.x[curve.rises <= RISE_90] for curve in curves])
    names, are = ", ".join(held), "are" if len(held) > 1 else "is"
    each = ", ".join(f"{n} {reach} {unit_of(n)} (fitted: {suspected[n]:.3g})" for n, reach in outputs.items())
    sentence = (
        f"{names} {are} held at the usual value, on which outputs that were not measured depend; with "
        f"all parameters free, the 90 % intervals are {each}: measure {' or '.join(outputs)}, free "
        "what is held (--free), or give its value in [parameters] if it is known"
    )
    why = f"compensates for errors in {names}, which {are} held"
    return Compensation(sentence, why, _widened_intervals(within, linear), outputs)


def held_that_move(
    fitted: Case,
    free: Mapping[str, tuple[float, float, float]],
    missed: Mapping[str, float],
    policy: str,
) -> dict[str, list[str]]:
    """Find held parameters that move missed measurements by more than their uncertainty, most first.

    Args:
        fitted: the case with its fitted values.
        free: value, lower and upper bound of each free parameter, in its unit.
        missed: standard uncertainty of each missed measurement.
        policy: blood volume policy.
    """
    open_ones = [n for n in (*BOUNDS, SHUNT, EXTRA_VOLUME) if n not in free and not stated(fitted, n)]
    with_volume = with_values(fitted, {EXTRA_VOLUME: 0.0}) if fitted.fluid is None else fitted
    model = model_of(with_volume)
    read = parameters_read(model.circuit)
    held = [name for name in open_ones if name in read]
    if not held:
        return {}
    try:
        slopes = derivatives(model, tuple(missed), held, policy).to_numpy()
    except NoDerivativesError:
        return {}
    scale, values = Scale.of(held), np.array([model.values[name] for name in held])
    by_coordinate = slopes * scale.slopes(scale.coordinates(values))
    moved = np.abs(by_coordinate) * USUAL_CHANGE / np.array(list(missed.values()))[:, None]
    result = {}
    for name, effects in zip(missed, moved, strict=True):
        order = np.argsort(-effects)[:MOST_NAMED]
        result[name] = [held[k] for k in order if effects[k] >= 1.0]
    return result


def _widened_intervals(within: np.ndarray, linear: _LinearisedFit) -> dict[str, tuple[float, float]]:
    """Ends of free parameters whose range is wider than that of the fit by more than `WIDENING_RATIO`.

    Args:
        within: coordinates of fits that meet the measurements, free parameters first, shape (fits,
            parameters).
        linear: first-order approximation of the fit.
    """
    own, errors = linear.own, np.sqrt(np.diag(linear.covariance))
    wider = {}
    for k, name in enumerate(own.names):
        low, high = (float(end(within[:, k])) for end in (np.min, np.max))
        narrow = own.clip(own.start + np.outer((-NORMAL_90, NORMAL_90), errors))[:, k]
        if max(high, narrow[1]) - min(low, narrow[0]) > WIDENING_RATIO * (narrow[1] - narrow[0]):
            wider[name] = (own.scale.value(k, low), own.scale.value(k, high))
    return wider


class _ProfileCurve(NamedTuple):
    """Fits with an output held at several increasing values, shape (fits, ...).

    Attributes:
        values: values of the output.
        rises: chi-square above its minimum.
        x: coordinates of the parameters.
    """

    values: np.ndarray
    rises: np.ndarray
    x: np.ndarray

    @classmethod
    def of(cls, values: np.ndarray, rises: np.ndarray, x: np.ndarray) -> _ProfileCurve:
        """Return the curve through the fits that have a steady beat, sorted by value."""
        order = np.flatnonzero(np.isfinite(rises))
        order = order[np.argsort(values[order], kind="stable")]
        return cls(values[order], rises[order], x[order])

    def reach(self, name: str) -> AdmissibleRange:
        """Return the 90 % range by profile likelihood."""
        low, high = interval_90(self.values, self.rises, Scale.of((name,)))
        return AdmissibleRange(low, high, bool(low <= self.values[0]), bool(high >= self.values[-1]))


def _profile_outputs(
    values: Mapping[str, float], likelihood: Target, box: Box, policy: str
) -> list[_ProfileCurve]:
    """Fit with all parameters free and outputs held at other values as if measured (profile likelihood).

    Such a search may end in a local minimum when it starts from the fit. If a value was not met, the fit is
    repeated from the patient fitted so far whose output is nearest to that value.
    """
    names = [name for name in values for _ in PROFILE_SHARES]
    values_to_meet = np.outer(list(values.values()), PROFILE_SHARES).ravel()
    targets = [
        replace(
            likelihood,
            measured={**likelihood.measured, name: one},
            scales={**likelihood.scales, name: PROFILE_UNCERTAINTY * one},
        )
        for name, one in zip(names, values_to_meet.tolist(), strict=True)
    ]
    objective, points = Objective(targets, box.names, policy), np.arange(len(targets))
    places = np.array([objective.outputs.index(name) for name in names])

    def search(points: np.ndarray, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return coordinates, outputs, and chi-square of the actual measurements only."""
        fits = refine(objective, points, starts, box, REFITTING)
        fitted = fits.outputs[np.arange(len(points)), places[points]]
        chi_square = fits.costs - ((fitted / values_to_meet[points] - 1.0) / PROFILE_UNCERTAINTY) ** 2
        return fits.x, fits.outputs, np.where(np.isfinite(chi_square), chi_square, np.inf)

    x, outputs, rises = search(points, np.tile(box.start, (len(points), 1)))
    for _ in range(PROFILE_RETRIES):
        met = rises <= rises.min() + RISE_90
        again = points[~met]
        if not len(again) or not np.isfinite(rises).any():
            break
        apart = np.abs(np.log(np.maximum(outputs[met][:, places[again]], 1e-9) / values_to_meet[again]))
        more_x, more_outputs, more = search(again, x[met][np.argmin(apart, axis=0)])
        better = more < rises[again]
        chosen = again[better]
        x[chosen], outputs[chosen], rises[chosen] = more_x[better], more_outputs[better], more[better]
    rises -= rises.min()
    return [
        _ProfileCurve.of(outputs[own, places[own]], rises[own], x[own])
        for own in points.reshape(len(values), -1)
    ]


class _LinearisedFit(NamedTuple):
    """First-order approximation of the fit, with its free parameters and with additional ones.

    Attributes:
        own: bounds of the free parameters.
        covariance: covariance of their coordinates.
        covariance_with_more: covariance of all coordinates if additional parameters, placed last, are free,
            too.
        values: values of the outputs considered.
        slopes: derivatives of these outputs with respect to all coordinates.
    """

    own: Box
    covariance: np.ndarray
    covariance_with_more: np.ndarray
    values: np.ndarray
    slopes: np.ndarray


def _linearised_fit(
    model: Model,
    free: Mapping[str, tuple[float, float, float]],
    more: Mapping[str, tuple[float, float, float]],
    errors: Mapping[str, float],
    read: Sequence[str],
    policy: str,
) -> _LinearisedFit | None:
    """Linearise the fit, with its free parameters and with more; None where the beat has no derivatives."""
    box, count, measured = Box.of({**free, **more}), len(free), len(errors)
    try:
        slopes = derivatives(model, (*errors, *read), box.names, policy)
    except NoDerivativesError:
        return None
    by_coordinate = slopes.to_numpy() * box.scale.slopes(box.start)
    scaled = by_coordinate[:measured] / np.array(list(errors.values()))[:, None]
    own = Box(box.names[:count], box.start[:count], box.lower[:count], box.upper[:count])
    return _LinearisedFit(
        own,
        own.covariance(scaled[:, :count]),
        box.covariance(scaled),
        slopes["value"].to_numpy()[measured:],
        by_coordinate[measured:],
    )


def _widened_outputs(names: Sequence[str], linear: _LinearisedFit) -> dict[str, float]:
    """Values of outputs whose first-order range widens beyond `WIDENING_RATIO` with all parameters free."""
    relative, free = linear.slopes / linear.values[:, None], len(linear.own.names)
    everything = _upper_end_ratio(relative, linear.covariance_with_more)
    without = _upper_end_ratio(relative[:, :free], linear.covariance)
    return {
        name: value
        for name, value, wide, narrow in zip(names, linear.values.tolist(), everything, without, strict=True)
        if np.isfinite(wide) and value > 0.0 and wide > WIDENING_RATIO and wide > WIDENING_RATIO * narrow
    }


def _upper_end_ratio(relative: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Ratio of the upper end of the 90 % interval to the value, shape (outputs,)."""
    variance = np.einsum("ij,jk,ik->i", relative, covariance, relative)
    return np.exp(NORMAL_90 * np.sqrt(np.maximum(variance, 0.0)))
