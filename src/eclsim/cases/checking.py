"""Checking a case given as nested mappings: every field on its own, then the case as a whole."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from eclsim.cases.events import check_events
from eclsim.cases.overrides import check_parameters
from eclsim.cases.plausibility import check_plausibility
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
from eclsim.devices.device import CaseValues, instance_key
from eclsim.inputs.mistakes import Remarks, shown
from eclsim.inputs.sections import Raw, check_field, check_section, short
from eclsim.parameters import did_you_mean

FORMAT = 1


@dataclass(slots=True)
class Checked(Remarks):
    """What checking found.

    Attributes:
        values: Sections and their values, names canonical, defaults filled in, missing ones left out.
    """

    values: dict[str, Any] = field(default_factory=dict)


def check_case(raw: object) -> Checked:
    """Check a whole case: all fields, then what they say together.

    Args:
        raw: A mapping as a case file holds it.

    Returns:
        Never raises: all mistakes at once, the values only as far as they are right.
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
            checked.error(short(key), "unknown key or section", shown(raw[key]), ", ".join(top_level), hint)
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
    present = (one.section for one in PATIENT_SECTIONS if one.section in checked.values)
    own = {name: checked.values[name] for name in present}
    values = CaseValues(
        checked.values.get("patient", {}), checked.values.get("measurements", {}), connected, own
    )
    checked.values["parameters"] = parameters
    check_plausibility(values, parameters, checked)
    if "events" in raw:
        rest = {key: value for key, value in raw.items() if key != "events"}
        blood_ml = None if checked.mistakes else _blood_ml(checked.values)
        checked.values["events"] = check_events(raw["events"], rest, blood_ml, check_case, checked)
    return checked


def _blood_ml(values: Raw) -> float:
    """Blood of a patient at the start of a course [mL]."""
    extra = values.get("fluid", {}).get("extra_volume_ml", 0.0)
    return blood_volume_ml(Patient.model_construct(**values["patient"])) + extra


def other_place(key: str) -> str:
    """Where a key belongs that stands in the wrong section; empty where nowhere."""
    return " or ".join(places_of(key))


def _check_devices(raw: Raw, checked: Checked) -> dict[str, Raw]:
    """Check the section of each connected device; its values by the key of its section."""
    connected: dict[str, Raw] = {}
    for device, name, section in device_sections(raw):
        key = instance_key(device.key, name)
        if name and not is_instance_name(name):
            allowed = f"letters, digits, _ and -, such as [{device.key}.left]"
            checked.error(short(key), "no name for one of several devices", allowed=allowed)
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
        message = "a format of case files that this version does not read"
        checked.error("format", message, shown(written), str(FORMAT))
    checked.values["format"] = FORMAT
