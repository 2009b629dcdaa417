"""What can be turned on the page, and turning it: every turn is a change of the case, checked like a file."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from eclsim.app.texts import text
from eclsim.cases.reading import read_mapping
from eclsim.cases.sections import by_instance, within
from eclsim.devices.description import Control, Knob
from eclsim.devices.registry import devices
from eclsim.inputs.fields import Field
from eclsim.inputs.mistakes import CaseError, Mistake, NumberAsWritten, shown
from eclsim.inputs.numbers import RefusedValueError, read_number
from eclsim.parameters import thiel2025
from eclsim.patient.sites import PATIENT_SITES, SAME_IN_REGIONS

if TYPE_CHECKING:
    from eclsim.cases.case import Case

VOLUME = "volume_ml"
_DIGITS = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?")
_COMMA = re.compile(r"[+-]?\d+,\d+", re.ASCII)
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}", re.ASCII)
_FILLED = ("svn", "pvn")
"""Vessels whose start pressure takes up blood that is given, in this order where blood is taken."""
VOLUME_FIELD = Field("Blood given or taken", "number", "mL", -200.0, 3000.0, 500.0, name=VOLUME)


def controls(case: Case) -> list[Control]:
    """What can be turned for a case, in the order of the panel."""
    found: list[Control] = [
        Knob(key, text(key), unit, low, high, step, key.startswith("parameters"), group)
        for key, group, unit, low, high, step in _OF_THE_PATIENT
    ]
    sites = case.sites()
    for one in case.instances():
        own = (_offered(control, sites) for control in one.device.controls(one.section, sites))
        found += [replace(control, key=f"{one.key}.{control.key}", group=one.key) for control in own]
    return found


def _offered(control: Control, sites: Mapping[str, str]) -> Control:
    """A choice without the compartments that this patient does not have."""
    if isinstance(control, Knob):
        return control
    options = [option for option in control.options if option[0] in sites or option[0] not in PATIENT_SITES]
    return replace(control, options=options)


_OF_THE_PATIENT = (
    ("patient.heart_rate_bpm", "heart", "bpm", 40, 180, 1),
    ("parameters.Emaxlv", "heart", "mmHg/mL", 0.2, 6.0, 0.01),
    ("parameters.Emaxrv", "heart", "mmHg/mL", 0.05, 2.0, 0.005),
    ("parameters.Rmc", "vessels", "mmHg s/mL", 0.1, 4.0, 0.01),
    ("parameters.Rpmc", "vessels", "mmHg s/mL", 0.01, 0.6, 0.002),
    ("parameters.Csart", "vessels", "mL/mmHg", 0.3, 6.0, 0.01),
    (VOLUME, "vessels", "mL", VOLUME_FIELD.minimum, 1200, 10),
)
"""Key, group, unit, both ends of the slider and its step; that of a parameter is logarithmic."""


def value_of(case: Case, key: str) -> float | str:
    """Where a knob or picker stands."""
    if key == VOLUME:
        return _given_volume(case)
    section, _, name = key.rpartition(".")
    if section == "parameters":
        return _parameter(case, name)
    one = case.instance(section)
    value = case.setting(section, name) if one is None else one.device.shown(one.section, name)
    if isinstance(value, str) and value in SAME_IN_REGIONS and value not in case.sites():
        return SAME_IN_REGIONS[value]
    return value


def turn(case: Case, key: str, value: Any) -> Case:
    """The case with one knob turned, or one picker set.

    Args:
        case: as it is.
        key: of a knob or picker of this case.
        value: a number, a name, or what somebody typed.

    Raises:
        CaseError: With what is wrong with the value, as for a case file.
    """
    if key not in {control.key for control in controls(case)}:
        raise CaseError([Mistake(str(key)[:64], "cannot be turned here")])
    raw = case.as_mapping()
    raw["parameters"] = dict(raw.get("parameters", {}))
    if meant := ambiguous_comma(value):
        raise CaseError([Mistake(key, meant)])
    value = as_written(value)
    section, _, name = key.rpartition(".")
    one = case.instance(section)
    if key == VOLUME:
        raw["parameters"] |= _start_pressures(case, _volume(value))
    elif one is None:
        raw[section][name] = value
    else:
        inner = within(raw, section)
        assert inner is not None  # the section of a connected device
        changed = one.device.turned(dict(inner), name, value)
        inner.clear()
        inner.update(changed)
        if name in one.device.set_by_products:
            raw["parameters"].pop(one.parameter(one.device.set_by_products[name]), None)
    return read_mapping(raw).case


def connectable() -> list[str]:
    """Devices that the page can connect, by the name of their section."""
    return [key for key, device in devices().items() if device.usual]


def connect(case: Case, device: str) -> Case:
    """The case with a device connected in the usual way, or disconnected if it is there (all of them)."""
    if device not in connectable():
        raise CaseError([Mistake(str(device)[:64], "no device", allowed=", ".join(connectable()))])
    raw = case.as_mapping()
    if device in raw:
        del raw[device]
    else:
        raw[device] = dict(devices()[device].usual)
    sites = {site for one in case.instances() if one.device.key in raw for site in one.sites()}
    for key, other in devices().items():
        for name, section in by_instance(other, raw[key]).items() if key in raw else ():
            if isinstance(section, dict):
                moved = other.reconnected(section, {*sites, *PATIENT_SITES})
                raw[key] = {**raw[key], name: moved} if name else moved
    return read_mapping(raw).case


def as_written(value: Any) -> Any:
    """A number that was typed, with its digits; any other text as it is, so that the check can say why.

    A decimal comma is read as a point where it can be nothing else: "3,425" may be meant as thousands.
    """
    typed = value.strip() if isinstance(value, str) else ""
    if _COMMA.fullmatch(typed) and not _THOUSANDS.fullmatch(typed):
        typed = typed.replace(",", ".")
    return NumberAsWritten(typed) if _DIGITS.fullmatch(typed) else value


def ambiguous_comma(value: Any) -> str:
    """What to type in place of a number whose comma may be a decimal or a thousands comma; else empty."""
    typed = value.strip() if isinstance(value, str) else ""
    if not _THOUSANDS.fullmatch(typed):
        return ""
    return text("ambiguous_comma", typed=typed, point=typed.replace(",", "."), whole=typed.replace(",", ""))


def _volume(value: Any) -> float:
    try:
        return read_number(value, VOLUME_FIELD)
    except RefusedValueError as error:
        found = error.mistake
        raise CaseError(
            [Mistake(VOLUME, found.message, shown(value), found.allowed, found.suggestion)]
        ) from None


def _parameter(case: Case, name: str) -> float:
    return case.parameters.get(name, thiel2025.PARAMETERS[name].value)


def _given_volume(case: Case) -> float:
    """Blood [mL] in the veins at the start above that of the published start pressures."""
    return sum(
        (_parameter(case, "P0" + at) - thiel2025.PARAMETERS["P0" + at].value) * _parameter(case, "C" + at)
        for at in _FILLED
    )


def _start_pressures(case: Case, volume_ml: float) -> dict[str, float]:
    """Start pressures that hold so much more blood than the published ones."""
    found, left = {}, volume_ml
    for at in _FILLED:
        usual, compliance = thiel2025.PARAMETERS["P0" + at].value, _parameter(case, "C" + at)
        found["P0" + at] = round(max(usual + left / compliance, 0.0), 6)
        left -= (found["P0" + at] - usual) * compliance
    return found
