"""From what a beat recorded to the waveforms that people read."""

from __future__ import annotations

from typing import Any

import numpy as np

from eclsim.circuit.network import Circuit, StartPressure
from eclsim.components.base import Values, value_of

BLOOD_VOLUME = "total_blood_volume_ml"


def whole_beat(recorded: np.ndarray) -> np.ndarray:
    """Signals at all grid points from phase 0 to 1: the steady beat starts where it ends."""
    return np.concatenate([recorded[-1:], recorded])


def unstressed_volume(circuit: Circuit, name: str, values: Values) -> Any:
    """Volume [mL] that a vessel holds at zero pressure: its share of all blood less the stressed start.

    Zero for chambers and extracorporeal compartments, whose stressed volume is all they hold.
    """
    compartment = circuit.compartment(name)
    if compartment.total_fraction is None or not isinstance(compartment.start, StartPressure):
        return 0.0
    total = value_of(values, compartment.total_fraction) * values[BLOOD_VOLUME]
    law = compartment.component
    with np.errstate(divide="ignore"):
        own = law.constants({n: np.asarray(values[n], dtype=float) for n in law.parameter_names()})
    return total - value_of(values, compartment.start.pressure) / law.pressure(0.0, 0.0, own)[1]
