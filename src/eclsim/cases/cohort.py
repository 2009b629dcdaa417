"""Cohorts: a CSV table with one row per data point, whose rows are read one by one into checked cases.

An error in a row excludes only that row; an error in the header refuses the whole file.
"""

from __future__ import annotations

import os
import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from eclsim.cases.cohort_rows import (
    Table,
    across_rows,
    expected_unit,
    in_order_of_time,
    is_units_row,
    read_table,
    when,
)
from eclsim.cases.reading import read_mapping
from eclsim.cases.sections import FURTHER_MEASUREMENTS, MEASURED, MEASURED_GASES, Gas, sections
from eclsim.devices.description import Columns
from eclsim.devices.registry import devices
from eclsim.files import unguarded
from eclsim.inputs.mistakes import CaseError, Mistake, NumberAsWritten, Remarks, shown
from eclsim.inputs.numbers import NUMBER
from eclsim.inputs.sections import MAXIMUM_ID_LENGTH, looks_identifiable
from eclsim.spelling import did_you_mean

if TYPE_CHECKING:
    from eclsim.cases.case import Case

ID, MEASUREMENT = "patient_id", "measurement"
_ABOUT_PATIENT = ("sex", "age_years", "height_cm", "weight_kg", "heart_rate_bpm")
_WITH_COLUMNS = [device for device in devices().values() if device.columns != Columns()]
_OMITTED_NOTES = {
    "measurements.CO",
    *(f"{one.key}.{key}" for one in _WITH_COLUMNS for key in one.columns.usual),
}
"""Keys whose notes are omitted, as they would appear for every row."""
COLUMNS: MappingProxyType[str, str] = MappingProxyType(
    {ID: "patient.id"}
    | {name: f"patient.{name}" for name in _ABOUT_PATIENT}
    | {name: f"measurements.{name}" for name in MEASURED[: MEASURED.index(FURTHER_MEASUREMENTS[0])]}
    | {name: f"{one.key}.{key}" for one in _WITH_COLUMNS for name, key in one.columns.needed.items()}
)
"""Required columns, besides `measurement`, and the case-file key of each."""
OPTIONAL: MappingProxyType[str, str] = MappingProxyType(
    {name: f"{one.key}.{key}" for one in _WITH_COLUMNS for name, key in one.columns.optional.items()}
    | {key: f"{one.key}.{key}" for one in _WITH_COLUMNS for key in one.columns.settings}
    | {name: f"measurements.{name}" for name in FURTHER_MEASUREMENTS + MEASURED_GASES}
    | {name: f"{Gas.section}.{name}" for name in Gas.fields()}
)
"""Optional columns. Without columns for its sites, ECMO is V-A at the usual sites. Gases are computed for
rows that have a cell of [gas]."""
_SPREADSHEET_ERROR = re.compile(r"#(REF!|DIV/0!|VALUE!|NAME\?|NUM!|NULL!|SPILL!|CALC!)", re.IGNORECASE)
_TEXT_COLUMNS = {
    name
    for name, key in (COLUMNS | OPTIONAL).items()
    if sections()[key.partition(".")[0]].fields()[key.partition(".")[2]].kind != "number"
}


@dataclass(frozen=True, slots=True)
class CohortPoint:
    """One row: a patient at one time.

    Attributes:
        patient_id: Pseudonym as written, without surrounding spaces.
        measurement: Label of the measurement, as written.
        line: Line in the file.
        case: The checked case.
    """

    patient_id: str
    measurement: str
    line: int
    case: Case

    @property
    def name(self) -> str:
        """Patient and measurement, such as "P01/2"."""
        return f"{self.patient_id}/{self.measurement}"


@dataclass(frozen=True, slots=True)
class CohortReading:
    """A cohort with the remarks about its file.

    Attributes:
        points: Usable rows.
        refused: Errors that make other rows unusable, each with line and column.
        warnings: Warnings about values that were kept.
        notes: How the table was read and what was left out.
        file: Path of the file.
        digest: SHA-256 of the file as read.
        refused_rows: Patient, as written, and line of each unusable row.
    """

    points: tuple[CohortPoint, ...]
    refused: tuple[Mistake, ...]
    warnings: tuple[Mistake, ...]
    notes: tuple[Mistake, ...]
    file: str
    digest: str
    refused_rows: tuple[tuple[str, int], ...] = ()


def read_cohort(path: str | os.PathLike[str]) -> CohortReading:
    """Read a cohort; each row is checked like a case file.

    Args:
        path: A CSV file with the columns `COLUMNS` and `measurement`; cells without a measurement are empty.

    Raises:
        CaseError: The file as a whole cannot be used.
    """
    table = read_table(path)
    result = _Rows(table)
    result.check_header()
    cells = result.cells()
    refused_lines = across_rows(cells, result)
    points = [
        p for line, row in cells.items() if line not in refused_lines and (p := result.point(line, row))
    ]
    used = {point.line for point in points}
    lost = tuple((row["patient_id"].strip(), line) for line, row in cells.items() if line not in used)
    ordered = in_order_of_time(points, result)

    def placed(remarks: Sequence[Mistake]) -> tuple[Mistake, ...]:
        put = (m.at(table.file, m.line) for m in remarks)
        return tuple(sorted(dict.fromkeys(put), key=lambda m: m.line or 0))

    return CohortReading(
        tuple(ordered), placed([*result.mistakes, *table.mistakes]), placed(result.warnings),
        placed([*table.notes, *result.notes]), table.file, table.digest, lost,
    )  # fmt: skip


class _Rows(Remarks):
    """Checks the rows of one table and collects errors, warnings and notes."""

    def __init__(self, table: Table):
        super().__init__()
        self.table = table
        self.reported: set[tuple[str, Mistake]] = set()  # notes given: [gas] once per table, else per patient

    def check_header(self) -> None:
        """Check the header and raise all its errors at once."""
        header, known = self.table.header, (*COLUMNS, MEASUREMENT, *OPTIONAL)
        extra = [name for name in dict.fromkeys(header) if name not in known]
        wrong = [
            Mistake(name or "(no name)", "more than one column of this name")
            for name in dict.fromkeys(header)
            if header.count(name) > 1
        ]
        if not any(name in known for name in header):
            result = ", ".join(header)
            shortened = result if len(result) <= 60 else result[:57] + "..."
            message = f"its first line contains no column name of a cohort: {shortened}"
            allowed = f"a header such as {ID},{MEASUREMENT},sex,age_years,..."
            raise CaseError([Mistake("", message, allowed=allowed, file=self.table.file)])
        for name in (ID, MEASUREMENT, *(c for c in COLUMNS if c != ID)):
            if name not in header:
                with_unit = [n for n in extra if re.fullmatch(rf"{name}\s*[(\[].*[)\]]", n)]
                suggestion = f"{name} for {with_unit[0]}" if with_unit else ""
                suggestion = suggestion or did_you_mean(name, [n for n in extra if n])
                allowed = "the column, with empty cells where nothing was measured"
                wrong.append(Mistake(name, "this column is missing", allowed=allowed, suggestion=suggestion))
        if wrong:
            raise CaseError([m.at(self.table.file, None) for m in wrong])
        for name in extra:
            self._warn_of_extra_column(name)

    def _warn_of_extra_column(self, name: str) -> None:
        place = self.table.header.index(name)
        cells = (row[place] for _, row in self.table.rows[:50] if place < len(row))
        private = any(looks_identifiable(cell) for cell in cells)
        message = "an extra column; it is not read" + (
            "; it looks like names, birth dates or record numbers: remove it" if private else ""
        )
        self.warning(name[:60] or "(no name)", message)

    def cells(self) -> dict[int, dict[str, str]]:
        """Return the cells by column for each row of the header's length, by line."""
        result: dict[int, dict[str, str]] = {}
        for line, row in self.table.rows:
            if len(row) != len(self.table.header):
                message = f"{len(row)} cells where the header has {len(self.table.header)}"
                hint = "a comma inside a number or a text (put quotes around it)"
                more = hint if len(row) > len(self.table.header) else ""
                self.error("", message, suggestion=more, line=line)
                continue
            by_column = {k: unguarded(v.strip()) for k, v in zip(self.table.header, row, strict=True)}
            if row == self.table.header or all(k == v for k, v in by_column.items()):
                self.error("", "the header again, in the middle of the table", line=line)
                continue
            if is_units_row(by_column):
                self._check_units(by_column, line)
                continue
            result[line] = by_column
        return result

    def _check_units(self, row: dict[str, str], line: int) -> None:
        wrong = {k: v for k, v in row.items() if (unit := expected_unit(k, v)) and unit[0] != unit[1]}
        if wrong:
            text = ", ".join(f"{k} in {v}" for k, v in wrong.items())
            expected = ", ".join(f"{k} in {(expected_unit(k, v) or ('',))[0]}" for k, v in wrong.items())
            message = f"the row of units gives {text}"
            raise CaseError([Mistake("", message, allowed=expected, file=self.table.file, line=line)])
        self.note("", "a row of units, the expected ones; not read as a patient", line=line)

    def point(self, line: int, row: dict[str, str]) -> CohortPoint | None:
        """Return the data point of a row; None if the row is unusable, after recording the reasons."""
        raw, wrong = _as_mapping(row)
        wrong += _label_mistakes(row[MEASUREMENT])
        try:
            reading = read_mapping(raw)
        except CaseError as error:
            wrong += [self._in_columns(m) for m in error.mistakes if not _refused_already(m, wrong)]
        else:
            if not any(getattr(reading.case.measurements, name, None) is not None for name in MEASURED):
                wrong.append(Mistake(", ".join(MEASURED), "nothing measured, so nothing to fit"))
            if not wrong:
                self.warnings += [self._in_columns(m).at("", line) for m in reading.warnings]
                name = reading.case.patient.id
                for m in reading.notes:
                    about = ("" if m.key.startswith(Gas.section) else name, m)
                    if m.key not in _OMITTED_NOTES and about not in self.reported:
                        self.reported.add(about)
                        self.notes.append(self._in_columns(m).at("", line))
                return CohortPoint(name, row[MEASUREMENT], line, reading.case)
        self.mistakes += [m.at("", line) for m in wrong]
        return None

    def _in_columns(self, mistake: Mistake) -> Mistake:
        columns = {key: name for name, key in (COLUMNS | OPTIONAL).items()}
        return replace(mistake, key=columns.get(mistake.key, mistake.key))


def _refused_already(mistake: Mistake, wrong: Sequence[Mistake]) -> bool:
    """Whether the same column was already refused for a simpler reason."""
    return any((COLUMNS | OPTIONAL).get(m.key) == mistake.key for m in wrong)


def _as_mapping(row: dict[str, str]) -> tuple[dict[str, Any], list[Mistake]]:
    """Return the sections of a row as in a case file, without empty cells, and the errors found."""
    raw: dict[str, Any] = {"format": 1, "patient": {"id": row[ID]}, "measurements": {}}
    wrong = []
    for column, key in (COLUMNS | OPTIONAL).items():
        text = row.get(column, "")
        if not text or column == ID:
            continue
        if _SPREADSHEET_ERROR.fullmatch(text):
            wrong.append(Mistake(column, "an error value of a spreadsheet", shown(text)))
            continue
        section, _, name = key.partition(".")
        number = column not in _TEXT_COLUMNS and NUMBER.fullmatch(text)
        raw.setdefault(section, {})[name] = NumberAsWritten(text) if number else text
    for device in _WITH_COLUMNS:
        if device.key in raw and not any(row.get(column) for column in device.columns.optional):
            raw[device.key] |= device.columns.usual
    return raw, wrong


def _label_mistakes(label: str) -> list[Mistake]:
    """Return the errors in the label of a measurement."""
    allowed = f"a number, a time such as 2024-03-01T08:00, or a text of 1 to {MAXIMUM_ID_LENGTH} characters"
    if not label:
        return [Mistake(MEASUREMENT, "empty", allowed=allowed)]
    if len(label) > MAXIMUM_ID_LENGTH or not unicodedata.normalize("NFC", label).isprintable():
        return [Mistake(MEASUREMENT, "too long, or contains unprintable characters", shown(label), allowed)]
    if re.fullmatch(r"\d{4}-\d\d-\d\d([T ].*)?", label) and when(label) is None:
        return [
            Mistake(MEASUREMENT, "no such date or time", shown(label), "2024-03-01T08:00, or a plain name")
        ]
    if re.search(r"\b\d{1,2}[/.]\d{1,2}[/.]\d{2,4}\b", label) and when(label) is None:
        return [Mistake(MEASUREMENT, "a date that can be read in two ways", shown(label), "2024-03-01T08:00")]
    return []
