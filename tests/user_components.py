"""Components that a user would write, outside the package: each states its law and nothing else."""

from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp

from eclsim.components import Activation, Path, Storage
from eclsim.components.base import Controller, ControlState, Key, value_of


@dataclass(frozen=True)
class StenosedValve(Path):
    """A valve with a linear and a quadratic drop, stiff backwards; the solver inverts the drop."""

    resistance_key: Key
    coefficient_key: Key

    def pressure_drop(self, flow: Any, constants: Any) -> Any:
        resistance, coefficient = constants[self.resistance_key], constants[self.coefficient_key]
        leak = 20.0 * jnp.minimum(flow, 0.0)
        return resistance * flow + flow * jnp.abs(flow) / coefficient**2 + leak


@dataclass(frozen=True)
class ValveWithInertia(StenosedValve):
    """The same with the inertia of the blood that it moves."""

    inertia_key: Key = "inertia"

    @property
    def inertial(self) -> bool:
        return True

    def inertance(self, constants: Any) -> Any:
        return constants[self.inertia_key]


@dataclass(frozen=True)
class StiffeningDevice(Storage):
    """A lung-kidney device whose fibres stiffen as it fills: P = a V + b V^3."""

    soft: Key
    stiff: Key

    def pressure(self, volume: Any, activation: Any, constants: Any) -> tuple[Any, Any]:
        a, b = value_of(constants, self.soft), value_of(constants, self.stiff)
        return a * volume + b * volume**3, a + 3.0 * b * volume**2


@dataclass(frozen=True)
class Sine(Activation):
    """One sine a beat."""

    def at(self, phase: Any, xp: Any) -> Any:
        return xp.sin(2.0 * xp.pi * phase)


@dataclass(frozen=True)
class PressureSource(Storage):
    """A pressure that no flow can change: mean + amplitude * sine."""

    mean: float
    amplitude: float = 0.0

    @property
    def activation(self) -> Activation:
        return Sine()

    def pressure(self, volume: Any, activation: Any, constants: Any) -> tuple[Any, Any]:
        return self.mean + self.amplitude * activation + 0.0 * volume, 0.0 * volume


@dataclass(frozen=True)
class SetPointControl(Controller):
    """Moves parameters until what it reads is at a set point: d drive / dt = gain (set point / reading - 1).

    Each parameter is multiplied by 1 + tanh(drive) / 2 or, where it should fall as the drive rises, divided.
    """

    set_point: Key
    gain: Key
    raises: tuple[bool, ...] = (True,)

    @property
    def states(self) -> tuple[ControlState, ...]:
        return (ControlState("drive"),)

    def start(self, constants: Any) -> list[Any]:
        return [0.0]

    def in_effect(self, states: Any, values: Any, constants: Any) -> list[Any]:
        factor = 1.0 + 0.5 * jnp.tanh(states[0])
        return [v * factor if up else v / factor for v, up in zip(values, self.raises, strict=True)]

    def next_states(self, states: Any, readings: Any, period: Any, constants: Any) -> list[Any]:
        set_point, gain = value_of(constants, self.set_point), value_of(constants, self.gain)
        return [states[0] + gain * period * (set_point / readings[0] - 1.0)]
