r"""What a hemofilter takes from blood: convection and diffusion, before and after dilution, in closed form.

    blood ->--(+ fluid before)--[==== fibres ====]--(+ fluid after)-->
                   effluent <---[== counter-current ==]---< dialysate

Water is filtered at the same rate J all along the fibres, and a solute crosses their wall by convection and
diffusion together (Patlak, Goldstein and Hoffman 1963, J Theor Biol 5:426): per length it loses
J c_b + B (c_b - c_d) with B = J / (exp(J / KoA) - 1). With blood water entering at Qb, dialysate at Qd and
effluent leaving at Qe = Qd + J, the difference c_b - c_d obeys an equation that separates, and

    K = Qe ((Qb - J) - q Qb) / ((Qb - J) - q Qe),   q = (Qd / Qe)^(1 + B/J) / (1 - J / Qb)^(B/J).

Its limits are the usual formulas, exactly: hemofiltration (Qd = 0) K = J; dialysis (J = 0)
K = Qb (e^Z - 1) / (e^Z - Qb/Qd) with Z = (KoA/Qb)(1 - Qb/Qd) (Michaels 1966); a large membrane K = Qe.

A solute of which only the share `sieving` passes is filtered as if the blood carried Qb / sieving of its
filterable concentration: K = sieving J in hemofiltration, at most sieving Qe.

Definitions of flows, filtration fraction and transmembrane pressure: Neri et al. 2016 (Crit Care 20:318).
Flows in mL/min here, concentrations in water.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from eclsim.blood.acid_base import bicarbonate, carbon_dioxide_solubility
from eclsim.components.base import Exchanger, Renaming, Values
from eclsim.components.exchangers import BLOOD, INLET_WEIGHTS, TEMPERATURE, GasExchanger, Points

PLASMA_WATER = 0.93
"""Share of plasma that is water; proteins take up the rest (textbook value)."""
CARBON_DIOXIDE_ML_PER_MMOL = 22.26
"""Volume of a mmol of carbon dioxide at 0 C and 760 mmHg."""
UREA_RED_CELL_WATER = 0.80
"""Urea leaves red cells while blood passes: their water, 0.72, with a partition of 1.11 (Colton 1970)."""
BASE_PER_CITRATE = 3.0
"""Bicarbonate that a molecule of citrate becomes when it is metabolised."""
CARBON_PER_CITRATE, OXYGEN_PER_CITRATE = 6.0, 4.5
"""Carbon of a molecule, and oxygen that burns it: C6H5O7(3-) + 4.5 O2 = 3 CO2 + 3 HCO3(-) + H2O."""
EFFECTIVE_CLEARANCE, BASE_GAIN, CITRATE_LOAD = "effective_clearance", "base_gain", "citrate_load"
"""Usual names of what a device with a filter gives, the first followed by the name of a solute."""


class Solute(NamedTuple):
    """What decides how a solute is carried and how it passes the membrane.

    Attributes:
        red_cell_water: share of red cells that gives the solute off while blood passes the filter.
        sieving: of the concentration in plasma water.
        area_product: KoA of the filter in question [mL/min].
    """

    red_cell_water: float
    sieving: float
    area_product: Array | float

    def water_flow(self, blood: Array, haematocrit: Array) -> Array:
        """Flow of the water that carries the solute [mL/min]."""
        return blood * (PLASMA_WATER * (1.0 - haematocrit) + self.red_cell_water * haematocrit)


class Fluids(NamedTuple):
    """Flows of fluid [mL/min].

    Attributes:
        dialysate: of fresh dialysate.
        before: of replacement fluid into the blood before the filter.
        after: behind it.
        net: what the patient loses.
    """

    dialysate: Array
    before: Array
    after: Array
    net: Array

    @property
    def ultrafiltrate(self) -> Array:
        """Water that crosses the membrane."""
        return self.before + self.after + self.net

    @property
    def effluent(self) -> Array:
        """What leaves the filter on the side of the dialysate."""
        return self.dialysate + self.ultrafiltrate


@dataclass(frozen=True)
class Hemofilter(Exchanger):
    """A filter and the fluids that run through it; the beat does not read it, outputs do (`performance`).

    Args:
        settings: names of its parameters, in the order of `Settings`.
        clearance: what the names of its device's outputs of clearances for the patient begin with.
        base_gain: name of its device's output of the bicarbonate gained.
        citrate: name of its device's output of the citrate that reaches the patient; none where it has none.
    """

    settings: tuple[str, ...]
    clearance: str = EFFECTIVE_CLEARANCE
    base_gain: str = BASE_GAIN
    citrate: str = CITRATE_LOAD

    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of `Settings`."""
        return self.settings

    def renamed(self, parameter: Renaming) -> Hemofilter:
        """The same filter of other parameters."""
        return replace(self, settings=tuple(map(parameter, self.settings)))


class PlasmaCarbonDioxide(NamedTuple):
    """Carbon dioxide of plasma [mmol/L].

    Attributes:
        bicarbonate: which is base; all of it where no more than the total is known.
        dissolved: the rest.
    """

    bicarbonate: Array
    dissolved: Array

    @classmethod
    def of(cls, pco2: Array, ph: Array, temperature: Array) -> PlasmaCarbonDioxide:
        """By Henderson and Hasselbalch from PCO2 [mmHg], pH and temperature [C]."""
        held = jnp.asarray(bicarbonate(pco2, ph, temperature))
        return cls(held, jnp.asarray(carbon_dioxide_solubility(temperature) * pco2))


class Settings(NamedTuple):
    """What is set at a filter and what it is made of.

    Attributes:
        dialysate: flow [mL/h].
        before: replacement before the filter [mL/h].
        after: replacement behind it [mL/h].
        net: net ultrafiltration [mL/h].
        haematocrit: of the blood that enters [-].
        fluid_bicarbonate: bicarbonate of the fluids [mmol/L].
        plasma_bicarbonate: total CO2 of the plasma that enters [mmol/L]; 0 for the blood's own.
        citrate: dose of regional citrate [mmol per L of blood].
        permeability: Kuf of the membrane in blood [mL/h/mmHg].
        urea: KoA [mL/min].
        creatinine: KoA [mL/min].
        potassium: KoA [mL/min].
        carbon_dioxide: KoA of bicarbonate and dissolved CO2 [mL/min].
        citrate_ion: KoA [mL/min].
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

    @property
    def fluids(self) -> Fluids:
        """Flows [mL/min]."""
        return Fluids(*(flow / 60.0 for flow in self[:4]))

    def plasma(self, own: PlasmaCarbonDioxide) -> PlasmaCarbonDioxide:
        """Carbon dioxide of the plasma that enters: as it is set, or the blood's own."""
        given = self.plasma_bicarbonate
        return PlasmaCarbonDioxide(
            jnp.where(given > 0.0, given, own.bicarbonate), jnp.where(given > 0.0, 0.0, own.dissolved)
        )

    def solute(self, name: str) -> Solute:
        """A solute as this filter clears it; all of these pass an AN69 membrane freely (Troyanov 2003)."""
        return Solute(UREA_RED_CELL_WATER if name == "urea" else 0.0, 1.0, getattr(self, name))


class Performance(NamedTuple):
    """What a filter does.

    Attributes:
        effluent: [mL/h].
        filtration_fraction: [-].
        transmembrane_pressure: that the ultrafiltration takes [mmHg].
        effluent_pressure: mean pressure of the blood in the fibres less that [mmHg].
        urea: clearance [mL/min].
        creatinine: clearance [mL/min].
        potassium: clearance [mL/min].
        base_gain: bicarbonate that blood gains, with that from citrate [mmol/h].
        carbon_dioxide: removal as bicarbonate and dissolved, less what the fluids bring [mL/min STPD].
        citrate: that leaves the filter in the blood [mmol/h].
        urea_water: flow of the water that carries urea to the filter [mL/min].
        plasma_water: flow of the plasma's water, which carries the others [mL/min].
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
    """What a filter does, in the order of `Performance`.

    Args:
        numbers: blood flow [mL/min], pressure of the blood before and behind the fibres [mmHg]; PCO2 [mmHg]
            and pH of the blood that enters and its temperature [C], where they are known; `Settings`.
    """
    blood, inlet, outlet, pco2, ph, temperature, *rest = numbers
    settings = Settings(*rest)
    fluids, haematocrit = settings.fluids, settings.haematocrit

    def cleared(name: str) -> Array:
        solute = settings.solute(name)
        return clearance(solute.water_flow(blood, haematocrit), fluids, solute)

    carbon_dioxide, base = _losses(blood, settings, PlasmaCarbonDioxide.of(pco2, ph, temperature))
    dose = 1e-3 * settings.citrate * blood
    plasma_water = settings.solute("citrate_ion").water_flow(blood, haematocrit)
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


def _losses(blood: Array, settings: Settings, own: PlasmaCarbonDioxide) -> tuple[Array, Array]:
    """Carbon dioxide and bicarbonate that a patient loses [mmol/min]; blood flow in mL/min.

    Fluids bring bicarbonate, and hardly any dissolved carbon dioxide. What leaves with the water that carried
    it is not counted: taking water off with what it holds changes no concentration.
    """
    solute, plasma = settings.solute("carbon_dioxide"), settings.plasma(own)
    cleared = clearance(solute.water_flow(blood, settings.haematocrit), settings.fluids, solute)
    base = solute_removed(cleared, plasma.bicarbonate, settings.fluid_bicarbonate, settings.fluids.net)
    base = base - 1e-3 * settings.fluids.net * plasma.bicarbonate
    return base + 1e-3 * (cleared - settings.fluids.net) * plasma.dissolved, base


@dataclass(frozen=True)
class DialysedBlood(GasExchanger):
    """Blood from which a filter clears bicarbonate and dissolved carbon dioxide, in the balance of its gases.

        in --(fibres, V_CO2 = (K - net) (c_plasma - c_fluid))--> out

    with c_plasma of the blood that enters, unless it is set.

    Base excess is the patient's own, so that what fluids bring leaves as gas where acid is made. A filter
    that takes more water than enters it exchanges nothing here; its own outputs say so.

    Args:
        filter: that it passes.
    """

    filter: Hemofilter
    analysed: ClassVar[bool] = False

    @property
    def collocation(self) -> tuple[int, np.ndarray]:  # noqa: D102  (see the base class; so below)
        return 1, INLET_WEIGHTS

    def parameter_names(self) -> tuple[str, ...]:
        """Names of the filter's parameters and of those of the blood."""
        return (*self.filter.parameter_names(), *BLOOD)

    def renamed(self, parameter: Renaming) -> DialysedBlood:
        """Blood that passes the same filter of other parameters."""
        return replace(self, filter=self.filter.renamed(parameter))

    def rates(self, flow: Array, inside: Points, values: Values) -> Array:  # noqa: D102
        settings = Settings(*(jnp.asarray(values[name]) for name in self.filter.settings))
        own = PlasmaCarbonDioxide.of(inside.pressure[1], inside.ph, jnp.asarray(values[TEMPERATURE]))
        lost, _ = _losses(1000.0 * jnp.asarray(flow), settings, own)
        gained = jnp.where(jnp.isfinite(lost), -CARBON_DIOXIDE_ML_PER_MMOL * lost, 0.0)
        return jnp.stack([jnp.zeros_like(gained), gained])


def clearance(water: Array, fluids: Fluids, solute: Solute) -> Array:
    """Clearance of a filter [mL/min], of the blood before the fluid that dilutes it.

    Args:
        water: flow of the water that carries the solute to the filter [mL/min].
        fluids: flows of fluid.
        solute: what is cleared.
    """
    inside = (water + fluids.before) / solute.sieving
    fibres = _filterable(inside, fluids.dialysate, fluids.ultrafiltrate, jnp.asarray(solute.area_product))
    return solute.sieving * fibres * water / (water + fluids.before)


def _filterable(blood: Array, dialysate: Array, filtered: Array, area_product: Array) -> Array:
    """The closed form for a solute that passes freely; not a number where more is filtered than enters."""
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
    """Share of the plasma, with what dilutes it, that is filtered off."""
    return fluids.ultrafiltrate / (blood * (1.0 - haematocrit) + fluids.before)


def solute_removed(cleared: Array, plasma: Array, fluid: Array, net: Array) -> Array:
    """What a patient loses of a solute [mmol/min] that is in all fluids too.

    Were blood and fluids alike, the patient would lose it with the net ultrafiltrate alone; what blood has
    more is cleared.

    Args:
        cleared: clearance [mL/min].
        plasma: concentration in plasma water [mmol/L].
        fluid: concentration in all fluids [mmol/L].
        net: net ultrafiltration [mL/min].
    """
    return 1e-3 * (cleared * (plasma - fluid) + net * fluid)
