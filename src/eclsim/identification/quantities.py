"""Quantities of a fit: parameters, with the coordinates of the search, and outputs that are measured.

Most parameters are resistances and the like, sought by their logarithms: a step means the same relative
change for all of them. What may be zero or negative, such as a shunt fraction, a base excess or a volume
given, is sought itself, in a unit of which its allowed range has as many as a factor of 100 has in
logarithms, so that a step is of the same order for all.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from eclsim.cases.quantities import quantity
from eclsim.cases.sections import FURTHER_MEASUREMENTS, MEASURED_GASES, Measurements
from eclsim.reporting.numbers import number
from eclsim.sensitivity.inputs import DEFAULTS, Uncertainty, standard_uncertainties

_DIGITS = 12


@dataclass(frozen=True)
class Scale:
    """Coordinates of some parameters.

    Args:
        units: what a coordinate of 1 is, of each parameter on a linear scale; 0 for logarithms.
    """

    units: tuple[float, ...]

    @classmethod
    def of(cls, names: Sequence[str]) -> Scale:
        """Scale of parameters by name."""
        return _scale(tuple(names))

    @property
    def linear(self) -> np.ndarray:
        """Which parameters are sought themselves, shape (parameters,)."""
        return np.array(self.units) > 0.0

    def coordinates(self, values: np.ndarray) -> np.ndarray:
        """Coordinates of values in their units, shape (..., parameters)."""
        values, linear = np.asarray(values, dtype=float), self.linear
        return np.where(linear, values / self._divisors, np.log(np.where(linear, 1.0, values)))

    def values(self, x: np.ndarray) -> np.ndarray:
        """In their units, of coordinates of shape (..., parameters)."""
        return np.where(self.linear, x * self._divisors, np.exp(np.where(self.linear, 0.0, x)))

    def slopes(self, x: np.ndarray) -> np.ndarray:
        """d value / d coordinate, shape (..., parameters) as x."""
        return np.where(self.linear, self._divisors, np.exp(np.where(self.linear, 0.0, x)))

    def of_parameter(self, k: int) -> Scale:
        """Scale of one of the parameters."""
        return Scale((self.units[k],))

    def value(self, k: int, x: float) -> float:
        """One parameter in its unit, without the rounding of going there and back."""
        return float(f"{self.of_parameter(k).values(np.array([x]))[0]:.{_DIGITS}g}")

    def difference_text(self, k: int, distance: float) -> str:
        """Two values at a distance in the coordinate of a parameter: relative, or in its unit."""
        unit = self.units[k]
        return number(distance * unit, digits=2) if unit else f"{100.0 * math.expm1(distance):.0f} %"

    def error(self, k: int, error: float) -> str:
        """A standard error in words."""
        unit = self.units[k]
        return number(error * unit, digits=2) if unit else f"a factor of {math.exp(error):.2g}"

    @property
    def _divisors(self) -> np.ndarray:
        return np.where(self.linear, self.units, 1.0)


@lru_cache(maxsize=1024)
def _scale(names: tuple[str, ...]) -> Scale:
    return Scale(tuple(0.0 if (p := quantity(name)) is None else p.linear_unit for name in names))


def unit_of_parameter(name: str) -> str:
    """Unit of a parameter or of a number of a case; empty for none."""
    known = quantity(name)
    return "" if known is None or known.unit == "1" else known.unit


def axis_label(name: str) -> str:
    """Name and unit of a parameter for an axis."""
    unit = unit_of_parameter(name)
    return f"{name} [{unit}]" if unit else name


# --- outputs that can be fitted, and their uncertainties --------------------------------------------


PRESSURES = ("SP", "DP", "MAP", "MPAP", "PCWP")
FLOWS = ("CO", "PF")
BEAT_OUTPUTS = PRESSURES + FLOWS
"""Outputs of the beat itself that can be fitted."""
GASES = MEASURED_GASES
"""Outputs of gas exchange that can be fitted, where a case has it."""
OUTPUTS = BEAT_OUTPUTS + FURTHER_MEASUREMENTS + GASES
"""All outputs that can be fitted."""


def unit_of(output: str) -> str:
    """Unit of an output that can be fitted."""
    return Measurements.fields()[output].unit


def measured_and_simulated(results: Sequence[Mapping[str, Any]], names: Sequence[str]) -> np.ndarray:
    """Values of some outputs of data points, as in JSON files, wherever there are both, shape (values, 2)."""
    cells = [result["outputs"].get(name) or {} for result in results for name in names]
    pairs = [(cell.get("measured"), cell.get("simulated")) for cell in cells]
    return np.array([pair for pair in pairs if None not in pair], dtype=float).reshape(-1, 2)


def relative_scale(output: str, value: float) -> float:
    """Scale of a relative difference: the value; at least the usual size where it may be negative."""
    usual = abs(Measurements.fields()[output].typical) if output in FURTHER_MEASUREMENTS else 0.0
    return max(abs(value), usual)


def measurement_errors(
    measured: Mapping[str, float], uncertainties: Mapping[str, Uncertainty] | None = None
) -> dict[str, float]:
    """Standard uncertainty of each measurement, in its unit.

    Args:
        measured: values [mmHg, L/min].
        uncertainties: uncertainties that differ from the defaults.
    """
    return standard_uncertainties(measured, {**DEFAULTS, **(uncertainties or {})})
