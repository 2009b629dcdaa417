"""Writing case files."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eclsim.cases.fields import POLICY_FIELD, SECTIONS
from eclsim.files import write_text

if TYPE_CHECKING:
    from eclsim.cases.case import Case


def case_text(case: Case) -> str:
    """A case as the text of a case file, with a comment of meaning and unit on every line."""
    import tomlkit

    mapping = case.as_mapping()
    document = tomlkit.document()
    document["format"] = mapping["format"]
    if POLICY_FIELD.name in mapping:
        document[POLICY_FIELD.name] = mapping[POLICY_FIELD.name]
        document[POLICY_FIELD.name].comment(POLICY_FIELD.description)
    for section, fields in SECTIONS.items():
        if section not in mapping:
            continue
        table = tomlkit.table()
        for item in fields:
            if item.name in mapping[section]:
                table[item.name] = _toml_value(mapping[section][item.name])
                table[item.name].comment(f"{item.description}{f' [{item.unit}]' if item.unit else ''}")
        document[section] = table
    if mapping.get("parameters"):
        document["parameters"] = _parameter_table(mapping["parameters"])
    return tomlkit.dumps(document)


def write_case(case: Case, path: str | os.PathLike[str]) -> None:
    """Write a case file. It appears whole or not at all; reading it back gives the same case.

    Raises:
        OSError: Where the folder cannot be written.
    """
    write_text(case_text(case), Path(path))


def _parameter_table(values: dict[str, float]) -> Any:
    import tomlkit

    from eclsim.parameters import default

    table = tomlkit.table()
    for key, value in values.items():
        parameter = default(key)
        table[key] = _toml_value(value)
        table[key].comment(f"{parameter.description} [{parameter.unit}]")
    return table


def _toml_value(value: Any) -> Any:
    import tomlkit

    if isinstance(value, dict):
        inline = tomlkit.inline_table()
        inline.update(value)
        return inline
    if isinstance(value, float) and value.is_integer() and abs(value) < 1e15:
        return tomlkit.item(int(value))
    return tomlkit.item(value)
