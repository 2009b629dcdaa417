"""Effects of controllers once the circulation is steady, as a function of what they read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import jax.numpy as jnp
from jax import Array

from eclsim.circuit.network import HEART_RATE, Circuit, Control, Reading
from eclsim.components.base import Number
from eclsim.parameters.regulation import REGULATION
from eclsim.regulation.reflex import Reflex, ReflexModel, SteadyController


def steady_controls(circuit: Circuit) -> tuple[Control, ...]:
    """Controllers whose effect follows from what they read."""
    return tuple(c for c in circuit.controllers if isinstance(c.component, SteadyController))


def readings_of(controls: Sequence[Control]) -> tuple[Reading, ...]:
    """Inputs of controllers, one after the other."""
    return tuple(reading for control in controls for reading in control.reads)


def parameters_of(controls: Sequence[Control]) -> tuple[str, ...]:
    """Parameters that what is in effect follows from."""
    names = (n for c in controls for n in (*c.parameter_names(), *c.acts_on))
    return tuple(dict.fromkeys((HEART_RATE, *names)))


@dataclass(frozen=True, eq=False)
class EffectLaw:
    """From readings and parameters, in the order of the functions above, to the values in effect.

    Args:
        controls: controllers.
        wanted: parameters that they act on.
    """

    controls: tuple[Control, ...]
    wanted: tuple[str, ...]

    def __call__(self, numbers: Array) -> Array:
        """The values in effect."""
        count, names = len(readings_of(self.controls)), parameters_of(self.controls)
        remaining, values = list(numbers[:count]), dict(zip(names, numbers[count:], strict=True))
        acted: dict[str, Number] = dict(values)
        for control in self.controls:
            component, constants = control.component, control.component.constants(values)
            assert isinstance(component, SteadyController)
            readings, remaining = remaining[: len(control.reads)], remaining[len(control.reads) :]
            states = component.steady_states(readings, constants)
            current = [acted[name] for name in control.acts_on]
            acted.update(zip(control.acts_on, component.in_effect(states, current, constants), strict=True))
        return jnp.stack([jnp.asarray(acted[name]) for name in self.wanted])


@lru_cache(maxsize=64)
def effect_law(controls: tuple[Control, ...], parameters: tuple[str, ...]) -> EffectLaw:
    """The law of some controllers, the same object each time: its programs are kept by it."""
    return EffectLaw(controls, parameters)


@dataclass(frozen=True, eq=False)
class ReflexUseLaw:
    """From arterial pressure, set point and gain to the share of a reflex's range in use, -100 to 100 %.

    Args:
        model: of the reflex.
    """

    model: ReflexModel

    def __call__(self, n: Array) -> Array:
        """The share."""
        return jnp.stack([jnp.where(n[2] > 0.0, 100.0 * self.model.share_in_use(n[0] - n[1]), 0.0)])


@lru_cache(maxsize=8)
def reflex_use_law(control: Control) -> ReflexUseLaw:
    """The law of a reflex, the same object each time."""
    reflex = control.component
    assert isinstance(reflex, Reflex)
    return ReflexUseLaw(reflex.model)


def reflex_of(circuit: Circuit) -> Control | None:
    """The circuit's reflex."""
    return next((c for c in circuit.controllers if c.name == REGULATION), None)
