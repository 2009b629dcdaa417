"""Writing of case files."""

from __future__ import annotations

import os
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eclsim.cases.sections import PATIENT_SECTIONS, POLICY, POLICY_KEY, Measurements, Patient
from eclsim.devices.registry import parameter_of
from eclsim.files import write_text

if TYPE_CHECKING:
    from tomlkit.items import AoT, Item, Table

    from eclsim.cases.case import Case
    from eclsim.inputs.sections import Raw, Section


def case_text(case: Case) -> str:
    """Format a case as the text of a case file, with meaning and unit in a comment on every line."""
    import tomlkit

    mapping = as_file(case)
    document = tomlkit.document()
    document["format"] = mapping["format"]
    if POLICY_KEY in mapping:
        document[POLICY_KEY] = mapping[POLICY_KEY]
        document[POLICY_KEY].comment(POLICY.description)
    for section in (Patient, Measurements, *PATIENT_SECTIONS):
        if section.section in mapping:
            document[section.section] = _table(section, mapping[section.section])
    for instance in case.instances():
        table = _table(
            instance.device.section, instance.section.model_dump(exclude_none=True, exclude_unset=True)
        )
        if not instance.name:
            document[instance.key] = table
            continue
        if instance.device.key not in document:
            document[instance.device.key] = tomlkit.table(is_super_table=True)
        document[instance.device.key][instance.name] = table
    if mapping.get("parameters"):
        document["parameters"] = _parameter_table(case.parameters, [i.key for i in case.instances()])
    if case.events:
        document["events"] = _event_tables(mapping["events"])
    return tomlkit.dumps(document)


def as_file(case: Case) -> dict[str, Any]:
    """Return the case as written to a file: what was given, as an assumed shunt would be read as known."""
    return case.as_mapping(only_given=True)


def write_case(case: Case, path: str | os.PathLike[str]) -> None:
    """Write a case file, completely or not at all; reading it gives the same case.

    Raises:
        OSError: The file cannot be written.
    """
    write_text(case_text(case), Path(path))


def _table(section: type[Section], values: Raw) -> Table:
    """Format a section, with meaning and unit in a comment on every line."""
    import tomlkit

    table = tomlkit.table()
    for name, item in section.fields().items():
        if name in values:
            written = _toml_value(values[name])
            table.add(name, written)
            written.comment(f"{item.description}{f' [{item.unit}]' if item.unit not in ('', '1') else ''}")
    return table


def _parameter_table(values: dict[str, float], connected: Collection[str]) -> Table:
    import tomlkit

    table = tomlkit.table()
    for key, value in values.items():
        parameter = parameter_of(key, connected)
        assert parameter is not None  # the case was checked
        table[key] = _toml_value(value)
        table[key].comment(f"{parameter.description} [{parameter.unit}]")
    return table


def _event_tables(events: Sequence[Raw]) -> AoT:
    import tomlkit

    tables = tomlkit.aot()
    for event in events:
        table = tomlkit.table()
        for key, value in event.items():
            table[key] = _toml_value(value)
        tables.append(table)
    return tables


def _toml_value(value: object) -> Item:
    import tomlkit

    if isinstance(value, dict):
        inline = tomlkit.inline_table()
        inline.update(value)
        return inline
    if isinstance(value, float) and value.is_integer() and abs(value) < 1e15:
        return tomlkit.item(int(value))
    return tomlkit.item(value)
