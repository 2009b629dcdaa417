"""Tables of text cells: a CSV file as written, with line numbers and remarks on how it was read."""

from __future__ import annotations

import csv
import hashlib
import os
import re
from dataclasses import dataclass, field

from eclsim.inputs.files import decoded, file_error, read_bytes
from eclsim.inputs.mistakes import Mistake, Remarks

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


def read_text_table(path: str | os.PathLike[str], *, missing: str) -> Table:
    """Read a table of text cells: UTF-8, with any common delimiter and line ending.

    Args:
        path: Path of the file.
        missing: What a table without rows lacks, such as "no patients", and what is needed, for the error.

    Raises:
        CaseError: The file as a whole cannot be used.
    """
    file = os.fsdecode(path)
    data = read_bytes(file, MAXIMUM_BYTES, "a table", "split the file")
    lines = decoded(data, file, "text in UTF-8 (in Excel: CSV UTF-8)")
    if not lines.strip():
        raise file_error(file, f"empty: {missing}")
    lines, delimiter = _delimited(lines)
    if not lines.strip():
        message = f"the first line states the column separator, and nothing follows: {missing}"
        raise file_error(file, message)
    table = Table(file=file, digest=hashlib.sha256(data).hexdigest())
    if delimiter != ",":
        table.note("", f"columns are separated by {_DELIMITERS[delimiter]}")
    _read_rows(lines, delimiter, table)
    if not table.rows and not table.mistakes:
        raise file_error(file, f"the first line is the header, and no rows follow: {missing}")
    return table


def digest_of(path: str | os.PathLike[str]) -> str | None:
    """Return the SHA-256 of a file as it is now; None if it cannot be read."""
    try:
        with open(path, "rb") as handle:
            return hashlib.file_digest(handle, "sha256").hexdigest()
    except OSError:
        return None


def _delimited(text: str) -> tuple[str, str]:
    """Return the table without a spreadsheet's line stating the delimiter, and the delimiter."""
    first = next(line for line in text.split("\n") if line.strip())
    if stated := _DELIMITER_LINE.fullmatch(first.strip(" ")):
        return text.replace(first, "", 1), stated["delimiter"].replace("\\t", "\t")
    return text, max(_DELIMITERS, key=first.count)


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
