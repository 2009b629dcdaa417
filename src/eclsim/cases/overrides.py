"""Checking the [parameters] section: known names, numbers, allowed ranges."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from eclsim.cases.fields import SECTIONS, Field
from eclsim.cases.mistakes import Mistake, shown
from eclsim.cases.numbers import NotANumberError, read_number, suspected_unit
from eclsim.parameters import did_you_mean, thiel2025
from eclsim.parameters.parameter import Parameter

_FRACTION_TOLERANCE = 1e-6
_FIELD_PLACES = {item.name: section for section in reversed(SECTIONS) for item in SECTIONS[section]}


@dataclass(slots=True)
class CheckedParameters:
    """Values in the tables' units by canonical key, with what there is to say about them."""

    values: dict[str, float] = field(default_factory=dict)
    mistakes: list[Mistake] = field(default_factory=list)
    warnings: list[Mistake] = field(default_factory=list)


def check_parameters(raw: Any, has_ecmo: bool, has_crrt: bool) -> CheckedParameters:
    """Check the overrides of a case; never raises.

    Args:
        raw: The [parameters] section.
        has_ecmo: Whether the case has an ECMO circuit; without one its parameters do nothing.
        has_crrt: Likewise for CRRT.
    """
    checked = CheckedParameters()
    if not isinstance(raw, Mapping):
        allowed = "[parameters] and its keys on lines below"
        checked.mistakes.append(Mistake("parameters", "a section belongs here", shown(raw), allowed))
        return checked
    for written, value in raw.items():
        key = thiel2025.ALIASES.get(str(written), str(written))
        parameter = thiel2025.PARAMETERS.get(key)
        if parameter is None:
            checked.mistakes.append(_unknown(str(written), value))
        elif key in checked.values:
            checked.mistakes.append(
                Mistake(f"parameters.{written}", f"given twice, also as {key}", shown(value))
            )
        else:
            _check_value(parameter, value, checked)
    for circuit, connected in (("ecmo", has_ecmo), ("crrt", has_crrt)):
        if not connected:
            _warn_without_effect(circuit, checked)
    _check_fractions(checked)
    _check_atria(checked)
    return checked


def _check_value(parameter: Parameter, value: Any, checked: CheckedParameters) -> None:
    key = f"parameters.{parameter.key}"
    typical = parameter.value or 1.0
    as_field = Field(
        parameter.key,
        parameter.description,
        "number",
        parameter.unit,
        parameter.minimum,
        parameter.maximum,
        typical,
    )
    try:
        number = read_number(value, as_field)
    except NotANumberError as error:
        found = error.mistake
        checked.mistakes.append(Mistake(key, found.message, shown(value), found.allowed, found.suggestion))
        return
    checked.values[parameter.key] = number
    if not parameter.value or typical / 12.0 <= number <= typical * 12.0:
        return
    limits = (typical / 3.0, typical * 3.0)
    hint = suspected_unit(number, parameter.unit, typical, limits)
    message = f"far from the usual {typical:g} {parameter.unit}"
    checked.warnings.append(Mistake(key, message, shown(value), suggestion=hint))


def _unknown(written: str, value: Any) -> Mistake:
    short = written if len(written) <= 64 else written[:60] + "..."
    hint = did_you_mean(written, (*thiel2025.PARAMETERS, *thiel2025.ALIASES)) or ""
    if written in _FIELD_PLACES:
        hint = f"{_FIELD_PLACES[written]}.{written}"
    allowed = "names of the parameter tables (eclsim parameters lists them)"
    return Mistake(f"parameters.{short}", "unknown parameter", shown(value), allowed, hint)


def _warn_without_effect(circuit: str, checked: CheckedParameters) -> None:
    for key, value in checked.values.items():
        if thiel2025.PARAMETERS[key].group == circuit:
            message = f"without effect: the case has no [{circuit}] section"
            checked.warnings.append(Mistake(f"parameters.{key}", message, shown(value)))


def _check_atria(checked: CheckedParameters) -> None:
    """An atrium that is stiffer at rest than at its strongest contraction fills when it should empty."""
    for side, words in (("la", "left"), ("ra", "right")):
        names = (f"Ed{side}", f"Emax{side}")
        rest, most = (checked.values.get(name, thiel2025.PARAMETERS[name].value) for name in names)
        if rest > most and any(name in checked.values for name in names):
            given = names[0] if names[0] in checked.values else names[1]
            message = (
                f"{names[0]} = {rest:g} is above {names[1]} = {most:g} mmHg/mL: the {words} atrium is "
                "stiffer at rest than in contraction, so it fills when it should empty"
            )
            checked.warnings.append(Mistake(f"parameters.{given}", message, shown(checked.values[given])))


def _check_fractions(checked: CheckedParameters) -> None:
    given = [key for key in thiel2025.VOLUME_FRACTIONS if key in checked.values]
    if not given:
        return
    for key in given:
        place = key.removeprefix("volume_fraction_")
        if f"P0{place}" in thiel2025.PARAMETERS or place == "capillaries":
            message = "without effect on pressures and flows: it only shifts the volume shown for a vessel"
            if place != "capillaries":
                message += f"; its stressed volume is C{place} times P0{place}"
            checked.warnings.append(Mistake(f"parameters.{key}", message, shown(checked.values[key])))
    total = sum(
        checked.values.get(key, thiel2025.PARAMETERS[key].value) for key in thiel2025.VOLUME_FRACTIONS
    )
    if abs(total - 1.0) > _FRACTION_TOLERANCE:
        message = f"the shares of the blood volume add to {total:.6g}, not to 1"
        allowed = "shares that add to 1: " + ", ".join(thiel2025.VOLUME_FRACTIONS)
        checked.mistakes.append(
            Mistake(f"parameters.{given[0]}", message, shown(checked.values[given[0]]), allowed)
        )
