"""Standard uncertainty of each measured value."""

from __future__ import annotations

from collections.abc import Mapping

from eclsim.sensitivity.uncertainties import DEFAULTS, Uncertainty, standard_uncertainties


def measurement_errors(
    measured: Mapping[str, float], given: Mapping[str, Uncertainty] | None = None
) -> dict[str, float]:
    """Standard uncertainty of each measurement, in its unit.

    Args:
        measured: values [mmHg, L/min].
        given: uncertainties that differ from the defaults.
    """
    return standard_uncertainties(measured, {**DEFAULTS, **(given or {})})
