"""Elastic compartments and the resistances between them: vessels, oxygenators, dialyzers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from eclsim.components.base import Key, Path, Storage, Values, names_in, value_of


@dataclass(frozen=True)
class ElasticVessel(Storage):
    """Blood vessel, tubing, cannula, oxygenator or dialyzer as a store of blood.

        o---+---o      P = V / C
            |
           === C
            |

    Args:
        compliance: C [mL/mmHg].

    Source: Thiel et al., Tables S-1 to S-3.
    """

    compliance: Key

    @property
    def constant_stiffness(self) -> bool:
        """1 / C does not change over the beat."""
        return True

    @property
    def above_zero(self) -> tuple[Key, ...]:
        """The compliance."""
        return (self.compliance,)

    def parameter_names(self) -> tuple[str, ...]:
        """The compliance."""
        return names_in(self.compliance)

    def constants(self, values: Values) -> Any:
        """Stiffness 1 / C [mmHg/mL]."""
        return 1.0 / value_of(values, self.compliance)

    def pressure(self, volume: Any, activation: Any, constants: Any) -> tuple[Any, Any]:
        """Pressure [mmHg] and stiffness [mmHg/mL]."""
        return constants * volume, constants


@dataclass(frozen=True)
class Resistance(Path):
    """Flow through a resistance: veins, oxygenator, dialyzer.

        source o---[ R ]---o target      Q = dp / R

    Args:
        ohmic: R [mmHg s/mL]; several names are summed (resistances in series).

    Source: Thiel et al., Tables S-1 to S-3.
    """

    ohmic: Key

    @property
    def linear(self) -> bool:
        """The drop is R Q."""
        return True

    @property
    def not_negative(self) -> tuple[Key, ...]:
        """The resistances."""
        return (self.ohmic,)

    def parameter_names(self) -> tuple[str, ...]:
        """The resistances."""
        return names_in(self.ohmic)

    def constants(self, values: Values) -> Any:
        """R [mmHg s/mL]."""
        return value_of(values, self.ohmic)

    def resistance(self, constants: Any) -> Any:
        """R [mmHg s/mL]."""
        return constants

    def pressure_drop(self, flow: Any, constants: Any) -> Any:
        """R Q [mmHg]."""
        return constants * flow

    def flow(self, pressure_difference: Any, load: Any, constants: Any) -> Any:
        """dp / (R + load) [mL/s]."""
        return pressure_difference / (constants + load)


@dataclass(frozen=True)
class InertialResistance(Path):
    """Friction and inertia in series, L dQ/dt = dp - R Q; `constants` are R [mmHg s/mL], L [mmHg s^2/mL]."""

    @property
    def inertial(self) -> bool:
        """The flow is a state."""
        return True

    @property
    def linear(self) -> bool:
        """The drop is R Q."""
        return True

    def inertance(self, constants: Any) -> Any:
        """L [mmHg s^2/mL]."""
        return constants[1]

    def resistance(self, constants: Any) -> Any:
        """R [mmHg s/mL]."""
        return constants[0]

    def pressure_drop(self, flow: Any, constants: Any) -> Any:
        """R Q [mmHg]."""
        return constants[0] * flow

    def flow(self, pressure_difference: Any, load: Any, constants: Any) -> Any:
        """dp / (R + load) [mL/s]; the load carries the inertia of the step."""
        return pressure_difference / (constants[0] + load)


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

    @property
    def not_negative(self) -> tuple[Key, ...]:
        """Resistances and inertance."""
        return (self.ohmic, self.inertia)

    def parameter_names(self) -> tuple[str, ...]:
        """Resistances and inertance."""
        return names_in(self.ohmic) + names_in(self.inertia)

    def constants(self, values: Values) -> Any:
        """R [mmHg s/mL] and L [mmHg s^2/mL]."""
        return value_of(values, self.ohmic), value_of(values, self.inertia)
