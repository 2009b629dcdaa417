"""Description of one key of a case-file section: meaning, unit, and allowed range or names."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal

from eclsim.parameters.parameter import Parameter

_NO_ALIASES: Mapping[str, str] = MappingProxyType({})


@dataclass(frozen=True, slots=True)
class Field:
    """One key of a section, given in the annotation of the section's attribute, whose name is the key.

    Attributes:
        description: Meaning of the value.
        kind: "number", "text" or "name" (one of `names`).
        unit: Unit of a number.
        minimum: Smallest allowed number.
        maximum: Largest allowed number.
        typical: Typical value, used to guess the unit of an impossible number.
        required: Whether a case file must contain the key.
        may_be_missing: Whether "NA", nan and the like stand for "not measured".
        names: Allowed names.
        aliases: Other accepted spellings, each with the name that it stands for.
        also_allowed: Further allowed values, in words; for a number it replaces the stated range.
        least: Smallest number above 0, where 0 is allowed and smaller numbers can only be in another unit.
        name: The key.
        read: Reads the value instead of the default reader of its kind; raises `RefusedValueError`.
    """

    description: str
    kind: Literal["number", "text", "name"] = "number"
    unit: str = ""
    minimum: float = 0.0
    maximum: float = 0.0
    typical: float = 1.0
    required: bool = True
    may_be_missing: bool = False
    names: tuple[str, ...] = ()
    aliases: Mapping[str, str] = field(default_factory=lambda: _NO_ALIASES)
    also_allowed: str = ""
    least: float = 0.0
    name: str = ""
    read: Callable[[object, Field], object] | None = None

    @property
    def allowed(self) -> str:
        """Allowed values, in words."""
        if self.kind == "number":
            unit = "" if self.unit == "1" else self.unit
            smallest = f"0, or {self.least:g}" if self.least else f"{self.minimum:g}"
            return self.also_allowed or f"{smallest} to {self.maximum:g} {unit}".rstrip()
        return ", ".join((*self.names, *filter(None, [self.also_allowed]))) or "text of 1 to 64 characters"


def number(
    description: str, unit: str, minimum: float, maximum: float, typical: float, *,
    required: bool = True, may_be_missing: bool = False, allowed: str = "", least: float = 0.0,
) -> Field:  # fmt: skip
    """Field for a number with a unit; `allowed` describes the allowed values in place of the range.

    With `least` the field allows 0 and numbers from `least` on; those between are probably in another unit.
    """
    return Field(
        description, "number", unit, minimum, maximum, typical, required, may_be_missing,
        also_allowed=allowed, least=least,
    )  # fmt: skip


def one_of(
    description: str,
    names: tuple[str, ...],
    *,
    aliases: Mapping[str, str] = _NO_ALIASES,
    required: bool = True,
) -> Field:
    """Field for one of several names."""
    return Field(description, "name", names=names, aliases=aliases, required=required)


def measured(description: str, unit: str, minimum: float, maximum: float, typical: float) -> Field:
    """Field for a number that may not have been measured."""
    return number(description, unit, minimum, maximum, typical, required=False, may_be_missing=True)


def setting(
    parameter: Parameter, allowed: str = "", read: Callable[[object, Field], object] | None = None
) -> Field:
    """Field for an optional number with the meaning, unit and range of a parameter."""
    return Field(
        parameter.description, "number", parameter.unit, parameter.minimum, parameter.maximum,
        parameter.value or 1.0, required=False, also_allowed=allowed, read=read,
    )  # fmt: skip
