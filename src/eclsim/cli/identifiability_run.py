"""What `eclsim identifiability` does with its options."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import typer

from eclsim.cli.messages import SOME_DID_NOT_CONVERGE, fail, warn

if TYPE_CHECKING:
    from eclsim.orbit.status import NoDerivativesError
    from eclsim.sensitivity.identifiability import Identifiability


@dataclass(frozen=True, slots=True)
class Request:
    """The options of the command, as they were written."""

    case_file: str
    parameters: str | None
    outputs: str | None
    uncertainty: str | None
    limit: float
    threshold: float
    json: str | None
    out: str | None
    settings: tuple[str, ...]
    policy: str | None
    force: bool


def run(request: Request) -> None:
    """Analyse the case, write files, show the proposal."""
    from eclsim.cli.cases import read_all, with_speeds
    from eclsim.orbit.status import NoDerivativesError
    from eclsim.sensitivity.identifiability import identifiability
    from eclsim.sensitivity.inputs import InputError
    from eclsim.sensitivity.uncertainties import read_uncertainties

    _check(request)
    (reading,) = with_speeds(read_all([request.case_file], request.settings, request.policy))
    try:
        found = identifiability(
            reading.case,
            parameters=_names(request.parameters),
            outputs=_names(request.outputs),
            uncertainties=read_uncertainties(request.uncertainty or ""),
            limit=request.limit,
            threshold=request.threshold,
        )
    except InputError as error:
        fail(*error.mistakes)
    except NoDerivativesError as error:
        _say_unknown(request, reading.file, error)
    _write(request, found)
    if request.json != "-":
        _show(found, request)


def _say_unknown(request: Request, file: str, error: NoDerivativesError) -> NoReturn:
    """Nothing is ranked: say why, on standard error and in the JSON, and leave with status 1."""
    said = f"nothing is ranked, because there are no derivatives ({error.word}): {error.reason}"
    content = {"id": error.name, "status": error.word, "message": said}
    try:
        _write_json(request, content)
    except OSError as problem:
        fail(f"{problem.filename or 'output'}: cannot be written: {problem.strerror or problem}")
    warn([f"{file}: {said}"])
    raise typer.Exit(SOME_DID_NOT_CONVERGE)


def _names(text: str | None) -> tuple[str, ...] | None:
    return tuple(n.strip() for n in text.split(",") if n.strip()) or None if text is not None else None


def _check(request: Request) -> None:
    from eclsim.cli.output_option import over_input

    wrong = over_input("--json", request.json, (request.case_file,))
    if not math.isfinite(request.limit) or not math.isfinite(request.threshold):
        wrong.append("--limit, --threshold: infinite; allowed: numbers such as 10 and 1")
    if request.json not in (None, "-"):
        path = Path(request.json)
        if path.exists() and not request.force:
            wrong.append(f"--json {path}: exists already; --force overwrites it")
        if not path.absolute().parent.is_dir():
            wrong.append(f"--json {path}: the folder does not exist")
    if request.out is not None:
        folder = Path(request.out)
        if folder.exists() and not folder.is_dir():
            wrong.append(f"--out {folder}: a file; a folder belongs here")
        elif (folder / "identifiability.json").exists() and not request.force:
            wrong.append(f"--out {folder}: holds identifiability.json; --force overwrites it")
    if wrong:
        fail(*wrong)


def _write(request: Request, found: Identifiability) -> None:
    try:
        _write_json(request, found.as_object())
        if request.out is not None:
            from eclsim.sensitivity.figures import write_identifiability_figures

            write_identifiability_figures(found, Path(request.out) / "figures")
    except OSError as error:
        fail(f"{error.filename or 'output'}: cannot be written: {error.strerror or error}")


def _write_json(request: Request, content: dict[str, Any]) -> None:
    from eclsim.files import write_json

    if request.out is not None:
        Path(request.out).mkdir(parents=True, exist_ok=True)
        write_json(content, Path(request.out) / "identifiability.json")
    if request.json is not None:
        write_json(content, request.json)


def _show(found: Identifiability, request: Request) -> None:
    from eclsim.cli.tables import columns

    typer.echo("Measurements and their standard uncertainties (a percentage is one of the measured value)")
    rows = [
        (
            o,
            f"{found.measured[o]:.4g}" if o in found.measured else "-",
            f"{found.simulated[o]:.4g}",
            f"±{u:.3g}",
        )
        for o, u in found.uncertainties.items()
    ]
    typer.echo(columns(("output", "measured", "simulated", "uncertainty"), rows, numeric=(1, 2, 3)))
    if found.far_off:
        off = ", ".join(f"{o} by {abs(d):.0f}" for o, d in found.far_off.items())
        typer.echo(
            f"The model misses these measurements, in standard uncertainties: {off}. What follows holds near "
            "the model's values: fit the case first (eclsim identify) and analyse the fitted one."
        )
    typer.echo("\nCollinearity index of all sets of a size (above the limit: cannot be told apart)")
    rows = [
        (
            str(s.size),
            str(s.count),
            str(s.below_limit),
            f"{s.smallest:.2f}",
            f"{s.quantiles[1]:.3g}",
            " ".join(s.best),
        )
        for s in found.subsets
    ]
    head = ("size", "sets", f"up to {request.limit:g}", "smallest", "median", "set with the smallest")
    typer.echo(columns(head, rows, numeric=range(5)))
    p = found.proposal
    typer.echo(f"\nProposed to fit together (collinearity index {p.collinearity:.2f})")
    effect = dict(zip(found.scaled.parameters, found.scaled.effect, strict=True))
    rows = [(n, f"{effect[n]:.3g}", f"{100 * p.relative_errors[n]:.3g} %") for n in p.chosen]
    typer.echo(columns(("parameter", "effect", "least standard error"), rows, numeric=(1, 2)))
    typer.echo("\nLeft out")
    typer.echo(columns(("parameter", "reason"), list(p.excluded.items())))
