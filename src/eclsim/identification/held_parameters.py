"""Outputs of a fit if the parameters that it holds at usual values were free as well.

Blood gases, or few measurements, are often fitted with some of the seven parameters held, since their effects
cannot be told from others'. Their usual values are then taken as known, and a failing heart may come
out as a healthy one with wide vessels, with narrow intervals. The derivatives at the fit show whether this is
possible; further fits show how far it goes, with everything free and the output in question at other values
(profile likelihood). To first order alone the cardiac output of 3 L/min of such a heart lay outside.

Likewise an oxygen consumption by the formula, which nobody measured: arterial gases alone follow from it and
the shunt together, and what is wrong with it goes into the shunt.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eclsim.cases.quantities import stated
from eclsim.cases.sections import MEASURED_GASES
from eclsim.devices.description import GASES as VO2
from eclsim.identification.least_squares import refine
from eclsim.identification.objective import NORMAL_90, RISE_90, Box, Objective, Target
from eclsim.identification.profiles import REFITTING, interval_90
from eclsim.identification.quantities import Scale, unit_of
from eclsim.orbit.model import Model, model_of
from eclsim.orbit.status import NoDerivativesError
from eclsim.outputs.results import derivatives
from eclsim.parameters.thiel2025 import BOUNDS

if TYPE_CHECKING:
    from eclsim.cases.case import Case

KEY_OUTPUTS = ("CO", "PCWP", "MPAP")
"""Outputs that a fit is read for, the gravest first."""
CONSUMPTION_SPREAD = 0.25
"""Standard deviation of the logarithm of a critically ill patient's consumption about the formula, from
the cooled to the septic: an assumption."""
WIDENING_RATIO = 1.3
"""Ratio of the ends of a 90 % interval to the value, from which an output counts as left open."""
PROFILE_SHARES = (1.0, *np.geomspace(1.0 / 6.0, 4.0, 10).tolist())
"""Values that an output is held near in further fits, as shares of the fit's value."""
PROFILE_UNCERTAINTY = 0.01
"""Standard uncertainty of such a value, as a share of it."""
PROFILE_RETRIES = 2
"""How often a fit that missed its value is repeated from another start."""


class AdmissibleRange(NamedTuple):
    """Values of an output or parameter at which the measurements are met.

    Attributes:
        low: smallest, in its unit.
        high: largest.
        open_below: nothing smaller was tried.
        open_above: nothing larger was tried.
    """

    low: float
    high: float
    open_below: bool = False
    open_above: bool = False

    def __str__(self) -> str:
        low, high = f"{self.low:.3g}", f"{self.high:.3g}"
        return f"{low}{' or less' * self.open_below} to {high}{' or more' * self.open_above}"


@dataclass(frozen=True)
class UndeterminedOutputs:
    """What follows from held parameters.

    Attributes:
        held: parameters at their usual values.
        outputs: 90 % of each output that is left open, in its unit, were these free as well.
        values: of the fit.
        parameters: lower and upper end of each free parameter that reaches further too.
    """

    held: tuple[str, ...]
    outputs: Mapping[str, AdmissibleRange]
    values: Mapping[str, float]
    parameters: Mapping[str, tuple[float, float]]

    @property
    def sentence(self) -> str:
        """In words, with what to do."""
        held, are = ", ".join(self.held), "are" if len(self.held) > 1 else "is"
        each = ", ".join(
            f"{name} {reach} {unit_of(name)} in place of {self.values[name]:.3g}"
            for name, reach in self.outputs.items()
        )
        return (
            f"{held} {are} held at the usual value, and what was not measured follows from that: free as "
            f"well, these measurements leave {each} (90 %); measure it, free them (--free), or give "
            "[parameters] that are known"
        )


@dataclass(frozen=True)
class ConsumptionUncertainty:
    """Free parameters that carry what is wrong with an oxygen consumption by the formula.

    Attributes:
        value: the consumption [mL/min].
        gases: measured ones that follow from it.
        intervals: 90 % of each such parameter, in its unit, with the consumption not known.
    """

    value: float
    gases: tuple[str, ...]
    intervals: Mapping[str, tuple[float, float]]

    @property
    def sentence(self) -> str:
        """In words, with what to do."""
        share, names = f"{100 * CONSUMPTION_SPREAD:.0f} %", ", ".join(self.intervals)
        ends = ", ".join(f"{name} {low:.3g} to {high:.3g}" for name, (low, high) in self.intervals.items())
        return (
            f"the oxygen consumption is held at {self.value:.0f} mL/min, a formula's, and {names} "
            f"make{'s' if len(self.intervals) == 1 else ''} up for what is wrong with it, since "
            f"{', '.join(self.gases)} alone cannot tell: known to {share}, these measurements leave {ends} "
            f"(90 %); measure SvO2 or SpreO2, or give {VO2}"
        )


def consumption_uncertainty(
    fitted: Case,
    free: Mapping[str, tuple[float, float, float]],
    errors: Mapping[str, float],
    policy: str,
) -> ConsumptionUncertainty | None:
    """Free parameters whose intervals a consumption by the formula makes too narrow; None where none are.

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
    gases = tuple(name for name in errors if name in MEASURED_GASES)
    return ConsumptionUncertainty(consumed, gases, intervals) if intervals else None


def undetermined_outputs(
    fitted: Case,
    free: Mapping[str, tuple[float, float, float]],
    measured: Mapping[str, float],
    errors: Mapping[str, float],
    policy: str,
) -> UndeterminedOutputs | None:
    """Outputs that the parameters which a fit holds leave open; None where there are none.

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
    if next(iter(suspected), "") != KEY_OUTPUTS[0]:
        return None
    curves = _profile_outputs(suspected, Target(model, measured, errors), Box.of({**free, **held}), policy)
    return UndeterminedOutputs(
        tuple(held),
        {name: curve.reach(name) for name, curve in zip(suspected, curves, strict=True)},
        suspected,
        _widened_intervals(np.concatenate([curve.x[curve.rises <= RISE_90] for curve in curves]), linear),
    )


def _widened_intervals(within: np.ndarray, linear: _LinearisedFit) -> dict[str, tuple[float, float]]:
    """Ends of the free parameters that reach further than those of the fit do, by more than `WIDENING_RATIO`.

    Args:
        within: coordinates of fits that meet the measurements, free parameters first, (fits, parameters).
        linear: the fit.
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
    """Fits with an output at several values, these rising, shape (fits, ...).

    Attributes:
        values: of the output.
        rises: of chi-square from the least.
        x: coordinates of the parameters.
    """

    values: np.ndarray
    rises: np.ndarray
    x: np.ndarray

    @classmethod
    def of(cls, values: np.ndarray, rises: np.ndarray, x: np.ndarray) -> _ProfileCurve:
        """The curve through the fits that have a steady beat, in order."""
        order = np.flatnonzero(np.isfinite(rises))
        order = order[np.argsort(values[order], kind="stable")]
        return cls(values[order], rises[order], x[order])

    def reach(self, name: str) -> AdmissibleRange:
        """Where chi-square stays within 90 %."""
        low, high = interval_90(self.values, self.rises, Scale.of((name,)))
        return AdmissibleRange(low, high, bool(low <= self.values[0]), bool(high >= self.values[-1]))


def _profile_outputs(
    values: Mapping[str, float], likelihood: Target, box: Box, policy: str
) -> list[_ProfileCurve]:
    """Fit again, everything free, with other values of outputs as if measured (profile likelihood).

    From the fit alone such a search may end in a local minimum: a value that was not met is tried again, from
    the fitted patient whose output is nearest to it.
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
        """Coordinates, outputs and chi-square of the measurements alone."""
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
    """The fit to first order, with its free parameters and with more of them.

    Attributes:
        own: bounds of the free parameters.
        covariance: of their coordinates.
        covariance_with_more: of all coordinates, the further ones behind, where these are free as well.
        values: of the outputs that are read.
        slopes: of these, by all coordinates.
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
    """The fit with its free parameters, and with more; None where the beat has no derivatives."""
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
    """Outputs wider with all free by more than `WIDENING_RATIO` to first order, and their values."""
    relative, free = linear.slopes / linear.values[:, None], len(linear.own.names)
    everything = _upper_end_ratio(relative, linear.covariance_with_more)
    without = _upper_end_ratio(relative[:, :free], linear.covariance)
    return {
        name: value
        for name, value, wide, narrow in zip(names, linear.values.tolist(), everything, without, strict=True)
        if np.isfinite(wide) and value > 0.0 and wide > WIDENING_RATIO and wide > WIDENING_RATIO * narrow
    }


def _upper_end_ratio(relative: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Ratio of the upper end of 90 % to the value, shape (outputs,)."""
    variance = np.einsum("ij,jk,ik->i", relative, covariance, relative)
    return np.exp(NORMAL_90 * np.sqrt(np.maximum(variance, 0.0)))
