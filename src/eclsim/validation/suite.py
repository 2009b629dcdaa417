"""All comparisons in the order of `eclsim validate`, and their JSON and Markdown."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

from eclsim.paper.comparison import Check, Row, worst
from eclsim.reporting.numbers import text_table
from eclsim.validation import (
    bleeding,
    boluses,
    dialysis,
    drugs,
    fluid,
    gas,
    measurements,
    reference_cases,
    refill,
    regulation,
    robustness,
    solvers,
    vasopressors,
    ventilation,
)
from eclsim.validation.robustness import Effort
from eclsim.validation.timing import Measurement, machine

PARTS: dict[str, Callable[[Effort], list[Check]]] = {
    "reference": lambda effort: reference_cases.checks(effort.quick),
    "gradients": lambda _: solvers.gradient_checks(),
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
    "gas": lambda _: [gas.gas_check(), ventilation.apnoea_check()],
    "drugs": lambda _: [drugs.drugs_check()],
    "regulation": lambda _: [*regulation.regulation_checks(), *ventilation.hypercapnia_checks()],
    "fluid": lambda _: [
        fluid.fluid_check(),
        bleeding.bleeding_check(),
        boluses.boluses_check(),
        refill.refill_check(),
        refill.pericapillary_check(),
        refill.protein_check(),
        vasopressors.vasopressors_check(),
    ],
    "suction": lambda _: [fluid.suction_check()],
    "patients": lambda _: [measurements.healthy_check(), *measurements.effects_checks()],
}
"""Parts of the validation by the name for `--only`."""
PRELOAD = ("eclsim.validation.suite", "eclsim.outputs.steady_beat")
"""Modules that a worker imports before its first task."""
FIT = "(fit"
"""Marks the name of a row that constants were fitted to; all others are tests."""
RED = ("miss, explained", "not decidable", "MISS")
"""Verdicts of rows that miss: explained by an experiment; undecidable from the source; neither."""


def run(
    effort: Effort, parts: Sequence[str] = (), announce: Callable[[str], None] = lambda _: None
) -> Iterator[Check]:
    """Run the checks of some or all parts, and yield each as soon as it is done.

    Args:
        effort: extent of the validation.
        parts: names from `PARTS`; empty for all.
        announce: called with the name of each part before it starts.
    """
    for name in parts or PARTS:
        announce(name)
        start = time.perf_counter()
        checks = PARTS[name](effort)
        share = (time.perf_counter() - start) / max(len(checks), 1)
        yield from (replace(check, seconds=share) for check in checks)


# --- JSON -----------------------------------------------------------------------------------------


def validation_object(checks: Iterable[Check]) -> dict[str, object]:
    """All checks with every row as plain data."""
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
    """Tables with one line for each check and for each row that misses, and the reasons by number."""
    about = machine()
    heading = f"eclsim {about['eclsim']}, {about['date']}, {about['processor']}, Python {about['python']}."
    required = [check for check in checks if check.required]
    compared = [check for check in checks if not check.required]
    parts = [heading, _summary(required)]
    if compared:
        parts += [
            "Compared with measurements and with the paper's text, nothing required:",
            _summary(compared),
        ]
    parts += [f"- {remark}" for check in checks for remark in check.remarks]
    missed = [(check.key, row) for check in checks for row in check.missed]
    if missed:
        texts = dict.fromkeys(row.explained for _, row in missed if row.explained)
        reasons = {text: number for number, text in enumerate(texts, start=1)}
        head = ("comparison", "quantity", "expected", "eclsim", "error", "verdict", "reason")
        parts += ["Rows that miss:", _table(head, (_miss(key, row, reasons) for key, row in missed))]
        parts += ["\n".join(f"{number}. {text}" for text, number in reasons.items())] if reasons else []
    return "\n\n".join(_joined(parts)) + "\n"


def _summary(checks: Iterable[Check]) -> str:
    rows = []
    for check in checks:
        most, red = worst(check.rows), Counter(map(_verdict, check.missed))
        fits = [row for row in check.rows if FIT in row.name]
        others = [row for row in check.rows if FIT not in row.name]
        cells = (_rows_held(fits), _rows_held(others), *(str(red[verdict] or "") for verdict in RED))
        rows.append((check.title, check.bar.partition(";")[0], *cells, f"{most.name}: {_error(most)}"))
    others = "others within" if any(row[2] for row in rows) else "rows within"
    return _table(("comparison", "tolerance", "fits within", others, *RED, "worst row"), rows)


def _rows_held(rows: Sequence[Row]) -> str:
    return f"{sum(row.holds for row in rows)} of {len(rows)}" if rows else ""


def _miss(key: str, row: Row, reasons: Mapping[str, int]) -> tuple[str, ...]:
    reason = str(reasons[row.explained]) if row.explained else ""
    numbers = (_expected(row), f"{row.got:.5g} {_unit(row)}", _error(row))
    return key, row.name, *numbers, _verdict(row), reason


def _expected(row: Row) -> str:
    if row.expected is not None:
        return f"{row.expected:.5g} {_unit(row)}"
    return f"{row.low:.4g} to {row.high:.4g} {_unit(row)}"


def _error(row: Row) -> str:
    if row.percent is None:
        return f"{row.got:.2g} {_unit(row)}".strip()
    if row.name.endswith(": sign"):
        return "right" if row.holds else "wrong"
    return f"{row.percent:+.0f} %" if abs(row.percent) >= 10.0 else f"{row.percent:+.2g} %"


def _unit(row: Row) -> str:
    return "" if row.unit == "1" else row.unit


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table without columns that are empty in all rows."""
    body = [[cell.strip().replace("|", "/") for cell in row] for row in rows]
    kept = [k for k in range(len(head)) if any(row[k] for row in body)]
    lines = [head, ["---"] * len(head), *body]
    return "\n".join("| " + " | ".join(line[k] for k in kept) + " |" for line in lines)


def _joined(parts: Iterable[str]) -> list[str]:
    """Items of a list on consecutive lines."""
    joined: list[str] = []
    for part in parts:
        if joined and part.startswith("- ") and joined[-1].startswith("- "):
            joined[-1] += "\n" + part
        else:
            joined.append(part)
    return joined


# --- text for the command line ----------------------------------------------------------------------


_SHORT = 50
"""Largest number of rows of a check that are all shown."""
_WORST = 5


def check_text(check: Check, every_row: bool = False) -> str:
    """A check as text: all rows if there are few, else the misses and the worst row."""
    rows = _chosen(check, every_row)
    head = ("quantity", "expected", "got", "unit", "error", "verdict")
    percent = ["" if row.percent is None else f"{row.percent:+.2f} %" for row in rows]
    cells = [
        (r.name, _expected_text(r), _number(r.got), r.unit, error, _verdict(r))
        for r, error in zip(rows, percent, strict=True)
    ]
    lines = [f"\n{check.title}", f"tolerance: {check.bar}", text_table(head, cells, numeric=(1, 2, 4))]
    if len(rows) < len(check.rows):
        lines.append(f"... and {len(check.rows) - len(rows)} rows within tolerance (--all shows them)")
    for text in dict.fromkeys(row.explained for row in check.missed if row.explained):
        lines.append(f"explained: {text}")
    lines += [f"note: {remark}" for remark in check.remarks]
    within = len(check.rows) - len(check.missed)
    lines.append(f"{within} of {len(check.rows)} rows within tolerance ({check.seconds:.1f} s)")
    return "\n".join(lines)


def _chosen(check: Check, every_row: bool) -> Sequence[Row]:
    if every_row or len(check.rows) <= _SHORT:
        return check.rows
    within = sorted((row for row in check.rows if row.holds), key=lambda row: -row.used)
    return [*check.missed, *within[:_WORST]]


def verdict_text(checks: Sequence[Check]) -> str:
    """Text on how many rows hold, and on each required row that misses."""
    required = [check for check in checks if check.required]
    compared = [check for check in checks if not check.required]
    rows, off = _count(required)
    explained = sum(1 for check in required for row in check.missed if row.explained)
    line = (
        f"{rows - off} of {rows} required rows within tolerance, {off} miss ({explained} of them explained)."
    )
    if compared:
        total, missed = _count(compared)
        line += f" Compared with measurements and the paper's text: {total - missed} of {total}."
    names = [f"missed: {c.title}: {row.name}" for c in required if not c.holds for row in c.missed]
    return "\n".join([line, *names]) if names else f"{line} All required comparisons pass."


def _count(checks: Sequence[Check]) -> tuple[int, int]:
    return sum(len(check.rows) for check in checks), sum(len(check.missed) for check in checks)


def _expected_text(row: Row) -> str:
    if row.expected is not None:
        return _number(row.expected)
    if row.low in (0.0, float("-inf")):
        return f"<= {row.high:.3g}"
    return f">= {row.low:.4g}" if row.high == float("inf") else f"{row.low:.4g} to {row.high:.4g}"


def _number(value: float) -> str:
    return f"{value:.5g}" if abs(value) >= 1e-3 or value == 0.0 else f"{value:.1e}"


def _verdict(row: Row) -> str:
    if row.holds:
        return "ok"
    explained, undecided, unexplained = RED
    if not row.explained or row.explanation is None:
        return unexplained
    return undecided if row.explanation.undecided else explained


def measurements_text(measurements: Sequence[Measurement]) -> str:
    """Text of times and memory with their limits and the published code's values."""
    head = ("figure", "elapsed", "processor", "limit", "verdict", "published code", "times faster")
    rows = [
        (
            m.name,
            *(_with_unit(number, m) for number in (m.value, m.processor, m.bar)),
            "ok" if m.holds else "MISS",
            _with_unit(m.published, m),
            f"{m.ratio:.0f}" if m.ratio else "",
        )
        for m in measurements
    ]
    remarks = "\n".join(f"  {m.name}: {m.remark}" for m in measurements)
    return f"{text_table(head, rows, numeric=(1, 2, 3, 5, 6))}\n{remarks}"


def _with_unit(value: float | None, m: Measurement) -> str:
    return "" if value is None else f"{value:.3g} {m.unit}" if value < 1000 else f"{value:,.0f} {m.unit}"
