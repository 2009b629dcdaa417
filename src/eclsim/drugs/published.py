"""Drugs with published measurements before and after: dose-response curves, fitted effects, half-lives.

The effects of each drug are those with which eclsim agrees best with the drug's study, in a virtual patient
who has the study's values before the drug, without reflexes. `python benchmarks/drug_fit.py` repeats the fit
and prints the effects listed here. The reflexes of the study's patients are therefore part of the effects.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from eclsim.circuit.network import Circuit, Control
from eclsim.drugs.law import ACTS_ON, Drug, Effects, InfusedDrugs
from eclsim.parameters.regulation import DRUG_DOSES, DRUGS, dose
from eclsim.slow import Named, SlowLaw, SlowState

BELOEIL = "Beloeil 2005 (Br J Anaesth 95:782), read in a public program"
_ALL = (
    Drug(
        "noradrenaline", 0.6, 1.8, Effects(1.212, 1.188, 0.0, -0.06, -0.066), 3.06,
        source="Hamzaoui 2010 (10.1186/cc9207), septic shock, n 105; the dose, 0.3, is not in the abstract: "
        "that of later patients of the same unit (Persichini 2012, Adda 2021)",
        shape_source=f"steepness and largest rise of pressure (98.7 mmHg) of {BELOEIL}; the half dose is "
        "where the 22 mmHg of Hamzaoui are 22/98.7 of it",
        half_life_source=f"volume 8.84 L, clearance 2 L/min, of {BELOEIL}",
    ),
    Drug(
        "adrenaline", 0.085, 1.0, Effects(1.246, -0.474, 0.244, 0.366, 0.024), 3.0,
        source="Thorac Cardiovasc Surg 27:378 (1979, 10.1055/s-0028-1096281), anaesthetised before coronary "
        "surgery, n 8 and 8, 0.075 and 0.15 ug/kg/min",
        shape_source="cardiac index +47 and +69 % at the two doses of the same study; its dP/dt gives 0.094",
        half_life_source="steady within 10 to 15 min, half-life below 5: prescribing information",
    ),
    Drug(
        "vasopressin", 0.012, 1.0, Effects(0.0, 0.875, 0.0, 0.0, -0.002), 10.0,
        source="Landry 1997 (PMID 9054839), septic shock, n 10, 0.04 U/min",
        shape_source="systolic pressure +32 mmHg at 0.01 and +54 mmHg at 0.04 U/min, in other patients "
        "of the same study",
        half_life_source="not verified: at most 10 min",
    ),
    Drug(
        "dobutamine", 10.0, 1.0, Effects(0.644, -1.092, -0.974, 0.124, 0.085), 2.5,
        source="heart failure: Grose 1986 (J Am Coll Cardiol 7:1107), n 11, dose taken as 10; Akhtar 1975 "
        "(10.1016/0002-9149(75)90526-3), n 15, 10 ug/kg/min; Rpmc: \"Additive effects of milrinone and "
        "dobutamine in severe heart failure\" (abstract), n 14, 9 ug/kg/min",
        shape_source="not verified: effects still rise between 5 and 10 ug/kg/min (Akhtar 1975)",
        half_life_source="2 to 3 min: table 23 of the ACCF/AHA guideline on heart failure",
    ),
    Drug(
        "milrinone", 0.5, 1.0, Effects(0.285, -1.107, -0.646, 0.0, 0.132), 150.0,
        source="heart failure: Grose 1986 (J Am Coll Cardiol 7:1107), n 11, dose taken as 0.5; Rpmc: "
        "\"Additive effects of milrinone and dobutamine in severe heart failure\" (abstract), n 14, "
        "0.5 ug/kg/min",
        shape_source="cardiac index +12 % and +37 % after 12.5 and 75 ug/kg at once (Fitzpatrick 1987, Am "
        "Heart J 114:97), 50 ug/kg at once taken as 0.5 ug/kg/min",
        half_life_source="2.5 h: table 23 of the ACCF/AHA guideline on heart failure; 1.7 h in Benotti 1985",
    ),
    Drug(
        "levosimendan", 0.02, 1.0, Effects(0.092, -0.477, 0.0, 0.082, 0.03), 60.0,
        source="heart failure: Slawsky 2000 (PMID 11056096), n 97, 0.4 ug/kg/min; Delle Karth 2003 "
        "(10.1046/j.1399-6576.2003.00252.x), n 10, 0.1; Poelzl 2008 (10.1007/s00059-008-3051-2), n 18, "
        "dose taken as 0.1",
        shape_source="cardiac index +30 to +39 % between 0.05 and 0.2 ug/kg/min (review of Nieminen and "
        "Sandell)",
        half_life_source="steady within 4 h (PMID 15025738), taken for four half-lives; that of its active "
        "metabolite, 81 h, is not followed",
    ),
    Drug(
        "nitroprusside", 1.5, 1.0, Effects(0.0, -0.958, 0.0, 0.079, 0.078), 2.0,
        source="heart failure: Monrad 1986 (Circulation 73:III-168), n 10, 1.5 ug/kg/min",
        shape_source="not verified", half_life_source="not verified: minutes",
    ),
)  # fmt: skip
PUBLISHED: dict[str, Drug] = {drug.name: drug for drug in _ALL}
"""All published drugs by name."""
_RATE = Effects._fields.index("heart_rate")


def with_drugs(circuit: Circuit) -> Circuit:
    """Add the controller of all published drugs to a circuit with volume offset."""
    control = Control(DRUGS, InfusedDrugs(tuple(PUBLISHED.values())), (), ACTS_ON)
    return circuit + Circuit(controllers=(control,))


def heart_rate_on_drugs(rate_bpm: float, doses: Mapping[str, float], response: float = 1.0) -> float:
    """Heart rate that a patient's own rate becomes on drugs, without reflexes [bpm].

    Args:
        rate_bpm: rate before the drugs [bpm].
        doses: dose of each drug times the patient's sensitivity to it, by name; drugs left out are not given.
        response: share of the change that takes place: 1 for a healthy sinus node, 0 for a paced heart.
    """
    factor = math.exp(sum(float(PUBLISHED[name].effects(dose)[_RATE]) for name, dose in doses.items()))
    return rate_bpm * (1.0 + response * (factor - 1.0))


# --- wash-in and wash-out: the dose in effect follows the pump with each drug's half-life ------------


@dataclass(frozen=True)
class InfusedDoses(SlowLaw):
    """Dose in effect of each drug, one state each: d(dose)/dt = (pump - dose) ln 2 / half-life.

    This is a single-compartment model in which the effect follows the concentration at once. Noradrenaline
    reaches 94 % after four half-lives, 12 min; milrinone after 10 h without a loading dose.

    Args:
        drugs: drugs that can be given.
    """

    drugs: tuple[Drug, ...] = tuple(PUBLISHED.values())

    @property
    def states(self) -> tuple[SlowState, ...]:
        """Dose in effect of each drug."""
        return tuple(
            SlowState(
                f"{dose(d.name)}_in_effect", DRUG_DOSES[d.name].unit, f"{d.name} in effect", 0.1 * d.half_dose
            )
            for d in self.drugs
        )

    @property
    def reads(self) -> tuple[str, ...]:
        """No outputs are read."""
        return ()

    def start(self, settings: Named, beat: Named) -> Named:
        """Doses in effect equal to those of the pumps, as after a long infusion."""
        pairs = zip(self.states, self.drugs, strict=True)
        return {state.name: np.asarray(settings[dose(drug.name)], dtype=float) for state, drug in pairs}

    def in_effect(self, states: Named, settings: Named) -> Named:
        """Dose of each drug in the circuit."""
        pairs = zip(self.states, self.drugs, strict=True)
        return {dose(drug.name): states[state.name] for state, drug in pairs}

    def rates(self, states: Named, settings: Named, beat: Named, inflows: Named) -> Named:
        """Rate towards the dose of the pump."""
        return {
            state.name: (settings[dose(drug.name)] - states[state.name])
            * (math.log(2.0) / (60.0 * drug.half_life_min))
            for state, drug in zip(self.states, self.drugs, strict=True)
        }
