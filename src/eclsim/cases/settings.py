"""Settings that override a case file, such as --set ecmo.speed_rpm=3000."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from copy import deepcopy
from typing import TYPE_CHECKING, Any

from eclsim.arguments import written
from eclsim.cases.quantities import section_and_key
from eclsim.cases.sections import POLICY_KEY, places_of, section_of, sections, within
from eclsim.devices.registry import device_of, example_setting, parameters
from eclsim.inputs.files import too_deep
from eclsim.inputs.mistakes import Mistake, NumberAsWritten, Remarks, WithoutQuotes, shown
from eclsim.spelling import did_you_mean

if TYPE_CHECKING:
    from eclsim.cases.case import Case

SETTING_SOURCE = "--set"


def texts_of(settings: Iterable[str]) -> list[str]:
    """Return settings as a list; a single string is one setting.

    Raises:
        TypeError: They are not strings.
    """
    allowed = 'texts such as ["ecmo.speed_rpm=3000", "Rmc=0.8"]'
    if isinstance(settings, Mapping) or not isinstance(settings, Iterable):
        raise TypeError(f"settings: {written(settings)} is not a list of settings; allowed: {allowed}")
    listed = [settings] if isinstance(settings, str) else list(settings)
    for one in listed:
        if not isinstance(one, str):
            raise TypeError(f"settings: {written(one)} is not a setting; allowed: {allowed}")
    return listed


def parse_settings(settings: Iterable[str]) -> dict[tuple[str, str], Any]:
    """Return section, key and value of each setting; the last one for a key applies.

    Raises:
        CaseError: There are invalid settings; each is named with the nearest correct spelling.
    """
    parsed, remarks = _parsed(settings)
    remarks.raise_mistakes()
    return parsed


def keys_set(settings: Iterable[str]) -> set[str]:
    """Return the keys of the valid settings, such as "ecmo.speed_rpm" and "parameters.Rmc"."""
    return {f"{section}.{key}" for section, key in _parsed(settings)[0]}


def _parsed(settings: Iterable[str]) -> tuple[dict[tuple[str, str], Any], Remarks]:
    """Return the valid settings, the errors in the others, and a note for each that a later one overrides."""
    result: dict[tuple[str, str], Any] = {}
    remarks = Remarks()
    for setting in settings:
        name, equals, text = setting.partition("=")
        path = section_and_key(name.strip())
        if not equals or not name.strip():
            allowed = f"KEY=VALUE, such as {example_setting()}=3000 or Rmc=0.8"
            remarks.mistakes.append(
                Mistake("", "not a setting", shown(WithoutQuotes(setting)), allowed, file=SETTING_SOURCE)
            )
        elif path is None:
            remarks.mistakes.append(unknown_key(name.strip(), _value_of(text.strip())))
        else:
            value = _value_of(text.strip())
            if path in result and result[path] != value:
                message = f"given more than once: overrides the earlier {shown(result[path])}"
                remarks.notes.append(Mistake(".".join(path), message, shown(value), file=SETTING_SOURCE))
            result[path] = value
    return result, remarks


def merge_settings(
    raw: dict[str, Any], settings: Iterable[str], file: str = "the case"
) -> tuple[dict[str, Any], Remarks]:
    """Return a case as mappings with the valid settings inserted.

    The remarks are the errors in the other settings, and a note for each value that is overridden.
    """
    parsed, remarks = _parsed(settings)
    merged, more = put_in(raw, parsed, file)
    return merged, Remarks(remarks.mistakes + more.mistakes, notes=remarks.notes + more.notes)


def put_in(
    raw: Mapping[str, Any], values: Mapping[tuple[str, str], Any], file: str = "the case"
) -> tuple[dict[str, Any], Remarks]:
    """Return a case as mappings with values inserted by section and key.

    The remarks are errors for keys that name no instance of several devices, which are left out, and a note
    for each value that is overridden.
    """
    merged = deepcopy(dict(raw))
    ambiguous = _without_instance(merged, values)
    remarks = Remarks(list(ambiguous.values()))
    for (section, key), value in values.items():
        if (section, key) in ambiguous:
            continue
        target = merged.setdefault(section, {}) if section == "parameters" else within(merged, section)
        if not isinstance(target, dict):
            continue
        for other in keys_replaced_by(section, key):
            if other in target and (section, other) not in values:
                message = f"replaces {other} = {shown(target.pop(other))} of {file}"
                remarks.notes.append(Mistake(f"{section}.{key}", message, shown(value), file=SETTING_SOURCE))
        if key in target and target[key] != value:
            message = f"overrides {shown(target[key])} of {file}"
            remarks.notes.append(Mistake(f"{section}.{key}", message, shown(value), file=SETTING_SOURCE))
        target[key] = value
    return merged, remarks


def _without_instance(
    raw: Mapping[str, Any], values: Mapping[tuple[str, str], Any]
) -> dict[tuple[str, str], Mistake]:
    """Return the errors for device keys without instance name, where the case has named instances."""
    mistakes: dict[tuple[str, str], Mistake] = {}
    for (section, key), value in values.items():
        there = raw.get(section) if device_of(section) else None
        tables = isinstance(there, dict) and all(isinstance(one, dict) for one in there.values())
        if there and tables:
            named = list(there)
            message = f"the case has {' and '.join(f'[{section}.{name}]' for name in named)}"
            meant = " or ".join(f"{section}.{name}.{key}" for name in named)
            mistakes[section, key] = Mistake(
                f"{section}.{key}", message, shown(value), suggestion=meant, file=SETTING_SOURCE
            )
    return mistakes


def apply_settings(case: Case, settings: Iterable[str]) -> Case:
    """Return a case with settings such as "ecmo.speed_rpm=3000" or "Rmc=0.8", checked like a case file.

    Raises:
        CaseError: There are errors; all are listed, with "--set" as their file.
    """
    from eclsim.cases.reading import read_mapping

    merged, remarks = merge_settings(case.as_mapping(only_given=True), settings)
    return read_mapping(merged, file=SETTING_SOURCE, refused=remarks.mistakes).case


def keys_replaced_by(section: str, key: str) -> list[str]:
    """Return the keys that setting a key removes because the two are mutually exclusive."""
    kind = section_of(section)
    pairs = () if kind is None else kind.exclusive
    return [pair[1 - pair.index(key)] for pair in pairs if key in pair]


def _value_of(text: str) -> object:
    """Parse a value as TOML; anything that is not valid TOML is text, so that quotes may be omitted."""
    if too_deep(text):
        return WithoutQuotes(text)
    try:
        return tomllib.loads(f"value = {text}\n", parse_float=NumberAsWritten)["value"]
    except (ValueError, RecursionError):
        return WithoutQuotes(text)


def unknown_key(name: str, value: object) -> Mistake:
    """Return the error for an unknown key, with the nearest correct spelling."""
    paths = [f"{section}.{key}" for section, kind in sections().items() for key in kind.fields()]
    exact = [path for path in places_of(name) if path.endswith(f".{name}")]
    hint = " or ".join(exact) or did_you_mean(name, (*paths, *parameters()))
    if name == POLICY_KEY:
        hint = "the option --volume-policy"
    allowed = "section.key of a case file, or a parameter (eclsim parameters lists them)"
    return Mistake(name[:64], "unknown key", shown(value), allowed, hint, file=SETTING_SOURCE)
