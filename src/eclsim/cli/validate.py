"""Commands `eclsim validate` and `eclsim benchmark`: results compared with expected ones, and speed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from eclsim.cli.console import INCOMPLETE, Progress, say
from eclsim.cli.destination import Destinations, explaining_resume, reporting_write_errors, write_json_output
from eclsim.cli.options import Distributed, Json, option
from eclsim.files import write_text
from eclsim.spelling import spelling_hint

if TYPE_CHECKING:
    from eclsim.execution import Distribution
    from eclsim.paper.comparison import Check

PARTS = (
    "reference gradients shi-hose adaptive invariants robustness "
    "paper devices dialysis gas drugs regulation fluid suction patients"
)
SWEEPS = ("robustness", "adaptive")
"""Parts that consist of tasks, which shards can share."""
_SWEEP_QUICK, _SWEEP, _SWEEP_FULL = 64, 512, 10_000


@dataclass(frozen=True, kw_only=True)
class ValidateOptions(Distributed):
    """Options of `eclsim validate`."""

    out: str | None = option(
        None, "Keep the results of the sweeps here, for --resume and --shard.", metavar="DIR"
    )

    quick: bool = option(False, "One case of each kind of circuit and 64 points of the sweep.", "--quick")
    full: bool = option(
        False, "10,000 points per configuration in the robustness sweep instead of 512.", "--full"
    )
    only: list[str] = option(
        [],
        f"Only these parts; separate several by commas, or repeat the option: {PARTS}.",
        "--only",
        metavar="PART",
    )
    every_row: bool = option(False, "Show every row, even of tables with hundreds of rows.", "--all")
    json: str | None = option(
        None, "Write every row as JSON; - writes to standard output.", "--json", metavar="FILE"
    )
    markdown: str | None = option(None, "Write a summary and all misses as Markdown.", metavar="FILE")


def validate(options: ValidateOptions) -> None:
    """Compare eclsim with the published code, other solvers, bench data and patients.

    Rows that miss are shown, even if the reason is known. Exit status: 0 all required comparisons pass, 1 a
    required row misses, 2 bad input. Comparisons with measurements of devices and patients are not required.
    """
    options = replace(options, only=[name for names in options.only for name in names.split(",")])
    places = Destinations(force=options.force, resume=options.continues)
    target, page = places.target("--json", options.json), places.target("--markdown", options.markdown)
    places.folder("--out", options.out, parents=True)
    distribution = options.distribution(places.mistakes)
    if options.shard and (len(options.only) != 1 or options.only[0] not in SWEEPS):
        places.mistakes.append(
            f"--shard: needs exactly one part made of tasks: --only {' or --only '.join(SWEEPS)}"
        )
    if wrong := [name for name in options.only if name not in PARTS.split()]:
        hint = spelling_hint(wrong[0], PARTS.split())
        places.mistakes.append(f"--only {wrong[0]!r}: no such part; allowed: {PARTS}{hint}")
    if "adaptive" in (options.only or PARTS.split()) and find_spec("diffrax") is None:
        others = ",".join(name for name in options.only or PARTS.split() if name != "adaptive")
        without = f", or --only {others}" if others else ""
        places.mistakes.append(f"the part adaptive needs diffrax: pip install 'eclsim[verify]'{without}")
    if options.quick and options.full:
        places.mistakes.append("--quick, --full: give only one")
    if target == page == "-":
        places.mistakes.append("--json and --markdown name the same file: -")
    places.check()
    from eclsim.validation.suite import validation_markdown, validation_object, verdict_text

    quiet = "-" in (target, page)
    with explaining_resume(options.out), reporting_write_errors(options.out):
        checks = _run(options, distribution, quiet)
    with reporting_write_errors():
        write_json_output(validation_object(checks), target)
        if page is not None:
            write_text(validation_markdown(checks), page)
    if not quiet:
        typer.echo("\n" + verdict_text(checks))
    if any(check.required and not check.holds for check in checks):
        raise typer.Exit(INCOMPLETE)


def _run(o: ValidateOptions, distribution: Distribution, quiet: bool) -> Sequence[Check]:
    from eclsim.validation import suite
    from eclsim.validation.robustness import Effort
    from eclsim.validation.suite import check_text

    points = _SWEEP_QUICK if o.quick else _SWEEP_FULL if o.full else _SWEEP
    folder = None if o.out is None else Path(o.out)
    checks = []
    with distribution.running(suite.PRELOAD) as executor, Progress() as progress:
        effort = Effort(o.quick, points, executor, folder, progress)
        for check in suite.run(effort, o.only, lambda part: say(f"running: {part}")):
            checks.append(check)
            if not quiet:
                typer.echo(check_text(check, o.every_row))
    return checks


@dataclass(frozen=True, kw_only=True)
class BenchmarkOptions(Json):
    """Options of `eclsim benchmark`."""


def benchmark(options: BenchmarkOptions) -> None:
    """Measure speed and memory on the paper's patient, beside limits and the published code's numbers.

    Takes one to two minutes. Exit status: 0 all within their limits, 1 a limit is missed, 2 bad input.
    """
    places = Destinations(force=options.force)
    target = places.target("--json", options.json)
    places.check()
    from eclsim.validation import timing
    from eclsim.validation.suite import measurements_text

    measurements = []
    for measurement in timing.measurements():
        measurements.append(measurement)
        say(f"measured: {measurement.name}")
    about = timing.machine()
    content = {"machine": about, "measurements": [figure.as_object() for figure in measurements]}
    if write_json_output(content, target):
        typer.echo(measurements_text(measurements))
        typer.echo("\n" + ", ".join(f"{key} {value}" for key, value in about.items()))
    if not all(figure.holds for figure in measurements):
        raise typer.Exit(INCOMPLETE)
