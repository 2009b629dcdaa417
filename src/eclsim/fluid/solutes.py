"""Urea, creatinine, potassium and bicarbonate over hours of dialysis, and stores of carbon dioxide.

Urea and creatinine have two pools, extracellular and intracellular water. Potassium has one, extracellular,
to which cells add what is missing to a target (mobilisation, Agar 2015) that falls as they release it.
Bicarbonate has its apparent space. Amounts are in mmol; amounts generated, removed and mobilised are states,
so that balances can be checked. Clearances are those computed from the beat.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from eclsim.blood.acid_base import CLOSED_PCO2_SLOPE, carbon_dioxide_solubility, excess_of
from eclsim.blood.types import Blood
from eclsim.circuit.network import Circuit
from eclsim.components.base import Derived, Number, value_of
from eclsim.components.dialysis import (
    BASE_GAIN,
    CARBON_DIOXIDE_ML_PER_MMOL,
    CARBON_PER_CITRATE,
    CITRATE_LOAD,
    EFFECTIVE_CLEARANCE,
    OXYGEN_PER_CITRATE,
    UREA_RED_CELL_WATER,
    Hemofilter,
)
from eclsim.components.exchangers import BLOOD, HAEMOGLOBIN, TEMPERATURE, Tissue
from eclsim.fluid.law import INTERSTITIUM, PLASMA, RED_CELLS, blood_at_start
from eclsim.parameters.fluid import (
    ACID,
    CARBON_DIOXIDE_STORES_HOLD,
    FCELLS,
    HAEMATOCRIT,
    KIDNEY,
    SOLUTES,
)
from eclsim.parameters.gas import NORMAL_C
from eclsim.slow import DerivedQuantity, Named, SlowLaw, SlowState

EXTRACELLULAR_SHARE = 1.0 / 3.0
"""Extracellular share of body water if fluid is not followed; textbook value."""
SMALLEST_INTRACELLULAR_SHARE = 0.2
"""Smallest intracellular share of body water, in a patient with oedema."""
POOL_TRANSFER_ML_MIN = {"urea": 600.0, "creatinine": 280.0}
"""Transfer between extra- and intracellular water [mL/min]; usual in two-pool models, not verified."""
POTASSIUM_MOBILISATION = 158.0
"""Mobilisation clearance of potassium [mL/min], 547 patients (Agar 2015); the number is not verified."""
BLOOD_SHARE = 0.2
"""Blood's share of the CO2 store: 5 L of blood hold 24 mL/mmHg, all tissues and blood 120 mL/mmHg."""
BLOOD_FOLLOWS_S = 60.0
"""Time constant of the blood [s], its volume divided by its flow."""
SLOW_SHARE = 0.6
"""Slow tissues' share of the CO2 store: muscle, skin, fat, bone, 4/5 of the mass; estimated, not fitted."""
SLOW_FOLLOWS_S = 540.0
"""Time constant of slow tissues [s]: 63 mL/mmHg over 5 mL/L/mmHg times their flow, 1/4 of 5.5 L/min."""
STANDARD_PCO2 = 40.0
BASE_EXCESS = BLOOD[1]
QUOTIENT = "gas.respiratory_quotient"
_MINUTE, _HOUR = 60.0, 3600.0


def _key_of(name: str) -> str:
    return f"{SOLUTES}.{name}"


_PLACES = {"outside": "outside cells", "inside": "inside cells", "mobilised": "mobilised from cells"}
_PLACES |= {"made": "made", "removed": "removed"}


def _state(solute: str, what: str = "outside") -> str:
    return _key_of(f"{solute}_{what}_mmol")


@dataclass(frozen=True)
class Filter:
    """Outputs of a dialyzer that the solutes law reads.

    Args:
        group: group of the device, such as "crrt" or "crrt.left".
        clearance: prefix of the names of the device's outputs of clearances.
        base_gain: name of its output of the bicarbonate gained.
        citrate: name of its output of the citrate that reaches the patient; empty if there is none.
    """

    group: str
    clearance: str = EFFECTIVE_CLEARANCE
    base_gain: str = BASE_GAIN
    citrate: str = CITRATE_LOAD

    def output(self, name: str) -> str:
        """Name of an output of the device, which may be a named instance."""
        device, _, own = self.group.partition(".")
        return f"{self.group}.{name.removeprefix(f'{device}_')}" if own else name

    @property
    def reads(self) -> tuple[str, ...]:
        """Outputs of clearances and bicarbonate gain."""
        cleared = (f"{self.clearance}_{name}" for name in (*POOL_TRANSFER_ML_MIN, "potassium"))
        return tuple(map(self.output, (*cleared, self.base_gain)))

    def gained(self, beat: Named) -> np.ndarray:
        """Bicarbonate gained by the patient [mmol/s]."""
        return beat[self.output(self.base_gain)] / _HOUR

    @property
    def reads_of_carbon(self) -> tuple[str, ...]:
        """Outputs from which the carbon that it brings is computed."""
        return tuple(self.output(name) for name in (self.base_gain, self.citrate) if name)

    def metabolised(self, beat: Named) -> np.ndarray:
        """Citrate that the patient metabolises [mmol/s]."""
        return beat[self.output(self.citrate)] / _HOUR if self.citrate else np.zeros(1)

    def cleared(self, beat: Named, solute: str) -> np.ndarray:
        """Effective clearance of a solute for the patient [mL/s]."""
        return beat[self.output(f"{self.clearance}_{solute}")] / _MINUTE


@dataclass(frozen=True)
class SolutesLaw(SlowLaw):
    """Slow law of solutes that dialysis clears.

    Args:
        filters: the dialyzers.
        fluid: whether fluid volumes are followed; otherwise they are constant.
        gas: whether the base excess follows bicarbonate.
    """

    filters: tuple[Filter, ...] = ()
    fluid: bool = False
    gas: bool = False

    @property
    def states(self) -> tuple[SlowState, ...]:  # noqa: D102  (as documented in the base class; so below)
        scales = {"urea": 10.0, "creatinine": 0.1, "potassium": 1.0, "bicarbonate": 10.0}
        further = {"urea": ("inside",), "creatinine": ("inside",), "potassium": ("mobilised",)}
        return tuple(
            SlowState(_state(solute, what), "mmol", f"{solute} {_PLACES[what]}", scale, "side" in what)
            for solute, scale in scales.items()
            for what in ("outside", *further.get(solute, ()), "made", "removed")
        )

    @property
    def reads(self) -> tuple[str, ...]:  # noqa: D102
        return tuple(name for one in self.filters for name in one.reads)

    def start(self, settings: Named, beat: Named) -> Named:  # noqa: D102
        outside, inside = _volumes_at_start(settings, self.fluid)
        amounts = dict.fromkeys((s.name for s in self.states), np.zeros_like(outside))
        for solute in POOL_TRANSFER_ML_MIN:
            concentration = _concentration_at_start(settings, solute)
            amounts[_state(solute)] = 1e-3 * concentration * outside
            amounts[_state(solute, "inside")] = 1e-3 * concentration * inside
        amounts[_state("potassium")] = 1e-3 * _concentration_at_start(settings, "potassium") * outside
        amounts[_state("bicarbonate")] = (
            1e-3 * settings[_key_of("bicarbonate_mmol_l")] * _bicarbonate_space(settings)
        )
        return amounts

    def in_effect(self, states: Named, settings: Named) -> Named:  # noqa: D102
        space = _bicarbonate_space(settings)
        bicarbonate = 1e3 * states[_state("bicarbonate")] / space
        start = 1e3 * (1e-3 * settings[_key_of("bicarbonate_mmol_l")] * space) / space
        keys = tuple(f"{one.group}.plasma_bicarbonate_mmol_l" for one in self.filters)
        # Where none is set, the plasma's CO2 follows from the gases, whose base excess changes.
        effect = {
            key: np.where(settings[key] > 0.0, settings[key] + (bicarbonate - start), 0.0) for key in keys
        }
        if self.gas:
            haemoglobin = settings[HAEMOGLOBIN]
            gained = standard_base_excess(bicarbonate, haemoglobin) - standard_base_excess(start, haemoglobin)
            effect[BASE_EXCESS] = settings[BASE_EXCESS] + gained
        return effect

    def rates(self, states: Named, settings: Named, beat: Named, inflows: Named) -> Named:  # noqa: D102
        start, inside = _volumes_at_start(settings, self.fluid)
        outside = states[PLASMA] + states[INTERSTITIUM] if self.fluid else start
        blood = inflows["blood_ml"] - inflows["bleed_ml"]
        clear = inflows["crystalloid_ml"] + inflows["albumin_ml"]
        plasma = plasma_share(states, settings, self.fluid)
        result: dict[str, np.ndarray] = {}
        for solute, transfer in POOL_TRANSFER_ML_MIN.items():
            concentration = 1e3 * states[_state(solute)] / outside
            within = 1e3 * states[_state(solute, "inside")] / inside
            cleared = sum((f.cleared(beat, solute) for f in self.filters), np.zeros_like(outside))
            cleared = cleared + settings[KIDNEY] / _MINUTE
            cells = UREA_RED_CELL_WATER if solute == "urea" else 0.0
            cleared = cleared - blood * (plasma + cells * (1.0 - plasma))
            removed = 1e-3 * cleared * concentration
            moved = 1e-3 * transfer / _MINUTE * (within - concentration)
            made = _generation(settings, solute)
            result |= {
                _state(solute): made + moved - removed, _state(solute, "inside"): -moved,
                _state(solute, "made"): made, _state(solute, "removed"): removed,
            }  # fmt: skip
        potassium = 1e3 * states[_state("potassium")] / outside
        fresh = settings[_key_of("fluid_potassium_mmol_l")]
        removed = -1e-3 * (blood * plasma * potassium + clear * fresh)
        for one in self.filters:
            net = settings[f"{one.group}.net_ultrafiltration_ml_h"] / _HOUR
            removed = removed + 1e-3 * (one.cleared(beat, "potassium") * (potassium - fresh) + net * fresh)
        held = states[_state("potassium", "mobilised")] / settings[_key_of("potassium_store_l")]
        missing = _concentration_at_start(settings, "potassium") - held - potassium
        moved, made = 1e-3 * POTASSIUM_MOBILISATION / _MINUTE * missing, _generation(settings, "potassium")
        acid = settings[ACID] / _HOUR
        gain = self.net_bicarbonate_gain(settings, beat) + acid
        return result | {
            _state("potassium"): made + moved - removed, _state("potassium", "mobilised"): moved,
            _state("potassium", "made"): made, _state("potassium", "removed"): removed,
            _state("bicarbonate"): gain - acid, _state("bicarbonate", "made"): -acid,
            _state("bicarbonate", "removed"): -gain,
        }  # fmt: skip

    def net_bicarbonate_gain(self, settings: Named, beat: Named) -> np.ndarray:
        """Bicarbonate gained from filters minus acid generation [mmol/s]."""
        acid = settings[ACID] / _HOUR
        return sum((one.gained(beat) for one in self.filters), -acid)

    def carbon_of_citrate(self, settings: Named, beat: Named) -> np.ndarray:
        """Carbon of metabolised citrate minus that of the fuel that its oxygen would burn [mmol/s]."""
        each = CARBON_PER_CITRATE - OXYGEN_PER_CITRATE * settings[QUOTIENT]
        return sum((each * one.metabolised(beat) for one in self.filters), np.zeros(1))

    def concentrations(self, states: Named, settings: Named) -> dict[str, np.ndarray]:
        """Concentrations in plasma [mmol/L]."""
        outside = EXTRACELLULAR_SHARE * settings[_key_of("body_water_ml")]
        if self.fluid:
            outside = states[PLASMA] + states[INTERSTITIUM]
        volumes = dict.fromkeys((*POOL_TRANSFER_ML_MIN, "potassium"), outside) | {
            "bicarbonate": _bicarbonate_space(settings)
        }
        return {solute: 1e3 * states[_state(solute)] / volume for solute, volume in volumes.items()}

    def derived_quantities(self, states: Named, in_effect: Named) -> tuple[DerivedQuantity, ...]:  # noqa: D102
        quantities = self.concentrations(states, in_effect)
        micro = 1e3 * quantities.pop("creatinine")
        whole = tuple(
            DerivedQuantity(name, "mmol/L", f"{name} of the plasma", value)
            for name, value in quantities.items()
        )
        return (*whole, DerivedQuantity("creatinine", "umol/L", "creatinine of the plasma", micro))


@dataclass(frozen=True)
class CarbonDioxideLaw(SlowLaw):
    """Stores of carbon dioxide: well perfused tissues, slow tissues with little flow, and blood.

        tissues      (1 - b - s) S dP/dt = produced - given to the blood - kept as bicarbonate
                                           - b S (P - P_b) / tau_b - s S (P - P_s) / tau_s
        little flow  dP_s/dt = (P - P_s) / tau_s
        blood        dP_b/dt = (P - P_b) / tau_b

    with the share b of the store S in the blood and s in muscle, skin, fat and bone. The pressures are those
    at 37 C; at a temperature T they are 10^(0.019 (T - 37)) times as high, as in blood that is closed off. In
    a steady beat the blood of tissues is at P_b, which lags by tau_b. If blood is followed beat by beat, it
    holds its own store. Bicarbonate from a filter is carbon dioxide of the blood. The part of it that acid
    does not consume remains as the bicarbonate that `SolutesLaw` counts; beat by beat only in tissues, as the
    blood's part is in its contents. Citrate supplies the carbon of its bicarbonate itself; as oxygen
    consumption is unchanged, other fuel is saved.

    Args:
        tissues: names of the tissues' exchanges, each with its share of the store.
        solutes: law of solutes if they are followed; if None, base excess is constant and base leaves as gas.
        every_beat: whether blood is followed beat by beat.
    """

    tissues: tuple[tuple[str, Derived | str | float], ...]
    solutes: SolutesLaw | None = None
    every_beat: bool = False

    @property
    def states(self) -> tuple[SlowState, ...]:  # noqa: D102
        words = {_pressure: "of {}", _of_slow: "of {} with little flow", _of_blood: "in the blood of {}"}
        return tuple(
            SlowState(key(name), "mmHg", f"PCO2 {place.format(_tissue_words(name))}, at 37 C", 1.0)
            for name, _ in self.tissues
            for key, place in words.items()
        )

    @property
    def blood(self) -> tuple[str, ...]:  # noqa: D102
        return tuple(_of_blood(name) for name, _ in self.tissues)

    def beat_by_beat(self) -> SlowLaw:  # noqa: D102
        return replace(self, every_beat=True)

    @property
    def reads(self) -> tuple[str, ...]:  # noqa: D102
        own = tuple(
            _output_of(what, name) for name, _ in self.tissues for what in ("tissue_PCO2", "stored_CO2")
        )
        filters = self.solutes.filters if self.solutes else ()
        return own + tuple(name for one in filters for name in one.reads_of_carbon)

    def start(self, settings: Named, beat: Named) -> Named:  # noqa: D102
        return {
            key(name): beat[_output_of("tissue_PCO2", name)] / _closed_store_ratio(settings)
            for name, _ in self.tissues
            for key in (_pressure, _of_slow, _of_blood)
        }

    def in_effect(self, states: Named, settings: Named) -> Named:  # noqa: D102
        held = _pressure if self.every_beat else _of_blood
        warmer = _closed_store_ratio(settings)
        own = {_pressure(name): states[held(name)] * warmer for name, _ in self.tissues}
        return own | {CARBON_DIOXIDE_STORES_HOLD: np.ones_like(next(iter(own.values())))}

    def rates(self, states: Named, settings: Named, beat: Named, inflows: Named) -> Named:  # noqa: D102
        quantities: dict[str, np.ndarray] = {}
        kept = self.solutes.net_bicarbonate_gain(settings, beat) if self.solutes else 0.0
        kept = CARBON_DIOXIDE_ML_PER_MMOL * kept
        if self.every_beat:
            kept = kept * (1.0 - settings["total_blood_volume_ml"] / _bicarbonate_space(settings))
        if self.solutes:
            kept = kept - CARBON_DIOXIDE_ML_PER_MMOL * self.solutes.carbon_of_citrate(settings, beat)
        for name, of_all in self.tissues:
            share = np.asarray(value_of(settings, of_all))
            store = settings[_key_of("carbon_dioxide_store_ml_mmHg")] * share
            slow = (states[_pressure(name)] - states[_of_slow(name)]) / SLOW_FOLLOWS_S
            blood = (states[_pressure(name)] - states[_of_blood(name)]) / BLOOD_FOLLOWS_S
            stored = beat[_output_of("stored_CO2", name)] / _MINUTE - share * kept - SLOW_SHARE * store * slow
            if not self.every_beat:
                stored = stored - BLOOD_SHARE * store * blood
            own = (1.0 - BLOOD_SHARE - SLOW_SHARE) * store
            quantities |= {_pressure(name): stored / own, _of_slow(name): slow, _of_blood(name): blood}
        return quantities


def filters_of(circuit: Circuit) -> tuple[Filter, ...]:
    """Outputs of all dialyzers of a circuit."""
    return tuple(
        Filter(e.group, e.component.clearance, e.component.base_gain, e.component.citrate)
        for e in circuit.exchanges
        if isinstance(e.component, Hemofilter)
    )


def stores_of_carbon_dioxide(circuit: Circuit, solutes: SolutesLaw | None) -> tuple[SlowLaw, ...]:
    """Law of carbon dioxide stores of a circuit; empty if its tissues hold none."""
    tissues = tuple(
        (e.name, e.component.share)
        for e in circuit.exchanges
        if isinstance(e.component, Tissue) and e.component.held == CARBON_DIOXIDE_STORES_HOLD
    )
    return (CarbonDioxideLaw(tissues, solutes),) if tissues else ()  # pyright: ignore[reportArgumentType]  # one share


def _pressure(tissue: str) -> str:
    return _key_of(f"{tissue}_pco2_mmHg")


TISSUE_PCO2 = _pressure("tissue")
"""Slow state of the PCO2 of the tissues' stores; `tissue_PCO2` is that of the blood that leaves them."""


def _of_slow(tissue: str) -> str:
    return _key_of(f"{tissue}_slow_pco2_mmHg")


def _of_blood(tissue: str) -> str:
    return _key_of(f"{tissue}_blood_pco2_mmHg")


def _region(tissue: str) -> str:
    return tissue.removesuffix("tissue").rstrip("_")


def _output_of(what: str, tissue: str) -> str:
    return f"{what}_{_region(tissue)}" if _region(tissue) else what


def _tissue_words(tissue: str) -> str:
    return f"the tissues of the {_region(tissue)} body" if _region(tissue) else "the tissues"


def _closed_store_ratio(settings: Named) -> np.ndarray:
    """PCO2 of a closed store over that which it has at 37 C."""
    return 10.0 ** (CLOSED_PCO2_SLOPE * (settings[TEMPERATURE] - NORMAL_C))


def plasma_share(states: Named, settings: Named, fluid: bool) -> np.ndarray:
    """Plasma share of blood that is bled or given: that in large vessels."""
    if not fluid:
        return 1.0 - settings[HAEMATOCRIT]
    return 1.0 - states[RED_CELLS] / (FCELLS * (states[PLASMA] + states[RED_CELLS]))


def _bicarbonate_space(settings: Named) -> np.ndarray:
    return settings[_key_of("bicarbonate_space_ml")]


def _concentration_at_start(settings: Named, solute: str) -> np.ndarray:
    """Concentration of a solute at the start [mmol/L]."""
    if solute == "creatinine":
        return 1e-3 * settings[_key_of("creatinine_umol_l")]
    return settings[_key_of(f"{solute}_mmol_l")]


def _generation(settings: Named, solute: str) -> np.ndarray:
    """Generation rate of a solute [mmol/s]."""
    if solute == "creatinine":
        return 1e-3 * settings[_key_of("creatinine_generation_umol_h")] / _HOUR
    return settings[_key_of(f"{solute}_generation_mmol_h")] / _HOUR


def _volumes_at_start(settings: Named, fluid: bool) -> tuple[np.ndarray, np.ndarray]:
    """Extracellular and intracellular water at the start [mL]."""
    water = settings[_key_of("body_water_ml")]
    if not fluid:
        return EXTRACELLULAR_SHARE * water, (1.0 - EXTRACELLULAR_SHARE) * water
    plasma, _ = blood_at_start(settings)
    outside = plasma + settings["fluid.interstitial_volume_ml"]
    return outside, np.maximum(water - outside, SMALLEST_INTRACELLULAR_SHARE * water)


def standard_base_excess(bicarbonate: Number, haemoglobin: Number) -> Number:
    """Base excess [mmol/L] of oxygenated blood with a bicarbonate [mmol/L] at a PCO2 of 40 mmHg."""
    ph = 6.1 + np.log10(np.maximum(bicarbonate, 1e-3) / (carbon_dioxide_solubility() * STANDARD_PCO2))
    blood = Blood(haemoglobin, 0.0, 37.0, 1.34)
    return (1.0 - 0.0143 * haemoglobin) * excess_of(STANDARD_PCO2, ph, 1.0, blood)


def standard_bicarbonate(base_excess: float, haemoglobin: float) -> float:
    """Inverse of `standard_base_excess`: bicarbonate [mmol/L] at a base excess, to rounding."""
    low, high = 0.1, 200.0
    while high - low > 1e-12 * high:
        middle = 0.5 * (low + high)
        above = float(standard_base_excess(middle, haemoglobin)) > base_excess
        low, high = (low, middle) if above else (middle, high)
    return 0.5 * (low + high)
