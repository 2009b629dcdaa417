"""The checks of `eclsim validate` as Markdown: a summary, every row that misses, machine and date."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from eclsim.validation.machine import machine
from eclsim.validation.rows import Check, Row, worst


def validation_markdown(checks: Sequence[Check]) -> str:
    """Two tables, one line a check and one line a row that misses."""
    about = machine()
    heading = f"eclsim {about['eclsim']}, {about['date']}, {about['processor']}, Python {about['python']}."
    required = [check for check in checks if check.required]
    compared = [check for check in checks if not check.required]
    parts = [heading, _summary(required)]
    if compared:
        parts += [
            "Compared with measurements and with the paper's text, without a bar to pass:",
            _summary(compared),
        ]
    parts += [f"- {remark}" for check in checks for remark in check.remarks]
    misses = [row for check in checks for row in _misses(check)]
    if misses:
        head = ("comparison", "quantity", "expected", "eclsim", "error")
        parts += ["Rows that miss:", _table(head, misses)]
    return "\n\n".join(_joined(parts)) + "\n"


def _summary(checks: Iterable[Check]) -> str:
    rows = []
    for check in checks:
        hardest = worst(check.rows)
        held = f"{len(check.rows) - len(check.missed)} of {len(check.rows)}"
        rows.append((check.title, check.bar.partition(";")[0], held, f"{hardest.name}: {_error(hardest)}"))
    return _table(("comparison", "bar", "rows within", "hardest row"), rows)


def _misses(check: Check) -> list[tuple[str, ...]]:
    return [
        (check.key, row.name, _expected(row), f"{row.got:.5g} {_unit(row)}", _error(row))
        for row in check.missed
    ]


def _expected(row: Row) -> str:
    if row.expected is not None:
        return f"{row.expected:.5g} {_unit(row)}"
    return f"{row.low:.4g} to {row.high:.4g} {_unit(row)}"


def _error(row: Row) -> str:
    if row.percent is not None:
        return f"{row.percent:+.2g} %"
    return f"{row.got:.2g} {_unit(row)}".strip()


def _unit(row: Row) -> str:
    return "" if row.unit == "1" else row.unit


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(
        "| " + " | ".join(cell.strip().replace("|", "/") for cell in line) + " |" for line in lines
    )


def _joined(parts: Iterable[str]) -> list[str]:
    """Items of a list directly below each other."""
    joined: list[str] = []
    for part in parts:
        if joined and part.startswith("- ") and joined[-1].startswith("- "):
            joined[-1] += "\n" + part
        else:
            joined.append(part)
    return joined
