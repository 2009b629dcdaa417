"""Circuits as data, and their assembly into states and laws."""

from eclsim.circuit.network import (
    Choice,
    Circuit,
    Compartment,
    Connection,
    Control,
    Exchange,
    StartPressure,
    StartVolume,
    Surrounding,
    maximum_of,
    mean_of,
    minimum_of,
)
from eclsim.circuit.validation import CircuitError, validate

__all__ = [
    "Choice", "Circuit", "CircuitError", "Compartment", "Connection", "Control", "Exchange",
    "StartPressure", "StartVolume", "Surrounding", "maximum_of", "mean_of", "minimum_of", "validate",
]  # fmt: skip
