"""Model parameters: a value with its unit, meaning, source and allowed range."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

from eclsim.files import read_table
from eclsim.units import quantity_of

DEFAULT_LOG_RANGE = math.log(100.0)
"""Width of the allowed range of a linear-scale parameter in its scaled coordinate."""


class Bounds(NamedTuple):
    """Start value, lower and upper bound of a fitted parameter, in the parameter's unit."""

    start: float
    lower: float
    upper: float


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter of the model.

    Attributes:
        key: Name in case files, as in the paper's tables (`Rmc`, `Emaxlv`).
        value: The default, in `unit`.
        unit: Unit of the value, the minimum and the maximum.
        description: Description in words.
        source: Source of the default, and whether it was measured, fitted or assumed.
        minimum: Smallest value a case may give.
        maximum: Largest value a case may give.
        group: Part of the model: blood, systemic, pulmonary, heart, initial, or the section of a case file.
        bounds: Start and bounds of a fit; None if there are no usual ones.
        half_width: Change that is used in place of 25 % in an analysis, where a relative change is not
            meaningful, as of a base excess; else None.
        clipped: Whether the range of an analysis is limited to the allowed range.
    """

    key: str
    value: float
    unit: str
    description: str
    source: str
    minimum: float
    maximum: float
    group: str
    bounds: Bounds | None = None
    half_width: float | None = None
    clipped: bool = False

    @property
    def quantity(self) -> str | None:
        """Kind of quantity: "resistance", "compliance", "elastance", "inertance" ..., or None."""
        return quantity_of(self.unit)

    @property
    def allowed(self) -> str:
        """The allowed range in words, such as "0.02 to 8 mmHg s/mL"."""
        return f"{self.minimum:g} to {self.maximum:g} {self.unit}".strip()

    @property
    def is_linear(self) -> bool:
        """Whether a fit uses the value, not its logarithm: for ranges below 0, and fractions from 0."""
        return self.minimum < 0.0 or (self.minimum == 0.0 and self.unit == "1")

    @property
    def linear_unit(self) -> float:
        """Change used in place of 100 % if a relative change is not meaningful; else 0."""
        return (self.maximum - self.minimum) / DEFAULT_LOG_RANGE if self.is_linear else 0.0

    def varied(self, value: float, share: float) -> tuple[float, float]:
        """Range of an analysis around a value; `share` is the relative half width, such as 0.25."""
        if self.half_width is None:
            low, high = sorted((value * (1.0 - share), value * (1.0 + share)))
        else:
            half = self.half_width * share / 0.25
            low, high = value - half, value + half
        return (max(low, self.minimum), min(high, self.maximum)) if self.clipped else (low, high)

    def accepts(self, value: float) -> bool:
        """Whether a value lies in the allowed range (NaN does not)."""
        return self.minimum <= value <= self.maximum


def read_parameters(module: str) -> MappingProxyType[str, Parameter]:
    """Parameters of the table beside a module, by key.

    The columns are the attributes of a parameter; those of its bounds are start, lower and upper. Tables
    leave out columns, and rows cells, of what their parameters have not.

    Args:
        module: file of the module (`__file__`).
    """
    table = Path(module).with_suffix(".csv")
    return MappingProxyType({row["key"]: _parameter(row) for row in read_table(table)})


def _parameter(row: dict[str, str]) -> Parameter:
    bounds = Bounds(*(float(row[end]) for end in Bounds._fields)) if row.get("start") else None
    half_width = float(row["half_width"]) if row.get("half_width") else None
    return Parameter(
        row["key"], float(row["value"]), row["unit"], row["description"], row["source"],
        float(row["minimum"]), float(row["maximum"]), row["group"], bounds, half_width,
        row.get("clipped") == "yes",
    )  # fmt: skip
