"""Wash-in and wash-out: the dose in effect follows the pump with each drug's half-life."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from eclsim.drugs.law import Drug
from eclsim.drugs.published import PUBLISHED
from eclsim.parameters.regulation import DRUG_DOSES, dose
from eclsim.slow import Named, SlowLaw, SlowState


@dataclass(frozen=True)
class InfusedDoses(SlowLaw):
    """One state for each drug, its dose in effect; d(dose)/dt = (pump - dose) ln 2 / half-life.

    The mean of a single compartment of distribution, effect and concentration in step: noradrenaline is
    in effect to 94 % after four half-lives, 12 min, milrinone after 10 h where no loading dose is given.

    Args:
        drugs: those that can be given.
    """

    drugs: tuple[Drug, ...] = tuple(PUBLISHED.values())

    @property
    def states(self) -> tuple[SlowState, ...]:
        """Dose in effect of each drug."""
        return tuple(
            SlowState(f"{dose(d.name)}_in_effect", DRUG_DOSES[d.name].unit, 0.1 * d.half_dose)
            for d in self.drugs
        )

    @property
    def reads(self) -> tuple[str, ...]:
        """Nothing."""
        return ()

    def start(self, settings: Named, beat: Named) -> Named:
        """Doses that the pumps have long run at."""
        pairs = zip(self.states, self.drugs, strict=True)
        return {state.name: np.asarray(settings[dose(drug.name)], dtype=float) for state, drug in pairs}

    def in_effect(self, states: Named, settings: Named) -> Named:
        """The dose of each drug in the circuit."""
        pairs = zip(self.states, self.drugs, strict=True)
        return {dose(drug.name): states[state.name] for state, drug in pairs}

    def rates(self, states: Named, settings: Named, beat: Named, inflows: Named) -> Named:
        """Towards the dose of the pump."""
        return {
            state.name: (settings[dose(drug.name)] - states[state.name])
            * (math.log(2.0) / (60.0 * drug.half_life_min))
            for state, drug in zip(self.states, self.drugs, strict=True)
        }
