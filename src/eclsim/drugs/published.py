"""Drugs with published measurements before and after: dose-response curves, fitted effects, half-lives.

The effects of each drug are those with which eclsim agrees best with the drug's study, in a virtual patient
who has the study's values before the drug, without reflexes. `python benchmarks/drug_fit.py` repeats the fit
and prints the effects listed in published.csv. The reflexes of the study's patients are therefore part of the
effects.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eclsim.circuit.network import Circuit, Control
from eclsim.drugs.law import ACTS_ON, Drug, Effects, InfusedDrugs
from eclsim.files import read_table
from eclsim.parameters.regulation import DRUG_DOSES, DRUGS, dose
from eclsim.slow import Named, SlowLaw, SlowState


def _drug(row: Mapping[str, str]) -> Drug:
    return Drug(
        row["name"], float(row["half_dose"]), float(row["steepness"]),
        Effects(*(float(row[name]) for name in Effects._fields)), float(row["half_life_min"]), row["source"],
        row["shape_source"], row["half_life_source"],
    )  # fmt: skip


PUBLISHED = {row["name"]: _drug(row) for row in read_table(Path(__file__).with_suffix(".csv"))}
"""All published drugs by name."""


def with_drugs(circuit: Circuit) -> Circuit:
    """Add the controller of all published drugs to a circuit with volume offset."""
    control = Control(DRUGS, InfusedDrugs(tuple(PUBLISHED.values())), (), ACTS_ON)
    return circuit + Circuit(controllers=(control,))


def combined_effect(effect: str, doses: Mapping[str, float | np.ndarray]) -> np.ndarray:
    """Natural logarithm of the factor by which drugs together change something, such as the heart rate.

    Args:
        effect: name of a field of `Effects`, except that of the veins, which is no factor.
        doses: dose of each drug times the patient's sensitivity to it, by name; drugs left out are not given.
    """
    place = Effects._fields.index(effect)
    each = (np.asarray(PUBLISHED[name].effects(dose)[place]) for name, dose in doses.items())
    return sum(each, np.zeros(()))


def heart_rate_on_drugs(rate_bpm: float, doses: Mapping[str, float], response: float = 1.0) -> float:
    """Heart rate that a patient's own rate becomes on drugs, without reflexes [bpm].

    Args:
        rate_bpm: rate before the drugs [bpm].
        doses: dose of each drug times the patient's sensitivity to it, by name; drugs left out are not given.
        response: share of the change that takes place: 1 for a healthy sinus node, 0 for a paced heart.
    """
    factor = math.exp(float(combined_effect("heart_rate", doses)))
    return rate_bpm * (1.0 + response * (factor - 1.0))


# --- wash-in and wash-out: the dose in effect follows the pump with each drug's half-life ------------


def dose_in_effect(drug: str) -> str:
    """Name of the slow state of a drug's dose in effect."""
    return f"{dose(drug)}_in_effect"


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
                dose_in_effect(d.name),
                DRUG_DOSES[d.name].unit,
                f"{d.name} in effect",
                0.1 * d.half_dose,
                fades=True,
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
