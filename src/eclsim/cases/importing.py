"""From clinical data, a FHIR bundle or a long table (a row for each value), to the table of a cohort."""

from __future__ import annotations

import os
import re
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING

from eclsim.cases.cohort import COLUMNS, MEASUREMENT, OPTIONAL
from eclsim.cases.cohort_rows import read_table
from eclsim.cases.fhir import read_bundle
from eclsim.cases.observations import ABOUT, BY_CODE, Imported, Observation, data_points
from eclsim.cases.sections import Gas
from eclsim.files import csv_text
from eclsim.inputs.mistakes import CaseError, Mistake, shown
from eclsim.inputs.numbers import is_missing
from eclsim.spelling import did_you_mean

if TYPE_CHECKING:
    from eclsim.cases.case import Case

WITHIN = timedelta(minutes=5)
LONG = ("patient", "time", "code", "value", "unit")
"""Columns of a long table."""
_NUMBER = re.compile(r"[+-]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]+)?")
_HEAD = ("patient_id", MEASUREMENT, *(c for c in COLUMNS if c != "patient_id"), *OPTIONAL)


def import_cohort(
    path: str | os.PathLike[str], base: Case | None = None, within: timedelta = WITHIN
) -> Imported:
    """Read a FHIR bundle (.json) or a long table into rows of a cohort.

    Args:
        path: The file.
        base: Gives sex, age, size and heart rate where the file has none, and the ECMO circuit.
        within: Values of a patient up to so long after the first of a data point belong to it.

    Raises:
        CaseError: With everything that is wrong.
    """
    bundle = Path(os.fsdecode(path)).suffix.lower() == ".json"
    observations, about, result = (read_bundle if bundle else read_long_table)(path)
    data_points(observations, about, within, result)
    file = os.fsdecode(path)
    if result.mistakes:
        message = [] if result.rows else [*result.warnings, *result.notes]
        raise CaseError([m.at(file, m.line) for m in [*message, *result.mistakes]])
    result.warnings = [m.at(file, m.line) for m in result.warnings]
    result.notes = [m.at(file, m.line) for m in result.notes]
    if base is not None:
        _fill(result, base, file)
    return result


def as_table(rows: list[dict[str, str]]) -> str:
    """The rows as a cohort's CSV; columns that may be left out are, where they are empty."""
    used = [c for c in _HEAD if c not in OPTIONAL or any(row.get(c) for row in rows)]
    return csv_text(used, ([row.get(column, "") for column in used] for row in rows))


def _fill(result: Imported, base: Case, file: str) -> None:
    given = {f"patient.{k}": v for k, v in base.patient.model_dump(exclude_none=True).items()}
    gas = {} if base.gas is None else base.gas.model_dump(exclude_none=True)
    given |= {f"{Gas.section}.{k}": v for k, v in gas.items()}
    for one in base.instances():
        given |= {f"{one.key}.{k}": v for k, v in one.section.model_dump(exclude_none=True).items()}
    for column, key in (COLUMNS | OPTIONAL).items():
        if column == "patient_id" or not isinstance(value := given.get(key), str | float | int):
            continue
        text = value if isinstance(value, str) else f"{value:g}"
        empty = [row for row in result.rows if not row.get(column)]
        for row in empty:
            row[column] = text
        if empty and key.startswith("patient."):
            message = f"{text} of the base case, in {len(empty)} of {len(result.rows)} data points"
            result.notes.append(Mistake(column, message, file=file))
    result.notes += [
        Mistake(one.key, "circuit of the base case, where the file says nothing", file=file)
        for one in base.instances()
        if one.device.columns.needed
    ]


# --- a long table ------------------------------------------------------------------------------------


def read_long_table(
    path: str | os.PathLike[str],
) -> tuple[list[Observation], dict[str, dict[str, str]], Imported]:
    """Observations of a table, what it says of each patient, and everything there was to say.

    Codes are LOINC or SNOMED CT codes or names of cohort columns (SP, heart_rate_bpm ...); `sex` and
    `age_years` are read as well.

    Raises:
        CaseError: Where the file as a whole cannot be used.
    """
    table = read_table(path)
    wrong = []
    for name in LONG:
        if table.header.count(name) != 1:
            suggestion = did_you_mean(name, [h for h in table.header if h and h not in LONG])
            message = (
                "more than one column of this name" if name in table.header else "this column is missing"
            )
            wrong.append(Mistake(name, message, allowed=", ".join(LONG), suggestion=suggestion))
    if wrong:
        raise CaseError([m.at(table.file, None) for m in wrong])
    result, kept, about = Imported(notes=list(table.notes), mistakes=list(table.mistakes)), [], {}
    place = {name: table.header.index(name) for name in LONG}
    for line, cells in table.rows:
        if len(cells) != len(table.header):
            message = f"{len(cells)} cells where the header has {len(table.header)}"
            result.mistakes.append(Mistake("", message, line=line))
            continue
        row = {name: cells[k].strip() for name, k in place.items()}
        if not row["patient"]:
            result.mistakes.append(Mistake("patient", "empty", line=line))
        elif row["code"] in ABOUT:
            _say_about(row, about.setdefault(row["patient"], {}), line, result)
        else:
            kept += _observation(row, line, result)
    return kept, about, result


def _say_about(row: dict[str, str], cells: dict[str, str], line: int, result: Imported) -> None:
    if cells.setdefault(row["code"], row["value"]) != row["value"]:
        both = f"{cells[row['code']]} and {row['value']}"
        result.mistakes.append(Mistake(row["code"], "two values for one patient", both, line=line))


def _observation(row: dict[str, str], line: int, result: Imported) -> list[Observation]:
    if row["code"] in BY_CODE and is_missing(row["value"]):
        result.notes.append(Mistake(BY_CODE[row["code"]].column, "missing", line=line))
        return []
    if not _NUMBER.fullmatch(row["value"]):
        if row["code"] in BY_CODE:
            allowed = "a number with a decimal point"
            key = BY_CODE[row["code"]].column
            result.mistakes.append(Mistake(key, "no number", shown(row["value"]), allowed, line=line))
            return []
        return [Observation(row["patient"], row["time"], row["code"], 0.0, row["unit"], line=line)]
    value = float(row["value"])
    return [Observation(row["patient"], row["time"], row["code"], value, row["unit"], line=line)]
