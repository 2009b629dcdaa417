"""`eclsim reproduce`: every table and figure of the paper, recomputed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eclsim.paper.reproduction import PARTS, USUAL_EXPLORE, USUAL_SAMPLES, ReproductionSettings

if TYPE_CHECKING:
    from eclsim.paper.comparison import Row
    from eclsim.paper.reproduction import Reproduction


def reproduce(
    folder: Annotated[
        str | None, typer.Argument(metavar="DIR", help="The same as --out DIR.", show_default=False)
    ] = None,
    out: Annotated[
        str | None,
        typer.Option("--out", metavar="DIR", help="Folder to write to; made if it does not exist."),
    ] = None,
    parts: Annotated[
        str,
        typer.Option(
            metavar="LIST",
            help="Parts besides the CRRT study (crrt, always done), with commas between: sensitivity "
            "(Figures 3, S-1, S-3, S-4, Table 2), positions (Figures 7, S-5 to S-7), cohort (Table 1, "
            "Figures 4, S-2).",
        ),
    ] = ",".join(PARTS),
    samples: Annotated[
        int,
        typer.Option(min=2, help="Rows N of the sensitivity analyses, a power of two; the paper has 2048."),
    ] = USUAL_SAMPLES,
    explore: Annotated[
        int,
        typer.Option(
            min=2,
            help="Explored sets of parameters for each free one in the fits of the cohort; `eclsim "
            "identify` takes 1000.",
        ),
    ] = USUAL_EXPLORE,
    cohort: Annotated[
        str | None,
        typer.Option(
            metavar="COHORT.csv",
            help="Measurements to fit; left out, the synthetic cohort: the paper's are not published.",
        ),
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with what DIR/runs holds already.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Overwrite files that exist, begin anew.")] = False,
) -> None:
    """Recompute every table and figure of Thiel et al. 2025 and the numbers of its text.

    Writes index.html with all of them beside the printed values, and each as SVG or CSV, in a few minutes.
    Ctrl-C keeps what is done of the long parts; --resume goes on.

    Exit status: 0 done, 2 bad input.
    """  # fmt: skip
    from eclsim.cli.messages import resumable

    chosen = _parts(parts, samples)
    settings = ReproductionSettings(samples, explore, None if cohort is None else Path(cohort), resume)
    target = _folder(_named(folder, out), resume, force)
    _check_cohort(settings)
    with resumable(target), _progress() as progress:
        result = _compute(target, settings, chosen, progress)
        _write(result, target, progress)
    _show(result, target)


def _parts(written: str, samples: int) -> tuple[str, ...]:
    from eclsim.cli.messages import fail
    from eclsim.parameters import did_you_mean

    names = tuple(dict.fromkeys(name.strip() for name in written.split(",") if name.strip()))
    wrong = []
    for name in names:
        if name not in PARTS:
            hint = did_you_mean(name, PARTS)
            wrong.append(
                f"--parts '{name[:40]}': allowed: {', '.join(PARTS)}"
                + (f"; did you mean {hint}?" if hint else "")
            )
    if samples & (samples - 1):
        wrong.append(f"--samples {samples}: allowed: a power of two, such as 256 or 2048")
    if wrong:
        fail(*wrong)
    return names


def _named(folder: str | None, out: str | None) -> str:
    """The one folder that the command line names."""
    from eclsim.cli.messages import fail

    if folder is not None and out is not None:
        fail(f"{folder} and --out {out}: two folders; one of them")
    written = out if out is not None else folder
    if written is None:
        fail("no folder to write to; give one, such as --out reproduction")
    return written


def _folder(written: str, resume: bool, force: bool) -> Path:
    from eclsim.cli import destinations
    from eclsim.cli.messages import fail
    from eclsim.paper.reproduction import RUNS, file_names

    if resume and force:
        fail("--resume keeps what is there and --force throws it away: one of them")
    planned = destinations.plan(destinations.Request(None, None, written, None, force, 0.0), [], [])
    folder = planned.figures
    if folder is None:
        fail(f"{written}: no folder")
    standing = [name for name in (*file_names(), RUNS) if (folder / name).exists()]
    if standing and not (force or resume):
        fail(f"{folder}: holds {standing[0]} already; --resume goes on, --force overwrites it")
    return folder


def _check_cohort(settings: ReproductionSettings) -> None:
    if settings.cohort is None:
        return
    from eclsim.cases.cohort import read_cohort
    from eclsim.cli.messages import fail, warn
    from eclsim.inputs.mistakes import CaseError

    try:
        reading = read_cohort(settings.cohort)
    except CaseError as error:
        fail(*error.mistakes)
    warn(reading.refused, "refused")
    if not reading.points:
        fail(f"{settings.cohort}: no row can be used")


@contextmanager
def _progress() -> Iterator[Callable[[str], None]]:
    """What is being done: one line that changes on a terminal, elsewhere a line for each step."""
    import sys

    from eclsim.cli.messages import say

    if not sys.stderr.isatty():
        steps: set[str] = set()

        def line(text: str) -> None:
            step = text.partition(":")[0]
            if step not in steps:
                steps.add(step)
                say(text)

        yield line
        return
    from rich.console import Console

    with Console(stderr=True).status("computing ...") as status:
        yield status.update


def _compute(
    folder: Path, settings: ReproductionSettings, parts: Sequence[str], progress: Callable[[str], None]
) -> Reproduction:
    from eclsim.cli.messages import fail
    from eclsim.execution import ExecutionError
    from eclsim.identification.cohort_fit import StoreError
    from eclsim.paper.reproduction import RUNS
    from eclsim.paper.reproduction import reproduce as compute

    try:
        folder.mkdir(exist_ok=True)
        return compute(folder / RUNS, settings, parts, progress)
    except (ExecutionError, StoreError) as error:
        fail(error)
    except OSError as error:
        fail(f"{error.filename or folder}: {error.strerror or error}")


def _write(result: Reproduction, folder: Path, progress: Callable[[str], None]) -> None:
    from eclsim.cli.messages import fail
    from eclsim.paper.report import write_reproduction

    try:
        write_reproduction(result, folder, progress)
    except OSError as error:
        fail(f"{error.filename or folder}: cannot be written: {error.strerror or error}")


def _ours(row: Row) -> str:
    """The paper's number and ours with their unit; a claim of the text is met or not."""
    from eclsim.paper.comparison import YES_NO

    if row.unit == YES_NO:
        return "ours: no"
    unit = "" if row.unit == "1" else f" {row.unit}"
    return f"paper {row.expected:g}{unit}, ours {row.got:.4g}{unit}"


def _show(result: Reproduction, folder: Path) -> None:
    from eclsim.cli.messages import say
    from eclsim.paper.comparison import Verdict
    from eclsim.paper.report import counts
    from eclsim.paper.reproduction import INDEX

    typer.echo(counts(result.rows))
    for row in result.rows:
        if row.verdict is Verdict.DIFFERS:
            typer.echo(f"  {row.source}: {row.name}: {_ours(row)}; {row.reason}")
    say(f"all figures and tables: {folder / INDEX}")
