"""What is measured: outputs that can be fitted, their uncertainties, and when they were measured."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from eclsim.cases.cohort_rows import when
from eclsim.inputs.mistakes import CaseError, Mistake, shown
from eclsim.sensitivity.uncertainties import DEFAULTS, Uncertainty, standard_uncertainties

PRESSURES = ("SP", "DP", "MAP", "MPAP", "PCWP")
FLOWS = ("CO", "PF")
OUTPUTS = PRESSURES + FLOWS
"""What can be fitted."""
SECONDS_PER_HOUR = 3600.0
_TIME_IN_FILE_NAME = re.compile(r"(\d{4}-\d\d-\d\d)[T_ ](\d\d)[-.]?(\d\d)")


def unit_of(output: str) -> str:
    """Unit of an output that can be fitted."""
    return "L/min" if output in FLOWS else "mmHg"


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


def elapsed_hours(names: Sequence[str]) -> list[float | None] | None:
    """Hours from each measurement to the next, or None where the names are no times.

    Args:
        names: of the measurements in their order, such as 2024-03-01T08:00, in file names 2024-03-01T08-00.

    Returns:
        None for the first, hours for every other; None instead of all where a name is no time, or where some
        have a time zone and others not.

    Raises:
        CaseError: A time before the one before it.
    """
    times = [when(_TIME_IN_FILE_NAME.sub(r"\1T\2:\3", name)) for name in names]
    known = [t for t in times if t is not None]
    if len(known) < len(names) or len({t.tzinfo is None for t in known}) > 1:
        return None
    hours = [(later - earlier).total_seconds() / SECONDS_PER_HOUR for earlier, later in pairwise(known)]
    wrong = [
        Mistake("measurement", f"earlier than {shown(names[k])}, which comes before it", shown(names[k + 1]),
                "measurements in order of time")
        for k, passed in enumerate(hours)
        if passed < 0.0
    ]  # fmt: skip
    if wrong:
        raise CaseError(wrong)
    return [None, *hours]
