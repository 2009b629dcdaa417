"""Elastic compartments and the resistances between them: vessels, oxygenators, dialyzers, tubes, cannulae."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import jax.numpy as jnp

from eclsim.components.base import Component, Key, Number, Path, Storage, Values, value_of
from eclsim.units import ML_S_PER_L_MIN, PA_PER_MMHG


class VesselConstants(NamedTuple):
    """Stiffness 1 / C [mmHg/mL] and unstressed volume [mL]."""

    stiffness: Number
    unstressed: Number


@dataclass(frozen=True)
class ElasticVessel(Storage[VesselConstants]):
    """Compartment of constant compliance: blood vessel, tubing, cannula, oxygenator or dialyzer.

        o---+---o      P = (V - Vu) / C
            |
           === C
            |

    Args:
        compliance: C [mL/mmHg].
        unstressed: Vu, the part of the volume V that causes no pressure [mL]. In the published model V is the
            stressed volume alone, so that Vu is 0; a reflex that contracts the veins lowers it.

    Source: Thiel et al., Tables S-1 to S-3.
    """

    compliance: Key
    unstressed: Key = 0.0
    constant_stiffness: ClassVar = True
    above_zero: ClassVar = ("compliance",)

    def constants(self, values: Values) -> VesselConstants:
        """Stiffness and unstressed volume."""
        return VesselConstants(1.0 / value_of(values, self.compliance), value_of(values, self.unstressed))

    def pressure(
        self, volume: Number, activation: Number, constants: VesselConstants
    ) -> tuple[Number, Number]:
        """Pressure [mmHg] and stiffness [mmHg/mL]."""
        stressed = volume if self.unstressed == 0.0 else volume - constants.unstressed
        return constants.stiffness * stressed, constants.stiffness


@dataclass(frozen=True)
class Resistance(Path[Number]):
    """Flow through a resistance: veins, oxygenator, dialyzer.

        source o---[ R ]---o target      Q = dp / R

    Args:
        ohmic: R [mmHg s/mL]; several names are summed (resistances in series).

    Source: Thiel et al., Tables S-1 to S-3.
    """

    ohmic: Key
    linear: ClassVar = True
    not_negative: ClassVar = ("ohmic",)

    def constants(self, values: Values) -> Number:
        """R [mmHg s/mL]."""
        return value_of(values, self.ohmic)

    def resistance(self, constants: Number) -> Number:
        """R [mmHg s/mL]."""
        return constants

    def pressure_drop(self, flow: Number, constants: Number) -> Number:
        """R Q [mmHg]."""
        return constants * flow

    def flow(self, pressure_difference: Number, load: Number, constants: Number) -> Number:
        """dp / (R + load) [mL/s]."""
        return pressure_difference / (constants + load)


class InertialConstants(NamedTuple):
    """Resistance [mmHg s/mL] and inertance [mmHg s^2/mL]."""

    resistance: Number
    inertance: Number


class InertialResistance(Path[InertialConstants]):
    """Friction and inertia in series, L dQ/dt = dp - R Q."""

    linear: ClassVar = True

    @property
    def inertial(self) -> bool:
        """True: the flow is a state."""
        return True

    def inertance(self, constants: InertialConstants) -> Number:
        """L [mmHg s^2/mL]."""
        return constants.inertance

    def resistance(self, constants: InertialConstants) -> Number:
        """R [mmHg s/mL]."""
        return constants.resistance

    def pressure_drop(self, flow: Number, constants: InertialConstants) -> Number:
        """R Q [mmHg]."""
        return constants.resistance * flow

    def flow(self, pressure_difference: Number, load: Number, constants: InertialConstants) -> Number:
        """dp / (R + load) [mL/s]; the load includes the inertia term of the step."""
        return pressure_difference / (constants.resistance + load)


@dataclass(frozen=True)
class Artery(InertialResistance):
    """Flow through a vessel with friction and inertia.

        source o---[ R ]---( L )---o target      L dQ/dt = dp - R Q

    Args:
        ohmic: R [mmHg s/mL]; several names are summed.
        inertia: L [mmHg s^2/mL].

    Source: Thiel et al., Table S-1; the systemic microcirculation is in series: R = Rsart + Rmc, L = Lsart.
    """

    ohmic: Key
    inertia: Key
    not_negative: ClassVar = ("ohmic", "inertia")

    def constants(self, values: Values) -> InertialConstants:
        """R and L."""
        return InertialConstants(value_of(values, self.ohmic), value_of(values, self.inertia))


# --- tubes and cannulae -----------------------------------------------------------------------------


CUBIC_METRE_PER_ML = 1e-6
SMALLEST_OPENING = 1e-9
"""Keeps the resistance of a closed clamp finite; it leaks about 0.001 mL/s."""
SMALLEST_LOAD = 1e-12
"""Keeps the square root differentiable at zero flow; far below the rounding of a flow [mmHg^2 s^2/mL^2]."""


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
    above_zero: ClassVar = ("length", "diameter", "viscosity", "density")

    def constants(self, values: Values) -> InertialConstants:
        """R and L."""
        metres = value_of(values, self.length) / 100.0
        bore = value_of(values, self.diameter) / 100.0
        to_mmhg_ml = CUBIC_METRE_PER_ML / PA_PER_MMHG
        resistance = 128.0 * value_of(values, self.viscosity) * metres / (math.pi * bore**4) * to_mmhg_ml
        density = value_of(values, self.density) / CUBIC_METRE_PER_ML
        return InertialConstants(resistance, density * metres / (math.pi / 4.0 * bore**2) * to_mmhg_ml)


@dataclass(frozen=True)
class TubeVolume(Component):
    """Volume of a tube at zero pressure [mL], pi d^2 l / 4, from length l and inner diameter d [cm]."""

    length: Key
    diameter: Key

    def volume(self, values: Values) -> Number:
        """Volume [mL]."""
        return math.pi / 4.0 * value_of(values, self.diameter) ** 2 * value_of(values, self.length)


@dataclass(frozen=True)
class Cannula(Path[Number]):
    """Cannula as a turbulent orifice: quadratic pressure drop in both directions, from the French size.

        source o---<=====>---o target      Q [L/min] = sign(dp) sqrt(|dp| / R)
                                           R = c3 D^3 + c2 D^2 + c1 D + c0, D in Fr

    Args:
        french: size D [Fr].
        coefficients: c3, c2, c1, c0 of R [mmHg min^2/L^2].
        clamp: share of its area that is closed; the number 0 for no clamp.
        viscosity: factor of R for the viscosity of blood; the number 1 for none.

    Source: Getinge HLS data sheets (water), as fitted in the published code of Thiel et al.
    """

    french: Key
    coefficients: tuple[float, float, float, float]
    clamp: Key = 0.0
    viscosity: Key = 1.0
    above_zero: ClassVar = ("french",)

    def constants(self, values: Values) -> Number:
        """R [mmHg s^2/mL^2]."""
        size = value_of(values, self.french)
        c3, c2, c1, c0 = self.coefficients
        resistance = (((c3 * size + c2) * size + c1) * size + c0) / ML_S_PER_L_MIN**2
        if self.viscosity != 1.0:
            resistance = resistance * value_of(values, self.viscosity)
        if self.clamp == 0.0:
            return resistance
        return resistance / ((1.0 - value_of(values, self.clamp)) ** 2 + SMALLEST_OPENING)

    def pressure_drop(self, flow: Number, constants: Number) -> Number:
        """R Q |Q| [mmHg]."""
        return constants * flow * jnp.abs(flow)

    def flow(self, pressure_difference: Number, load: Number, constants: Number) -> Number:
        """Flow [mL/s] in either direction."""
        root = jnp.sqrt(load * load + 4.0 * constants * jnp.abs(pressure_difference) + SMALLEST_LOAD)
        return 2.0 * pressure_difference / (load + root)
