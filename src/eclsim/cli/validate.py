"""`eclsim validate`: what was expected, what comes out, and how far apart they are."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from pathlib import Path

    from eclsim.paper.comparison import Check, Row
    from eclsim.validation.suite import Effort

PARTS = "reference gradients shi-hose adaptive invariants robustness paper devices patients"
_FEW = 50
_WORST = 5
_SWEEP_QUICK, _SWEEP, _SWEEP_FULL = 64, 512, 10_000


def validate(
    quick: Annotated[
        bool, typer.Option("--quick", help="One case of each kind of circuit and 64 points of the sweep.")
    ] = False,
    full: Annotated[
        bool,
        typer.Option("--full", help="10,000 points a configuration in the robustness sweep instead of 512."),
    ] = False,
    only: Annotated[
        list[str] | None,
        typer.Option("--only", metavar="PART", help=f"Only this part; may be repeated. Parts: {PARTS}."),
    ] = None,
    every_row: Annotated[
        bool, typer.Option("--all", help="Show every row, also of tables with hundreds of them.")
    ] = False,
    json_file: Annotated[
        str | None,
        typer.Option("--json", metavar="FILE", help="Write every row as JSON; - writes to standard output."),
    ] = None,
    markdown: Annotated[
        str | None,
        typer.Option("--markdown", metavar="FILE", help="Write a summary and all misses as Markdown."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite a file that exists.")] = False,
) -> None:
    """Hold eclsim against the published code, other solvers, bench data and patients.

    Rows that miss are shown, also where it is known why. Exit status: 0 all bars hold, 1 a row misses its
    bar, 2 bad input. Comparisons with measurements of devices and patients are shown and fail nothing.
    """
    from eclsim.cli.messages import SOME_DID_NOT_CONVERGE, fail
    from eclsim.cli.output_option import destination
    from eclsim.parameters import did_you_mean

    wrong = [name for name in only or [] if name not in PARTS.split()]
    if wrong:
        hint = did_you_mean(wrong[0], PARTS.split())
        fail(
            f"--only {wrong[0]!r}: no such part; allowed: {PARTS}"
            + (f"; did you mean {hint}?" if hint else "")
        )
    if quick and full:
        fail("--quick and --full exclude each other")
    target = destination("--json", json_file, force)
    page = destination("--markdown", markdown, force)
    if target is not None and target == page:
        fail(f"--json and --markdown name the same file: {target}")
    quiet = "-" in (target, page)
    checks = _run(_effort(quick, full), only or [], every_row, quiet)
    _write(checks, target, page)
    missed = [check for check in checks if check.required and not check.holds]
    if not quiet:
        typer.echo("\n" + _verdict(checks, missed))
    if missed:
        raise typer.Exit(SOME_DID_NOT_CONVERGE)


def _write(checks: list[Check], target: Path | str | None, page: Path | str | None) -> None:
    from eclsim.files import write_json, write_text
    from eclsim.validation.suite import validation_markdown, validation_object

    if target is not None:
        write_json(validation_object(checks), target)
    if page is not None:
        write_text(validation_markdown(checks), page)


def _effort(quick: bool, full: bool) -> Effort:
    from eclsim.validation.suite import Effort

    return Effort(quick, _SWEEP_QUICK if quick else _SWEEP_FULL if full else _SWEEP)


def _run(effort: Effort, parts: list[str], every_row: bool, quiet: bool) -> list[Check]:
    from eclsim.cli.messages import say
    from eclsim.validation import suite

    checks = []
    for check in suite.run(effort, parts, lambda part: say(f"running: {part}")):
        checks.append(check)
        if not quiet:
            typer.echo(table(check, every_row))
    return checks


def table(check: Check, every_row: bool = False) -> str:
    """A check as text: all rows of a short one, the misses and the worst of a long one."""
    from eclsim.cli.tables import columns

    rows = _chosen(check, every_row)
    head = ("quantity", "expected", "got", "unit", "error", "verdict")
    body = [(row.name, _expected(row), _number(row.got), row.unit, _percent(row), _word(row)) for row in rows]
    lines = [f"\n{check.title}", f"bar: {check.bar}", columns(head, body, numeric=(1, 2, 4))]
    if len(rows) < len(check.rows):
        lines.append(f"... and {len(check.rows) - len(rows)} rows within the bar (--all shows them)")
    for text in dict.fromkeys(row.explained for row in check.missed if row.explained):
        lines.append(f"explained: {text}")
    lines += [f"note: {remark}" for remark in check.remarks]
    held = len(check.rows) - len(check.missed)
    lines.append(f"{held} of {len(check.rows)} rows within the bar ({check.seconds:.1f} s)")
    return "\n".join(lines)


def _chosen(check: Check, every_row: bool) -> list[Row]:
    if every_row or len(check.rows) <= _FEW:
        return list(check.rows)
    held = sorted((row for row in check.rows if row.holds), key=lambda row: -row.used)
    return [*check.missed, *held[:_WORST]]


def _verdict(checks: list[Check], missed: list[Check]) -> str:
    rows = sum(len(check.rows) for check in checks if check.required)
    off = sum(len(check.missed) for check in checks if check.required)
    explained = sum(1 for check in checks if check.required for row in check.missed if row.explained)
    line = (
        f"{rows - off} of {rows} required rows within their bars, {off} miss ({explained} of them explained)."
    )
    compared = [check for check in checks if not check.required]
    if compared:
        held = sum(len(check.rows) - len(check.missed) for check in compared)
        total = sum(len(check.rows) for check in compared)
        line += f" Compared with measurements and the paper's text: {held} of {total}."
    names = "\n".join(f"bar missed: {check.title}: {row.name}" for check in missed for row in check.missed)
    return f"{line}\n{names}" if missed else f"{line} All bars hold."


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


def _word(row: Row) -> str:
    if row.holds:
        return "ok"
    return "miss, explained" if row.explained else "MISS"
