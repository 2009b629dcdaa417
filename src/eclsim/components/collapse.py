"""Veins that collapse: what is left in a vessel under suction, and how hard it is to draw through.

Of Lu et al. 2001 (thoracic vena cava): above its rest volume the vein is a vessel of constant compliance;
below, its cross-section buckles and blood leaves it at nearly one pressure; when hardly anything is left the
walls touch, and pressure falls without bound.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple

import jax.numpy as jnp

from eclsim.components.base import Activation, Key, Number, Storage, Values, value_of
from eclsim.components.chambers import AtrialBump, Chamber

REST_PRESSURE_MMHG = 0.3855
"""D1, pressure at the rest volume."""
REST_ML, BUCKLING_ML, EMPTYING_ML = 130.0, 50.0, 8.0
"""V0, Vmin and D_xv of Lu: volumes over which the vein is filled, buckles and empties."""
EMPTYING_MMHG = 2.0
"""K_xv, pressure scale of emptying."""
ROUNDING = 0.04
"""Width over which both branches are blended, as a share of the rest volume; Lu's have a kink there."""
FURTHEST = 40.0
"""Widths beyond the rest volume at which the buckling branch no longer counts (its weight is e^-40)."""
EMPTY = 0.01
"""Share of the emptying volume below which its pressure (-200 mmHg there) goes on as a straight line."""


def emptying(volume: Number, scale: Number) -> tuple[Number, Number]:
    """Pressure [mmHg] by which walls that touch resist, 2 / (exp(V / scale) - 1), and its slope."""
    relative = volume / scale
    inside = jnp.where(relative.real > EMPTY, relative, EMPTY)
    grown = jnp.expm1(jnp.where(inside.real > FURTHEST, FURTHEST, inside))
    pressure = EMPTYING_MMHG / grown
    slope = -pressure * (1.0 + 1.0 / grown)
    return pressure + slope * jnp.where(relative.real > EMPTY, 0.0, relative - EMPTY), slope / scale


class VeinConstants(NamedTuple):
    """Constants of a collapsible vein."""

    stiffness: Number
    rest_volume: Number
    collapse_pressure: Number
    resistance: Number
    reference_volume: Number


@dataclass(frozen=True)
class CollapsibleVein(Storage[VeinConstants]):
    """A large vein that collapses when it is drained.

        o---+---[ R(V) ]---o       V > V0:  P = D1 + (V - V0) / C - psi
            |                      V < V0:  P = D2 + (D1 - D2) exp((V - V0) / Vb) - psi
           (=) V                   psi = 2 / (exp(V / Ve) - 1),  R = Rr (Vr / V)^2

    D1 = 0.3855 mmHg; Vb and Ve are 50 and 8 mL at V0 = 130 mL and in proportion to it otherwise. The branches
    meet at V0 with slopes of 0.15 and 0.11 mmHg/mL; they are blended over 5 mL. V is all blood in the vein.

    Args:
        compliance: C above the rest volume [mL/mmHg].
        rest_volume: V0 [mL].
        collapse_pressure: D2, at which the vein empties [mmHg].
        resistance: Rr, that of its outlet at the pressure `reference` [mmHg s/mL].
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
        beyond, width, buckling = volume - rest, ROUNDING * rest, BUCKLING_ML / REST_ML * rest
        steps = beyond / width
        near = jnp.where(steps.real > FURTHEST, FURTHEST, steps)
        share = 1.0 / (1.0 + jnp.exp(-jnp.where(near.real < -FURTHEST, -FURTHEST, near)))
        depth = (REST_PRESSURE_MMHG - low) * jnp.exp(near * width / buckling)
        buckled, filled = low + depth, REST_PRESSURE_MMHG + constants.stiffness * beyond
        touching, slope = emptying(volume, EMPTYING_ML / REST_ML * rest)
        pressure = buckled + share * (filled - buckled) - touching
        blended = share * (1.0 - share) / width * (filled - buckled)
        stiffness = depth / buckling * (1.0 - share) + share * constants.stiffness + blended - slope
        return pressure, stiffness

    def outlet(self, volume: Number, constants: VeinConstants) -> Number:
        """R(V) [mmHg s/mL]; the same below what an empty vein holds."""
        least = EMPTY * EMPTYING_ML / REST_ML * constants.rest_volume
        held = jnp.where(volume > least, volume, least)
        return constants.resistance * (constants.reference_volume / held) ** 2


class EmptyingConstants(NamedTuple):
    """Elastance at rest and its swing [mmHg/mL], volume over which the atrium empties [mL]."""

    rest: Number
    swing: Number
    scale: Number


@dataclass(frozen=True)
class CollapsibleAtrium(Chamber[EmptyingConstants]):
    """An atrium that cannot be drained below empty.

    P = E V - psi,  E = diastolic + (systolic - diastolic) * a(phase),  psi = 2 / (exp(V / Ve) - 1).

    Args:
        diastolic: elastance at rest [mmHg/mL].
        systolic: elastance at peak [mmHg/mL].
        emptying: Ve [mL].
        timing: activation curve.

    Source: the published atrium (Thiel et al., Table S-1) with the emptying of Lu et al. 2001 (see above).
    """

    diastolic: Key
    systolic: Key
    emptying: Key
    timing: Activation = field(default_factory=AtrialBump)
    not_negative: ClassVar = ("diastolic", "systolic")
    above_zero: ClassVar = ("emptying",)

    def constants(self, values: Values) -> EmptyingConstants:
        """Elastance at rest, its swing, and Ve."""
        rest = value_of(values, self.diastolic)
        return EmptyingConstants(
            rest, value_of(values, self.systolic) - rest, value_of(values, self.emptying)
        )

    def pressure(
        self, volume: Number, activation: Number, constants: EmptyingConstants
    ) -> tuple[Number, Number]:
        """Pressure [mmHg] and stiffness [mmHg/mL]."""
        elastance = constants.rest + constants.swing * activation
        touching, slope = emptying(volume, constants.scale)
        return elastance * volume - touching, elastance - slope
