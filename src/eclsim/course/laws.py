"""The laws of the slow states of a course."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from eclsim.circuit.network import Circuit
from eclsim.components.exchangers import HAEMOGLOBIN
from eclsim.drugs.published import InfusedDoses
from eclsim.fluid.dialysed_drug import dialysed_drug_law
from eclsim.fluid.law import fluid_law
from eclsim.fluid.solutes import SolutesLaw, filters_of, stores_of_carbon_dioxide
from eclsim.parameters.dialysed_drug import FOLLOWED as DRUG_FOLLOWED
from eclsim.parameters.fluid import HAEMATOCRIT, SOLUTES_FOLLOWED
from eclsim.parameters.regulation import DRUGS, LUNG_RESISTANCE
from eclsim.regulation.oxygen import HypoxicVasoconstriction
from eclsim.slow import DerivedQuantity, Named, SlowLaw


def laws_of(circuit: Circuit, settings: Mapping[str, float]) -> tuple[SlowLaw, ...]:
    """Return the laws of the slow states that a case follows, by its circuit and parameters."""
    names, gas = circuit.parameter_names(), HAEMOGLOBIN in circuit.content_names()
    fluid = HAEMATOCRIT in names
    followed = np.any(settings.get(SOLUTES_FOLLOWED, 0.0))
    solutes = SolutesLaw(filters_of(circuit), fluid, gas) if followed else None
    return (
        *([fluid_law(circuit, settings)] if fluid else []),
        *([] if solutes is None else [solutes]),
        *stores_of_carbon_dioxide(circuit, solutes),
        *([dialysed_drug_law(circuit, settings, fluid)] if np.any(settings.get(DRUG_FOLLOWED, 0.0)) else []),
        *([InfusedDoses()] if any(name.startswith(f"{DRUGS}.") for name in names) else []),
        *([HypoxicVasoconstriction()] if LUNG_RESISTANCE in names else []),
    )


USED_UP = 0.1
"""An amount may be below zero by this share of its scale, within the tolerance of a step."""


class Laws:
    """Several laws combined; their states are the rows of an array.

    Args:
        laws: laws that are combined.
    """

    def __init__(self, laws: tuple[SlowLaw, ...]):
        self.laws = laws
        self.states = tuple(state for law in laws for state in law.states)
        self.names = tuple(state.name for state in self.states)
        self.scales = np.array([state.scale for state in self.states])
        self.least = np.array([-USED_UP * s.scale if s.is_amount else -np.inf for s in self.states])
        self.blood = [self.names.index(name) for law in laws for name in law.blood]
        self.reads = tuple(dict.fromkeys(name for law in laws for name in law.reads))

    def beat_by_beat(self) -> Laws:
        """Return the laws for use where gases of the blood are followed beat by beat."""
        return Laws(tuple(law.beat_by_beat() for law in self.laws))

    def start(self, settings: Named, beat: Named) -> np.ndarray:
        """States at time 0, shape (states, members)."""
        values: dict[str, np.ndarray] = {}
        for law in self.laws:
            values |= law.start(settings, beat)
        return np.array([values[name] for name in self.names])

    def in_effect(self, states: np.ndarray, settings: Named) -> dict[str, np.ndarray]:
        """Return the settings with the values that slow states set."""
        named, values = self._named(states), dict(settings)
        for law in self.laws:
            values |= law.in_effect(named, values)
        return values

    def rates(self, states: np.ndarray, settings: Named, beat: Named, inflows: Named) -> np.ndarray:
        """Rate of change of each state per second, shape (states, members)."""
        named, rates = self._named(states), dict[str, np.ndarray]()
        for law in self.laws:
            rates |= law.rates(named, settings, beat, inflows)
        return np.array([rates[name] for name in self.names])

    def negative_amounts(self, states: np.ndarray) -> np.ndarray:
        """Whether each amount is below zero, shape (states, members)."""
        return states < self.least[:, None]

    def derived_quantities(self, states: np.ndarray, in_effect: Named) -> tuple[DerivedQuantity, ...]:
        """Quantities that are derived from the states and shown with them."""
        return tuple(
            quantity
            for law in self.laws
            for quantity in law.derived_quantities(self._named(states), in_effect)
        )

    def _named(self, states: np.ndarray) -> Mapping[str, np.ndarray]:
        return dict(zip(self.names, states, strict=True))


def message_without_rates(lacking: Sequence[str]) -> str:
    """Reason why slow states have no rates although a steady beat was found."""
    if not lacking:
        return "a slowly changing quantity has no finite rate of change"
    reason = f"the beat has no value of {', '.join(lacking)}, which the course needs to go on"
    if any("clearance" in name for name in lacking):
        reason += ": a filter takes as much water from its blood as the plasma holds, or gets no blood"
    return reason
