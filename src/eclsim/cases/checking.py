"""Checks of a case given as nested mappings: each field by itself, then the case as a whole."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from eclsim.cases.events import check_events
from eclsim.cases.plausibility import check_plausibility
from eclsim.cases.quantities import PARAMETERS, section_and_key
from eclsim.cases.resolve import blood_volume_ml
from eclsim.cases.sections import (
    PATIENT_SECTIONS,
    POLICY,
    POLICY_KEY,
    Measurements,
    Patient,
    device_sections,
    is_instance_name,
    places_of,
    sections,
)
from eclsim.devices.device import CaseValues, device_key, instance_key
from eclsim.devices.registry import devices, parameter_of, parameters
from eclsim.inputs.fields import setting
from eclsim.inputs.mistakes import Remarks, shown
from eclsim.inputs.numbers import suspected_unit
from eclsim.inputs.sections import Raw, check_field, check_section, short
from eclsim.parameters import thiel2025
from eclsim.parameters.parameter import Parameter
from eclsim.spelling import did_you_mean

FORMAT = 1


@dataclass(slots=True)
class Checked(Remarks):
    """Result of checking a case.

    Attributes:
        values: Sections and their values, with canonical names and defaults filled in; missing values are
            left out.
    """

    values: dict[str, Any] = field(default_factory=dict)


def check_case(raw: object) -> Checked:
    """Check a whole case: each field, then the consistency of fields with each other.

    Args:
        raw: Mapping with the content of a case file.

    Returns:
        All errors at once, and the values that are valid. Nothing is raised.
    """
    checked = Checked()
    if not isinstance(raw, Mapping):
        checked.error("", "a case is a table of sections", shown(raw))
        return checked
    _check_format(raw, checked)
    top_level = ("format", POLICY_KEY, *sections(), "parameters", "events")
    for key in raw:
        if key not in top_level:
            hint = did_you_mean(str(key), top_level) or other_place(str(key))
            message = _WITHOUT_DATA.get(str(key), "unknown key or section")
            checked.error(short(key), message, shown(raw[key]), ", ".join(top_level), hint)
    if POLICY_KEY in raw:
        check_field(POLICY_KEY, raw[POLICY_KEY], POLICY, checked.values, checked)
    for section in (Patient, Measurements, *PATIENT_SECTIONS):
        if section.section in raw:
            key = section.section
            checked.values[key] = check_section(section, raw[key], key, checked, other_place)
    connected = _check_devices(raw, checked)
    if "patient" not in raw:
        needed = ", ".join(name for name, item in Patient.fields().items() if item.required)
        checked.error("patient", "this section is missing", allowed=f"[patient] with {needed}")
    parameters = check_parameters(raw.get("parameters", {}), connected, checked)
    found = checked.values
    extensions = {one.section: found[one.section] for one in PATIENT_SECTIONS if one.section in found}
    values = CaseValues(found.get("patient", {}), found.get("measurements", {}), connected, extensions)
    found["parameters"] = parameters
    check_plausibility(values, parameters, checked)
    if "events" in raw:
        without_events = {key: value for key, value in raw.items() if key != "events"}
        blood_ml = None if checked.mistakes else _blood_ml(found)
        found["events"] = check_events(raw["events"], without_events, blood_ml, check_case, checked)
    return checked


def _blood_ml(values: Raw) -> float:
    """Return the patient's blood volume at the start of a course [mL]."""
    extra = values.get("fluid", {}).get("extra_volume_ml", 0.0)
    return blood_volume_ml(Patient.model_construct(**values["patient"])) + extra


_WITHOUT_DATA = {
    "impella": "not available: no pressure-flow curves of these pumps are openly published. What drains a "
    "left ventricle here: [lvad] (pump HMII, HM3, HVAD or Incor), [vent], [septostomy]; with your own "
    "curves, register a device of your own (eclsim.register_device, page Add a device of the documentation)"
}
"""Requested sections that the package cannot offer, with the reason."""


def other_place(key: str) -> str:
    """Return where a key found in the wrong section belongs; empty if nowhere."""
    return " or ".join(places_of(key))


def _check_devices(raw: Raw, checked: Checked) -> dict[str, Raw]:
    """Check the section of each connected device, and return its values by section key."""
    connected: dict[str, Raw] = {}
    for device, name, section in device_sections(raw):
        key = instance_key(device.key, name)
        if name and not is_instance_name(name):
            allowed = f"letters, digits, _ and -, such as [{device.key}.left]"
            checked.error(short(key), "not a valid name for one of several devices", allowed=allowed)
            continue
        values = check_section(device.section, section, key, checked, other_place)
        connected[key] = values
        if name:
            checked.values.setdefault(device.key, {})[name] = values
        else:
            checked.values[device.key] = values
    return connected


def _check_format(raw: Raw, checked: Checked) -> None:
    written = raw.get("format")
    if written is None:
        checked.error("format", "missing", allowed=f"format = {FORMAT} at the top of the file")
    elif isinstance(written, bool) or written != FORMAT:
        message = "a case file format that this version does not read"
        checked.error("format", message, shown(written), str(FORMAT))
    checked.values["format"] = FORMAT


# --- the section [parameters] -------------------------------------------------------------------

_FRACTION_TOLERANCE = 1e-6


def check_parameters(raw: object, connected: Mapping[str, Raw], remarks: Remarks) -> dict[str, float]:
    """Check the parameter overrides of a case; nothing is raised.

    Args:
        raw: The [parameters] section.
        connected: Sections of the connected devices, by key; parameters of other devices have no effect.
        remarks: Collects errors, warnings and notes.

    Returns:
        Values by canonical key, in the units of the parameter tables.
    """
    values: dict[str, float] = {}
    if not isinstance(raw, Mapping):
        allowed = "[parameters] and its keys on the lines below"
        remarks.error("parameters", "a section belongs here", shown(raw), allowed)
        return values
    for written, value in _flat(raw):
        key = thiel2025.ALIASES.get(written, written)
        parameter = parameter_of(key, connected)
        if (place := section_and_key(key)) is not None and place[0] != PARAMETERS:
            section, name = place
            message, allowed = f"is set in the section [{section}], not here", f"{name} in [{section}]"
            remarks.error(f"parameters.{written}", message, shown(value), allowed, f"{section}.{name}")
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
    """Yield keys and values; a dotted key such as `ecmo.left.Recmooxy` may be written without quotes."""
    for key, value in raw.items():
        if isinstance(value, Mapping) and device_key(str(key)) in devices():
            yield from ((f"{key}.{inner}", result) for inner, result in _flat(value))
        else:
            yield str(key), value


def _check_value(
    key: str, parameter: Parameter, value: object, values: dict[str, float], remarks: Remarks
) -> None:
    place, typical = f"parameters.{key}", parameter.value or 1.0
    check_field(place, value, replace(setting(parameter), name=key), values, remarks)
    if key in values and parameter.value and not typical / 12.0 <= values[key] <= typical * 12.0:
        hint = suspected_unit(values[key], parameter.unit, typical, (typical / 3.0, typical * 3.0))
        remarks.warning(place, f"far from the usual {typical:g} {parameter.unit}", shown(value), hint)


def _refuse_unknown(written: str, value: object, remarks: Remarks) -> None:
    short = written if len(written) <= 64 else written[:60] + "..."
    hint = did_you_mean(written, (*parameters(), *thiel2025.ALIASES))
    places = [place for place in places_of(written) if place.endswith(f".{written}")]
    allowed = "names of the parameter tables (eclsim parameters lists them)"
    key = f"parameters.{short}"
    remarks.error(key, "unknown parameter", shown(value), allowed, places[0] if places else hint)


def _warn_without_effect(values: Mapping[str, float], connected: Mapping[str, Raw], remarks: Remarks) -> None:
    present = {device_key(key) for key in connected}
    for name, device in devices().items():
        read_by_device = {parameter.key for parameter in device.parameters}
        for key, value in values.items():
            if key in read_by_device and name not in present:
                message = f"without effect: the case has no [{name}] section"
                remarks.warning(f"parameters.{key}", message, shown(value))


def _check_atria(values: Mapping[str, float], remarks: Remarks) -> None:
    """Warn of an atrium that is stiffer at rest than in contraction: it fills when it should empty."""
    for side, side_name in (("la", "left"), ("ra", "right")):
        names = (f"Ed{side}", f"Emax{side}")
        resting, most = (values.get(name, thiel2025.PARAMETERS[name].value) for name in names)
        if resting > most and any(name in values for name in names):
            stated = names[0] if names[0] in values else names[1]
            message = (
                f"{names[0]} = {resting:g} is above {names[1]} = {most:g} mmHg/mL: the {side_name} atrium is "
                "stiffer at rest than in contraction, so it fills when it should empty"
            )
            remarks.warning(f"parameters.{stated}", message, shown(values[stated]))


def _check_fractions(values: Mapping[str, float], remarks: Remarks) -> None:
    stated = [key for key in thiel2025.VOLUME_FRACTIONS if key in values]
    if not stated:
        return
    for key in stated:
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
        remarks.error(f"parameters.{stated[0]}", message, shown(values[stated[0]]), allowed)
