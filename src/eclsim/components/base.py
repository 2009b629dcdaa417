"""What a component is: a `Storage` keeps blood, a `Path` carries it.

A component states its law and the names of the parameters the law needs, nothing else: no solver, no file,
no plot. The circuit says where it stands. Values reach a component as a mapping from parameter name to
number or array (one entry per patient of a batch), so every law is written once for one and for many.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp

from eclsim import runtime as _runtime  # noqa: F401  (double precision before the first array)
from eclsim.components.activation import Activation

Values = Mapping[str, Any]
Key = str | float | tuple[str, ...]


def value_of(values: Values, key: Key) -> Any:
    """Value behind a key: a parameter name, a number that is meant as it stands, or names to be summed."""
    if isinstance(key, tuple):
        return sum((values[name] for name in key[1:]), start=values[key[0]])
    return values[key] if isinstance(key, str) else key


def names_in(key: Key | None) -> tuple[str, ...]:
    """Parameter names that a key refers to."""
    if isinstance(key, tuple):
        return key
    return (key,) if isinstance(key, str) else ()


@dataclass(frozen=True)
class Storage:
    """A compartment's law: pressure [mmHg] and stiffness dP/dV [mmHg/mL] of its stressed volume [mL]."""

    @property
    def activation(self) -> Activation | None:
        """Timing of the contraction; None for a passive compartment."""
        return None

    @property
    def constant_stiffness(self) -> bool:
        """True if dP/dV depends on neither volume nor phase, so that it can be computed once a beat."""
        return False

    @property
    def above_zero(self) -> tuple[Key, ...]:
        """Parameters without which the law makes no sense at zero or below, such as a compliance."""
        return ()

    @property
    def not_negative(self) -> tuple[Key, ...]:
        """Parameters without which the law makes no sense below zero, such as a resistance."""
        return ()

    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters that the law reads."""
        raise NotImplementedError

    def constants(self, values: Values) -> Any:
        """Anything that can be computed once from the parameters; handed back to `pressure`."""
        return values

    def pressure(self, volume: Any, activation: Any, constants: Any) -> tuple[Any, Any]:
        """Pressure [mmHg] and stiffness [mmHg/mL] at a stressed volume [mL] and an activation of 0 to 1."""
        raise NotImplementedError


@dataclass(frozen=True)
class Path:
    """A connection's law: the pressure drop [mmHg] that goes with a flow [mL/s].

    `pressure_drop` is all that a new component must state. `flow` is its inverse under a series load,
    load * Q + drop(Q) = dp; the default solves it by Newton's method, a closed form is faster.
    """

    @property
    def inertial(self) -> bool:
        """True if the flow has inertia and is a state of its own."""
        return False

    @property
    def linear(self) -> bool:
        """True if the drop is resistance * flow with a resistance that is constant over the beat."""
        return False

    @property
    def above_zero(self) -> tuple[Key, ...]:
        """Parameters without which the law makes no sense at zero or below, such as a compliance."""
        return ()

    @property
    def not_negative(self) -> tuple[Key, ...]:
        """Parameters without which the law makes no sense below zero, such as a resistance."""
        return ()

    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters that the law reads."""
        raise NotImplementedError

    def constants(self, values: Values) -> Any:
        """Anything that can be computed once from the parameters; handed back to the methods below."""
        return values

    def inertance(self, constants: Any) -> Any:
        """Inertance [mmHg s^2/mL] of an inertial path."""
        raise NotImplementedError

    def resistance(self, constants: Any) -> Any:
        """Resistance [mmHg s/mL] of a linear path."""
        raise NotImplementedError

    def pressure_drop(self, flow: Any, constants: Any) -> Any:
        """Pressure upstream minus downstream [mmHg] that a steady flow [mL/s] takes."""
        raise NotImplementedError

    def flow(self, pressure_difference: Any, load: Any, constants: Any) -> Any:
        """Flow [mL/s] with load * flow + pressure_drop(flow) = pressure_difference; load in mmHg s/mL."""
        return _newton_flow(self, pressure_difference, load, constants)


def _newton_flow(
    path: Path, pressure_difference: Any, load: Any, constants: Any, iterations: int = 40
) -> Any:
    """Newton's method on a monotone drop; slopes are kept positive, so a flat start cannot divide by 0.

    The last step alone is differentiated, which gives the exact derivative of the root.
    """

    def improved(flow: Any) -> Any:
        drop, slope = jax.jvp(lambda q: path.pressure_drop(q, constants), (flow,), (jnp.ones_like(flow),))
        return flow + (pressure_difference - drop - load * flow) / jnp.maximum(load + slope, 1e-9)

    start = jnp.zeros_like(pressure_difference + load)
    root = jax.lax.fori_loop(0, iterations, lambda _, flow: improved(flow), start)
    return improved(jax.lax.stop_gradient(root))
