"""Elastic compartments and the resistances between them: vessels, oxygenators, dialyzers, tubes, cannulae.

Collapsible veins follow the law of Lu et al. 2001 (thoracic vena cava). Above its rest volume the vein is a
vessel of constant compliance. Below, its cross-section buckles and blood leaves it at a nearly constant
pressure. When it is almost empty, its walls touch and pressure falls without bound.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import jax.numpy as jnp

from eclsim.components.base import (
    Activation,
    Component,
    Key,
    Number,
    Path,
    Renaming,
    Storage,
    Values,
    names_in,
    renamed,
    value_of,
)
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


# --- collapsible veins ----------------------------------------------------------------------------

REST_PRESSURE_MMHG = 0.3855
"""D1, pressure at the rest volume [mmHg]."""
REST_ML, BUCKLING_ML, EMPTYING_ML = 130.0, 50.0, 8.0
"""V0, Vmin and D_xv of Lu: rest volume and the volumes over which the vein buckles and empties [mL]."""
EMPTYING_MMHG = 2.0
"""K_xv, pressure scale of emptying [mmHg]."""
BLENDING_WIDTH = 0.04
"""Width over which both branches are blended, as a share of the rest volume; Lu's law has a kink there."""
LARGEST_EXPONENT = 40.0
"""Blending widths beyond the rest volume at which the buckling branch is negligible (weight e^-40)."""
SMALLEST_VOLUME_SHARE = 0.01
"""Share of the emptying volume below which the pressure (-200 mmHg there) is continued as a straight line."""


def emptying(volume: Number, scale: Number) -> tuple[Number, Number]:
    """Pressure loss [mmHg] due to touching walls, 2 / (exp(V / scale) - 1), and its slope [mmHg/mL]."""
    relative = volume / scale
    inside = jnp.where(relative.real > SMALLEST_VOLUME_SHARE, relative, SMALLEST_VOLUME_SHARE)
    grown = jnp.expm1(jnp.where(inside.real > LARGEST_EXPONENT, LARGEST_EXPONENT, inside))
    pressure = EMPTYING_MMHG / grown
    slope = -pressure * (1.0 + 1.0 / grown)
    return pressure + slope * jnp.where(
        relative.real > SMALLEST_VOLUME_SHARE, 0.0, relative - SMALLEST_VOLUME_SHARE
    ), slope / scale


class VeinConstants(NamedTuple):
    """Constants of a collapsible vein."""

    stiffness: Number
    rest_volume: Number
    collapse_pressure: Number
    resistance: Number
    reference_volume: Number


@dataclass(frozen=True)
class CollapsibleVein(Storage[VeinConstants]):
    """Large vein that collapses when it is drained.

        o---+---[ R(V) ]---o       V > V0:  P = D1 + (V - V0) / C - psi
            |                      V < V0:  P = D2 + (D1 - D2) exp((V - V0) / Vb) - psi
           (=) V                   psi = 2 / (exp(V / Ve) - 1),  R = Rr (Vr / V)^2

    D1 = 0.3855 mmHg. Vb and Ve are 50 and 8 mL at V0 = 130 mL and proportional to V0 otherwise. The branches
    meet at V0 with slopes of 0.15 and 0.11 mmHg/mL; they are blended over 5 mL. V is all blood in the vein.

    Args:
        compliance: C above the rest volume [mL/mmHg].
        rest_volume: V0 [mL].
        collapse_pressure: D2, at which the vein empties [mmHg].
        resistance: Rr, resistance of the outlet at the pressure `reference` [mmHg s/mL].
        reference: pressure [mmHg] at which the vein holds Vr.

    Source: Lu et al. 2001, doi 10.1152/ajpheart.2001.281.6.H2661, as in Albanese et al. 2016, doi
    10.1152/ajpheart.00230.2014, Table 2 (D2 = -5 mmHg, with which the branches meet).
    """

    compliance: Key
    rest_volume: Key
    collapse_pressure: Key
    resistance: Key
    reference: Key
    above_zero: ClassVar = ("compliance", "rest_volume")
    not_negative: ClassVar = ("resistance",)
    narrows: ClassVar = True

    def constants(self, values: Values) -> VeinConstants:
        """Stiffness, volumes, pressure and resistance."""
        compliance, rest = value_of(values, self.compliance), value_of(values, self.rest_volume)
        filled = value_of(values, self.reference) - REST_PRESSURE_MMHG
        keys = value_of(values, self.collapse_pressure), value_of(values, self.resistance)
        return VeinConstants(1.0 / compliance, rest, *keys, rest + compliance * filled)

    def pressure(self, volume: Number, activation: Number, constants: VeinConstants) -> tuple[Number, Number]:
        """Pressure [mmHg] and stiffness [mmHg/mL]."""
        rest, low = constants.rest_volume, constants.collapse_pressure
        beyond, width, buckling = volume - rest, BLENDING_WIDTH * rest, BUCKLING_ML / REST_ML * rest
        steps = beyond / width
        near = jnp.where(steps.real > LARGEST_EXPONENT, LARGEST_EXPONENT, steps)
        share = 1.0 / (1.0 + jnp.exp(-jnp.where(near.real < -LARGEST_EXPONENT, -LARGEST_EXPONENT, near)))
        depth = (REST_PRESSURE_MMHG - low) * jnp.exp(near * width / buckling)
        buckled, filled = low + depth, REST_PRESSURE_MMHG + constants.stiffness * beyond
        touching, slope = emptying(volume, EMPTYING_ML / REST_ML * rest)
        pressure = buckled + share * (filled - buckled) - touching
        blended = share * (1.0 - share) / width * (filled - buckled)
        stiffness = depth / buckling * (1.0 - share) + share * constants.stiffness + blended - slope
        return pressure, stiffness

    def outlet(self, volume: Number, constants: VeinConstants) -> Number:
        """R(V) [mmHg s/mL], constant below the residual volume of an empty vein."""
        least = SMALLEST_VOLUME_SHARE * EMPTYING_ML / REST_ML * constants.rest_volume
        held = jnp.where(volume > least, volume, least)
        return constants.resistance * (constants.reference_volume / held) ** 2


class ChamberConstants(NamedTuple):
    """Constants of the chamber itself, and the volume over which it empties [mL]."""

    chamber: object
    scale: Number


@dataclass(frozen=True)
class CollapsibleChamber(Storage[ChamberConstants]):
    """Heart chamber whose volume cannot fall below zero.

    P = P of the chamber - psi,  psi = 2 / (exp(V / Ve) - 1).

    Args:
        chamber: law of the chamber while it holds blood.
        emptying: Ve, volume over which it empties [mL].

    Source: emptying as in Lu et al. 2001 (see above); the published chamber laws continue to negative
        volumes.
    """

    chamber: Storage
    emptying: Key

    @property
    def activation(self) -> Activation | None:
        """Activation of the chamber."""
        return self.chamber.activation

    @property
    def above_zero(self) -> tuple[str, ...]:  # pyright: ignore[reportIncompatibleVariableOverride]  # read only
        """Fields of the chamber's law, and `emptying`."""
        return (*self.chamber.above_zero, "emptying")

    @property
    def not_negative(self) -> tuple[str, ...]:  # pyright: ignore[reportIncompatibleVariableOverride]  # read only
        """Fields of the chamber's law."""
        return self.chamber.not_negative

    def names_of(self, wanted: Iterable[str]) -> tuple[str, ...]:
        """Names of the parameters in the given fields of the chamber's law and of this one."""
        fields = tuple(wanted)
        own = names_in(self.emptying) if "emptying" in fields else ()
        return self.chamber.names_of(field for field in fields if field != "emptying") + own

    def parameter_names(self) -> tuple[str, ...]:
        """Names of the chamber's parameters and of Ve."""
        return self.chamber.parameter_names() + names_in(self.emptying)

    def renamed(self, parameter: Renaming) -> CollapsibleChamber:
        """The same law with its parameters renamed."""
        return CollapsibleChamber(self.chamber.renamed(parameter), renamed(self.emptying, parameter))

    def softens(self, volume: float, values: Values) -> bool:
        """Whether contraction lowers the chamber's pressure."""
        return self.chamber.softens(volume, values)

    def constants(self, values: Values) -> ChamberConstants:
        """Constants of the chamber, and Ve."""
        return ChamberConstants(self.chamber.constants(values), value_of(values, self.emptying))

    def pressure(
        self, volume: Number, activation: Number, constants: ChamberConstants
    ) -> tuple[Number, Number]:
        """Pressure [mmHg] and stiffness [mmHg/mL]."""
        pressure, stiffness = self.chamber.pressure(volume, activation, constants.chamber)
        touching, slope = emptying(volume, constants.scale)
        return pressure - touching, stiffness - slope
