"""Import of clinical data, a FHIR bundle or a long table (one row per value), into the table of a cohort."""

from __future__ import annotations

import os
from datetime import timedelta
from pathlib import Path

from eclsim.cases.case import Case
from eclsim.cases.cohort import COLUMNS, MEASUREMENT, OPTIONAL
from eclsim.cases.fhir import read_bundle
from eclsim.cases.observations import (
    BY_CODE,
    NOTHING_TO_FIT,
    PATIENT_COLUMNS,
    About,
    Imported,
    Observation,
    data_points,
)
from eclsim.cases.sections import PATIENT_SECTIONS, Gas
from eclsim.cases.table import read_text_table
from eclsim.files import NUMBER, csv_text
from eclsim.inputs.mistakes import CaseError, Mistake, shown
from eclsim.inputs.numbers import is_missing
from eclsim.spelling import did_you_mean
from eclsim.units import known_unit

DEFAULT_WINDOW = timedelta(minutes=5)
LONG_TABLE_COLUMNS = ("patient", "time", "code", "value", "unit")
"""Column names of a long table."""
_HEAD = ("patient_id", MEASUREMENT, *(c for c in COLUMNS if c != "patient_id"), *OPTIONAL)


def import_cohort(
    path: str | os.PathLike[str], base: Case | None = None, within: timedelta = DEFAULT_WINDOW
) -> Imported:
    """Read a FHIR bundle (.json) or a long table into rows of a cohort.

    Args:
        path: Path of the file.
        base: Supplies sex, age, size, heart rate and the sections of gases and devices where the file has
            none.
        within: Values of a patient up to this time after the first value of a data point belong to that
            point.

    Raises:
        CaseError: The file has errors; all are listed.
    """
    bundle = Path(os.fsdecode(path)).suffix.lower() == ".json"
    observations, about, result = (read_bundle if bundle else read_long_table)(path)
    data_points(observations, about, within, result)
    file = os.fsdecode(path)
    if result.mistakes:
        nothing_read = [m.message for m in result.mistakes] == [NOTHING_TO_FIT]
        message = [*result.warnings, *result.notes] if nothing_read else []
        raise CaseError([m.at(file, m.line) for m in [*message, *result.mistakes]])
    if base is not None:
        _fill(result, base)
    result.warnings = [m.at(file, m.line) for m in result.warnings]
    result.notes = [m.at(file, m.line) for m in result.notes]
    return result


def as_table(rows: list[dict[str, str]]) -> str:
    """Format rows as a cohort's CSV; optional columns that are empty are left out."""
    used = [c for c in _HEAD if c not in OPTIONAL or any(row.get(c) for row in rows)]
    return csv_text(used, ([row.get(column, "") for column in used] for row in rows))


def _fill(result: Imported, base: Case) -> None:
    stated = {f"patient.{k}": v for k, v in base.patient.model_dump(exclude_none=True).items()}
    gas = {} if base.gas is None else base.gas.model_dump(exclude_none=True)
    if base.gas is not None and "shunt_fraction" not in base.gas.model_fields_set:
        del gas["shunt_fraction"]  # an assumed value would be read as known from a table
    left_out = {f"{Gas.section}.{k}" for k in gas if base.gas and k not in base.gas.model_fields_set}
    stated |= {f"{Gas.section}.{k}": v for k, v in gas.items()}
    for device in base.instances():
        stated |= {f"{device.key}.{k}": v for k, v in device.section.model_dump(exclude_none=True).items()}
    assumed = []
    for column, key in (COLUMNS | OPTIONAL).items():
        if column == "patient_id" or not isinstance(value := stated.get(key), str | float | int):
            continue
        text = value if isinstance(value, str) else f"{value:g}"
        empty = [row for row in result.rows if not row.get(column)]
        for row in empty:
            row[column] = text
        if empty and key.startswith("patient."):
            result.note(column, f"{text} of the base case, in {len(empty)} of {len(result.rows)} data points")
        if empty and key in left_out:
            assumed.append(f"{column} = {text}")
    if assumed:
        result.note(Gas.section, f"left out of the base case, so assumed in the table: {', '.join(assumed)}")
    for device in base.instances():
        if device.device.columns.needed and not device.name:
            result.note(device.key, "circuit of the base case, where the file says nothing")
    if lost := _without_column(base):
        message = "a cohort has no columns for these of the base case, so its data points are without them"
        result.warning(", ".join(lost), message)


def _without_column(base: Case) -> list[str]:
    """Sections and keys of a base case that the table of a cohort cannot hold."""
    readable = {*COLUMNS.values(), *OPTIONAL.values()}
    lost = [
        f"[{one.section}]"
        for one in PATIENT_SECTIONS
        if one is not Gas and getattr(base, one.section) is not None
    ]
    for device in base.instances():
        given = device.section.model_dump(exclude_none=True, exclude_defaults=True)
        without = [
            f"{device.key}.{key}"
            for key, value in given.items()
            if f"{device.key}.{key}" not in readable or not isinstance(value, str | float | int)
        ]
        lost += without if len(without) < len(given) else [f"[{device.key}]"]
    lost += ["[parameters]"] * bool(base.parameters)
    return lost + ["blood_volume_policy"] * (base.volume_policy != "as_published")


# --- a long table ------------------------------------------------------------------------------------


def read_long_table(
    path: str | os.PathLike[str],
) -> tuple[list[Observation], dict[str, About], Imported]:
    """Return the observations of a table, data of each patient, and errors, warnings and notes.

    Codes are LOINC or SNOMED CT codes, or names of cohort columns (SP, heart_rate_bpm ...), `sex` or
    `age_years`.

    Raises:
        CaseError: The file as a whole cannot be used.
    """
    table = read_text_table(path, missing="no patients")
    wrong = []
    for name in LONG_TABLE_COLUMNS:
        if table.header.count(name) != 1:
            suggestion = did_you_mean(name, [h for h in table.header if h and h not in LONG_TABLE_COLUMNS])
            message = (
                "more than one column of this name" if name in table.header else "this column is missing"
            )
            wrong.append(Mistake(name, message, allowed=", ".join(LONG_TABLE_COLUMNS), suggestion=suggestion))
    if wrong:
        raise CaseError([m.at(table.file, None) for m in wrong])
    result, values = Imported(notes=list(table.notes), mistakes=list(table.mistakes)), []
    about: dict[str, About] = {}
    place = {name: table.header.index(name) for name in LONG_TABLE_COLUMNS}
    for line, cells in table.rows:
        if len(cells) != len(table.header):
            message = f"{len(cells)} cells where the header has {len(table.header)}"
            result.error("", message, line=line)
            continue
        row = {name: cells[k].strip() for name, k in place.items()}
        if not row["patient"]:
            result.error("patient", "empty", line=line)
        elif row["code"] in PATIENT_COLUMNS:
            _collect_patient_data(row, about.setdefault(row["patient"], About()).cells, line, result)
        else:
            values += _observation(row, line, result)
    return values, about, result


def _collect_patient_data(row: dict[str, str], cells: dict[str, str], line: int, result: Imported) -> None:
    unit = known_unit(row["unit"]) or row["unit"]
    if unit not in ("", "1", *(["years"] if row["code"] == "age_years" else [])):
        allowed = "years" if row["code"] == "age_years" else "no unit"
        result.error(row["code"], "another unit", shown(row["unit"]), allowed, line=line)
    if cells.setdefault(row["code"], row["value"]) != row["value"]:
        both = f"{cells[row['code']]} and {row['value']}"
        result.error(row["code"], "two values for one patient", both, line=line)


def _observation(row: dict[str, str], line: int, result: Imported) -> list[Observation]:
    if row["code"] in BY_CODE and is_missing(row["value"]):
        result.note(BY_CODE[row["code"]].column, "missing", line=line)
        return []
    is_number = NUMBER.fullmatch(row["value"])
    if not is_number and row["code"] in BY_CODE:
        allowed, key = "a number with a decimal point", BY_CODE[row["code"]].column
        result.error(key, "not a number", shown(row["value"]), allowed, line=line)
        return []
    value = float(row["value"]) if is_number else 0.0
    return [Observation(row["patient"], row["time"], row["code"], value, row["unit"], line=line)]
