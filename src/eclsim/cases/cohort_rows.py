"""Rows of a cohort's CSV file, and comparisons between them: repeats, ids, other units, order in time."""

from __future__ import annotations

import csv
import hashlib
import os
import re
import statistics
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from functools import cache
from typing import TYPE_CHECKING

from eclsim.cases.sections import sections
from eclsim.devices.registry import devices
from eclsim.inputs.files import decoded, file_error, read_bytes
from eclsim.inputs.mistakes import Mistake, Remarks, shown
from eclsim.units import MMHG_PER_KPA, known_unit

if TYPE_CHECKING:
    from eclsim.cases.cohort import CohortPoint

MAXIMUM_BYTES = 50_000_000
MAXIMUM_ROWS = 100_000
MAXIMUM_COLUMNS = 200
_DELIMITERS = {",": "commas", ";": "semicolons", "\t": "tabs"}
_DELIMITER_LINE = re.compile(r'"?sep=(?P<delimiter>[,;\t]|\\t)"?[,;]*', re.IGNORECASE)
"""Line before the header in which Excel states the delimiter."""


@dataclass(slots=True, kw_only=True)
class Table(Remarks):
    """A table as written, with remarks on how it was read.

    Attributes:
        file: Path of the file.
        header: Column names.
        rows: Line, counted from 1, and cells of each row; blank rows are left out.
        digest: SHA-256 of the file as read.
    """

    file: str
    header: list[str] = field(default_factory=list)
    rows: list[tuple[int, list[str]]] = field(default_factory=list)
    digest: str


def read_table(path: str | os.PathLike[str]) -> Table:
    """Read a table of text cells: UTF-8, with any common delimiter and line ending.

    Raises:
        CaseError: The file as a whole cannot be used.
    """
    file = os.fsdecode(path)
    data = read_bytes(file, MAXIMUM_BYTES, "a table", "split the file")
    lines = decoded(data, file, "text in UTF-8 (in Excel: CSV UTF-8)")
    if not lines.strip():
        raise file_error(file, "empty: no patients")
    lines, delimiter = _delimited(lines)
    if not lines.strip():
        raise file_error(file, "the first line states the column separator, and nothing follows: no patients")
    table = Table(file=file, digest=hashlib.sha256(data).hexdigest())
    if delimiter != ",":
        table.note("", f"columns are separated by {_DELIMITERS[delimiter]}")
    _read_rows(lines, delimiter, table)
    if not table.rows and not table.mistakes:
        raise file_error(file, "the first line is the header, and no rows follow: no patients")
    return table


def _delimited(text: str) -> tuple[str, str]:
    """Return the table without a spreadsheet's line stating the delimiter, and the delimiter."""
    first = next(line for line in text.split("\n") if line.strip())
    if stated := _DELIMITER_LINE.fullmatch(first.strip(" ")):
        return text.replace(first, "", 1), stated["delimiter"].replace("\\t", "\t")
    return text, max(_DELIMITERS, key=first.count)


def digest_of(path: str | os.PathLike[str]) -> str | None:
    """Return the SHA-256 of a file as it is now; None if it cannot be read."""
    try:
        with open(path, "rb") as handle:
            return hashlib.file_digest(handle, "sha256").hexdigest()
    except OSError:
        return None


def _read_rows(text: str, delimiter: str, table: Table) -> None:
    reader = csv.reader(text.split("\n"), delimiter=delimiter, strict=True)
    # A cell may contain line breaks, so a row begins on the line after the end of the previous row.
    begins = 1
    try:
        for cells in reader:
            line, begins = begins, reader.line_num + 1
            if not any(cell.strip() for cell in cells):
                continue
            if not table.header:
                table.header = [cell.strip() for cell in cells]
                if len(cells) > MAXIMUM_COLUMNS:
                    most = f"at most {MAXIMUM_COLUMNS} columns"
                    raise file_error(table.file, f"{len(cells)} columns", most)
                continue
            if len(table.rows) == MAXIMUM_ROWS:
                most = f"at most {MAXIMUM_ROWS:,} rows; split the file"
                raise file_error(table.file, "too many rows", most)
            table.rows.append((line, cells))
    except csv.Error as error:
        unclosed = "unexpected end" in str(error)
        message = "a quote opened here is never closed" if unclosed else f"not valid CSV: {error}"
        if not table.header:
            raise file_error(table.file, message) from None
        table.mistakes.append(
            Mistake("", f"{message}; rows from here on are not read", file=table.file, line=begins)
        )


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
    lines: dict[tuple[str, datetime | str], list[int]] = {}
    for line, row in rows.items():
        if row["patient_id"] and row["measurement"]:
            name = unicodedata.normalize("NFC", row["patient_id"])
            lines.setdefault((name, when(row["measurement"]) or row["measurement"]), []).append(line)
    repeated = {line: same for same in lines.values() if len(same) > 1 for line in same}
    for line, same in repeated.items():
        others = ", ".join(str(k) for k in same if k != line)
        message = f"the same patient and measurement as in line {others}"
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
