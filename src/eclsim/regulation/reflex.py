"""Reflexes: pressures read from a beat, pathways to organs, and their effects there.

A published reflex is data (`ReflexModel`); `Reflex` is the controller of any such data. All curves are used
relative to a set point: an effector is multiplied by the change of its published curve from the set point to
the pressure read, so that a patient at the set point is the same as without the reflex.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple, cast

import jax.numpy as jnp

from eclsim.circuit.network import BLOOD_VOLUME, Reading
from eclsim.components.base import Constants, Controller, ControlState, Key, Number, Values, value_of
from eclsim.parameters.regulation import GAIN, SET_POINT, UNSTRESSED, VENOUS_SET_POINT

EXTREME_DEVIATION_MMHG = 1000.0
"""Deviation of pressure [mmHg] at which a reflex is saturated."""
AT_REST_MMHG = 1e-5
"""Deviation of pressure that a search for the steady beat may leave of none."""


class SteadyController(Controller[Constants], ABC):
    """A controller whose steady states are a function of its readings; it scales or shifts parameters."""

    relative: ClassVar = True

    @abstractmethod
    def steady_states(self, readings: Sequence[Number], constants: Constants) -> Sequence[Number]:
        """States that are stationary at the given readings."""


class InstantController(SteadyController[Constants], ABC):
    """A controller without states and readings, whose effects follow from parameters alone."""

    @property
    def states(self) -> tuple[ControlState, ...]:
        """No states."""
        return ()

    def start(self, constants: Constants) -> Sequence[Number]:
        """No states."""
        return ()

    def steady_states(self, readings: Sequence[Number], constants: Constants) -> Sequence[Number]:
        """No states."""
        return ()

    def next_states(
        self, states: Sequence[Number], readings: Sequence[Number], period: Number, constants: Constants
    ) -> Sequence[Number]:
        """No states."""
        return ()


class Pathway(NamedTuple):
    """Nerve pathway to a group of organs.

    Attributes:
        name: name of the pathway and of the controller's state.
        lag_s: sum of delay and time constant [s]: the mean lag of the effect. The steady beat does not depend
            on it.
        scale: typical change of the drive along it, in the drive's unit.
    """

    name: str
    lag_s: float
    scale: float


@dataclass(frozen=True)
class Effector:
    """Effect of pathways on one parameter: theta_i + sum over pathways of gain * drive, for parallel beds i.

    Args:
        parameter: parameter that it acts on.
        reference: published value theta_i of each bed at the set point; one value if there are no beds.
        gains: gains of each bed, one per pathway.
        inverse: whether the published quantity is the inverse of the parameter: heart period for heart rate,
            end-systolic compliance for elastance.
        least: lower limit of a bed's published quantity as a share of theta_i; 0 for no limit.
    """

    parameter: str
    reference: tuple[float, ...]
    gains: tuple[tuple[float, ...], ...]
    inverse: bool = False
    least: float = 0.0

    def factor(self, drives: Sequence[Number]) -> Number:
        """Value of the parameter relative to that at the set point; exactly 1 where all drives are 0."""
        # Added one by one: from Python 3.12 on `sum` compensates rounding, and 1 would not be exact.
        at_rest, changed = 0.0, cast(Number, 0.0)
        for reference, gains in zip(self.reference, self.gains, strict=True):
            shift = sum((g * d for g, d in zip(gains, drives, strict=True) if g), start=0.0)
            value = reference + shift
            at_rest = at_rest + 1.0 / reference
            changed = changed + 1.0 / (jnp.maximum(value, self.least * reference) if self.least else value)
        factor = at_rest / changed
        return 1.0 / factor if self.inverse else factor


@dataclass(frozen=True)
class ReflexModel:
    """A published model of reflexes.

    Args:
        name: name in case files.
        source: source of its numbers.
        reads: readings of the arterial pressure and, if used, of the right atrial pressure.
        pathways: pathways, in the order of drives.
        drives: function from the deviations of the pressures from their set points [mmHg] to the drive along
            each pathway, 0 at the set point.
        effectors: effectors of the pathways other than the veins.
        venous_gains_ml: change of venous unstressed volume per unit of drive, per pathway [mL].
        blood_volume_ml: blood volume of the published subject [mL]; venous changes scale with the patient's.
    """

    name: str
    source: str
    reads: tuple[Reading, ...]
    pathways: tuple[Pathway, ...]
    drives: Callable[[Sequence[Number]], Sequence[Number]]
    effectors: tuple[Effector, ...]
    venous_gains_ml: tuple[float, ...]
    blood_volume_ml: float

    @property
    def acts_on(self) -> tuple[str, ...]:
        """Parameters that it acts on, in the order of `effects`."""
        return (*(effector.parameter for effector in self.effectors), UNSTRESSED)

    def effector(self, parameter: str) -> Effector:
        """Return the effector that acts on a parameter."""
        return next(effector for effector in self.effectors if effector.parameter == parameter)

    def effects(self, drives: Sequence[Number], blood_volume_ml: Number) -> list[Number]:
        """Factor of each effector's parameter, then the change of unstressed volume [mL]."""
        share = blood_volume_ml / self.blood_volume_ml
        veins = sum((g * d for g, d in zip(self.venous_gains_ml, drives, strict=True) if g), start=0.0)
        return [*(effector.factor(drives) for effector in self.effectors), share * veins]

    def steady_effects(
        self, deviations: Sequence[Number], gain: Number, blood_volume_ml: Number
    ) -> list[Number]:
        """Effects in the steady state at deviations [mmHg] of the pressures from their set points."""
        return self.effects([gain * drive for drive in self.drives(deviations)], blood_volume_ml)

    def share_in_use(self, arterial_deviation: Number) -> Number:
        """Share of the resistance's range in use: 1 at the lowest arterial pressure, -1 at the highest.

        It has a corner at the set point, where the slope is that towards lower pressures.
        """
        pathway = next(k for k, gain in enumerate(self.effector("Rmc").gains[0]) if gain)

        def drive(deviation: Number) -> Number:
            return self.drives([deviation, *[0.0] * (len(self.reads) - 1)])[pathway]

        low, high = drive(-EXTREME_DEVIATION_MMHG), drive(EXTREME_DEVIATION_MMHG)
        end = jnp.where(arterial_deviation < AT_REST_MMHG, low, -high)
        return drive(arterial_deviation) / end


class ReflexConstants(NamedTuple):
    """Gain, set points of the pressures read [mmHg], and the patient's blood volume [mL]."""

    gain: Number
    set_points: tuple[Number, ...]
    blood_volume_ml: Number


@dataclass(frozen=True)
class Reflex(SteadyController[ReflexConstants]):
    """Controller of a published reflex; its states are the drives along the pathways.

        pressures --> [ curves ] --> drives --> [ lags ] --> gain * drive --> factors of parameters

    A drive follows that of the last beat's mean pressures as a first-order filter with the pathway's lag.

    Args:
        model: published model.
        gain: 1 for the published reflex, less in sedation, 0 for none.
        set_point: arterial pressure without effect [mmHg].
        venous_set_point: right atrial pressure without effect [mmHg], if it is read.
        blood_volume: the patient's blood volume [mL].
    """

    model: ReflexModel
    gain: Key = GAIN
    set_point: Key = SET_POINT
    venous_set_point: Key = VENOUS_SET_POINT
    blood_volume: Key = BLOOD_VOLUME
    not_negative: ClassVar = ("gain",)

    @property
    def states(self) -> tuple[ControlState, ...]:
        """Drive along each pathway."""
        return tuple(ControlState(pathway.name, pathway.scale) for pathway in self.model.pathways)

    def constants(self, values: Values) -> ReflexConstants:
        """Gain, set points, blood volume."""
        keys = (self.set_point, self.venous_set_point)
        points = tuple(value_of(values, key) for key, _ in zip(keys, self.model.reads, strict=False))
        return ReflexConstants(value_of(values, self.gain), points, value_of(values, self.blood_volume))

    def start(self, constants: ReflexConstants) -> Sequence[Number]:
        """Zero drives: the state at the set point."""
        return [0.0] * len(self.model.pathways)

    def steady_states(self, readings: Sequence[Number], constants: ReflexConstants) -> Sequence[Number]:
        """Drives at the pressures read."""
        return self.model.drives([r - point for r, point in zip(readings, constants.set_points, strict=True)])

    def in_effect(
        self, states: Sequence[Number], values: Sequence[Number], constants: ReflexConstants
    ) -> Sequence[Number]:
        """Parameters times their factors, and the shifted unstressed volume."""
        drives = [constants.gain * state for state in states]
        *factors, shift = self.model.effects(drives, constants.blood_volume_ml)
        *usual, unstressed = values
        return [*(value * factor for value, factor in zip(usual, factors, strict=True)), unstressed + shift]

    def next_states(
        self, states: Sequence[Number], readings: Sequence[Number], period: Number, constants: ReflexConstants
    ) -> Sequence[Number]:
        """Drives one beat later, relaxed towards those at the pressures read."""
        target = self.steady_states(readings, constants)
        return [
            state - jnp.expm1(-period / pathway.lag_s) * (drive - state)
            for state, drive, pathway in zip(states, target, self.model.pathways, strict=True)
        ]


@dataclass(frozen=True)
class TransmuralReflex(Reflex):
    """Reflex whose right atrial receptors sense the transmural pressure inside a pericardium.

    It reads the pericardium's pressure after those of its model; the right atrial set point is transmural as
    well.
    """

    def steady_states(self, readings: Sequence[Number], constants: ReflexConstants) -> Sequence[Number]:
        """Drives at arterial and transmural right atrial pressure."""
        arterial, atrial, outside = readings
        return super().steady_states([arterial, atrial - outside], constants)
