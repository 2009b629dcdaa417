"""Whether the estimate after an update agrees with what was measured, and what else changed with it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from eclsim.identification.filtering import GaussianMixture
from eclsim.identification.points import Interval
from eclsim.identification.quantities import unit_of
from eclsim.identification.transport import Transport
from eclsim.outputs.uncertainty import Uncertainty, measurement_errors
from eclsim.reporting.numbers import significant

FARTHEST = 2.576
"""Standard deviations that a measurement may lie from the estimate: 99 % of a normal distribution."""
MOVED = 2.0
"""A measurement has moved if it differs from the last by more standard uncertainties of the difference,"""
MOVED_FROM_FORECAST = 1.0
"""and from its forecast, in the same direction, by more standard deviations."""
FEWEST_KINDS = 2
"""Fewer kinds of other measurements than this may move by chance."""
_ARTERIAL, _PULMONARY = ("SP", "DP", "MAP"), ("MPAP", "PCWP")
_OF_CIRCUIT = ("PF", "drainage_pressure", "pump_inlet_pressure", "pre_oxygenator_pressure",
               "post_oxygenator_pressure")  # fmt: skip
_HELD_CIRCUIT = (
    "something has changed that the model holds fixed, such as a cannula or tube that is kinked or clotted, "
    "or a vein that collapses around the cannula (tamponade, tension pneumothorax, bleeding)"
)
_HELD = "something has changed that the model holds fixed, or the value is wrong"
_FAST = "the patient has changed faster than the drift of the parameters allows, or the value is wrong"
_HELD_FIRST = "something that the model holds fixed is different in this patient, or the value is wrong"
_OUTWEIGHED = "the other measurements and the prior outweigh it, or the value is wrong"


class Miss(NamedTuple):
    """A measurement outside the 99 % interval of measurements that the updated estimate would give.

    Attributes:
        name: name of the output.
        measured: measured value.
        used: whether the estimate was updated with it.
        reachable: whether other values of the free parameters could meet it with the other measurements.
        is_first: whether it belongs to the first estimate, before which nothing can have changed.
    """

    name: str
    measured: float
    used: bool
    reachable: bool
    is_first: bool = False

    def sentence(self, estimate: Interval) -> str:
        """Doubt about the output, with its estimate after the update."""
        middle, low, high = (significant(v, 3) for v in (estimate.median, estimate.lower, estimate.upper))
        value, held = _value(self.name, self.measured), _HELD_CIRCUIT if self.name in _OF_CIRCUIT else _HELD
        fast = _FAST
        if self.is_first:
            held, fast = _HELD_FIRST, _OUTWEIGHED
        if not self.used:
            more = "" if self.reachable else f", and {held}"
            return (
                f"{self.name}: {value} was not used; if it is right, the estimate afterwards, {middle} "
                f"({low} to {high}), is not to be trusted{more}"
            )
        how = "is not met" if self.reachable else "cannot be met by the free parameters"
        return (
            f"{self.name}: {value} was used but {how}: the estimate afterwards is {middle} ({low} to "
            f"{high}), and its interval is not to be trusted; {fast if self.reachable else held}"
        )

    def sentence_later(self, point: str) -> str:
        """Doubt at later points, at which the output is not measured."""
        return (
            f"{self.name}: {_value(self.name, self.measured)} at {point}, the last measured, was not met by "
            "the estimate: the interval is not to be trusted until it is measured again"
        )


def unmet(
    names: Sequence[str], values: np.ndarray, scales: np.ndarray, after: GaussianMixture, used: np.ndarray,
    slope: np.ndarray, *, is_first: bool = False,
) -> dict[str, Miss]:  # fmt: skip
    """Measurements that the updated estimate does not meet, by name.

    Args:
        names: names of the outputs.
        values: measured values; NaN for none.
        scales: standard uncertainties of the measured values.
        after: distribution of the outputs after the update.
        used: whether each was used for the update.
        slope: derivatives of the outputs by the latent variables z, whose prior is N(0, 1).
        is_first: whether the estimate is the first of its patient.
    """
    measured = np.isfinite(values)
    off = np.where(measured, values - after.mean, 0.0)
    far = np.abs(off) > FARTHEST * np.hypot(np.sqrt(np.diag(after.covariance)), scales)
    own, noise = slope[measured], np.diag(scales[measured] ** 2)
    # What is left if the parameters may be anywhere in their prior, to first order.
    left = np.zeros(len(off))
    left[measured] = noise @ np.linalg.solve(own @ own.T + noise, off[measured])
    reachable = np.abs(left) <= FARTHEST * scales
    return {
        names[k]: Miss(names[k], float(values[k]), bool(used[k]), bool(reachable[k]), is_first)
        for k in np.flatnonzero(far).tolist()
    }


def slope_in_z(state: GaussianMixture, slope: np.ndarray, transport: Transport) -> np.ndarray:
    """Derivatives of the outputs by the latent variables z, shape (outputs, parameters).

    Args:
        state: forecast in the coordinates of the transport.
        slope: regression coefficients of each filter in these coordinates.
        transport: coordinates in which the state is given.
    """
    mean_slope = np.einsum("f,fop->op", state.weights / state.weights.sum(), slope)
    return mean_slope @ np.linalg.inv(transport.jacobian(state.mean))


def _value(name: str, value: float) -> str:
    return f"{significant(value, 3)} {unit_of(name)}".strip()


@dataclass
class Course:
    """What was last measured of each output.

    Args:
        uncertainties: uncertainties of the measurements that differ from the defaults.
    """

    uncertainties: Mapping[str, Uncertainty]

    def __post_init__(self) -> None:
        self.last: dict[str, float] = {}

    def learn(self, measured: Mapping[str, float]) -> None:
        """Keep the measurements for the next point."""
        self.last |= measured

    def moved(self, measured: Mapping[str, float], deviations: Mapping[str, float]) -> dict[str, str]:
        """Measurements that have moved since the last of the same output, and how: "fell", "rose".

        What a changed speed of the pump or heart rate explains is expected and has not moved.

        Args:
            measured: measured values.
            deviations: deviation of each from its forecast, in standard deviations.
        """
        result = {}
        for name in measured.keys() & self.last.keys():
            pair = self.last[name], measured[name]
            errors = [measurement_errors({name: value}, self.uncertainties)[name] for value in pair]
            change, direction = pair[1] - pair[0], deviations.get(name, 0.0)
            far = abs(change) > MOVED * math.hypot(*errors) and abs(direction) > MOVED_FROM_FORECAST
            if far and change * direction > 0.0:
                result[name] = "fell" if change < 0.0 else "rose"
        return {name: result[name] for name in measured if name in result}

    def sudden_change(self, name: str, measured: Mapping[str, float], deviations: Mapping[str, float]) -> str:
        """Description of a sudden change in which an output and several others have moved; empty for none."""
        moved = self.moved(measured, deviations)
        others = [n for n in moved if n != name]
        if name not in moved or len({_kind(n) for n in others}) < FEWEST_KINDS:
            return ""
        changes = ", ".join(
            f"{n} {moved[n]} from {significant(self.last[n], 3)} to {_value(n, measured[n])}"
            for n in (name, *others)
        )
        return f"{changes} at the same time"


def _kind(name: str) -> str:
    """The pressures of one place, which move together, are one kind."""
    return next((kind[0] for kind in (_ARTERIAL, _PULMONARY) if name in kind), name)
