"""What is measured: outputs that can be fitted, and their uncertainties."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from eclsim.cases.sections import MEASURED_GASES, Measurements
from eclsim.sensitivity.uncertainties import DEFAULTS, Uncertainty, standard_uncertainties

PRESSURES = ("SP", "DP", "MAP", "MPAP", "PCWP")
FLOWS = ("CO", "PF")
OF_THE_BEAT = PRESSURES + FLOWS
"""What can be fitted of the beat itself."""
GASES = MEASURED_GASES
"""What can be fitted of gas exchange, where a case has it."""
OF_ECMO = ("PF", "SpreO2", "SpostO2", "PpostO2", "PexhaustCO2")
"""What is measured at the ECMO circuit."""
OUTPUTS = OF_THE_BEAT + GASES
"""What can be fitted."""


def unit_of(output: str) -> str:
    """Unit of an output that can be fitted."""
    return Measurements.fields()[output].unit


def measured_and_simulated(results: Sequence[Mapping[str, Any]], names: Sequence[str]) -> np.ndarray:
    """Values of some outputs of data points, as in JSON files, wherever there are both, shape (values, 2)."""
    cells = [result["outputs"].get(name) or {} for result in results for name in names]
    pairs = [(cell.get("measured"), cell.get("simulated")) for cell in cells]
    return np.array([pair for pair in pairs if None not in pair], dtype=float).reshape(-1, 2)


def measurement_errors(
    measured: Mapping[str, float], given: Mapping[str, Uncertainty] | None = None
) -> dict[str, float]:
    """Standard uncertainty of each measurement, in its unit.

    Args:
        measured: values [mmHg, L/min].
        given: uncertainties that differ from the defaults.
    """
    return standard_uncertainties(measured, {**DEFAULTS, **(given or {})})
