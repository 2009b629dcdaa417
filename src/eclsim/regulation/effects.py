"""Effects of controllers in the steady state as a function of their readings."""

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
    """Controllers whose steady effect is a function of their readings."""
    return tuple(c for c in circuit.controllers if isinstance(c.component, SteadyController))


def readings_of(controls: Sequence[Control]) -> tuple[Reading, ...]:
    """Readings of controllers, one after the other."""
    return tuple(reading for control in controls for reading in control.reads)


def parameters_of(controls: Sequence[Control]) -> tuple[str, ...]:
    """Parameters on which the values in effect depend."""
    names = (n for c in controls for n in (*c.parameter_names(), *c.acts_on))
    return tuple(dict.fromkeys((HEART_RATE, *names)))


@dataclass(frozen=True, eq=False)
class EffectLaw:
    """Function from readings and parameters, in the order of the functions above, to the values in effect.

    Args:
        controls: controllers.
        wanted: parameters that they act on.
    """

    controls: tuple[Control, ...]
    wanted: tuple[str, ...]

    def __call__(self, numbers: Array) -> Array:
        """Return the values in effect."""
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


effect_law = lru_cache(maxsize=64)(EffectLaw)
"""The law of given controllers; the same object each time, as compiled programs are cached by it."""


@dataclass(frozen=True, eq=False)
class ReflexUseLaw:
    """Function from arterial pressure, set point and gain to the share of a reflex's range in use [%].

    Args:
        model: model of the reflex.
    """

    model: ReflexModel

    def __call__(self, n: Array) -> Array:
        """Return the share, -100 to 100 %."""
        return jnp.stack([jnp.where(n[2] > 0.0, 100.0 * self.model.share_in_use(n[0] - n[1]), 0.0)])


@lru_cache(maxsize=8)
def reflex_use_law(control: Control) -> ReflexUseLaw:
    """The law of a reflex; the same object each time."""
    reflex = control.component
    assert isinstance(reflex, Reflex)
    return ReflexUseLaw(reflex.model)


def reflex_of(circuit: Circuit) -> Control | None:
    """The circuit's reflex; None if it has none."""
    return next((c for c in circuit.controllers if c.name == REGULATION), None)
