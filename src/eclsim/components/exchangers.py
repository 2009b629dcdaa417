"""Where blood takes up or gives off oxygen and carbon dioxide: tissue, native lung and membrane lung.

The circuit says along which connection it happens. Blood that passes enters with given contents and is
followed at `points` inside; at the last one it leaves (a lung mixes what bypassed it to that). The logarithms
of both partial pressures at these points are the unknowns of the gas state, and `missing` says by how much
the exchanger's equations are not met: one for each gas and point, in mL/min STPD (a lung's in mL/min times
mmHg over 713).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from eclsim.components.base import Exchanger, Key, Number, Values, value_of

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

HAEMOGLOBIN, OXYGEN_CAPACITY = "gas.haemoglobin_g_dl", "gas.oxygen_capacity_ml_g"
BLOOD = (HAEMOGLOBIN, "gas.base_excess_mmol_l", "gas.temperature_c", OXYGEN_CAPACITY)
"""Parameters of the blood, which is the same everywhere."""


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


class GasExchanger(Exchanger, ABC):
    """The law of a place where oxygen and carbon dioxide enter or leave the blood of a connection."""

    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters that the law reads, those of the blood among them."""
        return (*super().parameter_names(), *BLOOD)

    @property
    @abstractmethod
    def points(self) -> int:
        """Number of points inside at which the partial pressures are unknown."""

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
class Tissue(GasExchanger):
    """Tissue that consumes oxygen and gives off carbon dioxide.

        in --(capillaries, VO2 = demand (1 - exp(-(PO2 / critical)^2)), VCO2 = RQ VO2)--> out

    PO2 is that of the blood that leaves. Demand is met to 2e-4 from three times the critical PO2 on; where
    supply does not allow it, consumption falls smoothly.

    Args:
        demand: parameter, oxygen that is wanted [mL/min STPD].
        quotient: parameter, carbon dioxide given off for each oxygen taken up [-].
        share: of the demand that is this tissue's [-], a parameter or a number.
        critical: PO2 at which consumption is 63 % of demand [mmHg].
        held: where stores of the tissue hold its PCO2, 1; else, 0, it is steady; a number 0 for no stores.
        stored: parameter, PCO2 that the stores hold [mmHg].
    """

    demand: Key = "gas.vo2_ml_min"
    quotient: Key = "gas.respiratory_quotient"
    share: Key = 1.0
    critical: float = 4.0
    held: Key = 0.0
    stored: Key = 0.0

    @property
    def points(self) -> int:  # noqa: D102  (as documented in the base class; so below)
        return 1

    def wanted(self, values: Values) -> Number:
        """Oxygen that this tissue wants [mL/min STPD]."""
        return value_of(values, self.share) * value_of(values, self.demand)

    def outlet(self, inlet: Array, inside: Points, values: Values) -> Array:  # noqa: D102
        return inside.content[:, 0]

    def missing(self, flow: Array, inlet: Array, inside: Points, values: Values) -> Array:  # noqa: D102
        met = -jnp.expm1(-((inside.pressure[0, 0] / self.critical) ** 2))
        consumed = self.wanted(values) * met
        gained = 10.0 * flow * (inside.content[:, 0] - inlet)
        missed = gained - consumed * jnp.stack([-1.0, value_of(values, self.quotient)])
        if self.held != 0.0:
            # As much as blood takes up for the difference in PCO2, some 0.5 mL/dL for each mmHg.
            apart = 5.0 * flow * (inside.pressure[1, 0] - value_of(values, self.stored))
            held = value_of(values, self.held)
            missed = jnp.stack([missed[0], (1.0 - held) * missed[1] + held * apart])
        return missed[:, None]


@dataclass(frozen=True)
class NativeLung(GasExchanger):
    """The lung: alveoli in equilibrium with the blood that passes them, and a shunt past them (Riley).

        in --+--(alveoli)--> point --+--> out
             +-------shunt-----------+

    The gas of the alveoli is balanced with nitrogen, which crosses no membrane in the steady state:
    V_I F_I = V_E F_A + uptake for each gas. The usual alveolar gas equation does not hold on ECMO, where the
    lung's respiratory quotient can be anything. Without ventilation the blood passes unchanged.

    Args:
        ventilation: parameter, inspired alveolar ventilation [L/min BTPS].
        oxygen: parameter, inspired fraction of oxygen [-].
        shunt: parameter, share of the flow that passes no alveolus [-].
    """

    ventilation: Key = "gas.alveolar_ventilation_l_min"
    oxygen: Key = "gas.fio2"
    shunt: Key = "gas.shunt_fraction"

    @property
    def points(self) -> int:  # noqa: D102
        return 1

    def outlet(self, inlet: Array, inside: Points, values: Values) -> Array:  # noqa: D102
        return inlet + (1.0 - value_of(values, self.shunt)) * (inside.content[:, 0] - inlet)

    def missing(self, flow: Array, inlet: Array, inside: Points, values: Values) -> Array:  # noqa: D102
        shunt = value_of(values, self.shunt)
        gas = 1000.0 * BTPS_TO_STPD * value_of(values, self.ventilation)
        # Alveoli that no blood passes need some gas for their equation to have a solution.
        gas = jnp.where(shunt >= 1.0, jnp.maximum(gas, 1.0), gas)
        gained = 10.0 * flow * (1.0 - shunt) * (inside.content[:, 0] - inlet)
        expired = gas - gained[0] - gained[1]
        inspired = gas * jnp.stack([value_of(values, self.oxygen), AIR_CARBON_DIOXIDE])
        return (gained + inside.pressure[:, 0] / DRY_MMHG * expired - inspired)[:, None]


@dataclass(frozen=True)
class MembraneLung(GasExchanger):
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
        oxygen_transfer: parameter, k_O2 [mL/min/mmHg at 1 L/min].
        oxygen_exponent: parameter, b [-].
        carbon_dioxide_transfer: parameter, k_CO2 [mL/min/mmHg at 1 L/min].
        clotted_fraction: parameter, share of the membrane that is lost [-].
        sweep: parameter, flow of the sweep gas [L/min, flowmeter at 20 C].
        oxygen: parameter, fraction of oxygen in it [-].
        cells: from inlet to outlet, with two points in each.
    """

    oxygen_transfer: Key = "ecmo.oxygenator.oxygen_transfer"
    oxygen_exponent: Key = "ecmo.oxygenator.oxygen_exponent"
    carbon_dioxide_transfer: Key = "ecmo.oxygenator.carbon_dioxide_transfer"
    clotted_fraction: Key = "ecmo.oxygenator.clotted_fraction"
    sweep: Key = "ecmo.sweep_l_min"
    oxygen: Key = "ecmo.fdo2"
    cells: int = 4

    @property
    def points(self) -> int:  # noqa: D102
        return 2 * self.cells

    def outlet(self, inlet: Array, inside: Points, values: Values) -> Array:  # noqa: D102
        return inside.content[:, -1]

    def missing(self, flow: Array, inlet: Array, inside: Points, values: Values) -> Array:  # noqa: D102
        gas = 1000.0 * FLOWMETER_TO_STPD * value_of(values, self.sweep)
        gained = 10.0 * flow * (inside.content - inlet[:, None])
        supplied = gas * jnp.stack([value_of(values, self.oxygen), AIR_CARBON_DIOXIDE])[:, None]
        left = gas - gained[0] - gained[1] + 1e-6
        partial = DRY_MMHG * (supplied - gained) / left
        rates = self.transfer(flow, inside.slope, values) * (partial - inside.pressure) * (gas / (gas + 1e-3))
        reached = gained.reshape(2, self.cells, 2)
        before = jnp.concatenate([jnp.zeros((2, 1)), reached[:, :-1, 1]], axis=1)
        within = rates.reshape(2, self.cells, 2) @ RADAU.T / self.cells
        return (reached - before[:, :, None] - within).reshape(2, self.points)

    def transfer(self, flow: Array, slope: Array, values: Values) -> Array:
        """Permeance of the whole membrane [mL/min/mmHg] for both gases at the points, shape (2, points)."""
        open_share = 1.0 - value_of(values, self.clotted_fraction)
        binding = values[OXYGEN_CAPACITY] * values[HAEMOGLOBIN]
        oxygen = value_of(values, self.oxygen_transfer) * flow ** value_of(values, self.oxygen_exponent)
        boosted = oxygen * jnp.cbrt(1.0 + binding * slope / 0.0031)
        carbon_dioxide = value_of(values, self.carbon_dioxide_transfer) * flow**0.6
        return jnp.asarray(open_share) * jnp.stack([boosted, jnp.broadcast_to(carbon_dioxide, boosted.shape)])
