"""Standard uncertainty of each measured value."""

from __future__ import annotations

from collections.abc import Mapping

from eclsim.sensitivity.uncertainties import DEFAULTS, Uncertainty

LEAST_FLOW = 0.1
"""A flow measured as 0 has the uncertainty of this one [L/min]."""


def measurement_errors(
    measured: Mapping[str, float], given: Mapping[str, Uncertainty] | None = None
) -> dict[str, float]:
    """Standard uncertainty of each measurement, in its unit.

    Args:
        measured: values [mmHg, L/min].
        given: uncertainties that differ from the defaults.
    """
    known = {**DEFAULTS, **(given or {})}
    return {n: known[n].at(v) or known[n].at(LEAST_FLOW) for n, v in measured.items()}
