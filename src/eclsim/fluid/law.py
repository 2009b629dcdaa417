"""Plasma, red cells, interstitium and protein as slow states: infusion, removal, filtration and refill."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from eclsim.circuit.network import BLOOD_VOLUME, Circuit
from eclsim.components.exchangers import HAEMOGLOBIN
from eclsim.drugs.published import PUBLISHED, combined_effect, dose_in_effect
from eclsim.fluid.starling import (
    ALBUMIN_EQUIVALENT,
    EXCLUDED_SHARE,
    Forces,
    Spaces,
    Wall,
    capillary_pressure,
    exchange,
    forces,
    oncotic_pressure,
)
from eclsim.parameters.fluid import (
    FCELLS,
    HAEMATOCRIT,
    INTERSTITIUM_TO_BLOOD,
    PERICAPILLARY,
    SECTION,
    VENULES,
)
from eclsim.parameters.physiology import UPPER_SHARE
from eclsim.parameters.regulation import (
    BEDS,
    DRUGS,
    EXTRA_VOLUME,
    dose,
    local_factor,
    local_resistance,
    sensitivity,
)
from eclsim.slow import DerivedQuantity, Named, SlowLaw, SlowState

CONCENTRATE_HAEMATOCRIT = 0.60
"""Haematocrit of a red cell concentrate; the rest is an additive solution without protein."""
ALBUMIN_G_ML = 0.05 * ALBUMIN_EQUIVALENT
"""Plasma protein equivalent in oncotic effect to 5 g/dL of infused albumin [g/mL]."""
_TONE = "systemic_resistance_factor"
_CAVAE = ("superior_caval_pressure", "inferior_caval_pressure")
_MINUTE, _HOUR = 60.0, 3600.0


def _key_of(name: str) -> str:
    return f"{SECTION}.{name}"


PLASMA, RED_CELLS, INTERSTITIUM = _key_of("plasma_ml"), _key_of("red_cells_ml"), _key_of("interstitium_ml")
PROTEIN, INTERSTITIAL_PROTEIN = _key_of("plasma_protein_g"), _key_of("interstitial_protein_g")
GIVEN, REMOVED, REFILLED = _key_of("given_ml"), _key_of("removed_ml"), _key_of("refilled_ml")
RED_CELLS_GIVEN, PROTEIN_GIVEN = _key_of("red_cells_given_ml"), _key_of("protein_given_g")
CAPILLARY, ARTERIOLES = _key_of("capillary_pressure_at_start_mmHg"), _key_of("resistance_at_start")
PERICAPILLARY_PROTEIN = SlowState(
    _key_of("pericapillary_protein_g"), "g", "protein in the fluid around the capillaries", 1.0, True
)
"""Pericapillary interstitial protein; a state if that layer has its own concentration."""
DRUG_TONE = SlowState(_key_of("drug_tone_at_start"), "1", "effect of drugs on resistance at the start", 0.1)
"""Factor by which drugs multiplied the resistance at the start; a state where drugs can be given."""
STATES = (
    SlowState(PLASMA, "mL", "plasma volume", 10.0, True),
    SlowState(RED_CELLS, "mL", "volume of red cells", 10.0, True),
    SlowState(INTERSTITIUM, "mL", "interstitial fluid", 50.0, True),
    SlowState(PROTEIN, "g", "plasma protein", 1.0, True),
    SlowState(INTERSTITIAL_PROTEIN, "g", "interstitial protein", 1.0, True),
    SlowState(GIVEN, "mL", "fluid and blood given", 10.0),
    SlowState(REMOVED, "mL", "fluid and blood removed", 10.0),
    SlowState(REFILLED, "mL", "refill from the tissues", 10.0),
    SlowState(RED_CELLS_GIVEN, "mL", "red cells given", 10.0),
    SlowState(PROTEIN_GIVEN, "g", "protein given", 1.0),
    SlowState(CAPILLARY, "mmHg", "capillary pressure at the start", 1.0),
    SlowState(ARTERIOLES, "1", "resistance of the arterioles at the start", 0.1),
)
"""Blood, interstitium, protein; then totals since the start: given, removed (bled and filtered), refilled,
red cells and protein (given minus removed); then values at the start."""


def blood_at_start(settings: Named) -> tuple[np.ndarray, np.ndarray]:
    """Plasma and red cells [mL] at the start, including blood given before."""
    blood = settings[BLOOD_VOLUME] + settings[EXTRA_VOLUME]
    cells = FCELLS * settings[HAEMATOCRIT] * blood
    return blood - cells, cells


@dataclass(frozen=True)
class FluidLaw(SlowLaw):
    """Slow law of the patient's fluid in a course.

    Blood that is bled or given has the patient's own composition; crystalloid and albumin are added to the
    plasma; ultrafiltration removes plasma water without protein. Blood in circuits counts as the patient's.

    Args:
        arterial: output of mean arterial pressure.
        venous: outputs of mean venous pressures (superior, then inferior if there are two).
        ultrafiltration: parameters of net ultrafiltration [mL/h].
        local: outputs of the factors by which gases change organs' resistance (upper, then lower if there are
            two).
        haematocrits: parameters that change together with `fluid.haematocrit`.
        gas: whether haemoglobin changes with it as well.
        has_pericapillary_layer: whether the pericapillary interstitium has its own concentration.
        drugs: names of drugs that can be given; venules follow their effect on resistance by
            `fluid.venular_tone`, and reflexes not at all.
    """

    arterial: str = "MAP"
    venous: tuple[str, ...] = ("venous_pressure",)
    local: tuple[str, ...] = ()
    ultrafiltration: tuple[str, ...] = ()
    haematocrits: tuple[str, ...] = ()
    gas: bool = False
    has_pericapillary_layer: bool = False
    drugs: tuple[str, ...] = ()

    @property
    def states(self) -> tuple[SlowState, ...]:  # noqa: D102  (as documented in the base class; so below)
        layer = (PERICAPILLARY_PROTEIN,) if self.has_pericapillary_layer else ()
        return (*STATES, *layer, *((DRUG_TONE,) if self.drugs else ()))

    @property
    def reads(self) -> tuple[str, ...]:  # noqa: D102
        return (self.arterial, *self.venous, _TONE, *self.local)

    def at_rest(self, settings: Named) -> tuple[Spaces, Wall]:
        """Fluid spaces at the start and the capillary wall between them."""
        return _rest(settings), _wall(settings)

    def start(self, settings: Named, beat: Named) -> Named:  # noqa: D102
        rest, zero = _rest(settings), np.zeros_like(settings[BLOOD_VOLUME])
        _, cells = blood_at_start(settings)
        tone = self._resistance(settings, beat)
        doses = {name: settings[dose(name)] for name in self.drugs}
        return {
            PLASMA: rest.plasma, RED_CELLS: cells, INTERSTITIUM: rest.interstitium,
            PROTEIN: rest.plasma_protein, INTERSTITIAL_PROTEIN: rest.interstitial_protein,
            **dict.fromkeys((GIVEN, REMOVED, REFILLED, RED_CELLS_GIVEN, PROTEIN_GIVEN), zero),
            CAPILLARY: self._capillary(settings, beat, np.ones_like(zero)), ARTERIOLES: tone,
            **self._pericapillary(settings[PERICAPILLARY] * rest.interstitial_protein),
            **self._drug_tone_at_start(self._drug_tone(doses, settings)),
        }  # fmt: skip

    def in_effect(self, states: Named, settings: Named) -> Named:  # noqa: D102
        plasma, cells = blood_at_start(settings)
        volume = (states[PLASMA] - plasma) + (states[RED_CELLS] - cells)
        thickened = (states[RED_CELLS] / (states[PLASMA] + states[RED_CELLS])) / (cells / (plasma + cells))
        follow = (HAEMATOCRIT, *self.haematocrits, *([HAEMOGLOBIN] if self.gas else []))
        return {EXTRA_VOLUME: settings[EXTRA_VOLUME] + volume} | {
            key: settings[key] * thickened for key in follow
        }

    def rates(self, states: Named, settings: Named, beat: Named, inflows: Named) -> Named:  # noqa: D102
        zero = np.zeros_like(states[PLASMA])
        open_wall = settings[_key_of("capillary_refill")] / _MINUTE
        crossed = exchange(*self._since_start(states, settings, beat), _wall(settings))
        out, protein_out = open_wall * crossed.fluid, open_wall * crossed.protein

        blood = inflows["blood_ml"] - inflows["bleed_ml"]
        haematocrit = states[RED_CELLS] / (FCELLS * (states[PLASMA] + states[RED_CELLS]))
        filtered = sum((settings[key] for key in self.ultrafiltration), zero) / _HOUR
        packed, clear = inflows["red_cells_ml"], inflows["crystalloid_ml"] + inflows["albumin_ml"]
        cells = CONCENTRATE_HAEMATOCRIT * packed + haematocrit * blood
        plasma = (1.0 - CONCENTRATE_HAEMATOCRIT) * packed + clear + (1.0 - haematocrit) * blood - filtered
        protein = ALBUMIN_G_ML * inflows["albumin_ml"]
        protein = protein + (1.0 - haematocrit) * blood * states[PROTEIN] / states[PLASMA]
        return {
            PLASMA: plasma - out, RED_CELLS: cells, INTERSTITIUM: out, PROTEIN: protein - protein_out,
            INTERSTITIAL_PROTEIN: protein_out, GIVEN: packed + clear + inflows["blood_ml"],
            REMOVED: inflows["bleed_ml"] + filtered, REFILLED: -out, RED_CELLS_GIVEN: cells,
            PROTEIN_GIVEN: protein, CAPILLARY: zero, ARTERIOLES: zero,
            **self._pericapillary(open_wall * crossed.pericapillary_protein),
            **self._drug_tone_at_start(zero),
        }  # fmt: skip

    def forces(self, states: Named, settings: Named, beat: Named) -> Forces:
        """Starling forces across the capillary wall, as changes since the start."""
        return forces(*self._since_start(states, settings, beat))

    def derived_quantities(self, states: Named, in_effect: Named) -> tuple[DerivedQuantity, ...]:  # noqa: D102
        protein = 100.0 * states[PROTEIN] / states[PLASMA]
        return (
            DerivedQuantity("haematocrit", "1", "haematocrit of the blood", in_effect[HAEMATOCRIT]),
            DerivedQuantity("plasma_protein", "g/dL", "protein of the plasma", protein),
            DerivedQuantity(
                "oncotic_pressure", "mmHg", "oncotic pressure of the plasma", oncotic_pressure(protein)
            ),
        )

    def _pericapillary(self, protein: np.ndarray) -> Named:
        """Pericapillary protein, or its rate of change, if it is a state."""
        return {PERICAPILLARY_PROTEIN.name: protein} if self.has_pericapillary_layer else {}

    def _since_start(self, states: Named, settings: Named, beat: Named) -> tuple[Spaces, Spaces, np.ndarray]:
        """Spaces now and at the start, and rise of capillary pressure since the start [mmHg]."""
        rest = _rest(settings)
        now = Spaces(
            states[PLASMA], states[INTERSTITIUM], states[PROTEIN], states[INTERSTITIAL_PROTEIN], rest.normal,
            *(
                (states[PERICAPILLARY_PROTEIN.name], settings[PERICAPILLARY])
                if self.has_pericapillary_layer
                else ()
            ),
        )  # fmt: skip
        tone = self._resistance(settings, beat) / states[ARTERIOLES]
        venules = self._venules(states, settings)
        return now, rest, self._capillary(settings, beat, tone, venules) - states[CAPILLARY]

    def _venules(self, states: Named, settings: Named) -> np.ndarray | float:
        """Resistance of the venules relative to the start."""
        if not self.drugs:
            return 1.0
        doses = {name: states[dose_in_effect(name)] for name in self.drugs}
        return (self._drug_tone(doses, settings) / states[DRUG_TONE.name]) ** settings[VENULES]

    def _drug_tone(self, doses: Named, settings: Named) -> np.ndarray:
        """Factor by which drugs multiply the systemic resistance."""
        felt = {name: dose * settings[sensitivity(name)] for name, dose in doses.items()}
        return np.exp(combined_effect("systemic_resistance", felt))

    def _drug_tone_at_start(self, tone: np.ndarray) -> Named:
        """Effect of drugs at the start, or its rate of change, if it is a state."""
        return {DRUG_TONE.name: tone} if self.drugs else {}

    def _resistance(self, settings: Named, beat: Named) -> np.ndarray:
        """Resistance of the systemic microcirculation with reflex, drugs, settings and organs' gases."""
        own = [beat[name] for name in self.local]
        if len(own) > 1:
            upper = settings[UPPER_SHARE]
            own = [1.0 / (upper / own[0] + (1.0 - upper) / own[1])]
        return settings["Rmc"] * beat[_TONE] * (own[0] if own else 1.0)

    def _capillary(
        self, settings: Named, beat: Named, tone: np.ndarray, venules: np.ndarray | float = 1.0
    ) -> np.ndarray:
        venous = beat[self.venous[0]]
        if len(self.venous) > 1:
            upper = settings[UPPER_SHARE]
            venous = upper * venous + (1.0 - upper) * beat[self.venous[1]]
        return capillary_pressure(beat[self.arterial], venous, tone, venules)


def fluid_law(circuit: Circuit, settings: Mapping[str, float | np.ndarray]) -> FluidLaw:
    """Fluid law of a circuit with a volume offset.

    Args:
        circuit: patient and devices.
        settings: the case's parameters.
    """
    names = (*circuit.parameter_names(), *circuit.content_names())
    regional = any(c.name == "svc" for c in circuit.compartments)
    resistances = (key for key in map(local_resistance, BEDS) if key in names)
    return FluidLaw(
        venous=_CAVAE if regional else ("venous_pressure",),
        local=tuple(map(local_factor, resistances)),
        ultrafiltration=tuple(n for n in names if n.endswith(".net_ultrafiltration_ml_h")),
        haematocrits=tuple(n for n in names if n.endswith(".haematocrit_in")),
        gas=HAEMOGLOBIN in names,
        has_pericapillary_layer=bool(np.any(np.asarray(settings[PERICAPILLARY]) < 1.0)),
        drugs=tuple(PUBLISHED) if any(name.startswith(f"{DRUGS}.") for name in names) else (),
    )


def _rest(settings: Named) -> Spaces:
    """Fluid spaces at the start."""
    plasma, _ = blood_at_start(settings)
    normal = INTERSTITIUM_TO_BLOOD * settings[BLOOD_VOLUME]
    interstitium = settings[_key_of("interstitial_volume_ml")]
    return Spaces(
        plasma, interstitium, 0.01 * plasma * settings[_key_of("plasma_protein_g_dl")],
        0.01 * (interstitium - EXCLUDED_SHARE * normal) * settings[_key_of("interstitial_protein_g_dl")],
        normal,
    )  # fmt: skip


def _wall(settings: Named) -> Wall:
    names = ("filtration_ml_min_mmHg", "reflection", "lymph_ml_min", "lymph_pump")
    return Wall(*(settings[_key_of(name)] for name in names))
