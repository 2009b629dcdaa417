"""The checks of `eclsim validate` as plain data."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from eclsim.validation.machine import machine
from eclsim.validation.rows import Check, Row


def validation_object(checks: Iterable[Check]) -> dict[str, Any]:
    """All checks with every row."""
    listed = [_check(check) for check in checks]
    holds = all(check["holds"] for check in listed if check["required"])
    return {"machine": machine(), "all_bars_hold": holds, "checks": listed}


def _check(check: Check) -> dict[str, Any]:
    return {
        "key": check.key,
        "title": check.title,
        "bar": check.bar,
        "required": check.required,
        "holds": check.holds,
        "rows_within": len(check.rows) - len(check.missed),
        "rows_total": len(check.rows),
        "seconds": round(check.seconds, 1),
        "remarks": list(check.remarks),
        "rows": [_row(row) for row in check.rows],
    }


def _row(row: Row) -> dict[str, Any]:
    return {
        "name": row.name,
        "expected": row.expected,
        "got": row.got,
        "unit": row.unit,
        "low": row.low,
        "high": row.high,
        "error_percent": row.percent,
        "holds": row.holds,
        "explanation": row.explained,
        "evidence": [_row(shown) for shown in _evidence(row)],
        "source": row.source,
    }


def _evidence(row: Row) -> tuple[Row, ...]:
    return () if row.holds or row.explanation is None else row.explanation.evidence
