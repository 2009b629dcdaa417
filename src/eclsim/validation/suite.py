"""All comparisons in the order in which `eclsim validate` shows them, and their JSON and Markdown."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace

from eclsim.paper.comparison import Check, Row, worst
from eclsim.validation import (
    dialysis,
    drugs,
    fluid,
    gas,
    gradients,
    measurements,
    reference_cases,
    regulation,
    robustness,
    solvers,
)
from eclsim.validation.effort import Effort
from eclsim.validation.timing import machine

PARTS: dict[str, Callable[[Effort], list[Check]]] = {
    "reference": lambda effort: reference_cases.checks(effort.quick),
    "gradients": lambda _: gradients.checks(),
    "shi-hose": lambda _: [solvers.shi_hose_check()],
    "adaptive": lambda effort: [solvers.adaptive_check(effort)],
    "invariants": lambda effort: [
        solvers.periodicity_check(effort.quick),
        solvers.conservation_check(effort.quick),
    ],
    "robustness": lambda effort: robustness.checks(effort),
    "paper": lambda _: [measurements.paper_check()],
    "devices": lambda _: [measurements.devices_check()],
    "dialysis": lambda _: [dialysis.dialysis_check()],
    "gas": lambda _: [gas.gas_check()],
    "drugs": lambda _: [drugs.drugs_check()],
    "regulation": lambda _: regulation.regulation_checks(),
    "fluid": lambda _: [fluid.fluid_check()],
    "patients": lambda _: [measurements.healthy_check(), *measurements.effects_checks()],
}
"""Parts of the validation by the name that `--only` takes."""
PRELOAD = ("eclsim.validation.suite", "eclsim.outputs.evaluation")
"""What a worker needs before its first task."""


def run(
    effort: Effort, parts: Sequence[str] = (), announce: Callable[[str], None] = lambda _: None
) -> Iterator[Check]:
    """The checks of some parts, or of all, each as soon as it is done.

    Args:
        effort: how much to compute.
        parts: names of `PARTS`; left out, all.
        announce: is told the name of each part before it starts.
    """
    for name in parts or PARTS:
        announce(name)
        start = time.perf_counter()
        found = PARTS[name](effort)
        share = (time.perf_counter() - start) / max(len(found), 1)
        yield from (replace(check, seconds=share) for check in found)


# --- JSON -----------------------------------------------------------------------------------------


def validation_object(checks: Iterable[Check]) -> dict[str, object]:
    """All checks with every row, as plain data."""
    listed = list(checks)
    holds = all(check.holds for check in listed if check.required)
    return {"machine": machine(), "all_bars_hold": holds, "checks": [_check_object(c) for c in listed]}


def _check_object(check: Check) -> dict[str, object]:
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
        "rows": [_row_object(row) for row in check.rows],
    }


def _row_object(row: Row) -> dict[str, object]:
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
        "evidence": [_row_object(shown) for shown in (() if row.holds else row.evidence)],
        "source": row.source,
    }


# --- Markdown -------------------------------------------------------------------------------------


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
