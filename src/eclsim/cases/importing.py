"""From clinical data to the table of a cohort."""

from __future__ import annotations

import os
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING

from eclsim.cases.cohort import COLUMNS, MEASUREMENT, OPTIONAL
from eclsim.cases.fhir import read_bundle
from eclsim.cases.long_table import read_long_table
from eclsim.cases.observations import Imported, data_points
from eclsim.files import csv_text
from eclsim.inputs.mistakes import CaseError, Mistake

if TYPE_CHECKING:
    from eclsim.cases.case import Case

WITHIN = timedelta(minutes=5)
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
    if base.ecmo is not None:
        given |= {f"ecmo.{k}": v for k, v in base.ecmo.model_dump(exclude_none=True).items()}
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
    if base.ecmo is not None:
        result.notes.append(
            Mistake("ecmo", "circuit of the base case, where the file says nothing", file=file)
        )
