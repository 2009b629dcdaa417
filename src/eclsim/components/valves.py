"""Heart valves: one-way orifices given by a flow coefficient or an area, leaking valves and open orifices."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

import jax.numpy as jnp

from eclsim.components.base import Derived, Key, Number, Path, Values, value_of
from eclsim.units import PA_PER_MMHG


@dataclass(frozen=True)
class Orifice(Derived):
    """Flow coefficient [mL/(s mmHg^1/2)] of an orifice, computed from its area.

    The jet converts pressure to velocity, dp = rho v^2 / 2 (Bernoulli), and fills the effective orifice area
    at its narrowest: Q = A sqrt(2 dp / rho), so CQ = A sqrt(2 / rho), 50.2 per cm^2 for blood of 1060 kg/m^3.
    Pressure recovery downstream of the orifice is neglected.

    Args:
        area: effective orifice area A [cm^2], smaller than the anatomical area.
        density: rho [kg/mL].

    Source: Gorlin and Gorlin 1951, doi 10.1016/0002-8703(51)90002-6; Garcia et al. 2000,
    doi 10.1161/01.CIR.101.7.765 (effective area and recovery).
    """

    area: Key
    density: Key = "rhoB"

    def value(self, values: Values) -> Number:
        """The flow coefficient."""
        per_metre = value_of(values, self.density) * 1e6  # kg/m^3
        return value_of(values, self.area) * 100.0 * (2.0 * PA_PER_MMHG / per_metre) ** 0.5


@dataclass(frozen=True)
class HeartValve(Path[Number]):
    """One-way valve with a pressure drop that grows with the square of the flow.

        source o---|>|---o target      Q = CQ sqrt(dp) if dp > 0, else 0

    Under a load b the open valve solves dp = b Q + Q^2 / CQ^2 in closed form,
    Q = 2 dp / (b + sqrt(b^2 + 4 dp / CQ^2)), which stays smooth where sqrt(dp) is stiff.

    Args:
        coefficient: CQ [mL/(s mmHg^1/2)].
        smoothing: width [mmHg] over which max(dp, 0) is rounded off where there is no load; used only by the
            explicit verification solver.

    Source: Thiel et al., section 2.2 and Table S-1 (`CQtri`, `CQpa`, `CQmi`, `CQao`).
    """

    coefficient: Key
    smoothing: float = 1e-3
    above_zero: ClassVar = ("coefficient",)
    one_way: ClassVar = True

    def constants(self, values: Values) -> Number:
        """4 / CQ^2 [mmHg s^2/mL^2]."""
        return 4.0 / value_of(values, self.coefficient) ** 2

    def pressure_drop(self, flow: Number, constants: Number) -> Number:
        """Q^2 / CQ^2 [mmHg] for forward flow, 0 for backward flow."""
        return 0.25 * constants * jnp.square(jnp.maximum(flow, 0.0))

    def flow(self, pressure_difference: Number, load: Number, constants: Number) -> Number:
        """Flow [mL/s]; never negative."""
        if isinstance(load, float) and load == 0.0:
            rounded = jnp.sqrt(pressure_difference**2 + self.smoothing**2)
            forward = 0.5 * (pressure_difference + rounded)
            return 2.0 * jnp.sqrt(forward / constants)
        forward = jnp.maximum(pressure_difference, 0.0)
        return 2.0 * forward / (load + jnp.sqrt(load * load + constants * forward))

    def sharpened(self, smoothing: float) -> HeartValve:
        """The same valve with another smoothing width [mmHg]."""
        return replace(self, smoothing=smoothing)


NO_LEAK = 1e-20
"""Keeps the constant of a tight valve finite [mL/(s mmHg^1/2)]; too small to change that of any leak."""


class LeakingConstants(NamedTuple):
    """4 / CQ^2 of the open and 4 / CR^2 of the closed valve [mmHg s^2/mL^2]."""

    forward: Number
    backward: Number


@dataclass(frozen=True)
class LeakingValve(Path[LeakingConstants]):
    """Heart valve that does not close completely: an orifice in each direction.

        source o---|>|---o target      Q = CQ sqrt(dp) if dp > 0, else -CR sqrt(-dp)

    Args:
        coefficient: CQ of the open valve [mL/(s mmHg^1/2)].
        leak: CR of the closed valve, such as `Orifice` of its effective regurgitant orifice area.

    Source: orifice equation as in `Orifice`; effective regurgitant orifice area as graded in Zoghbi et al.
    2017, doi 10.1016/j.echo.2017.01.007 (aortic and mitral: severe from 0.3 and 0.4 cm^2).
    """

    coefficient: Key
    leak: Key
    above_zero: ClassVar = ("coefficient",)
    not_negative: ClassVar = ("leak",)
    one_way: ClassVar = True
    leaks: ClassVar = True

    def is_leaking(self, values: Mapping[str, float]) -> bool:
        """Whether the leak is above 0."""
        known = set(self.names_of(("leak",))) <= values.keys()
        return not known or float(value_of(values, self.leak)) > 0.0

    def constants(self, values: Values) -> LeakingConstants:
        """Constants of both orifices."""
        leak = value_of(values, self.leak) + NO_LEAK
        return LeakingConstants(4.0 / value_of(values, self.coefficient) ** 2, 4.0 / leak**2)

    def pressure_drop(self, flow: Number, constants: LeakingConstants) -> Number:
        """Q |Q| / CQ^2 [mmHg] with the coefficient of the flow's direction."""
        return 0.25 * flow * jnp.abs(flow) * jnp.where(flow > 0.0, *constants)

    def flow(self, pressure_difference: Number, load: Number, constants: LeakingConstants) -> Number:
        """Flow [mL/s] in either direction."""
        width = 1e-12 if isinstance(load, float) and load == 0.0 else 0.0  # a slope at rest without a load
        squared = jnp.where(pressure_difference > 0.0, *constants) * jnp.abs(pressure_difference)
        return 2.0 * pressure_difference / (load + jnp.sqrt(load * load + squared + width))


@dataclass(frozen=True)
class OpenOrifice(Path[Number]):
    """Open hole with turbulent flow in either direction.

        source o---) (---o target      Q = CQ sqrt(dp) if dp > 0, else -CQ sqrt(-dp)

    Args:
        coefficient: CQ [mL/(s mmHg^1/2)], such as `Orifice` of its effective area.
    """

    coefficient: Key
    above_zero: ClassVar = ("coefficient",)

    def constants(self, values: Values) -> Number:
        """1 / CQ^2 [mmHg s^2/mL^2]."""
        return 1.0 / value_of(values, self.coefficient) ** 2

    def pressure_drop(self, flow: Number, constants: Number) -> Number:
        """Q |Q| / CQ^2 [mmHg]."""
        return constants * flow * jnp.abs(flow)

    def flow(self, pressure_difference: Number, load: Number, constants: Number) -> Number:
        """Flow [mL/s] in either direction; its slope at rest stays finite without a load."""
        squared = load * load + 4.0 * constants * jnp.abs(pressure_difference) + 1e-18
        return 2.0 * pressure_difference / (load + jnp.sqrt(squared))
