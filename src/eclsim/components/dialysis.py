r"""Solute clearance of a hemofilter by convection and diffusion, with pre- and post-dilution, in closed form.

    blood ->--(+ fluid before)--[==== fibres ====]--(+ fluid after)-->
                   effluent <---[== counter-current ==]---< dialysate

Water is filtered at a uniform rate J along the fibres, and a solute crosses their wall by convection and
diffusion together (Patlak, Goldstein and Hoffman 1963, J Theor Biol 5:426): per unit length it loses
J c_b + B (c_b - c_d) with B = J / (exp(J / KoA) - 1). With blood water entering at Qb, dialysate at Qd and
effluent leaving at Qe = Qd + J, the difference c_b - c_d obeys an equation that separates, and

    K = Qe ((Qb - J) - q Qb) / ((Qb - J) - q Qe),   q = (Qd / Qe)^(1 + B/J) / (1 - J / Qb)^(B/J).

Its limits are exactly the usual formulas: hemofiltration (Qd = 0) K = J; dialysis (J = 0)
K = Qb (e^Z - 1) / (e^Z - Qb/Qd) with Z = (KoA/Qb)(1 - Qb/Qd) (Michaels 1966); a large membrane K = Qe.

A solute with the sieving coefficient `sieving` is filtered as if the blood carried Qb / sieving of its
filterable concentration: K = sieving J in hemofiltration, at most sieving Qe.

Definitions of flows, filtration fraction and transmembrane pressure: Neri et al. 2016 (Crit Care 20:318).
Flows in mL/min here, concentrations in water.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from eclsim.blood.acid_base import bicarbonate, carbon_dioxide_solubility
from eclsim.components.base import Exchanger, Renaming, Values
from eclsim.components.exchangers import (
    BLOOD,
    HAEMOGLOBIN,
    INLET_WEIGHTS,
    TEMPERATURE,
    GasExchanger,
    Points,
)
from eclsim.units import RED_CELL_HAEMOGLOBIN

PLASMA_WATER = 0.93
"""Share of plasma that is water; proteins occupy the rest (textbook value)."""
CARBON_DIOXIDE_ML_PER_MMOL = 22.26
"""Volume of 1 mmol of carbon dioxide at 0 C and 760 mmHg [mL]."""
UREA_RED_CELL_WATER = 0.80
"""Red cells' water for urea, which leaves them in the filter: 0.72 with a partition of 1.11 (Colton 1970)."""
BASE_PER_CITRATE = 3.0
"""Molecules of bicarbonate formed when one molecule of citrate is metabolised."""
CARBON_PER_CITRATE, OXYGEN_PER_CITRATE = 6.0, 4.5
"""Carbon atoms, and O2 used, per molecule of citrate: C6H5O7(3-) + 4.5 O2 = 3 CO2 + 3 HCO3(-) + H2O."""
STANDING_ML_MIN = 1e-6
"""Blood flow that takes the place of none [mL/min]: all clearances are then below it."""
EFFECTIVE_CLEARANCE, BASE_GAIN, CITRATE_LOAD = "effective_clearance", "base_gain", "citrate_load"
"""Default names of the outputs of a device with a filter; the first is followed by the name of a solute."""


class Solute(NamedTuple):
    """Properties that determine how blood carries a solute and how the solute passes the membrane.

    Attributes:
        red_cell_water: share of the red cells' volume that releases the solute while blood passes the filter.
        sieving: sieving coefficient, relative to the concentration in plasma water (of a drug, in plasma).
        area_product: KoA of the filter for this solute [mL/min].
    """

    red_cell_water: float
    sieving: Array | float
    area_product: Array | float

    def water_flow(self, blood: Array, haematocrit: Array) -> Array:
        """Flow of water that carries the solute [mL/min] at a blood flow [mL/min] and a haematocrit."""
        return blood * (PLASMA_WATER * (1.0 - haematocrit) + self.red_cell_water * haematocrit)


class Fluids(NamedTuple):
    """Fluid flows at a filter [mL/min].

    Attributes:
        dialysate: flow of fresh dialysate.
        before: flow of replacement fluid into the blood before the filter (pre-dilution).
        after: flow of replacement fluid into the blood after the filter (post-dilution).
        net: net ultrafiltration, the fluid that the patient loses.
    """

    dialysate: Array
    before: Array
    after: Array
    net: Array

    @property
    def ultrafiltrate(self) -> Array:
        """Flow of water across the membrane."""
        return self.before + self.after + self.net

    @property
    def effluent(self) -> Array:
        """Flow that leaves the filter on the dialysate side."""
        return self.dialysate + self.ultrafiltrate


@dataclass(frozen=True)
class Hemofilter(Exchanger):
    """A filter and the fluids that run through it; read by outputs (`performance`), not by the heartbeat.

    Args:
        settings: names of its parameters, in the order of `Settings`.
        clearance: prefix of the names of its device's outputs of effective clearances.
        base_gain: name of its device's output of the bicarbonate gained.
        citrate: name of its device's output of the citrate that reaches the patient; empty if there is none.
        drug: parameters of a drug that it clears: sieving coefficient and KoA; empty if there is none.
    """

    settings: tuple[str, ...]
    clearance: str = EFFECTIVE_CLEARANCE
    base_gain: str = BASE_GAIN
    citrate: str = CITRATE_LOAD
    drug: tuple[str, ...] = ()

    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of `Settings`; then those of a drug."""
        return (*self.settings, *self.drug)

    def renamed(self, parameter: Renaming) -> Hemofilter:
        """The same filter with its parameters renamed, except those of the drug, which is the patient's."""
        return replace(self, settings=tuple(map(parameter, self.settings)))


class PlasmaCarbonDioxide(NamedTuple):
    """Carbon dioxide of plasma [mmol/L].

    Attributes:
        bicarbonate: concentration of bicarbonate; the total CO2 where only that is known.
        dissolved: concentration of dissolved carbon dioxide.
    """

    bicarbonate: Array
    dissolved: Array

    @classmethod
    def of(cls, pco2: Array, ph: Array, temperature: Array) -> PlasmaCarbonDioxide:
        """Compute both by the Henderson-Hasselbalch equation from PCO2 [mmHg], pH and temperature [C]."""
        held = jnp.asarray(bicarbonate(pco2, ph, temperature))
        return cls(held, jnp.asarray(carbon_dioxide_solubility(temperature) * pco2))


class Settings(NamedTuple):
    """Settings and membrane properties of a filter.

    Attributes:
        dialysate: flow of dialysate [mL/h].
        before: flow of replacement fluid before the filter [mL/h].
        after: flow of replacement fluid after the filter [mL/h].
        net: net ultrafiltration [mL/h].
        haematocrit: haematocrit of the blood that enters [-]; 0 to use the patient's.
        fluid_bicarbonate: bicarbonate of the fluids [mmol/L].
        plasma_bicarbonate: total CO2 of the plasma that enters [mmol/L]; 0 to use that of the blood gases.
        citrate: dose of regional citrate anticoagulation [mmol per L of blood].
        permeability: Kuf of the membrane in blood [mL/h/mmHg].
        urea: KoA of urea [mL/min].
        creatinine: KoA of creatinine [mL/min].
        potassium: KoA of potassium [mL/min].
        carbon_dioxide: KoA of bicarbonate and dissolved CO2 [mL/min].
        citrate_ion: KoA of citrate [mL/min].
    """

    dialysate: Array
    before: Array
    after: Array
    net: Array
    haematocrit: Array
    fluid_bicarbonate: Array
    plasma_bicarbonate: Array
    citrate: Array
    permeability: Array
    urea: Array
    creatinine: Array
    potassium: Array
    carbon_dioxide: Array
    citrate_ion: Array

    @classmethod
    def of(cls, numbers: Sequence[Array], patients_haematocrit: Array) -> Settings:
        """Settings from the numbers in this order; a haematocrit of 0 is replaced by the patient's."""
        settings = cls(*numbers)
        stated = settings.haematocrit
        # The sum has the right slope with respect to a stated haematocrit also where none is stated.
        return settings._replace(haematocrit=jnp.where(stated > 0.0, stated, patients_haematocrit + stated))

    @property
    def fluids(self) -> Fluids:
        """Fluid flows [mL/min]."""
        return Fluids(*(flow / 60.0 for flow in self[:4]))

    def plasma(self, own: PlasmaCarbonDioxide) -> PlasmaCarbonDioxide:
        """Carbon dioxide of the plasma that enters: as set, or `own` (of the blood gases) if not set."""
        given = self.plasma_bicarbonate
        return PlasmaCarbonDioxide(
            jnp.where(given > 0.0, given, own.bicarbonate), jnp.where(given > 0.0, 0.0, own.dissolved)
        )

    def solute(self, name: str) -> Solute:
        """Properties of a solute at this filter; all pass an AN69 membrane freely (Troyanov 2003)."""
        return Solute(UREA_RED_CELL_WATER if name == "urea" else 0.0, 1.0, getattr(self, name))


class Performance(NamedTuple):
    """Performance of a filter: its flows, pressures and clearances.

    Attributes:
        effluent: flow of effluent [mL/h].
        filtration_fraction: share of the plasma, with pre-dilution, that is filtered [-].
        transmembrane_pressure: pressure across the membrane that drives the ultrafiltration [mmHg].
        effluent_pressure: mean blood pressure in the fibres minus the transmembrane pressure [mmHg].
        urea: clearance of urea [mL/min].
        creatinine: clearance of creatinine [mL/min].
        potassium: clearance of potassium [mL/min].
        base_gain: bicarbonate that the blood gains, including that from citrate [mmol/h].
        carbon_dioxide: removal as bicarbonate and dissolved gas, minus what the fluids bring [mL/min STPD].
        citrate: citrate that leaves the filter in the blood [mmol/h].
        urea_water: flow of water that carries urea to the filter [mL/min].
        plasma_water: flow of plasma water, which carries the other solutes [mL/min].
        carbon_dioxide_cleared: clearance of bicarbonate and dissolved carbon dioxide [mL/min].
        citrate_cleared: clearance of citrate [mL/min].
        plasma: flow of plasma [mL/h].
    """

    effluent: Array
    filtration_fraction: Array
    transmembrane_pressure: Array
    effluent_pressure: Array
    urea: Array
    creatinine: Array
    potassium: Array
    base_gain: Array
    carbon_dioxide: Array
    citrate: Array
    urea_water: Array
    plasma_water: Array
    carbon_dioxide_cleared: Array
    citrate_cleared: Array
    plasma: Array


def performance(numbers: Array) -> Array:
    """Compute the performance of a filter, in the order of `Performance`.

    Args:
        numbers: blood flow [mL/min]; blood pressure before and after the fibres [mmHg]; PCO2 [mmHg], pH and
            temperature [C] of the blood that enters, where known; haematocrit of the patient's blood; then
            the entries of `Settings`.
    """
    blood, inlet, outlet, pco2, ph, temperature, patients_haematocrit, *rest = numbers
    blood, settings = _moving(blood), Settings.of(rest, patients_haematocrit)
    fluids, haematocrit = settings.fluids, settings.haematocrit

    plasma_water = settings.solute("citrate_ion").water_flow(blood, haematocrit)

    def cleared(name: str) -> Array:
        solute = settings.solute(name)
        done = clearance(solute.water_flow(blood, haematocrit), fluids, solute)
        return _if_water_is_left(done, plasma_water, fluids)

    carbon_dioxide, base = _losses(blood, settings, PlasmaCarbonDioxide.of(pco2, ph, temperature))
    dose = 1e-3 * settings.citrate * blood
    urea_water = settings.solute("urea").water_flow(blood, haematocrit)
    citrate = cleared("citrate_ion")
    load = dose * (1.0 - citrate / plasma_water)
    transmembrane = 60.0 * fluids.ultrafiltrate / settings.permeability
    result = Performance(
        60.0 * fluids.effluent,
        filtration_fraction(blood, haematocrit, fluids),
        transmembrane,
        0.5 * (inlet + outlet) - transmembrane,
        cleared("urea"),
        cleared("creatinine"),
        cleared("potassium"),
        60.0 * (BASE_PER_CITRATE * load - base),
        CARBON_DIOXIDE_ML_PER_MMOL * carbon_dioxide,
        60.0 * load,
        urea_water,
        plasma_water,
        cleared("carbon_dioxide"),
        citrate,
        60.0 * blood * (1.0 - haematocrit),
    )
    return jnp.stack(jnp.broadcast_arrays(*result))


def drug_clearance(numbers: Array) -> Array:
    """Compute the clearance of a drug by a filter, relative to plasma, and the flow of plasma [mL/min].

    Only unbound drug passes; binding in the fibres is in equilibrium, and red cells hold none.

    Args:
        numbers: blood flow [mL/min]; sieving coefficient; KoA [mL/min]; haematocrit of the patient's blood;
            then the entries of `Settings`.
    """
    blood, sieving, area_product, patients_haematocrit, *rest = numbers
    blood, settings = _moving(blood), Settings.of(rest, patients_haematocrit)
    plasma, fluids = blood * (1.0 - settings.haematocrit), settings.fluids
    cleared = clearance(plasma, fluids, Solute(0.0, sieving, area_product))
    return jnp.stack([_if_water_is_left(cleared, PLASMA_WATER * plasma, fluids), plasma])


def _if_water_is_left(cleared: Array, plasma_water: Array, fluids: Fluids) -> Array:
    """A clearance; NaN where the filter would take all water of the plasma."""
    return jnp.where(plasma_water > fluids.after + fluids.net, cleared, jnp.nan)


def pumped_performance(numbers: Array) -> Array:
    """Compute `performance` of a filter whose fluids stand still with its blood pump.

    Args:
        numbers: flow that the blood pump is set to; then those of `performance`.
    """
    return performance(_without_fluids_if_still(numbers))


def pumped_drug_clearance(numbers: Array) -> Array:
    """Compute `drug_clearance` of a filter whose fluids stand still with its blood pump.

    Args:
        numbers: flow that the blood pump is set to; then those of `drug_clearance`.
    """
    return drug_clearance(_without_fluids_if_still(numbers))


def _without_fluids_if_still(numbers: Array) -> Array:
    """The numbers behind the pump's flow, the last of which are `Settings`; without fluids if that is 0."""
    pump, rest = numbers[0], jnp.asarray(numbers[1:])
    place = np.arange(len(rest)) - (len(rest) - len(Settings._fields))
    fluids = (place >= 0) & (place < len(Fluids._fields))
    return jnp.where(fluids & (pump == 0.0), 0.0, rest)


def _moving(blood: Array) -> Array:
    """Blood flow [mL/min] in either direction, hardly any where it stands, so that shares of it are defined.

    Dialysate then flows with blood that runs backwards, not against it. Where blood flows much faster than
    dialysate, the effluent is saturated either way.
    """
    return jnp.where(blood == 0.0, STANDING_ML_MIN, jnp.abs(blood))


def _losses(blood: Array, settings: Settings, own: PlasmaCarbonDioxide) -> tuple[Array, Array]:
    """Carbon dioxide and bicarbonate that a patient loses [mmol/min]; blood flow in mL/min.

    Fluids bring bicarbonate, and hardly any dissolved carbon dioxide. What leaves together with the water
    that carried it is not counted: removing water with its solutes changes no concentration.
    """
    solute, plasma = settings.solute("carbon_dioxide"), settings.plasma(own)
    cleared = clearance(solute.water_flow(blood, settings.haematocrit), settings.fluids, solute)
    base = solute_removed(cleared, plasma.bicarbonate, settings.fluid_bicarbonate, settings.fluids.net)
    base = base - 1e-3 * settings.fluids.net * plasma.bicarbonate
    return base + 1e-3 * (cleared - settings.fluids.net) * plasma.dissolved, base


@dataclass(frozen=True)
class DialysedBlood(GasExchanger):
    """Blood from which a filter clears bicarbonate and dissolved carbon dioxide, as part of the gas balance.

        in --(fibres, V_CO2 = (K - net) (c_plasma - c_fluid))--> out

    with c_plasma that of the blood that enters, unless it is set.

    The base excess of the blood is a fixed parameter. Bicarbonate brought by the fluids therefore leaves as
    gas where acid is produced. A filter that takes more water than enters it exchanges nothing here; its own
    outputs report that.

    Args:
        filter: the filter that the blood passes.
    """

    filter: Hemofilter
    analysed: ClassVar[bool] = False

    @property
    def collocation(self) -> tuple[int, np.ndarray]:  # noqa: D102  (see the base class; so below)
        return 1, INLET_WEIGHTS

    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters of the filter and of the blood."""
        return (*self.filter.parameter_names(), *BLOOD)

    def renamed(self, parameter: Renaming) -> DialysedBlood:
        """The same exchange with the filter's parameters renamed."""
        return replace(self, filter=self.filter.renamed(parameter))

    def rates(self, flow: Array, inside: Points, values: Values) -> Array:  # noqa: D102
        own_haematocrit = jnp.asarray(values[HAEMOGLOBIN]) / RED_CELL_HAEMOGLOBIN
        settings = Settings.of([jnp.asarray(values[n]) for n in self.filter.settings], own_haematocrit)
        own = PlasmaCarbonDioxide.of(inside.pressure[1], inside.ph, jnp.asarray(values[TEMPERATURE]))
        lost, _ = _losses(_moving(1000.0 * jnp.asarray(flow)), settings, own)
        gained = jnp.where(jnp.isfinite(lost), -CARBON_DIOXIDE_ML_PER_MMOL * lost, 0.0)
        return jnp.stack([jnp.zeros_like(gained), gained])


def clearance(water: Array, fluids: Fluids, solute: Solute) -> Array:
    """Clearance of a filter [mL/min], relative to the blood before pre-dilution.

    Args:
        water: flow of water that carries the solute to the filter [mL/min].
        fluids: fluid flows.
        solute: the solute that is cleared.
    """
    inside = (water + fluids.before) / solute.sieving
    fibres = _filterable(inside, fluids.dialysate, fluids.ultrafiltrate, jnp.asarray(solute.area_product))
    return solute.sieving * fibres * water / (water + fluids.before)


def _filterable(blood: Array, dialysate: Array, filtered: Array, area_product: Array) -> Array:
    """Clearance of a freely passing solute in closed form; NaN where more water is filtered than enters."""
    effluent = dialysate + filtered
    blood = jnp.where(jnp.abs(blood - effluent) < 1e-7 * blood, (1.0 + 1e-7) * blood, blood)
    peclet = filtered / area_product
    mixing = area_product * _bernoulli(peclet)  # B; A = B + J
    # (B/J) ln(1 - J/Qb) and (A/J) ln(1 + J/Qd), both finite without filtration.
    along_blood = -mixing / blood * _log1p_ratio(-filtered / blood)
    fresh = jnp.maximum(dialysate, 1e-9)
    along_dialysate = (mixing + filtered) / fresh * _log1p_ratio(filtered / fresh)
    q = jnp.exp(-along_dialysate - along_blood)
    left = blood - filtered
    cleared = effluent * (left - q * blood) / (left - q * effluent)
    return jnp.where(effluent >= 0.0, jnp.where(left > 0.0, cleared, jnp.nan), 0.0)


def _bernoulli(x: Array) -> Array:
    """x / (e^x - 1), smooth at 0."""
    small = jnp.abs(x) < 1e-4
    safe = jnp.where(small, 1.0, x)
    return jnp.where(small, 1.0 - 0.5 * x + x * x / 12.0, safe / jnp.expm1(safe))


def _log1p_ratio(x: Array) -> Array:
    """ln(1 + x) / x, smooth at 0."""
    small = jnp.abs(x) < 1e-4
    safe = jnp.where(small, 1.0, x)
    return jnp.where(small, 1.0 - x * (0.5 - x * (1.0 / 3.0 - 0.25 * x)), jnp.log1p(safe) / safe)


def filtration_fraction(blood: Array, haematocrit: Array, fluids: Fluids) -> Array:
    """Filtration fraction: share of the plasma, with pre-dilution, that is filtered."""
    return fluids.ultrafiltrate / (blood * (1.0 - haematocrit) + fluids.before)


def solute_removed(cleared: Array, plasma: Array, fluid: Array, net: Array) -> Array:
    """Amount of a solute [mmol/min] that a patient loses when all fluids contain the solute too.

    If blood and fluids had the same concentration, the patient would lose only what the net ultrafiltrate
    contains; the difference in concentration is cleared.

    Args:
        cleared: clearance [mL/min].
        plasma: concentration in plasma water [mmol/L].
        fluid: concentration in all fluids [mmol/L].
        net: net ultrafiltration [mL/min].
    """
    return 1e-3 * (cleared * (plasma - fluid) + net * fluid)
