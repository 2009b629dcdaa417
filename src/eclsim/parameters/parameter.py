"""Model parameters: a number with its unit, meaning, origin and allowed range."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from eclsim.units import quantity_of

DEFAULT_LOG_RANGE = math.log(100.0)
"""Length of the allowed range of a parameter on a linear scale, in its coordinate."""


class Bounds(NamedTuple):
    """Start value, lower and upper bound of a fitted parameter, in the parameter's unit."""

    start: float
    lower: float
    upper: float


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter of the model.

    Attributes:
        key: The name users write, as in the paper's tables (`Rmc`, `Emaxlv`).
        value: The default, in `unit`.
        unit: Unit of the value, the minimum and the maximum.
        description: What it is, in words.
        source: Where the default comes from, and whether it was measured, fitted or assumed.
        minimum: Smallest value a case may give.
        maximum: Largest value a case may give.
        group: Part of the model: blood, systemic, pulmonary, heart, initial, or the section of a case file.
        bounds: Where a fit looks; None for a parameter without usual ones.
        half_width: What stands for 25 % in an analysis, where a share of the value says nothing, as of a base
            excess.
        clipped: Whether a range of an analysis ends where the allowed one does.
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
        """Whether it is sought itself and not by its logarithm: it may be negative, or no part of 1."""
        return self.minimum < 0.0 or (self.minimum == 0.0 and self.unit == "1")

    @property
    def linear_unit(self) -> float:
        """The change that stands for 100 % where a share of the value says nothing; else 0."""
        return (self.maximum - self.minimum) / DEFAULT_LOG_RANGE if self.is_linear else 0.0

    def varied(self, value: float, share: float) -> tuple[float, float]:
        """Range of an analysis around a value; `share` is its half width as a share of it, such as 0.25."""
        if self.half_width is None:
            low, high = sorted((value * (1.0 - share), value * (1.0 + share)))
        else:
            half = self.half_width * share / 0.25
            low, high = value - half, value + half
        return (max(low, self.minimum), min(high, self.maximum)) if self.clipped else (low, high)

    def accepts(self, value: float) -> bool:
        """Whether a value lies in the allowed range (NaN does not)."""
        return self.minimum <= value <= self.maximum
