"""Checking a case given as nested mappings: every field on its own, then the case as a whole."""

from __future__ import annotations

import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from eclsim.cases.fields import POLICY_FIELD, ROLLER_FIELD, SECTIONS, USUAL, Field
from eclsim.cases.mistakes import Mistake, shown
from eclsim.cases.numbers import NotANumberError, is_missing, read_number
from eclsim.cases.overrides import check_parameters
from eclsim.cases.plausibility import check_plausibility, looks_identifiable
from eclsim.parameters import did_you_mean

FORMAT = 1
MAXIMUM_ID_LENGTH = 64
_TOP_LEVEL = ("format", POLICY_FIELD.name, *SECTIONS, "parameters")


@dataclass(slots=True)
class Checked:
    """What checking found: the values that stand, and everything there is to say about the input.

    Attributes:
        values: Sections and their values, names canonical, defaults filled in, missing ones left out.
        mistakes: Errors; with any of them the input must not be used.
        warnings: Doubts; the input is used.
        notes: What was filled in, converted or left out.
    """

    values: dict[str, Any] = field(default_factory=dict)
    mistakes: list[Mistake] = field(default_factory=list)
    warnings: list[Mistake] = field(default_factory=list)
    notes: list[Mistake] = field(default_factory=list)

    def extend(self, other: Checked) -> None:
        """Take over what another check has to say, but not its values."""
        self.mistakes += other.mistakes
        self.warnings += other.warnings
        self.notes += other.notes


def check_case(raw: Any) -> Checked:
    """Check a whole case: all fields, then what they say together.

    Args:
        raw: A mapping as a case file holds it.

    Returns:
        Never raises: all mistakes at once, the values only as far as they are right.
    """
    checked = Checked()
    if not isinstance(raw, Mapping):
        checked.mistakes.append(Mistake("", "a case is a table of sections", shown(raw)))
        return checked
    _check_format(raw, checked)
    for key in raw:
        if key not in _TOP_LEVEL:
            checked.mistakes.append(_unknown_top_level(key, raw[key]))
    if POLICY_FIELD.name in raw:
        _check_field(POLICY_FIELD.name, raw[POLICY_FIELD.name], POLICY_FIELD, checked)
    for section in SECTIONS:
        if section in raw:
            found = check_section(section, raw[section])
            checked.extend(found)
            checked.values[section] = found.values
    if "patient" not in raw:
        needed = ", ".join(item.name for item in SECTIONS["patient"] if item.required)
        checked.mistakes.append(
            Mistake("patient", "this section is missing", allowed=f"[patient] with {needed}")
        )
    parameters = check_parameters(raw.get("parameters", {}), has_ecmo="ecmo" in raw, has_crrt="crrt" in raw)
    checked.mistakes += parameters.mistakes
    checked.warnings += parameters.warnings
    checked.values["parameters"] = parameters.values
    doubts = check_plausibility(checked.values, {mistake.key for mistake in checked.mistakes})
    checked.mistakes += doubts.mistakes
    checked.warnings += doubts.warnings
    checked.notes += doubts.notes
    return checked


def check_section(section: str, raw: Any) -> Checked:
    """Check the fields of one section, each on its own; fill in what `mode` and defaults give."""
    checked = Checked()
    if not isinstance(raw, Mapping):
        checked.mistakes.append(_no_table(section, raw))
        return checked
    fields = {item.name: item for item in SECTIONS[section]}
    for key, value in raw.items():
        if key in fields:
            _check_field(f"{section}.{key}", value, fields[key], checked)
        else:
            checked.mistakes.append(_unknown_key(section, key, value))
    for item in fields.values():
        if item.required and item.name not in raw:
            checked.mistakes.append(Mistake(f"{section}.{item.name}", "missing", allowed=item.allowed))
    if section == "ecmo":
        _complete_ecmo(raw, fields, checked)
    return checked


def _check_format(raw: Mapping[str, Any], checked: Checked) -> None:
    written = raw.get("format")
    if written is None:
        checked.mistakes.append(
            Mistake("format", "missing", allowed=f"format = {FORMAT} at the top of the file")
        )
    elif isinstance(written, bool) or written != FORMAT:
        message = "a format of case files that this version does not read"
        checked.mistakes.append(Mistake("format", message, shown(written), allowed=str(FORMAT)))
    checked.values["format"] = FORMAT


def _check_field(key: str, value: Any, item: Field, checked: Checked) -> None:
    if item.may_be_missing and (value is None or is_missing(value)):
        message = "not measured, so not fitted" if key.startswith("measurements") else "not given"
        checked.notes.append(Mistake(key, message, shown(value)))
        return
    readers = {"number": read_number, "text": _read_id, "name": _read_name, "pump": _read_pump}
    try:
        read = readers[item.kind](value, item)
    except NotANumberError as error:
        found = error.mistake
        hidden = item.kind == "text" and looks_identifiable(value)
        written = "(hidden)" if hidden else shown(value)
        checked.mistakes.append(Mistake(key, found.message, written, found.allowed, found.suggestion))
    else:
        checked.values[item.name] = read


def _read_id(value: Any, item: Field) -> str:
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        raise NotANumberError(
            "a number where text belongs; write it in quotes", item.allowed, f'"{shown(value)}"'
        )
    if not isinstance(value, str):
        raise NotANumberError("text belongs here", item.allowed)
    name = unicodedata.normalize("NFC", value).strip()
    if not name:
        raise NotANumberError("empty", item.allowed)
    if len(name) > MAXIMUM_ID_LENGTH:
        raise NotANumberError(f"too long: {len(name)} characters", item.allowed)
    if not name.isprintable():
        raise NotANumberError("holds line breaks or other characters that cannot be printed", item.allowed)
    return name


def _read_name(value: Any, item: Field) -> str:
    if isinstance(value, str):
        name = value.strip()
        name = item.aliases.get(name, name)
        if name in item.names:
            return name
        hint = did_you_mean(name, (*item.names, *item.aliases)) or ""
        raise NotANumberError("unknown name", item.allowed, hint)
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        raise NotANumberError(
            "a number; only names are read, as lists of devices and sites differ", item.allowed
        )
    raise NotANumberError("a name belongs here", item.allowed)


def _read_pump(value: Any, item: Field) -> str | dict[str, float]:
    is_ecmo = "Rotaflow" in item.names
    if isinstance(value, Mapping) and is_ecmo:
        if set(value) != {ROLLER_FIELD.name}:
            raise NotANumberError("a pump as a table holds roller_l_min alone", item.allowed)
        try:
            return {ROLLER_FIELD.name: read_number(value[ROLLER_FIELD.name], ROLLER_FIELD)}
        except NotANumberError as error:
            found = error.mistake
            message = f"roller_l_min {shown(value[ROLLER_FIELD.name])}: {found.message}"
            raise NotANumberError(message, found.allowed, found.suggestion) from None
    if isinstance(value, str) and is_ecmo and "roller" in value.lower():
        raise NotANumberError("a roller pump needs its flow", item.allowed, "{ roller_l_min = 4.0 }")
    name = _read_name(value, item)
    if name not in item.names:
        raise NotANumberError("a pump for another use", item.allowed)
    return name


def _complete_ecmo(raw: Mapping[str, Any], fields: Mapping[str, Field], checked: Checked) -> None:
    """Fill in what `mode` gives and see that the rest is there."""
    values = checked.values
    usual = USUAL.get(str(values.get("mode")), {})
    filled = {name: value for name, value in usual.items() if name not in raw}
    values |= filled
    if filled:
        words = ", ".join(f"{name} = {shown(value)}" for name, value in filled.items())
        checked.notes.append(Mistake("ecmo.mode", f"fills in {words}", shown(values["mode"])))
    for name in USUAL["VA"]:
        if name not in raw and name not in filled:
            allowed = fields[name].allowed + ', or mode = "VA" or "VV" for the usual ones'
            checked.mistakes.append(Mistake(f"ecmo.{name}", "missing", allowed=allowed))
    _check_speed_or_flow(raw, fields, checked)


def _check_speed_or_flow(raw: Mapping[str, Any], fields: Mapping[str, Field], checked: Checked) -> None:
    """A rotary pump has a speed or the flow that it is solved for, a roller pump neither."""
    pump = checked.values.get("pump")
    if isinstance(pump, str):
        if "speed_rpm" not in raw and "flow_l_min" not in raw:
            allowed = f"{fields['speed_rpm'].allowed}, or flow_l_min, and the speed is solved for"
            checked.mistakes.append(Mistake("ecmo.speed_rpm", "missing", allowed=allowed))
        if "speed_rpm" in raw and "flow_l_min" in raw:
            message = f"beside speed_rpm = {shown(raw['speed_rpm'])}: the speed follows from the flow"
            allowed = "one of the two"
            checked.mistakes.append(Mistake("ecmo.flow_l_min", message, shown(raw["flow_l_min"]), allowed))
    if isinstance(pump, dict):
        wrong = {"speed_rpm": "has a flow and no speed", "flow_l_min": "has its flow as roller_l_min"}
        for name, why in wrong.items():
            if name in raw:
                message = f"a roller pump {why}; leave it out"
                checked.mistakes.append(Mistake(f"ecmo.{name}", message, shown(raw[name])))


def _no_table(section: str, raw: Any) -> Mistake:
    if isinstance(raw, (list, tuple)):
        said = f"given {len(raw)} times" if len(raw) != 1 else "written as one of a list"
        return Mistake(
            section, f"{said}; a case has one at most", allowed=f"one [{section}] section, in single brackets"
        )
    return Mistake(
        section, "a section belongs here", shown(raw), allowed=f"[{section}] and its keys on lines below"
    )


def _unknown_key(section: str, key: str, value: Any) -> Mistake:
    own = [item.name for item in SECTIONS[section]]
    hint = did_you_mean(str(key), own) or _elsewhere(str(key)) or ""
    return Mistake(f"{section}.{_short(key)}", "unknown key", shown(value), ", ".join(own), hint)


def _unknown_top_level(key: Any, value: Any) -> Mistake:
    hint = did_you_mean(str(key), _TOP_LEVEL) or _elsewhere(str(key)) or ""
    return Mistake(_short(key), "unknown key or section", shown(value), ", ".join(_TOP_LEVEL), hint)


def _elsewhere(key: str) -> str | None:
    """Where a key belongs that stands in the wrong section."""
    places = {f"{section}.{item.name}": item.name for section in SECTIONS for item in SECTIONS[section]}
    found = [place for place, name in places.items() if name.lower() == key.lower()]
    return " or ".join(found) or None


def _short(key: Any) -> str:
    text = str(key)
    text = text if text.isprintable() else text.encode("unicode_escape").decode("ascii")
    return text if len(text) <= 64 else text[:60] + "..."
