"""What a model parameter is: a number with its unit, meaning, origin and allowed range."""

from __future__ import annotations

from dataclasses import dataclass

from eclsim.units import quantity_of


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
        group: Part of the model: blood, systemic, pulmonary, heart, ecmo, crrt or initial.
    """

    key: str
    value: float
    unit: str
    description: str
    source: str
    minimum: float
    maximum: float
    group: str

    @property
    def quantity(self) -> str | None:
        """What is measured: "resistance", "compliance", "elastance", "inertance" ..., or None."""
        return quantity_of(self.unit)

    @property
    def allowed(self) -> str:
        """The allowed range in words, such as "0.02 to 8 mmHg s/mL"."""
        return f"{self.minimum:g} to {self.maximum:g} {self.unit}".strip()

    def accepts(self, value: float) -> bool:
        """Whether a value lies in the allowed range (NaN does not)."""
        return self.minimum <= value <= self.maximum
