"""Where blood takes up or gives off oxygen and carbon dioxide: tissue, native lung and membrane lung.

An exchanger sits on a connection. Blood that passes enters with given contents and is followed at `points`
inside; at the last one it leaves (a lung mixes what bypassed it to that). The logarithms of both partial
pressures at these points are the unknowns of the gas state, and `missing` says by how much the exchanger's
equations are not met: one for each gas and point, in mL/min STPD (a lung's in mL/min times mmHg over 713).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

BAROMETRIC_MMHG, WATER_VAPOUR_MMHG = 760.0, 47.0
DRY_MMHG = BAROMETRIC_MMHG - WATER_VAPOUR_MMHG
"""Pressure of dry gas in contact with blood at 37 C."""
BTPS_TO_STPD = 273.15 / 310.15 * DRY_MMHG / 760.0
"""Ventilation is stated as saturated gas at body temperature, exchange as dry gas at 0 C."""
FLOWMETER_TO_STPD = 273.15 / 293.15
"""Sweep gas is stated as a flowmeter shows it: dry gas at 20 C and 760 mmHg."""
AIR_CARBON_DIOXIDE = 4e-4
"""Fraction of carbon dioxide in inspired gas."""
RADAU = np.array([[5.0, -1.0], [9.0, 3.0]]) / 12.0
"""Weights of the rates at 1/3 and at the end of a cell (Radau IIA)."""

Values = Mapping[str, Array]


class Points(NamedTuple):
    """Blood at the points inside an exchanger; arrays (points,), or (2, points) for oxygen, carbon dioxide.

    Attributes:
        pressure: partial pressures [mmHg].
        content: contents [mL/dL].
        slope: derivative of the oxygen saturation with respect to PO2 at constant pH [1/mmHg].
    """

    pressure: Array
    content: Array
    slope: Array


class Exchanger(ABC):
    """A place where gases enter or leave the blood of a connection.

    Attributes:
        connection: name of the connection it sits on.
    """

    connection: str

    @property
    @abstractmethod
    def points(self) -> int:
        """Number of points inside at which the partial pressures are unknown."""

    @abstractmethod
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters that it reads."""

    @abstractmethod
    def outlet(self, inlet: Array, inside: Points, values: Values) -> Array:
        """Contents [mL/dL] of the blood that leaves, shape (2,)."""

    @abstractmethod
    def missing(self, flow: Array, inlet: Array, inside: Points, values: Values) -> Array:
        """What is not met yet, shape (2, points).

        Args:
            flow: of blood [L/min].
            inlet: contents of the blood that enters [mL/dL], shape (2,).
            inside: blood at the points.
            values: all parameters.
        """


@dataclass(frozen=True)
class Tissue(Exchanger):
    """Tissue that consumes oxygen and gives off carbon dioxide.

        in --(capillaries, VO2 = demand (1 - exp(-(PO2 / critical)^2)), VCO2 = RQ VO2)--> out

    PO2 is that of the blood that leaves. Demand is met to 2e-4 from three times the critical PO2 on; where
    supply does not allow it, consumption falls smoothly.

    Args:
        connection: the capillaries, such as `sart`.
        demand: parameter, oxygen that is wanted [mL/min STPD].
        quotient: parameter, carbon dioxide given off for each oxygen taken up [-].
        share: of the demand that is this tissue's [-].
        critical: PO2 at which consumption is 63 % of demand [mmHg].
    """

    connection: str
    demand: str = "gas.vo2_ml_min"
    quotient: str = "gas.respiratory_quotient"
    share: float = 1.0
    critical: float = 4.0

    @property
    def points(self) -> int:  # noqa: D102  (as documented in the base class; so below)
        return 1

    def parameter_names(self) -> tuple[str, ...]:  # noqa: D102
        return (self.demand, self.quotient)

    def outlet(self, inlet: Array, inside: Points, values: Values) -> Array:  # noqa: D102
        return inside.content[:, 0]

    def missing(self, flow: Array, inlet: Array, inside: Points, values: Values) -> Array:  # noqa: D102
        met = -jnp.expm1(-((inside.pressure[0, 0] / self.critical) ** 2))
        consumed = self.share * values[self.demand] * met
        gained = 10.0 * flow * (inside.content[:, 0] - inlet)
        return (gained - consumed * jnp.stack([-1.0, values[self.quotient]]))[:, None]


@dataclass(frozen=True)
class NativeLung(Exchanger):
    """The lung: alveoli in equilibrium with the blood that passes them, and a shunt past them (Riley).

        in --+--(alveoli)--> point --+--> out
             +-------shunt-----------+

    The gas of the alveoli is balanced with nitrogen, which crosses no membrane in the steady state:
    V_I F_I = V_E F_A + uptake for each gas. The usual alveolar gas equation does not hold on ECMO, where the
    lung's respiratory quotient can be anything. Without ventilation the blood passes unchanged.

    Args:
        connection: the pulmonary capillaries, such as `part`.
        ventilation: parameter, inspired alveolar ventilation [L/min BTPS].
        oxygen: parameter, inspired fraction of oxygen [-].
        shunt: parameter, share of the flow that passes no alveolus [-].
    """

    connection: str
    ventilation: str = "gas.alveolar_ventilation_l_min"
    oxygen: str = "gas.fio2"
    shunt: str = "gas.shunt_fraction"

    @property
    def points(self) -> int:  # noqa: D102
        return 1

    def parameter_names(self) -> tuple[str, ...]:  # noqa: D102
        return (self.ventilation, self.oxygen, self.shunt)

    def outlet(self, inlet: Array, inside: Points, values: Values) -> Array:  # noqa: D102
        return inlet + (1.0 - values[self.shunt]) * (inside.content[:, 0] - inlet)

    def missing(self, flow: Array, inlet: Array, inside: Points, values: Values) -> Array:  # noqa: D102
        gas = 1000.0 * BTPS_TO_STPD * values[self.ventilation]
        gained = 10.0 * flow * (1.0 - values[self.shunt]) * (inside.content[:, 0] - inlet)
        expired = gas - gained[0] - gained[1]
        inspired = gas * jnp.stack([values[self.oxygen], AIR_CARBON_DIOXIDE])
        return (gained + inside.pressure[:, 0] / DRY_MMHG * expired - inspired)[:, None]


@dataclass(frozen=True)
class MembraneLung(Exchanger):
    """A bundle of hollow fibres with blood outside and sweep gas inside, both followed along it.

        in --|point 1 .. point n|--> out;   sweep gas along the same way

    Q dC_O2/dx = k_O2 Q^b (1 + lambda)^(1/3) (P_gas - P),  lambda = 1.34 Hb (dS/dP) / 0.0031
    Q dC_CO2/dx = k_CO2 Q^0.6 (P_gas - P)

    with x from 0 to 1 along the bundle (Vaslef et al. 1994, ASAIO J 40:990); in every cell the collocation of
    Radau (third order, and stable at any ratio of membrane to flow).

    The gas changes by what the blood has taken up and given off on the way: CO2 is limited by the sweep at a
    low one and by the blood flow at a high one. Without sweep the blood passes unchanged. A clot takes away
    its share of the membrane.

    Args:
        connection: the oxygenator, such as `ecmooxy`.
        prefix: of the parameters `oxygen_transfer` [mL/min/mmHg at 1 L/min], `oxygen_exponent` [-],
            `carbon_dioxide_transfer` [mL/min/mmHg at 1 L/min], `clotted_fraction` [-].
        sweep: parameter, flow of the sweep gas [L/min, flowmeter at 20 C].
        oxygen: parameter, fraction of oxygen in it [-].
        cells: from inlet to outlet, with two points in each.
    """

    connection: str
    prefix: str = "ecmo.oxygenator."
    sweep: str = "ecmo.sweep_l_min"
    oxygen: str = "ecmo.fdo2"
    cells: int = 4

    @property
    def points(self) -> int:  # noqa: D102
        return 2 * self.cells

    def parameter_names(self) -> tuple[str, ...]:  # noqa: D102
        own = ("oxygen_transfer", "oxygen_exponent", "carbon_dioxide_transfer", "clotted_fraction")
        return (self.sweep, self.oxygen, *(self.prefix + name for name in own))

    def outlet(self, inlet: Array, inside: Points, values: Values) -> Array:  # noqa: D102
        return inside.content[:, -1]

    def missing(self, flow: Array, inlet: Array, inside: Points, values: Values) -> Array:  # noqa: D102
        gas = 1000.0 * FLOWMETER_TO_STPD * values[self.sweep]
        gained = 10.0 * flow * (inside.content - inlet[:, None])
        supplied = gas * jnp.stack([values[self.oxygen], AIR_CARBON_DIOXIDE])[:, None]
        left = gas - gained[0] - gained[1] + 1e-6
        partial = DRY_MMHG * (supplied - gained) / left
        rates = self.transfer(flow, inside.slope, values) * (partial - inside.pressure) * (gas / (gas + 1e-3))
        reached = gained.reshape(2, self.cells, 2)
        before = jnp.concatenate([jnp.zeros((2, 1)), reached[:, :-1, 1]], axis=1)
        within = rates.reshape(2, self.cells, 2) @ RADAU.T / self.cells
        return (reached - before[:, :, None] - within).reshape(2, self.points)

    def transfer(self, flow: Array, slope: Array, values: Values) -> Array:
        """Permeance of the whole membrane [mL/min/mmHg] for both gases at the points, shape (2, points)."""
        open_share = 1.0 - values[self.prefix + "clotted_fraction"]
        capacity = values["gas.oxygen_capacity_ml_g"] * values["gas.haemoglobin_g_dl"] * slope / 0.0031
        oxygen = values[self.prefix + "oxygen_transfer"] * flow ** values[self.prefix + "oxygen_exponent"]
        carbon_dioxide = values[self.prefix + "carbon_dioxide_transfer"] * flow**0.6
        boosted = oxygen * jnp.cbrt(1.0 + capacity)
        return open_share * jnp.stack([boosted, jnp.broadcast_to(carbon_dioxide, boosted.shape)])
