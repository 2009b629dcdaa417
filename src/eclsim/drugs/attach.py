"""Drugs in a circuit's tables."""

from __future__ import annotations

from eclsim.circuit.network import Circuit, Control
from eclsim.drugs.law import ACTS_ON, InfusedDrugs
from eclsim.drugs.published import PUBLISHED
from eclsim.parameters.regulation import DRUGS


def with_drugs(circuit: Circuit) -> Circuit:
    """A circuit with volume offset whose patient can be given every published drug."""
    control = Control(DRUGS, InfusedDrugs(tuple(PUBLISHED.values())), (), ACTS_ON)
    return circuit + Circuit(controllers=(control,))
