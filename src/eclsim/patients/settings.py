"""Settings given beside a case file, such as --set ecmo.speed_rpm=3000."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from eclsim.parameters import did_you_mean, thiel2025
from eclsim.patients.fields import SECTIONS
from eclsim.patients.mistakes import CaseError, Mistake, NumberAsWritten, shown

if TYPE_CHECKING:
    from eclsim.patients.case import Case

PLACE = "--set"
_PATHS = {
    f"{section}.{item.name}": (section, item.name) for section in SECTIONS for item in SECTIONS[section]
}
_EXPECTED = "KEY=VALUE, such as ecmo.speed_rpm=3000 or Rmc=0.8"


def parse_settings(settings: Iterable[str]) -> dict[tuple[str, str], Any]:
    """Section, key and value of each setting; a later one wins over an earlier one of the same key.

    Raises:
        CaseError: Naming every setting that is none, with the nearest right spelling.
    """
    found: dict[tuple[str, str], Any] = {}
    mistakes = []
    for setting in settings:
        name, equals, text = setting.partition("=")
        path = _path_of(name.strip())
        if not equals or not name.strip():
            mistakes.append(Mistake("", "no setting", shown(setting), _EXPECTED, file=PLACE))
        elif path is None:
            mistakes.append(_unknown(name.strip(), text))
        else:
            found[path] = _value_of(text.strip())
    if mistakes:
        raise CaseError(mistakes)
    return found


def merge_settings(
    raw: dict[str, Any], settings: Iterable[str], file: str = "the case"
) -> tuple[dict[str, Any], list[Mistake]]:
    """A case as mappings with settings put in, and a note for each value of its file that gives way."""
    merged = {key: dict(value) if isinstance(value, dict) else value for key, value in raw.items()}
    notes = []
    for (section, key), value in parse_settings(settings).items():
        target = merged.setdefault(section, {})
        if not isinstance(target, dict):
            continue
        if key in target and target[key] != value:
            message = f"wins over {shown(target[key])} of {file}"
            notes.append(Mistake(f"{section}.{key}", message, shown(value), file=PLACE))
        target[key] = value
    return merged, notes


def apply_settings(case: Case, settings: Iterable[str]) -> Case:
    """A case with settings such as "ecmo.speed_rpm=3000" or "Rmc=0.8" put in, checked as a file is.

    Raises:
        CaseError: With every mistake, named "--set".
    """
    from eclsim.patients.reading import read_mapping

    merged, _ = merge_settings(case.as_mapping(), settings)
    return read_mapping(merged, file=PLACE).case


def _path_of(name: str) -> tuple[str, str] | None:
    if name in _PATHS:
        return _PATHS[name]
    key = name.removeprefix("parameters.")
    key = thiel2025.ALIASES.get(key, key)
    return ("parameters", key) if key in thiel2025.PARAMETERS else None


def _value_of(text: str) -> Any:
    """The value as TOML reads it; anything else is text, so that quotes may be left out."""
    try:
        return tomllib.loads(f"value = {text}\n", parse_float=NumberAsWritten)["value"]
    except (ValueError, RecursionError):
        return text


def _unknown(name: str, text: str) -> Mistake:
    known = (*_PATHS, *thiel2025.PARAMETERS)
    bare = [path for path in _PATHS if path.partition(".")[2] == name]
    hint = " or ".join(bare) or did_you_mean(name, known) or ""
    allowed = "section.key of a case file, or a parameter (eclsim parameters lists them)"
    return Mistake(name[:64], "unknown key", shown(text.strip()), allowed, hint, file=PLACE)
