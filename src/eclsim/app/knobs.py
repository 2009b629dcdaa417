"""Knobs and pickers of the page: every turn changes the case, which is then checked like a case file."""

from __future__ import annotations

import re
import weakref
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import wraps
from types import MappingProxyType
from typing import Any, TypeVar

from eclsim.app.texts import ENGLISH, text
from eclsim.cases.case import Case
from eclsim.cases.reading import read_mapping
from eclsim.cases.resolve import circuit_of, resolve_parameters
from eclsim.cases.sections import PATIENT_SECTIONS, Gas, by_instance, within
from eclsim.devices.description import Control, Knob, Picker, plain_control
from eclsim.devices.device import Instance
from eclsim.devices.registry import devices, naming_of
from eclsim.gas.network import gas_exchanges
from eclsim.inputs.fields import Field
from eclsim.inputs.mistakes import CaseError, Mistake, NumberAsWritten, shown
from eclsim.inputs.numbers import RefusedValueError, read_number
from eclsim.parameters import physiology, thiel2025
from eclsim.parameters.regulation import HEART_RATE_RESPONSE
from eclsim.patient.sites import PATIENT_SITES, SAME_IN_REGIONS

T = TypeVar("T")
_PARAMETERS = "parameters"
VOLUME = "volume_ml"
_DIGITS = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_COMMA = re.compile(r"[+-]?\d+,\d+", re.ASCII)
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}", re.ASCII)
_THOUSANDS_POINT = re.compile(r"[+-]?[1-9]\d{0,2}\.\d{3}", re.ASCII)
_CONSUMPTION = "gas.vo2_ml_min"
"""A setting that is derived from the body surface area if omitted."""
_IF_OMITTED = MappingProxyType({HEART_RATE_RESPONSE: 1.0})
"""Omitted numbers of sections that are neither 0 (off) nor computed."""
_SWITCH = MappingProxyType({"true": True, "false": False})
_SWITCHED_ON = MappingProxyType({"regulation": {"baroreflex": 1.0}, "physiology": {"regional": True}})
"""Initial values of sections when they are switched on; other sections start with their defaults."""
LUNGS_WITHOUT_ECMO = MappingProxyType(
    {"haemoglobin_g_dl": 14.0, "alveolar_ventilation_l_min": 4.4, "shunt_fraction": 0.05, "fio2": 0.21}
)
"""Blood and lungs [g/dL, L/min, 1, 1] of a patient without an oxygenator: healthy, breathing air.

The defaults of a case file describe a patient on ECMO with lungs at rest, which do not sustain life alone.
"""
ASSUMED_SHUNTS = (Gas().shunt_fraction, LUNGS_WITHOUT_ECMO["shunt_fraction"])
"""Shunts that the page sets if none is given; a fit reports them as assumed."""
_FILLED = ("svn", "pvn")
"""Vessels whose start pressure accounts for given blood, in the order in which blood is taken from them."""
START_PRESSURES = tuple(f"P0{place}" for place in _FILLED)
"""Parameters that account for given blood."""
VOLUME_FIELD = Field("Extra blood volume", "number", "mL", -200.0, 3000.0, 500.0, name=VOLUME)


def cached_by_case(function: Callable[[Case], T]) -> Callable[[Case], T]:
    """Cache a function's result for the lifetime of its case: one turn needs the same result many times."""
    kept: dict[int, tuple[weakref.ref[Case], T]] = {}

    @wraps(function)
    def result_of(case: Case) -> T:
        key = id(case)
        known = kept.get(key)
        if known is None or known[0]() is not case:
            known = kept[key] = weakref.ref(case, lambda _: kept.pop(key, None)), function(case)
        return known[1]

    return result_of


@cached_by_case
def _instances(case: Case) -> dict[str, Instance]:
    return {instance.key: instance for instance in case.instances()}


_resolved = cached_by_case(resolve_parameters)


@cached_by_case
def controls(case: Case) -> list[Control]:
    """Return the knobs and pickers of a case, in the order of the panel."""
    offered: list[Control] = [
        Knob(key, text(key), unit, low, high, step, key.startswith(_PARAMETERS), group)
        for key, group, unit, low, high, step in _PATIENT_CONTROLS
    ]
    sites = case.sites()
    for instance in case.instances():
        of_device = (
            _with_available_sites(control, sites)
            for control in instance.device.controls(instance.section, sites)
        )
        offered += [
            replace(control, key=_key_in_case(instance, control), group=instance.key)
            for control in of_device
            if _is_shown(control, case)
        ]
    return [*offered, *_section_controls(case)]


def _is_shown(control: Control, case: Case) -> bool:
    """Whether the case has the section that a control needs, and none with which another replaces it."""
    unless = control.unless if isinstance(control, Picker) else ""
    if unless and getattr(case, unless) is not None:
        return False
    return not control.needs or getattr(case, control.needs) is not None


def _key_in_case(instance: Instance, control: Control) -> str:
    """Return the case-file key of a device's knob or picker."""
    if isinstance(control, Knob) and control.is_parameter:
        return f"{_PARAMETERS}.{instance.parameter(control.key)}"
    return f"{instance.key}.{control.key}"


def section_and_name(key: str) -> tuple[str, str]:
    """Return the case-file section of a knob, and its name there, which contains dots for some parameters."""
    if key.startswith(f"{_PARAMETERS}."):
        return _PARAMETERS, key.removeprefix(f"{_PARAMETERS}.")
    section, _, name = key.rpartition(".")
    return section, name


def _section_controls(case: Case) -> list[Control]:
    """Return controls for those fields of the patient's optional sections in the case that have a value."""
    offered: list[Control] = []
    regional = case.physiology is not None and case.physiology.regional
    for kind in PATIENT_SECTIONS:
        for name, field in kind.fields().items() if getattr(case, kind.section) is not None else ():
            key, control = f"{kind.section}.{name}", plain_control(field)
            has_effect = regional or key != physiology.UPPER_SHARE
            if control is not None and has_effect and value_of(case, key) is not None:
                label = ENGLISH.get(key, control.label)
                if isinstance(control, Picker):
                    options = tuple((n, ENGLISH.get(f"{key}.{n}", value)) for n, value in control.options)
                    control = replace(control, options=options)
                offered.append(replace(control, key=key, label=label, group=kind.section))
    return offered


def _value_if_omitted(case: Case, section: str, name: str) -> float | None:
    """Return the value of an omitted number; None if only an entered number gives one."""
    instance = _instances(case).get(section)
    if instance is not None:
        return _resolved(case).get(instance.parameter(f"{instance.device.key}.{name}"))
    key = f"{section}.{name}"
    if key == _CONSUMPTION:
        return _resolved(case)[key]
    kind = next(kind for kind in PATIENT_SECTIONS if kind.section == section)
    return _IF_OMITTED.get(key, 0.0 if kind.fields()[name].minimum == 0.0 else None)


def _with_available_sites(control: Control, sites: Mapping[str, str]) -> Control:
    """Remove the options of a picker that are compartments which this patient does not have."""
    if isinstance(control, Knob):
        return control
    options = [option for option in control.options if option[0] in sites or option[0] not in PATIENT_SITES]
    return replace(control, options=options)


_PATIENT_CONTROLS = (
    ("patient.heart_rate_bpm", "heart", "bpm", 40, 180, 1),
    ("parameters.Emaxlv", "heart", "mmHg/mL", 0.2, 6.0, 0.01),
    ("parameters.Emaxrv", "heart", "mmHg/mL", 0.05, 2.0, 0.005),
    ("parameters.Rmc", "vessels", "mmHg s/mL", 0.1, 4.0, 0.01),
    ("parameters.Rpmc", "vessels", "mmHg s/mL", 0.01, 0.6, 0.002),
    ("parameters.Csart", "vessels", "mL/mmHg", 0.3, 6.0, 0.01),
    (VOLUME, "vessels", "mL", VOLUME_FIELD.minimum, 1200, 10),
)
"""Key, group, unit, both ends of the slider and its step; sliders of parameters are logarithmic."""


@cached_by_case
def knobs_of(case: Case) -> dict[str, float | str | None]:
    """Return the values of all knobs of a case, by key."""
    return {control.key: value_of(case, control.key) for control in controls(case)}


def value_of(case: Case, key: str) -> float | str | None:
    """Return the value of a knob or picker; None if it has no value."""
    if key == VOLUME:
        return _given_volume(case)
    section, name = section_and_name(key)
    if section == _PARAMETERS:
        return _resolved(case)[name]
    instance = _instances(case).get(section)
    if instance is None:
        value = getattr(getattr(case, section), name)
    else:
        value = instance.device.shown(instance.section, name)
    if value is None:
        return _value_if_omitted(case, section, name)
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str) and value in SAME_IN_REGIONS and value not in case.sites():
        return SAME_IN_REGIONS[value]
    return value


def turn(case: Case, key: str, value: object) -> Case:
    """Return the case with one knob or picker set to a value.

    Args:
        case: the case before.
        key: key of a knob or picker of this case.
        value: a number, a name, or text as typed.

    Raises:
        CaseError: The value is invalid, with the same message as for a case file.
    """
    value = turned_value(case, key, value)
    raw = case.as_mapping()
    raw["parameters"] = dict(raw.get("parameters", {}))
    section, name = section_and_name(key)
    instance = case.instance(section)
    if key == VOLUME:
        raw["parameters"] |= _start_pressures(case, _volume(value))
    elif instance is None:
        raw[section][name] = value
    else:
        inner = within(raw, section)
        assert inner is not None  # the section of a connected device
        there = [kind.section for kind in PATIENT_SECTIONS if getattr(case, kind.section) is not None]
        changed = instance.device.turned_in(dict(inner), name, value, there)
        inner.clear()
        inner.update(changed)
        if name in instance.device.set_by_products:
            raw["parameters"].pop(instance.parameter(instance.device.set_by_products[name]), None)
    return read_mapping(raw).case


def turned_value(case: Case, key: str, value: object) -> object:
    """Convert a typed or chosen value to the value stored in a case.

    Raises:
        CaseError: There is no such knob, or the value could be two different numbers.
    """
    if key not in {control.key for control in controls(case)}:
        raise CaseError([Mistake(str(key)[:64], "cannot be changed here")])
    if suggestion := ambiguous_number(value, is_whole(case, key)):
        raise CaseError([Mistake(key, suggestion)])
    section, name = section_and_name(key)
    switch = isinstance(getattr(getattr(case, section, None), name, None), bool)
    value = as_written(value)
    return _SWITCH.get(value, value) if switch and isinstance(value, str) else value


def connectable() -> list[str]:
    """Return the devices that the page can connect, by section name."""
    return [key for key, device in devices().items() if device.usual]


def switchable() -> list[str]:
    """Return what can be switched on and off: devices and optional sections of the patient."""
    return [*connectable(), *(section.section for section in PATIENT_SECTIONS)]


def connected(case: Case) -> list[str]:
    """Return the keys of the devices of a case and of its optional patient sections."""
    sections = (part.section for part in PATIENT_SECTIONS if getattr(case, part.section) is not None)
    return [*dict.fromkeys(part.device.key for part in case.instances()), *sections]


def connect(case: Case, key: str) -> Case:
    """Add a device or section in its usual form, or remove it with all its instances if it is present.

    Devices that cannot be without a removed one, such as a RenOx or a vent without ECMO, go with it.
    """
    if key not in switchable():
        raise CaseError([Mistake(str(key)[:64], "no device", allowed=", ".join(switchable()))])
    raw = case.as_mapping()
    removed = key in raw
    if removed:
        del raw[key]
    else:
        raw[key] = dict(devices()[key].usual if key in devices() else _switched_on(case, key))
    raw = _reconnected(case, raw)
    try:
        return read_mapping(raw).case
    except CaseError as error:
        if not removed or not (lost := {mistake.key for mistake in error.mistakes} & devices().keys()):
            raise
        kept = {place: section for place, section in raw.items() if place not in lost}
        return read_mapping(_reconnected(case, kept)).case


def _reconnected(case: Case, raw: Mapping[str, Any]) -> dict[str, Any]:
    """Return the sections of a case with the lines moved whose sites are gone."""
    raw = dict(raw)
    sites = {site for instance in case.instances() if instance.device.key in raw for site in instance.sites()}
    for place, other in devices().items():
        for name, section in by_instance(other, raw[place]).items() if place in raw else ():
            if isinstance(section, dict):
                moved = other.reconnected(section, {*sites, *PATIENT_SITES})
                raw[place] = {**raw[place], name: moved} if name else moved
    return raw


def _switched_on(case: Case, key: str) -> Mapping[str, Any]:
    """Return the initial values of an optional section that is switched on."""
    if key != "gas":
        return _SWITCHED_ON.get(key, {})
    of_devices = [naming_of(exchange.group) for exchange in gas_exchanges(circuit_of(case))]
    return {} if any(of_devices) else LUNGS_WITHOUT_ECMO


def as_written(value: object) -> object:
    """Convert a typed number, keeping its digits; other text is returned for the check to refuse.

    A decimal comma is read as a point unless it could separate thousands, as in "3,425".
    """
    typed = value.strip() if isinstance(value, str) else ""
    if _COMMA.fullmatch(typed) and not _THOUSANDS.fullmatch(typed):
        typed = typed.replace(",", ".")
    return NumberAsWritten(typed) if _DIGITS.fullmatch(typed) else value


def ambiguous_number(value: object, whole: bool = False) -> str:
    """Return what to type for a number whose comma or point may separate thousands; else empty.

    Args:
        value: value as typed.
        whole: whether the quantity is given in whole numbers, such as rpm and mL; only then is "1.000" more
            likely a thousand than a one with three decimals.
    """
    typed = value.strip() if isinstance(value, str) else ""
    if _THOUSANDS.fullmatch(typed):
        point, digits = typed.replace(",", "."), typed.replace(",", "")
    elif whole and _THOUSANDS_POINT.fullmatch(typed):
        point, digits = f"{float(typed):g}" if typed.endswith("0") else f"{typed}0", typed.replace(".", "")
    else:
        return ""
    return text("ambiguous_comma", typed=typed, point=point, whole=digits)


def is_whole(case: Case, key: str) -> bool:
    """Whether a quantity is given in whole numbers: a knob with whole steps, or a flow in mL/h."""
    whole = (c.key for c in controls(case) if isinstance(c, Knob) and c.step >= 1.0)
    return key.endswith("_ml_h") or key in whole


def _volume(value: object) -> float:
    try:
        return read_number(value, VOLUME_FIELD)
    except RefusedValueError as error:
        raise CaseError([replace(error.mistake, key=VOLUME, value=shown(value))]) from None


def _given_volume(case: Case) -> float:
    """Return the blood [mL] in the veins at the start in excess of the published start pressures."""
    values = _resolved(case)
    published = thiel2025.PARAMETERS
    return sum((values["P0" + at] - published["P0" + at].value) * values["C" + at] for at in _FILLED)


def _start_pressures(case: Case, volume_ml: float) -> dict[str, float]:
    """Return the start pressures that hold a given volume of blood more than the published ones."""
    pressures, left, values = {}, volume_ml, _resolved(case)
    for at in _FILLED:
        usual, compliance = thiel2025.PARAMETERS["P0" + at].value, values["C" + at]
        pressures["P0" + at] = round(max(usual + left / compliance, 0.0), 6)
        left -= (pressures["P0" + at] - usual) * compliance
    return pressures
