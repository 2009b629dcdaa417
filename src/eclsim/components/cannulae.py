"""ECMO cannulae: turbulent orifices whose resistance follows from the French size."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp

from eclsim.components.base import Key, Path, Values, names_in, value_of
from eclsim.units import ML_S_PER_L_MIN

TINY = 1e-12
"""Keeps the square root differentiable at zero flow; far below the rounding of a flow [mmHg^2 s^2/mL^2]."""


@dataclass(frozen=True)
class Cannula(Path):
    """Quadratic pressure drop in both directions.

        source o---<=====>---o target      Q [L/min] = sign(dp) sqrt(|dp| / R)
                                           R = c3 D^3 + c2 D^2 + c1 D + c0, D in Fr

    Args:
        french: size D [Fr].
        coefficients: c3, c2, c1, c0 of R [mmHg min^2/L^2].

    Source: Getinge HLS data sheets (water), as fitted in the published code of Thiel et al.
    """

    french: Key
    coefficients: tuple[float, float, float, float]

    @property
    def above_zero(self) -> tuple[Key, ...]:
        """The size."""
        return (self.french,)

    def parameter_names(self) -> tuple[str, ...]:
        """The size."""
        return names_in(self.french)

    def constants(self, values: Values) -> Any:
        """R [mmHg s^2/mL^2]."""
        size = value_of(values, self.french)
        c3, c2, c1, c0 = self.coefficients
        return (((c3 * size + c2) * size + c1) * size + c0) / ML_S_PER_L_MIN**2

    def pressure_drop(self, flow: Any, constants: Any) -> Any:
        """R Q |Q| [mmHg]."""
        return constants * flow * jnp.abs(flow)

    def flow(self, pressure_difference: Any, load: Any, constants: Any) -> Any:
        """Flow [mL/s] in either direction."""
        root = jnp.sqrt(load * load + 4.0 * constants * jnp.abs(pressure_difference) + TINY)
        return 2.0 * pressure_difference / (load + root)
