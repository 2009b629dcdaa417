"""Elastic compartments and the resistances between them: vessels, oxygenators, dialyzers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from eclsim.components.base import Key, Number, Path, Storage, Values, value_of


class VesselConstants(NamedTuple):
    """Stiffness 1 / C [mmHg/mL] and unstressed volume [mL]."""

    stiffness: Number
    unstressed: Number


@dataclass(frozen=True)
class ElasticVessel(Storage[VesselConstants]):
    """Blood vessel, tubing, cannula, oxygenator or dialyzer as a store of blood.

        o---+---o      P = (V - Vu) / C
            |
           === C
            |

    Args:
        compliance: C [mL/mmHg].
        unstressed: Vu, the part of the volume V that makes no pressure [mL]. The published model counts
            stressed volumes alone, so that it is 0; a reflex that contracts the veins lowers it.

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


class Inertial(NamedTuple):
    """Resistance [mmHg s/mL] and inertance [mmHg s^2/mL]."""

    resistance: Number
    inertance: Number


class InertialResistance(Path[Inertial]):
    """Friction and inertia in series, L dQ/dt = dp - R Q."""

    linear: ClassVar = True

    @property
    def inertial(self) -> bool:
        """The flow is a state."""
        return True

    def inertance(self, constants: Inertial) -> Number:
        """L [mmHg s^2/mL]."""
        return constants.inertance

    def resistance(self, constants: Inertial) -> Number:
        """R [mmHg s/mL]."""
        return constants.resistance

    def pressure_drop(self, flow: Number, constants: Inertial) -> Number:
        """R Q [mmHg]."""
        return constants.resistance * flow

    def flow(self, pressure_difference: Number, load: Number, constants: Inertial) -> Number:
        """dp / (R + load) [mL/s]; the load carries the inertia of the step."""
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

    def constants(self, values: Values) -> Inertial:
        """R and L."""
        return Inertial(value_of(values, self.ohmic), value_of(values, self.inertia))
