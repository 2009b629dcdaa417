"""Formatting of numbers, the same in figures, pages and tables."""

from __future__ import annotations

import math
import sys
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

MINUS = "\N{MINUS SIGN}"
MISSING = "–"
LARGEST_WITHOUT_EXPONENT = 1e6
"""Smaller numbers are written without a power of ten."""


def number(
    value: float | None,
    decimals: int | None = None,
    *,
    digits: int = 4,
    unit: str = "",
    missing: str = MISSING,
) -> str:
    """Format a number with a true minus sign and without negative zero.

    Args:
        value: the number; None, NaN and infinity give `missing`.
        decimals: number of decimals; None to use `digits`.
        digits: significant digits, used if `decimals` is None.
        unit: unit, written after the number.
        missing: text for a missing number.
    """
    if value is None or not math.isfinite(value):
        return missing
    text = significant(value, digits) if decimals is None else f"{value:.{decimals}f}"
    if float(text) == 0.0:
        text = text.lstrip("-")
    return text.replace("-", MINUS) + (f" {unit}" if unit else "")


def significant(value: float, digits: int = 4) -> str:
    """Format a number with significant digits, in plain text; a million or more as a power of ten."""
    text = f"{value:.{digits}g}"
    return f"{float(text):.0f}" if "e+" in text and abs(value) < LARGEST_WITHOUT_EXPONENT else text


def dashed(value: float | None, digits: int = 4) -> str:
    """A number as text with significant digits; "-" for none."""
    return "-" if value is None else significant(value, digits)


def interval(low: float | None, high: float | None, digits: int = 3) -> str:
    """Format an interval as two numbers with "to" between them; empty if one of them is unknown."""
    if low is None or high is None:
        return ""
    return f"{number(low, digits=digits)} to {number(high, digits=digits)}"


# --- plain text tables ------------------------------------------------------------------------------


def text_table(head: Sequence[str], rows: Sequence[Sequence[str]], numeric: Collection[int] = ()) -> str:
    """Format rows under a header, with columns two spaces apart."""
    table = [head, *rows]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    lines = []
    for row in table:
        cells = [
            cell.rjust(width) if index in numeric else cell.ljust(width)
            for index, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        lines.append("  ".join(cells).rstrip())
    return "\n".join(lines)


# --- tables in a terminal ---------------------------------------------------------------------------

WIDTH_WITHOUT_TERMINAL = 140
"""Width of the text, in characters, if standard output is not a terminal."""


def show_table(
    title: str,
    heads: Sequence[str],
    rows: Sequence[Sequence[str]],
    numeric: Collection[int] = (),
    unbroken: Collection[int] = (),
) -> None:
    """Print a table to standard output, as wide as the terminal; a column name may have several lines.

    Args:
        title: title above the table.
        heads: column names.
        rows: cells of each row.
        numeric: indices of right-aligned columns.
        unbroken: indices of columns whose cells stay on one line.
    """
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=None, pad_edge=False)
    for k, head in enumerate(heads):
        table.add_column(head, justify="right" if k in numeric else "left", no_wrap=k in unbroken)
    for row in rows:
        table.add_row(*row)
    _console().print(table)


def show_text(text: str) -> None:
    """Print text to standard output, wrapped at the width of the terminal."""
    _console().print(text, markup=False)


def _console() -> Console:
    from rich.console import Console

    return Console(width=None if sys.stdout.isatty() else WIDTH_WITHOUT_TERMINAL, highlight=False)
