"""What the command line shows of checks and of measured times, as text."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from eclsim.reporting.text_table import text_table

if TYPE_CHECKING:
    from eclsim.paper.comparison import Check, Row
    from eclsim.validation.timing import Measurement

_SHORT = 50
"""Checks with up to as many rows show all of them."""
_WORST = 5


def check_text(check: Check, every_row: bool = False) -> str:
    """A check as text: all rows of a short one, the misses and the worst of a long one."""
    rows = _chosen(check, every_row)
    head = ("quantity", "expected", "got", "unit", "error", "verdict")
    cells = [(r.name, _expected(r), _number(r.got), r.unit, _percent(r), _verdict(r)) for r in rows]
    lines = [f"\n{check.title}", f"bar: {check.bar}", text_table(head, cells, numeric=(1, 2, 4))]
    if len(rows) < len(check.rows):
        lines.append(f"... and {len(check.rows) - len(rows)} rows within the bar (--all shows them)")
    for text in dict.fromkeys(row.explained for row in check.missed if row.explained):
        lines.append(f"explained: {text}")
    lines += [f"note: {remark}" for remark in check.remarks]
    held = len(check.rows) - len(check.missed)
    lines.append(f"{held} of {len(check.rows)} rows within the bar ({check.seconds:.1f} s)")
    return "\n".join(lines)


def _chosen(check: Check, every_row: bool) -> Sequence[Row]:
    if every_row or len(check.rows) <= _SHORT:
        return check.rows
    held = sorted((row for row in check.rows if row.holds), key=lambda row: -row.used)
    return [*check.missed, *held[:_WORST]]


def verdict_text(checks: Sequence[Check]) -> str:
    """How many rows hold, and each bar that is missed."""
    required = [check for check in checks if check.required]
    compared = [check for check in checks if not check.required]
    rows, off = _count(required)
    explained = sum(1 for check in required for row in check.missed if row.explained)
    line = (
        f"{rows - off} of {rows} required rows within their bars, {off} miss ({explained} of them explained)."
    )
    if compared:
        total, missed = _count(compared)
        line += f" Compared with measurements and the paper's text: {total - missed} of {total}."
    names = [f"bar missed: {c.title}: {row.name}" for c in required if not c.holds for row in c.missed]
    return "\n".join([line, *names]) if names else f"{line} All bars hold."


def _count(checks: Sequence[Check]) -> tuple[int, int]:
    return sum(len(check.rows) for check in checks), sum(len(check.missed) for check in checks)


def _expected(row: Row) -> str:
    if row.expected is not None:
        return _number(row.expected)
    if row.low in (0.0, float("-inf")):
        return f"<= {row.high:.3g}"
    return f">= {row.low:.4g}" if row.high == float("inf") else f"{row.low:.4g} to {row.high:.4g}"


def _number(value: float) -> str:
    return f"{value:.5g}" if abs(value) >= 1e-3 or value == 0.0 else f"{value:.1e}"


def _percent(row: Row) -> str:
    return "" if row.percent is None else f"{row.percent:+.2f} %"


def _verdict(row: Row) -> str:
    if row.holds:
        return "ok"
    return "miss, explained" if row.explained else "MISS"


def measurements_text(measurements: Sequence[Measurement]) -> str:
    """Times and memory beside their bars and the published code's."""
    head = ("figure", "elapsed", "processor", "bar", "verdict", "published code", "times faster")
    rows = [
        (
            one.name,
            *(_with_unit(number, one) for number in (one.value, one.processor, one.bar)),
            "ok" if one.holds else "MISS",
            _with_unit(one.published, one),
            f"{one.ratio:.0f}" if one.ratio else "",
        )
        for one in measurements
    ]
    remarks = "\n".join(f"  {one.name}: {one.remark}" for one in measurements)
    return f"{text_table(head, rows, numeric=(1, 2, 3, 5, 6))}\n{remarks}"


def _with_unit(value: float | None, one: Measurement) -> str:
    return "" if value is None else f"{value:.3g} {one.unit}" if value < 1000 else f"{value:,.0f} {one.unit}"
