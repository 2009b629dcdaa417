"""`eclsim reproduce`: the numbers of the paper, recomputed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from eclsim.studies.reproduction import Reproduction


def reproduce(
    folder: Annotated[
        str, typer.Argument(metavar="DIR", help="Folder to write to; made if it does not exist.")
    ],
    force: Annotated[bool, typer.Option("--force", help="Overwrite files that exist.")] = False,
) -> None:
    """Recompute the numbers of Thiel et al. 2025 (sections 3.3 and 4, Figures 2, 5, 6, Tables S-1 to S-4).

    Writes reproduction.html, .csv and .json and the figures in about a minute.

    Exit status: 0 done, 2 bad input.
    """
    target = _folder(folder, force)
    result = _compute()
    _write(result, target)


def _folder(written: str, force: bool) -> Path:
    from eclsim.cli import destinations
    from eclsim.cli.messages import fail
    from eclsim.report.reproduction_names import file_names

    planned = destinations.plan(destinations.Request(None, None, written, None, force, 0.0), [], [])
    folder = planned.figures
    if folder is None:
        fail(f"{written}: no folder")
    standing = [name for name in file_names() if (folder / name).exists()]
    if standing and not force:
        fail(f"{folder}: holds {standing[0]} already; --force overwrites it")
    return folder


def _compute() -> Reproduction:
    import sys

    from eclsim.studies.reproduction import reproduce as compute

    if not sys.stderr.isatty():
        return compute()
    from rich.console import Console

    with Console(stderr=True).status("computing ...") as status:
        return compute(status.update)


def _write(result: Reproduction, folder: Path) -> None:
    from eclsim.cli.messages import fail, say
    from eclsim.report.reproduction_files import counts, write_reproduction

    try:
        write_reproduction(result, folder)
    except OSError as error:
        fail(f"{error.filename or folder}: cannot be written: {error.strerror or error}")
    typer.echo(counts(result))
    for row in result.rows:
        if not row.as_printed and "it agrees" not in row.why:
            ours = f"paper {row.paper:g}, ours {row.ours:.2f} {row.unit}"
            typer.echo(f"  {row.section}: {row.quantity}: {ours}; {row.why}")
    say(f"table: {folder / 'reproduction.html'}")
