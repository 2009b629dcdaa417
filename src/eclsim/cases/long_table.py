"""Reading a long table: a row for each value, with patient, time, code, value and unit."""

from __future__ import annotations

import os
import re

from eclsim.cases.clinical_codes import BY_CODE
from eclsim.cases.cohort_table import read_table
from eclsim.cases.observations import ABOUT, Imported, Observation
from eclsim.inputs.mistakes import CaseError, Mistake, shown
from eclsim.inputs.numbers import is_missing
from eclsim.parameters import did_you_mean

COLUMNS = ("patient", "time", "code", "value", "unit")
_NUMBER = re.compile(r"[+-]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]+)?")


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
    for name in COLUMNS:
        if table.header.count(name) != 1:
            near = did_you_mean(name, [h for h in table.header if h and h not in COLUMNS]) or ""
            message = (
                "more than one column of this name" if name in table.header else "this column is missing"
            )
            wrong.append(Mistake(name, message, allowed=", ".join(COLUMNS), suggestion=near))
    if wrong:
        raise CaseError([m.at(table.file, None) for m in wrong])
    result, kept, about = Imported(notes=list(table.notes), mistakes=list(table.mistakes)), [], {}
    place = {name: table.header.index(name) for name in COLUMNS}
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
    return [
        Observation(row["patient"], row["time"], row["code"], float(row["value"]), row["unit"], line=line)
    ]
