"""What controllers have in effect once the circulation is steady, as a function of what they read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import jax.numpy as jnp
from jax import Array

from eclsim.circuit.network import HEART_RATE, Circuit, Control, Reading
from eclsim.components.base import Number
from eclsim.parameters.regulation import REGULATION
from eclsim.regulation.reflex import Reflex, SteadyController


def steady_controls(circuit: Circuit) -> tuple[Control, ...]:
    """Controllers whose effect follows from what they read."""
    return tuple(c for c in circuit.controllers if isinstance(c.component, SteadyController))


def readings_of(controls: Sequence[Control]) -> tuple[Reading, ...]:
    """What controllers read, one after the other."""
    return tuple(reading for control in controls for reading in control.reads)


def parameters_of(controls: Sequence[Control]) -> tuple[str, ...]:
    """Parameters that what is in effect follows from."""
    names = (n for c in controls for n in (*c.parameter_names(), *c.acts_on))
    return tuple(dict.fromkeys((HEART_RATE, *names)))


@lru_cache(maxsize=64)
def effect_law(controls: tuple[Control, ...], wanted: tuple[str, ...]) -> Callable[[Array], Array]:
    """From readings and parameters, in the order of the functions above, to the values in effect."""
    count, names = len(readings_of(controls)), parameters_of(controls)

    def law(numbers: Array) -> Array:
        rest, values = list(numbers[:count]), dict(zip(names, numbers[count:], strict=True))
        acted: dict[str, Number] = dict(values)
        for control in controls:
            component, constants = control.component, control.component.constants(values)
            assert isinstance(component, SteadyController)
            own, rest = rest[: len(control.reads)], rest[len(control.reads) :]
            states = component.steady_states(own, constants)
            given = [acted[name] for name in control.acts_on]
            acted.update(zip(control.acts_on, component.in_effect(states, given, constants), strict=True))
        return jnp.stack([jnp.asarray(acted[name]) for name in wanted])

    return law


@lru_cache(maxsize=8)
def use_law(control: Control) -> Callable[[Array], Array]:
    """From arterial pressure, set point and gain to the share of the reflex's range in use, -100 to 100 %."""
    reflex = control.component
    assert isinstance(reflex, Reflex)
    model = reflex.model
    return lambda n: jnp.stack([jnp.where(n[2] > 0.0, 100.0 * model.use(n[0] - n[1]), 0.0)])


def reflex_of(circuit: Circuit) -> Control | None:
    """The circuit's reflex."""
    return next((c for c in circuit.controllers if c.name == REGULATION), None)
