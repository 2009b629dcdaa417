"""Circuits as data, and their assembly into states and laws."""

from eclsim.circuit.network import Choice, Circuit, Compartment, Connection, StartPressure, StartVolume
from eclsim.circuit.validation import CircuitError, validate

__all__ = [
    "Choice", "Circuit", "CircuitError", "Compartment", "Connection", "StartPressure", "StartVolume",
    "validate",
]  # fmt: skip
