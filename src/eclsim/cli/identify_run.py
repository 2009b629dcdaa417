"""What `eclsim identify` does with its options."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer

from eclsim.cli.messages import SOME_DID_NOT_CONVERGE, fail, resumable, say, warn

if TYPE_CHECKING:
    from eclsim.cases.case import Case
    from eclsim.cli.posterior_run import PosteriorRequest
    from eclsim.identification.fit import FitResult
    from eclsim.identification.settings import FitSettings


@dataclass(frozen=True, slots=True)
class Request:
    """The options of the command, as they were written."""

    file: str
    out: str
    parameters: str | None
    bounds: str | None
    weights: Literal["relative", "uncertainty"]
    uncertainty: str | None
    seed: int
    json: str | None
    settings: tuple[str, ...]
    policy: str | None
    resume: bool
    force: bool
    posterior: PosteriorRequest
    shared: str | None = None


def run(request: Request) -> None:
    """Fit, write, show."""
    cohort = Path(request.file).suffix.lower() in (".csv", ".tsv")
    _check_destinations(request, cohort)
    _one_cohort(request) if cohort else _one_case(request)


def _check_destinations(request: Request, cohort: bool) -> None:
    from eclsim.cli.output_option import destination, output_folder

    destination("--json", request.json, request.force, (request.file,))
    output_folder(request.out, None if request.force or request.resume else "identification.json")
    if cohort and request.settings:
        fail("--set: for case files; change the table of a cohort instead")
    if cohort and request.posterior.wanted:
        fail("--posterior, --predict: for case files; `eclsim identify` of a cohort gives intervals")
    request.posterior.check_in_vain()
    if not cohort and request.shared is not None:
        fail("--shared: for cohorts; a case is one data point")
    if not cohort and request.resume:
        fail("--resume: for cohorts; a case is fitted in one go")


def _settings(request: Request, policy: str) -> FitSettings:
    from dataclasses import replace

    from eclsim.cli.fit_options import fit_settings
    from eclsim.identification.settings import parameter_names

    settings = fit_settings(
        request.parameters, request.bounds, request.uncertainty,
        weights=request.weights, policy=policy, seed=request.seed,
    )  # fmt: skip
    return replace(settings, shared=tuple(parameter_names(request.shared or "")))


def _one_case(request: Request) -> None:
    from eclsim.cli.cases import read_all
    from eclsim.identification.settings import checked_fit, unmeasured_uncertainties

    (reading,) = read_all([request.file], request.settings, request.policy)
    settings = _settings(request, reading.case.volume_policy)
    predictions = request.posterior.cases(request.file, request.settings, settings.names)
    checked = checked_fit(reading.case, settings)
    mistakes = [*checked.mistakes, *unmeasured_uncertainties([reading.case], settings)]
    if mistakes:
        fail(*(m.at(request.file, None) for m in mistakes))
    warn(checked.warnings)
    warn([note for note in checked.notes if note.key in checked.fixed], "note")

    from eclsim.identification.fit import fit

    result = fit(reading.case, settings, _progress())
    folder = Path(request.out)
    (folder / "cases").mkdir(parents=True, exist_ok=True)
    _write_one(request, result, predictions, settings, folder)


def _write_one(
    request: Request,
    fit: FitResult,
    predictions: Sequence[tuple[str, Case]],
    settings: FitSettings,
    folder: Path,
) -> None:
    """Intervals, figures, files and the page of one fit."""
    from eclsim.identification.files import (
        fits_object,
        write_fit_figures,
        write_fits,
        write_fitted_case,
    )
    from eclsim.identification.page import write_fit_page
    from eclsim.identification.profiles import with_profiles
    from eclsim.identification.verdict import interval_agreement

    progress, posterior = _progress(), None
    if fit.simulated:
        path = write_fitted_case(folder / "cases", fit)
        if progress is not None:
            progress("profiles: how far each parameter can move")
        fit, profiled = with_profiles(fit)
        write_fit_figures(folder / "figures", fit, profiled)
        say(f"fitted case: {path}")
    if request.posterior.wanted and fit.simulated:
        from eclsim.cli.posterior_run import add_posterior

        posterior = add_posterior(request.posterior, fit, predictions, settings, folder, progress)
        if posterior["method"] != "gaussian" and posterior["trusted"]:
            own = fit.as_object()["parameters"]
            fit = fit.judged(interval_agreement(own, posterior["parameters"], "posterior"))
    content = fits_object([fit.as_object()], settings.as_object())
    if posterior is not None:
        content["posterior"] = posterior
    write_fits(folder, content)
    say(f"report: {write_fit_page(folder, content, fit.case, folder / 'figures')}")
    _hand_out(request, content)
    _leave(content["points"], ())


def _one_cohort(request: Request) -> None:
    from eclsim.cases.cohort import read_cohort
    from eclsim.cases.cohort_table import digest_of
    from eclsim.inputs.mistakes import CaseError

    try:
        reading = read_cohort(request.file)
    except CaseError as error:
        fail(*error.mistakes)
    settings = _settings(request, request.policy or "as_published")
    for mistake in reading.refused:
        say(f"refused: {mistake}")
    warn(reading.warnings)
    warn(reading.notes, "note")
    if not reading.points:
        fail(f"{request.file}: no row can be used")
    _check_points(reading.points, settings, request.file)

    from eclsim.identification.cohort_fit import FitStore, StoreError, fit_cohort
    from eclsim.identification.files import fits_object, write_cohort_figures, write_fits
    from eclsim.identification.page import write_fit_page

    store = FitStore(Path(request.out), reading.digest, settings)
    try:
        store.open(request.resume, request.force)
        with resumable(request.out):
            results = fit_cohort(reading.points, settings, store, _progress())
    except StoreError as error:
        fail(error)
    content = fits_object(results, settings.as_object(), reading.refused)
    write_fits(Path(request.out), content)
    write_cohort_figures(Path(request.out) / "figures", content)
    say(f"report: {write_fit_page(Path(request.out), content, drawings=Path(request.out) / 'figures')}")
    _hand_out(request, content)
    changed = digest_of(request.file) != reading.digest
    if changed:
        say(f"error: {request.file}: changed or deleted meanwhile; these are results of the file as it was")
    _leave(content["points"], [*reading.refused, *([request.file] if changed else [])])


def _check_points(points: Sequence[Any], settings: FitSettings, file: str) -> None:
    """Bounds and free parameters are the same for all points, so a mistake in them stops the run."""
    from eclsim.identification.settings import checked_fit, unmeasured_uncertainties

    said: dict[str, None] = {}
    for point in points:
        checked = checked_fit(point.case, settings)
        if checked.mistakes:
            fail(*checked.mistakes)
        said |= dict.fromkeys(str(w.at(file, point.line)) for w in checked.warnings)
    unmeasured = unmeasured_uncertainties([point.case for point in points], settings)
    if unmeasured:
        fail(*(mistake.at(file, None) for mistake in unmeasured))
    warn(said)


def _progress() -> Any:
    """Says on a terminal what is being done."""
    if not sys.stderr.isatty():
        return None
    return lambda text: sys.stderr.write(f"\r\x1b[K{text}")


def _hand_out(request: Request, content: Mapping[str, Any]) -> None:
    from eclsim.files import write_json

    if sys.stderr.isatty():
        sys.stderr.write("\r\x1b[K")
    if request.json == "-":
        write_json(content, "-")
        return
    if request.json is not None:
        write_json(content, Path(request.json))
    points = content["points"]
    typer.echo(_one_table(points[0]) if len(points) == 1 else _many_table(points))
    if "posterior" in content:
        from eclsim.cli.posterior_run import posterior_table

        typer.echo(posterior_table(content["posterior"]))
    for kind, value in content["r2"].items():
        if value is not None and len(points) > 1:
            typer.echo(f"R2 of {kind}: {value:.4f}{_about_r2(value)}")


def _about_r2(value: float) -> str:
    """What the number means: it is no square, and below zero it does not speak for the fits."""
    if value >= 0.0:
        return " (share of the variation among the measured values that the fits explain; 1: all of it)"
    return " (below 0: the fits miss the measured values by more than these differ from their mean)"


def _one_table(point: Mapping[str, Any]) -> str:
    from eclsim.cli.tables import columns
    from eclsim.identification.verdict import headline, signed
    from eclsim.parameters import thiel2025

    goodness = point["verdict"]["goodness"]
    off = {} if goodness is None else goodness["differences"]
    outputs = [
        (n, _text(c["measured"]), _text(c["simulated"]), signed(off[n]) if n in off else "-")
        for n, c in point["outputs"].items()
    ]
    rows = [
        (n, _text(p["value"]), _text(p["lower"]), _text(p["upper"]), thiel2025.PARAMETERS[n].unit,
         "yes" if p["identifiable"] else "no: " + p["reason"])
        for n, p in point["parameters"].items()
    ]  # fmt: skip
    head = ("parameter", "value", "5 %", "95 %", "unit", "determined by the measurements")
    share = f"{point['starts_agreeing']} of {point['starts_refined']} starts agree"
    return "\n".join(
        (
            f"{point['id']}: {headline(point['verdict'])}",
            *(f"  {_SIGNS[r['level']]} {r['sentence']}" for r in point["verdict"]["reasons"]),
            "",
            f"Search: {point['message']} ({share}, {point['seconds']:.1f} s)",
            f"Sum of squared residuals: {_text(point['cost'])}",
            columns(
                ("output", "measured", "fitted", "standard uncertainties off"), outputs, numeric=(1, 2, 3)
            ),
            "",
            columns(head, rows, numeric=(1, 2, 3)),
        )
    )


_SIGNS = {"poor": "!!", "doubtful": "! ", "good": "- "}


def _many_table(points: Sequence[Mapping[str, Any]]) -> str:
    from eclsim.cli.tables import columns

    names = list(dict.fromkeys(n for p in points for n in p["parameters"]))
    rows = []
    for p in points:
        values = [
            _text(p["parameters"][n]["value"]) + ("*" if p["parameters"][n]["at_bound"] else "")
            for n in names
        ]
        row = (
            p["id"],
            p["verdict"]["level"],
            _text(p["cost"]),
            *values,
            str(p["starts_agreeing"]),
            p["status"],
        )
        rows.append(row)
    head = ("id", "verdict", "cost", *names, "agree", "status")
    table = columns(head, rows, numeric=range(2, len(head) - 1)) + "\n* at a bound"
    return "\n".join((table, *_doubts(points)))


def _doubts(points: Sequence[Mapping[str, Any]]) -> list[str]:
    """How many fits are good, and the chief reason of each that is not."""
    from eclsim.identification.verdict import Level

    levels = [p["verdict"]["level"] for p in points]
    lines = ["", ", ".join(f"{levels.count(level)} {level}" for level in Level) + f" of {len(levels)} fits"]
    for p in points:
        if p["verdict"]["level"] != Level.GOOD:
            lines.append(f"{p['id']}: {p['verdict']['level']}: {p['verdict']['reasons'][0]['sentence']}")
    return lines


def _text(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"


def _leave(points: Sequence[Mapping[str, Any]], refused: Sequence[object]) -> None:
    """A fit that did not end, or that is poor, is none: exit status 1."""
    if refused or any(p["status"] != "fitted" or p["verdict"]["level"] == "poor" for p in points):
        raise SystemExit(SOME_DID_NOT_CONVERGE)
