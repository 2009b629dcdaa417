"""Gas exchange of blood: laws of oxygen and carbon dioxide in tissue, native lung and membrane lung.

The circuit says along which connection the exchange happens. Blood enters with given contents and is followed
through a row of `cells`, at one or several points in each, and leaves from the last one (a lung then mixes in
the shunted blood). The law gives the rate at which blood gains gas at a point. The gas that blood has gained
up to a point is the sum of these rates with the weights of the collocation:

    gained at a point = gained before the cell + sum over its points (weight x rate) / cells

The logarithms of both partial pressures at the points are the unknowns of the gas state (`eclsim.gas`).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from eclsim.blood.standard import OXYGEN_SOLUBILITY, mean_slope
from eclsim.components.base import Exchanger, Key, Number, Values, value_of

BAROMETRIC_MMHG, WATER_VAPOUR_MMHG = 760.0, 47.0
"""Barometric pressure, and pressure of water vapour at 37 C [mmHg]."""
FLOWMETER_TO_STPD = 273.15 / 293.15
"""Volume at STPD per volume of sweep gas shown by a flowmeter (dry gas at 20 C and 760 mmHg)."""
AIR_CARBON_DIOXIDE = 4e-4
"""Fraction of carbon dioxide in inspired gas."""
AIR_OXYGEN = 0.2095
"""Fraction of oxygen in air."""
USED_UP_SHARE, USED_UP_ML_MIN = 0.05, 2.0
"""Share and flow [mL/min] of sweep gas; contact with blood falls when less than their sum is left."""
NO_GAS = -1e-6
"""Gas that is left [mL/min STPD], or its share of that which loses its contact, down to which it is none but
for rounding: the law of gas that is there then has the right slope where ventilation or sweep are 0."""
FRONT = 3.0 * math.gamma(4.0 / 3.0) ** 3
"""Factor of the oxygen that haemoglobin takes up in the boundary layer of a fibre, 2.14. With it the transfer
is exact where saturation rises at a front, and within 0.3 % with pure oxygen, 4 % with half of it and a tenth
(a sixth above a saturation of 95 %) with air."""
RADAU = np.array([[5.0, -1.0], [9.0, 3.0]]) / 12.0
"""Weights of the rates at 1/3 and at the end of a cell (Radau IIA)."""
MIXED_WEIGHTS = np.ones((1, 1))
"""Weights of a well-mixed site: the rate is that of the blood that leaves."""
INLET_WEIGHTS = np.array([[0.0, 0.0], [1.0, 0.0]])
"""Weights of a site where the rate is that of the blood that enters, the first of two points."""

HAEMOGLOBIN, OXYGEN_CAPACITY = "gas.haemoglobin_g_dl", "gas.oxygen_capacity_ml_g"
TEMPERATURE = "gas.temperature_c"
BLOOD = (HAEMOGLOBIN, "gas.base_excess_mmol_l", TEMPERATURE, OXYGEN_CAPACITY)
"""Parameters of the blood, which are the same at every site."""


def dry_gas_pressure(temperature: Number) -> Number:
    """Pressure of dry gas [mmHg] in contact with blood of a temperature [C]: without water vapour.

    Vapour pressure by Alduchov and Eskridge 1996 (doi 10.1175/1520-0450(1996)035<0601:IMFAOS>2.0.CO;2),
    scaled to the usual 47 mmHg at 37 C.
    """
    warmer = 17.625 * 243.04 * (temperature - 37.0) / ((temperature + 243.04) * (37.0 + 243.04))
    return BAROMETRIC_MMHG - WATER_VAPOUR_MMHG * jnp.exp(warmer)


def stpd_of_btps(temperature: Number) -> Number:
    """Ratio of STPD to BTPS volume of a gas at a body temperature [C].

    Ventilation is stated in BTPS (body temperature, saturated), gas exchange in STPD (dry, 0 C, 760 mmHg).
    """
    return 273.15 / (273.15 + temperature) * dry_gas_pressure(temperature) / BAROMETRIC_MMHG


class Points(NamedTuple):
    """Blood at the points inside an exchanger: arrays (points,), or (2, points) for O2 and CO2.

    Attributes:
        gained: gas that the blood has gained up to the point [mL/min STPD].
        pressure: partial pressures [mmHg].
        standard: PO2 with the same saturation at pH 7.4, PCO2 40 mmHg and 37 C [mmHg].
        ph: pH.
    """

    gained: Array
    pressure: Array
    standard: Array
    ph: Array


class GasExchanger(Exchanger, ABC):
    """Law of a site where oxygen and carbon dioxide enter or leave the blood of a connection.

    Attributes:
        analysed: whether the blood gases before and after it are computed when it is outside the patient.
    """

    analysed: ClassVar[bool] = True

    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters that the law reads, including those of the blood."""
        return (*super().parameter_names(), *BLOOD)

    @property
    def collocation(self) -> tuple[int, np.ndarray]:
        """Number of cells from inlet to outlet, and the weights of the rates in each."""
        return 1, MIXED_WEIGHTS

    @property
    def points(self) -> int:
        """Number of points inside at which the partial pressures are unknown."""
        cells, weights = self.collocation
        return cells * len(weights)

    def exchanging(self, values: Values) -> Number:
        """Share of the blood that exchanges gas; the rest passes unchanged."""
        return 1.0

    def over_a_step(self, held: str, before: tuple[str, str]) -> GasExchanger:
        """The law over a step in time; the law itself where the site holds no gas.

        Args:
            held: name of the volume of gas over the length of the step [L/min BTPS].
            before: names of its partial pressures of oxygen and carbon dioxide at the beginning [mmHg].
        """
        return self

    @abstractmethod
    def rates(self, flow: Array, inside: Points, values: Values) -> Array:
        """Transfer to blood if the whole exchanger had each point's rate [mL/min STPD], shape (2, points).

        Args:
            flow: blood flow, including the part that passes unchanged [L/min].
            inside: blood at the points; every rate depends on its own point alone.
            values: all parameters.
        """


@dataclass(frozen=True)
class Tissue(GasExchanger):
    """Tissue that consumes oxygen and produces carbon dioxide.

        in --(capillaries, VO2 = demand (1 - exp(-(PO2 / critical)^2)), VCO2 = RQ VO2)--> out

    PO2 is that of the blood that leaves. From three times the critical PO2 upwards, consumption is within
    2e-4 of demand; where supply is insufficient, consumption falls smoothly. With a temperature T the demand
    is multiplied by (1 + rise)^(T - 37).

    Args:
        demand: parameter, oxygen demand of the whole body at 37 C [mL/min STPD].
        rise: parameter, rise of the demand for each degree [%/C]; at 0 it is the same at every temperature.
        quotient: parameter, respiratory quotient: carbon dioxide produced per oxygen consumed [-].
        share: this tissue's share of the demand [-], a parameter or a number.
        critical: PO2 at which consumption is 63 % of demand [mmHg].
        held: 1 where stores fix the tissue's PCO2, 0 where it is steady; the number 0 for no stores.
        stored: parameter, PCO2 of the stores [mmHg].
    """

    demand: Key = "gas.vo2_ml_min"
    rise: Key = "gas.vo2_percent_per_c"
    quotient: Key = "gas.respiratory_quotient"
    share: Key = 1.0
    critical: float = 4.0
    held: Key = 0.0
    stored: Key = 0.0

    def oxygen_demand(self, values: Values) -> Number:
        """Oxygen that this tissue consumes if the supply is sufficient [mL/min STPD]."""
        warmer = (1.0 + 0.01 * value_of(values, self.rise)) ** (values[TEMPERATURE] - 37.0)
        return value_of(values, self.share) * value_of(values, self.demand) * warmer

    def rates(self, flow: Array, inside: Points, values: Values) -> Array:  # noqa: D102  (see the base class)
        met = -jnp.expm1(-((inside.pressure[0] / self.critical) ** 2))
        consumed = self.oxygen_demand(values) * met
        given_off = value_of(values, self.quotient) * consumed
        if self.held != 0.0:
            # As much as blood takes up for the difference in PCO2, some 0.5 mL/dL for each mmHg.
            stored_difference = 5.0 * flow * (inside.pressure[1] - value_of(values, self.stored))
            held = value_of(values, self.held)
            given_off = (1.0 - held) * given_off + held * (inside.gained[1] - stored_difference)
        return jnp.stack([-consumed, given_off])


@dataclass(frozen=True)
class NativeLung(GasExchanger):
    """Native lung: alveoli in equilibrium with the blood that perfuses them, and a shunt around them (Riley).

        in --+--(alveoli)--> point --+--> out
             +-------shunt-----------+

    The balance of alveolar gas includes nitrogen, which crosses no membrane in the steady state:
    V_I F_I = V_E F_A + uptake for each gas. The usual alveolar gas equation does not hold on ECMO, where the
    lung's respiratory quotient can take any value. Without ventilation the blood passes unchanged.

    Over a step in time of length h the alveoli hold a volume V of gas with initial partial pressures P_0:

        V (P - P_0) / h = V_I P_I - V_E P - uptake x (barometric pressure - water vapour)

    Where blood takes up more gas than ventilation brings, more flows in through the open airway: inspired
    gas, or air if there is no ventilation.

    Args:
        ventilation: parameter, inspired alveolar ventilation [L/min BTPS].
        oxygen: parameter, inspired fraction of oxygen [-].
        shunt: parameter, share of the blood flow that passes no ventilated alveolus [-].
        held: V / h [L/min BTPS], a parameter of a step in time; a number 0 where the lung is steady.
        before: P_0 of oxygen and carbon dioxide [mmHg].
    """

    ventilation: Key = "gas.alveolar_ventilation_l_min"
    oxygen: Key = "gas.fio2"
    shunt: Key = "gas.shunt_fraction"
    held: Key = 0.0
    before: tuple[Key, Key] = (0.0, 0.0)

    def exchanging(self, values: Values) -> Number:  # noqa: D102
        return 1.0 - value_of(values, self.shunt)

    def over_a_step(self, held: str, before: tuple[str, str]) -> NativeLung:  # noqa: D102
        return replace(self, held=held, before=before)

    def rates(self, flow: Array, inside: Points, values: Values) -> Array:  # noqa: D102
        dry, stpd = dry_gas_pressure(values[TEMPERATURE]), stpd_of_btps(values[TEMPERATURE])
        gas = 1000.0 * stpd * value_of(values, self.ventilation)
        # Alveoli that no blood passes need some gas for their equation to have a solution.
        gas = jnp.where(jnp.asarray(value_of(values, self.shunt)) >= 1.0, jnp.maximum(gas, 1.0), gas)
        expired = gas - inside.gained[0] - inside.gained[1]
        fractions = jnp.stack([value_of(values, self.oxygen), AIR_CARBON_DIOXIDE])[:, None]
        if self.held == 0.0:
            # Alveoli from which nothing is breathed out have no gas to give to the blood.
            expired = jnp.where(expired >= NO_GAS, expired, 0.0)
            return jnp.asarray(gas * fractions - inside.pressure / dry * expired)
        air = jnp.array([[AIR_OXYGEN], [AIR_CARBON_DIOXIDE]])
        inspired = gas * fractions + jnp.maximum(-expired, 0.0) * jnp.where(gas > 0.0, fractions, air)
        held = 1000.0 * stpd * value_of(values, self.held)
        kept = held * (
            inside.pressure - jnp.stack([jnp.asarray(value_of(values, key)) for key in self.before])[:, None]
        )
        return jnp.asarray(inspired - (inside.pressure * jnp.maximum(expired, 0.0) + kept) / dry)


@dataclass(frozen=True)
class MembraneLung(GasExchanger):
    """Membrane lung: hollow fibres with blood outside and sweep gas inside, both followed along the bundle.

        in --|point 1 .. point n|--> out;   sweep gas in the same direction

    Q dC_O2/dx = k_O2 Q^b (1 + 2.14 lambda)^(1/3) (P_gas - P)
    lambda = 1.34 Hb (S_fresh - S) / (0.0031 (P_fresh - P))
    Q dC_CO2/dx = k_CO2 Q^0.6 (P_gas - P)

    with x from 0 to 1 along the bundle (form of Vaslef et al. 1994, ASAIO J 40:990). The blood next to a
    fibre is nearly saturated whatever the blood further away holds, so the slope of the dissociation curve
    is the mean one from the blood to the fresh gas, S_fresh being the saturation at its PO2; `FRONT` tells
    how closely that solves the boundary layer. Each cell uses Radau collocation (third order, stable at any
    ratio of membrane to flow).

    The sweep gas changes by what the blood has taken up and given off upstream, so that CO2 transfer is
    limited by the sweep flow when it is low and by the blood flow when it is high. Blood takes up no more
    than the sweep brings: when nearly all of it is used up, exchange falls smoothly to zero. Without sweep
    the blood passes unchanged. A clot removes its share of the membrane.

    Args:
        oxygen_transfer: parameter, k_O2 [mL/min/mmHg at 1 L/min].
        oxygen_exponent: parameter, b [-].
        carbon_dioxide_transfer: parameter, k_CO2 [mL/min/mmHg at 1 L/min].
        clotted_fraction: parameter, share of the membrane that is lost [-].
        sweep: parameter, flow of the sweep gas [L/min, flowmeter at 20 C].
        oxygen: parameter, fraction of oxygen in it [-].
        cells: number of cells from inlet to outlet, with two points in each.
    """

    oxygen_transfer: Key
    oxygen_exponent: Key
    carbon_dioxide_transfer: Key
    clotted_fraction: Key
    sweep: Key
    oxygen: Key
    cells: int = 4

    @property
    def collocation(self) -> tuple[int, np.ndarray]:  # noqa: D102
        return self.cells, RADAU

    def rates(self, flow: Array, inside: Points, values: Values) -> Array:  # noqa: D102
        gas = 1000.0 * FLOWMETER_TO_STPD * value_of(values, self.sweep)
        supplied = gas * jnp.stack([value_of(values, self.oxygen), AIR_CARBON_DIOXIDE])[:, None]
        left = gas - inside.gained[0] - inside.gained[1]
        # Gas that is used up exchanges nothing more: the last of it, `least`, loses its contact smoothly.
        least = USED_UP_SHARE * gas + USED_UP_ML_MIN
        rest = jnp.where(left / least >= NO_GAS, left / least, 0.0)
        contact = jnp.where(rest < 1.0, rest * (2.0 - rest), 1.0)
        mixture = jnp.where(rest < 1.0, least / (2.0 - rest), left)
        partial = dry_gas_pressure(values[TEMPERATURE]) * (supplied - inside.gained) / mixture
        driving = partial - contact * inside.pressure
        return self.transfer(flow, inside, values) * driving

    def transfer(self, flow: Array, inside: Points, values: Values) -> Array:
        """Permeance of the whole membrane [mL/min/mmHg] for both gases at the points, shape (2, points)."""
        open_share = 1.0 - value_of(values, self.clotted_fraction)
        fresh = value_of(values, self.oxygen) * dry_gas_pressure(values[TEMPERATURE])
        shift = inside.standard / inside.pressure[0]
        slope = shift * mean_slope(inside.standard, shift * fresh)
        binding = values[OXYGEN_CAPACITY] * values[HAEMOGLOBIN] * slope / OXYGEN_SOLUBILITY
        oxygen = value_of(values, self.oxygen_transfer) * flow ** value_of(values, self.oxygen_exponent)
        boosted = oxygen * jnp.cbrt(1.0 + FRONT * binding)
        carbon_dioxide = value_of(values, self.carbon_dioxide_transfer) * flow**0.6
        return jnp.asarray(open_share) * jnp.stack([boosted, jnp.broadcast_to(carbon_dioxide, boosted.shape)])
