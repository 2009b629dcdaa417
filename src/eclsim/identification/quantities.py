"""Quantities of a fit: parameters with their search coordinates, and outputs that can be measured.

The search uses the logarithm of most parameters (resistances and the like): a step means the same relative
change for all of them. Parameters that may be zero or negative, such as a shunt fraction, a base excess or an
infused volume, have a linear coordinate. Its unit is chosen so that the allowed range has the same length as
a factor of 100 in logarithms, so that a step is of the same order for all.
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
from eclsim.circuit.network import Circuit
from eclsim.devices.registry import instances_in, is_of_user
from eclsim.outputs.registry import find_output
from eclsim.outputs.signals import output_names
from eclsim.reporting.numbers import number, significant
from eclsim.units import unit_after_number

_DIGITS = 12


@dataclass(frozen=True)
class Scale:
    """Conversion between parameters and their search coordinates.

    Args:
        units: for a linear parameter, the value that corresponds to a coordinate of 1; 0 for a logarithmic
            one.
        written: unit of each parameter as text; empty if it is dimensionless. May be left out.
    """

    units: tuple[float, ...]
    written: tuple[str, ...] = ()

    @classmethod
    def of(cls, names: Sequence[str]) -> Scale:
        """Return the scale of parameters by name."""
        return _scale(tuple(names))

    @property
    def linear(self) -> np.ndarray:
        """Whether each parameter has a linear coordinate, shape (parameters,)."""
        return np.array(self.units) > 0.0

    def coordinates(self, values: np.ndarray) -> np.ndarray:
        """Convert values in their units to coordinates, shape (..., parameters)."""
        values, linear = np.asarray(values, dtype=float), self.linear
        return np.where(linear, values / self._divisors, np.log(np.where(linear, 1.0, values)))

    def values(self, x: np.ndarray) -> np.ndarray:
        """Convert coordinates to values in their units, shape (..., parameters)."""
        return np.where(self.linear, x * self._divisors, np.exp(np.where(self.linear, 0.0, x)))

    def slopes(self, x: np.ndarray) -> np.ndarray:
        """Derivatives d value / d coordinate, shape (..., parameters)."""
        return np.where(self.linear, self._divisors, np.exp(np.where(self.linear, 0.0, x)))

    def of_parameter(self, k: int) -> Scale:
        """Return the scale of one of the parameters."""
        return Scale((self.units[k],), self.written[k : k + 1])

    def value(self, k: int, x: float) -> float:
        """Convert one coordinate to a value in its unit, rounded to remove conversion errors."""
        return float(f"{self.of_parameter(k).values(np.array([x]))[0]:.{_DIGITS}g}")

    def difference_text(self, k: int, distance: float) -> str:
        """Difference between two values as text (in % or with the unit), from that of their coordinates."""
        return self._with_unit(k, distance) if self.units[k] else f"{100.0 * math.expm1(distance):.0f} %"

    def error(self, k: int, error: float) -> str:
        """A standard error as text, with its unit."""
        if self.units[k]:
            return self._with_unit(k, error)
        return f"a factor of {significant(math.exp(error), 2)}"

    def _with_unit(self, k: int, distance: float) -> str:
        """A difference of coordinates of a linear parameter as text, with its unit."""
        unit = self.written[k] if self.written else ""
        return f"{number(distance * self.units[k], digits=2)} {unit}".strip()

    @property
    def _divisors(self) -> np.ndarray:
        return np.where(self.linear, self.units, 1.0)


@lru_cache(maxsize=1024)
def _scale(names: tuple[str, ...]) -> Scale:
    known = [quantity(name) for name in names]
    units = tuple(0.0 if one is None else one.linear_unit for one in known)
    return Scale(units, tuple(map(unit_of_parameter, names)))


def unit_of_parameter(name: str) -> str:
    """Unit of a parameter or of a number of a case; empty if dimensionless."""
    known = quantity(name)
    return "" if known is None else unit_after_number(known.unit)


def axis_label(name: str) -> str:
    """Axis label of a parameter: name and unit."""
    unit = unit_of_parameter(name)
    return f"{name} [{unit}]" if unit else name


# --- outputs that can be fitted, and their uncertainties --------------------------------------------


PRESSURES = ("SP", "DP", "MAP", "MPAP", "PCWP")
FLOWS = ("CO", "PF")
BEAT_OUTPUTS = PRESSURES + FLOWS
"""Outputs of the beat that can be fitted."""
GASES = MEASURED_GASES
"""Outputs of gas exchange that can be fitted if the case has a section [gas]."""
OUTPUTS = BEAT_OUTPUTS + FURTHER_MEASUREMENTS + GASES
"""All outputs that can be fitted."""


def unit_of(output: str) -> str:
    """Unit of an output; empty for one of a device that is not registered now."""
    field = Measurements.fields().get(output)
    if field is not None:
        return field.unit
    known = find_output(output)
    return "" if known is None else known.unit


def predicted_outputs(circuit: Circuit) -> tuple[str, ...]:
    """Outputs that predictions have: those that can be measured, assist flows, all of users' devices."""
    of_devices: list[str] = []
    for names in instances_in(circuit):
        own = [entry.name for entry in names.device.outputs] if is_of_user(names.device) else []
        of_devices += map(names.output, (*filter(None, (names.device.assist_flow,)), *own))
    known = output_names(circuit)
    return tuple(name for name in dict.fromkeys((*OUTPUTS, *of_devices)) if name in known)


BOUNDS = (0.0, 100.0)
"""Least value of outputs that cannot be negative, and largest value of saturations [%]."""


def possible_range(output: str) -> tuple[float, float]:
    """Range within which every value of an output that can be fitted lies; infinite where it has no bound.

    Circuit pressures and CVP may be negative, and so may PF where blood runs backwards.
    """
    field = Measurements.fields()[output]
    may_be_negative = field.minimum < 0.0 or output == "PF"
    return -math.inf if may_be_negative else BOUNDS[0], BOUNDS[1] if field.unit == "%" else math.inf


def measured_and_simulated(results: Sequence[Mapping[str, Any]], names: Sequence[str]) -> np.ndarray:
    """Pairs of measured and simulated values, as in JSON files, where both exist, shape (values, 2)."""
    cells = [result["outputs"].get(name) or {} for result in results for name in names]
    pairs = [(cell.get("measured"), cell.get("simulated")) for cell in cells]
    return np.array([pair for pair in pairs if None not in pair], dtype=float).reshape(-1, 2)


def relative_scale(output: str, value: float) -> float:
    """Scale of a relative difference: the size of the value; at least a typical one if it may be negative."""
    usual = abs(Measurements.fields()[output].typical) if output in FURTHER_MEASUREMENTS else 0.0
    return max(abs(value), usual)
