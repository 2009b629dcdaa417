"""From the bytes of a cohort's CSV file to its header and rows, with the line of each."""

from __future__ import annotations

import csv
import hashlib
import os
from dataclasses import dataclass, field

from eclsim.inputs.files import decoded, read_bytes, refused
from eclsim.inputs.mistakes import Mistake

MAXIMUM_BYTES = 50_000_000
MAXIMUM_ROWS = 100_000
MAXIMUM_COLUMNS = 200
_DELIMITERS = {",": "commas", ";": "semicolons", "\t": "tabs"}


@dataclass(slots=True)
class Table:
    """A table as it was written.

    Attributes:
        file: Where it was read.
        header: Names of the columns.
        rows: Line, counted from 1, and cells of each row; blank rows are left out.
        digest: SHA-256 of the file, as it was read.
        mistakes: What made it impossible to read the rows after a line.
        notes: How it was read, where that is not plain.
    """

    file: str
    header: list[str]
    rows: list[tuple[int, list[str]]]
    digest: str
    mistakes: list[Mistake] = field(default_factory=list)
    notes: list[Mistake] = field(default_factory=list)


def read_table(path: str | os.PathLike[str]) -> Table:
    """Read a table of text cells: UTF-8, any usual delimiter and line ending.

    Raises:
        CaseError: Where the file as a whole cannot be used.
    """
    file = os.fsdecode(path)
    data = read_bytes(file, MAXIMUM_BYTES, "a table", "split the file")
    lines = decoded(data, file, "text in UTF-8 (in Excel: CSV UTF-8)")
    if not lines.strip():
        raise refused(file, "empty: no patients")
    first = next(line for line in lines.split("\n") if line.strip())
    delimiter = max(_DELIMITERS, key=first.count)
    table = Table(file, [], [], hashlib.sha256(data).hexdigest())
    if delimiter != ",":
        table.notes.append(Mistake("", f"columns are separated by {_DELIMITERS[delimiter]}", file=file))
    _read_rows(lines, delimiter, table)
    if not table.rows and not table.mistakes:
        raise refused(file, "the first line is the header, and no rows follow: no patients")
    return table


def digest_of(path: str | os.PathLike[str]) -> str | None:
    """SHA-256 of a file as it is now; None where it is gone."""
    try:
        with open(path, "rb") as handle:
            return hashlib.file_digest(handle, "sha256").hexdigest()
    except OSError:
        return None


def _read_rows(text: str, delimiter: str, table: Table) -> None:
    reader = csv.reader(text.split("\n"), delimiter=delimiter, strict=True)
    # A cell may hold line breaks, so a row begins after the line on which the one before ended.
    begins = 1
    try:
        for cells in reader:
            line, begins = begins, reader.line_num + 1
            if not any(cell.strip() for cell in cells):
                continue
            if not table.header:
                table.header = [cell.strip() for cell in cells]
                if len(cells) > MAXIMUM_COLUMNS:
                    raise refused(table.file, f"{len(cells)} columns", f"at most {MAXIMUM_COLUMNS} columns")
                continue
            if len(table.rows) == MAXIMUM_ROWS:
                raise refused(table.file, "too many rows", f"at most {MAXIMUM_ROWS:,} rows; split the file")
            table.rows.append((line, cells))
    except csv.Error as error:
        unclosed = "unexpected end" in str(error)
        message = "a quote that is opened here is never closed" if unclosed else f"no valid CSV: {error}"
        if not table.header:
            raise refused(table.file, message) from None
        table.mistakes.append(
            Mistake("", f"{message}; rows from here on are not read", file=table.file, line=begins)
        )
