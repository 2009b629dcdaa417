"""Cohorts: a CSV table with one row per data point, whose rows are read one by one into checked cases.

An error in a row excludes only that row; an error in the header refuses the whole file.
"""

from __future__ import annotations

import os
import re
import statistics
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from functools import cache
from types import MappingProxyType
from typing import Any

from eclsim.cases.case import Case
from eclsim.cases.doubts import speeds_too_low
from eclsim.cases.reading import read_mapping
from eclsim.cases.sections import FURTHER_MEASUREMENTS, MEASURED, MEASURED_GASES, Gas, sections
from eclsim.cases.table import Table, read_text_table
from eclsim.devices.description import Columns
from eclsim.devices.registry import devices
from eclsim.files import NUMBER, unguarded
from eclsim.inputs.mistakes import CaseError, Mistake, NumberAsWritten, Remarks, shown
from eclsim.inputs.sections import MAXIMUM_ID_LENGTH, NOT_FITTED, looks_identifiable
from eclsim.spelling import did_you_mean
from eclsim.units import MMHG_PER_KPA, known_unit

# --- what the rows say together ---------------------------------------------------------------------


_PRESSURES = ("SP", "DP", "MAP", "MPAP", "PCWP")
_GASES = ("PaO2", "PaCO2", "PpostO2", "PexhaustCO2")
_FEWEST_ROWS = 4
Rows = Mapping[int, Mapping[str, str]]
"""Cells by column of each row, by line."""
_TIME = re.compile(r"\d{4}-\d\d-\d\d([T ]\d\d:\d\d(:\d\d(\.\d+)?)?(Z|[+-]\d\d:?\d\d)?)?")


@cache
def _units() -> dict[str, str]:
    """Return the units of the columns that have one."""
    fields = (item for kind in sections().values() for item in kind.fields().values())
    columns = {
        column: device.section.fields()[key].unit
        for device in devices().values()
        for column, key in device.columns.needed.items()
    }
    return {name: unit for name, unit in ({f.name: f.unit for f in fields} | columns).items() if unit}


def expected_unit(column: str, text: str) -> tuple[str, str] | None:
    """Return the unit of a column and the unit that a text names; None if either is missing."""
    written = known_unit(text.strip("[]() "))
    unit = _units().get(column)
    return (unit, written) if unit is not None and written is not None else None


def is_units_row(row: Mapping[str, str]) -> bool:
    """Whether the cells of a row are units rather than values."""
    columns = [column for column, text in row.items() if expected_unit(column, text)]
    return len(columns) >= 2 and not any(_number(row.get(name, "")) is not None for name in _units())


def across_rows(rows: Rows, remarks: Remarks) -> set[int]:
    """Compare the rows, by line; return the lines of rows that others make unusable."""
    lines = _repeats(rows, remarks)
    for names in (_PRESSURES, _GASES):
        lines |= _in_kilopascal(rows, names, remarks)
    _warn_of_similar_ids(rows, remarks)
    _warn_of_changed_patients(rows, remarks)
    return lines


def plain_id(written: str) -> str:
    """Normalise a patient id, so that ids that differ only in case, spaces or Unicode form become equal."""
    return unicodedata.normalize("NFKC", "".join(written.split())).casefold()


def when(label: str) -> datetime | None:
    """Return the time given by a label in ISO 8601; None for any other label."""
    if not _TIME.fullmatch(label):
        return None
    try:
        return datetime.fromisoformat(label)
    except ValueError:
        return None


def mistakes_in_date(label: str) -> list[Mistake]:
    """Return the error of a label that is written as a date, but gives no existing date or time."""
    if not re.fullmatch(r"\d{4}-\d\d-\d\d([T ].*)?", label) or when(label) is not None:
        return []
    return [Mistake(MEASUREMENT, "no such date or time", shown(label), "2024-03-01T08:00, or a plain name")]


def in_order_of_time(points: Sequence[CohortPoint], remarks: Remarks) -> list[CohortPoint]:
    """Sort each patient's points by time, if all their labels are times; what was done is noted."""
    ordered = list(points)
    by_patient: dict[str, list[int]] = {}
    for k, point in enumerate(points):
        by_patient.setdefault(point.patient_id, []).append(k)
    for places in by_patient.values():
        times = [when(points[k].measurement) for k in places]
        if any(t is None for t in times):
            continue
        if len({t.tzinfo is None for t in times if t}) > 1:
            message = (
                "times with and without a time zone: the rows of this patient stay in the order of the file"
            )
            remarks.note("measurement", message, line=points[places[0]].line)
            continue
        sorted_places = [k for _, k in sorted(zip(times, places, strict=True))]  # pyright: ignore[reportArgumentType]  # none is None
        if sorted_places != places:
            for place, k in zip(places, sorted_places, strict=True):
                ordered[place] = points[k]
            message = f"the {len(places)} rows of this patient are put in order of time"
            remarks.note("measurement", message, line=points[places[0]].line)
    return ordered


def _repeats(rows: Rows, remarks: Remarks) -> set[int]:
    """Return the lines of all rows of repeated data points: it is not known which is right."""
    # By name, which results are found by: measurement C of patient A/B has that of B/C of A.
    lines: dict[tuple[str, datetime] | str, list[int]] = {}
    for line, row in rows.items():
        if row["patient_id"] and row["measurement"]:
            patient = unicodedata.normalize("NFC", row["patient_id"])
            time, name = when(row["measurement"]), f"{patient}/{row['measurement']}"
            lines.setdefault((patient, time) if time else name, []).append(line)
    repeated = {line: same for same in lines.values() if len(same) > 1 for line in same}
    for line, same in repeated.items():
        others = ", ".join(str(k) for k in same if k != line)
        every = " and ".join(filter(None, (", ".join(map(str, same[:-1])), str(same[-1]))))
        message = f"the same patient and measurement as in line {others}: keep one of lines {every}"
        remarks.error("measurement", message, shown(rows[line]["measurement"]), line=line)
    return set(repeated)


def _warn_of_similar_ids(rows: Rows, remarks: Remarks) -> None:
    """Warn of different ids that a reader would take to be the same."""
    first: dict[str, tuple[str, int]] = {}
    text = set()
    for line, row in rows.items():
        name = unicodedata.normalize("NFC", row["patient_id"])
        known, where = first.setdefault(plain_id(name), (name, line))
        if known != name and name not in text:
            text.add(name)
            message = (
                f"differs from the id in line {where} only in case, spaces or Unicode form: two patients"
            )
            remarks.warning("patient_id", message, shown(name[:80]), line=line)


def _warn_of_changed_patients(rows: Rows, remarks: Remarks) -> None:
    """Warn of rows of one id that differ in what does not change in an adult: sex and height."""
    first: dict[tuple[str, str], tuple[str, int]] = {}
    for line, row in rows.items():
        name = unicodedata.normalize("NFC", row["patient_id"])
        for column in ("sex", "height_cm"):
            text = row.get(column, "").strip()
            if not text:
                continue
            known, where = first.setdefault((name, column), (text, line))
            number = _number(text)
            if known != text and (number is None or number != _number(known)):
                message = f"{known} in line {where}, under the same patient_id: one patient, or two?"
                remarks.warning(column, message, text[:80], line=line)


def _in_kilopascal(rows: Rows, names: Sequence[str], remarks: Remarks) -> set[int]:
    """Return the lines of rows whose pressures are all smaller than others' by the factor mmHg to kPa."""
    usual = {name: _median(_number(row.get(name, "")) for row in rows.values()) for name in names}
    result = set()
    for line, row in rows.items():
        values = {name: _number(row.get(name, "")) for name in names}
        ratios = {name: v / u for name, v in values.items() if v and (u := usual[name])}
        if len(ratios) >= 2 and all(0.5 < ratio * MMHG_PER_KPA < 2.0 for ratio in ratios.values()):
            name = next(iter(ratios))
            message = f"about 7.5 times smaller than in the other rows, as are {', '.join(list(ratios)[1:])}"
            hint = f"{values[name]:g} kPa = {values[name] * MMHG_PER_KPA:.4g} mmHg"  # pyright: ignore[reportOptionalOperand]  # has a ratio
            remarks.error(name, message, row[name], "mmHg", hint, line)
            result.add(line)
    return result


def _median(values: Iterable[float | None]) -> float | None:
    known = [v for v in values if v is not None and v > 0]
    return statistics.median(known) if len(known) >= _FEWEST_ROWS else None


def _number(text: str) -> float | None:
    return float(text) if re.fullmatch(r"[+-]?[0-9]+(\.[0-9]*)?([eE][+-]?[0-9]{1,2})?", text) else None


# --- the file and its rows ------------------------------------------------------------------------


ID, MEASUREMENT = "patient_id", "measurement"
_ABOUT_PATIENT = ("sex", "age_years", "height_cm", "weight_kg", "heart_rate_bpm")
_WITH_COLUMNS = [device for device in devices().values() if device.columns != Columns()]
_OMITTED_NOTES = {
    "measurements.CO",
    *(f"{one.key}.{key}" for one in _WITH_COLUMNS for key in one.columns.usual),
}
"""Keys whose notes on what a row gives are omitted, as they would appear for every row."""
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

    @property
    def refusals(self) -> dict[str, str]:
        """Reasons why rows are unusable, by line and patient, such as "line 3 (P01)"."""
        patients = {line: f" ({patient})" for patient, line in self.refused_rows if patient}
        reasons: dict[str, list[str]] = {}
        for mistake in self.refused:
            label = f"line {mistake.line}{patients.get(mistake.line or 0, '')}"
            reasons.setdefault(label, []).append(str(mistake.at("", None)))
        return {label: "; ".join(each) for label, each in reasons.items()}


def read_cohort(path: str | os.PathLike[str]) -> CohortReading:
    """Read a cohort; each row is checked like a case file.

    Args:
        path: A CSV file with the columns `COLUMNS` and `measurement`; cells without a measurement are empty.

    Raises:
        CaseError: The file as a whole cannot be used.
    """
    table = read_text_table(path, missing="no patients")
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
            refused = {(COLUMNS | OPTIONAL).get(m.key) for m in wrong}  # already, for a simpler reason
            wrong += [self._in_columns(m) for m in error.mistakes if m.key not in refused]
        else:
            if not any(getattr(reading.case.measurements, name, None) is not None for name in MEASURED):
                wrong.append(Mistake(", ".join(MEASURED), "nothing measured, so nothing to fit"))
            wrong += [self._in_columns(m) for m in speeds_too_low(reading.case)]
            if not wrong:
                self.warnings += [self._in_columns(m).at("", line) for m in reading.warnings]
                name = reading.case.patient.id
                for m in reading.notes:
                    about = ("" if m.key.startswith(Gas.section) else name, m)
                    omitted = m.key in _OMITTED_NOTES and m.message != NOT_FITTED
                    if not omitted and about not in self.reported:
                        self.reported.add(about)
                        self.notes.append(self._in_columns(m).at("", line))
                return CohortPoint(name, row[MEASUREMENT], line, reading.case)
        self.mistakes += [m.at("", line) for m in wrong]
        return None

    def _in_columns(self, mistake: Mistake) -> Mistake:
        columns = {key: name for name, key in (COLUMNS | OPTIONAL).items()}
        return replace(mistake, key=columns.get(mistake.key, mistake.key))


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
    if impossible := mistakes_in_date(label):
        return impossible
    if re.search(r"\b\d{1,2}[/.]\d{1,2}[/.]\d{2,4}\b", label) and when(label) is None:
        return [Mistake(MEASUREMENT, "a date that can be read in two ways", shown(label), "2024-03-01T08:00")]
    return []
