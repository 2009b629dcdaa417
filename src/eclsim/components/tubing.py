"""Tubes of the extracorporeal circuits: resistance and inertance from length and diameter."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from eclsim.components.base import Key, Values, names_in, value_of
from eclsim.components.vessels import InertialResistance
from eclsim.units import PA_PER_MMHG

CUBIC_METRE_PER_ML = 1e-6


@dataclass(frozen=True)
class Tube(InertialResistance):
    """Laminar flow through a straight tube.

        source o===[ R ]===( L )===o target      L dQ/dt = dp - R Q
        R = 128 eta l / (pi d^4)                 (Hagen-Poiseuille)
        L = rho l / (pi d^2 / 4)

    Args:
        length: l [cm].
        diameter: inner diameter d [cm].
        viscosity: eta [Pa s].
        density: rho [kg/mL].

    Source: Thiel et al., section 2.2 and Tables S-1 to S-3.
    """

    length: Key
    diameter: Key
    viscosity: Key = "etaB"
    density: Key = "rhoB"

    @property
    def above_zero(self) -> tuple[Key, ...]:
        """Geometry and blood."""
        return (self.length, self.diameter, self.viscosity, self.density)

    def parameter_names(self) -> tuple[str, ...]:
        """Geometry and blood."""
        return sum((names_in(k) for k in (self.length, self.diameter, self.viscosity, self.density)), ())

    def constants(self, values: Values) -> Any:
        """R [mmHg s/mL] and L [mmHg s^2/mL]."""
        metres = value_of(values, self.length) / 100.0
        bore = value_of(values, self.diameter) / 100.0
        to_mmhg_ml = CUBIC_METRE_PER_ML / PA_PER_MMHG
        resistance = 128.0 * value_of(values, self.viscosity) * metres / (math.pi * bore**4) * to_mmhg_ml
        density = value_of(values, self.density) / CUBIC_METRE_PER_ML
        return resistance, density * metres / (math.pi / 4.0 * bore**2) * to_mmhg_ml
