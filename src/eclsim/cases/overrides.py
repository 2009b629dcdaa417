"""Checking the [parameters] section: known names, numbers, allowed ranges."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from eclsim.cases.quantities import PARAMETERS, place_of
from eclsim.cases.sections import places_of
from eclsim.devices.device import device_key
from eclsim.devices.registry import devices, parameter_of, parameters
from eclsim.inputs.fields import Field
from eclsim.inputs.mistakes import Remarks, shown
from eclsim.inputs.numbers import RefusedValueError, read_number, suspected_unit
from eclsim.inputs.sections import Raw
from eclsim.parameters import did_you_mean, thiel2025
from eclsim.parameters.parameter import Parameter

_FRACTION_TOLERANCE = 1e-6


def check_parameters(raw: object, connected: Mapping[str, Raw], remarks: Remarks) -> dict[str, float]:
    """Check the overrides of a case; never raises.

    Args:
        raw: The [parameters] section.
        connected: Sections of the devices connected, by key; the parameters of others do nothing.
        remarks: Gets what there is to say.

    Returns:
        Values in the tables' units by canonical key.
    """
    values: dict[str, float] = {}
    if not isinstance(raw, Mapping):
        allowed = "[parameters] and its keys on lines below"
        remarks.error("parameters", "a section belongs here", shown(raw), allowed)
        return values
    for written, value in _flat(raw):
        key = thiel2025.ALIASES.get(written, written)
        parameter = parameter_of(key, connected)
        if (place := place_of(key)) is not None and place[0] != PARAMETERS:
            where = ".".join(place)
            message = f"is set in the section [{place[0]}], not here"
            remarks.error(
                f"parameters.{written}", message, shown(value), f"{place[1]} in [{place[0]}]", where
            )
        elif parameter is None:
            _refuse_unknown(written, value, remarks)
        elif key in values:
            remarks.error(f"parameters.{written}", f"given twice, also as {key}", shown(value))
        else:
            _check_value(key, parameter, value, values, remarks)
    _warn_without_effect(values, connected, remarks)
    _check_fractions(values, remarks)
    _check_atria(values, remarks)
    return values


def _flat(raw: Raw) -> Iterator[tuple[str, object]]:
    """Keys and values; a dotted key such as `ecmo.left.Recmooxy` may be written without quotes."""
    for key, value in raw.items():
        if isinstance(value, Mapping) and device_key(str(key)) in devices():
            yield from ((f"{key}.{inner}", result) for inner, result in _flat(value))
        else:
            yield str(key), value


def _check_value(
    key: str, parameter: Parameter, value: object, values: dict[str, float], remarks: Remarks
) -> None:
    place, typical = f"parameters.{key}", parameter.value or 1.0
    field = Field(
        parameter.description, "number", parameter.unit, parameter.minimum, parameter.maximum, typical,
        name=key,
    )  # fmt: skip
    try:
        values[key] = read_number(value, field)
    except RefusedValueError as error:
        why = error.mistake
        remarks.error(place, why.message, shown(value), why.allowed, why.suggestion)
        return
    if parameter.value and not typical / 12.0 <= values[key] <= typical * 12.0:
        hint = suspected_unit(values[key], parameter.unit, typical, (typical / 3.0, typical * 3.0))
        remarks.warning(place, f"far from the usual {typical:g} {parameter.unit}", shown(value), hint)


def _refuse_unknown(written: str, value: object, remarks: Remarks) -> None:
    short = written if len(written) <= 64 else written[:60] + "..."
    hint = did_you_mean(written, (*parameters(), *thiel2025.ALIASES)) or ""
    places = [place for place in places_of(written) if place.endswith(f".{written}")]
    allowed = "names of the parameter tables (eclsim parameters lists them)"
    key = f"parameters.{short}"
    remarks.error(key, "unknown parameter", shown(value), allowed, places[0] if places else hint)


def _warn_without_effect(values: Mapping[str, float], connected: Mapping[str, Raw], remarks: Remarks) -> None:
    there = {device_key(key) for key in connected}
    for name, device in devices().items():
        own = {parameter.key for parameter in device.parameters}
        for key, value in values.items():
            if key in own and name not in there:
                message = f"without effect: the case has no [{name}] section"
                remarks.warning(f"parameters.{key}", message, shown(value))


def _check_atria(values: Mapping[str, float], remarks: Remarks) -> None:
    """An atrium that is stiffer at rest than at its strongest contraction fills when it should empty."""
    for side, words in (("la", "left"), ("ra", "right")):
        names = (f"Ed{side}", f"Emax{side}")
        rest, most = (values.get(name, thiel2025.PARAMETERS[name].value) for name in names)
        if rest > most and any(name in values for name in names):
            given = names[0] if names[0] in values else names[1]
            message = (
                f"{names[0]} = {rest:g} is above {names[1]} = {most:g} mmHg/mL: the {words} atrium is "
                "stiffer at rest than in contraction, so it fills when it should empty"
            )
            remarks.warning(f"parameters.{given}", message, shown(values[given]))


def _check_fractions(values: Mapping[str, float], remarks: Remarks) -> None:
    given = [key for key in thiel2025.VOLUME_FRACTIONS if key in values]
    if not given:
        return
    for key in given:
        place = key.removeprefix("volume_fraction_")
        if f"P0{place}" in thiel2025.PARAMETERS or place == "capillaries":
            message = "without effect on pressures and flows: it only shifts the volume shown for a vessel"
            if place != "capillaries":
                message += f"; its stressed volume is C{place} times P0{place}"
            remarks.warning(f"parameters.{key}", message, shown(values[key]))
    total = sum(values.get(key, thiel2025.PARAMETERS[key].value) for key in thiel2025.VOLUME_FRACTIONS)
    if abs(total - 1.0) > _FRACTION_TOLERANCE:
        message = f"the shares of the blood volume add to {total:.6g}, not to 1"
        allowed = "shares that add to 1: " + ", ".join(thiel2025.VOLUME_FRACTIONS)
        remarks.error(f"parameters.{given[0]}", message, shown(values[given[0]]), allowed)
