"""What `eclsim track` does with its options."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer

from eclsim.cli.messages import SOME_DID_NOT_CONVERGE, fail, say, warn

if TYPE_CHECKING:
    from eclsim.patients.case import Case
    from eclsim.studies.track import TrackSettings

Series = dict[str, list[tuple[str, "Case"]]]


@dataclass(frozen=True, slots=True)
class Request:
    """The options of the command, as they were written."""

    files: tuple[str, ...]
    out: str
    parameters: str | None
    bounds: str | None
    uncertainty: str | None
    prior: Literal["log-uniform", "log-normal"]
    drift: float | None
    json: str | None
    policy: str
    force: bool


def run(request: Request) -> None:
    """Read, follow, write, show."""
    _check_destinations(request)
    series, refused = _series(request)
    settings = _settings(request)
    _check_points(series, settings)

    from eclsim.report.track_files import as_object, write_tracks
    from eclsim.studies.track import track

    content: dict[str, Any] = {"series": [], "refused": refused}
    for patient, points in series.items():
        tracked = track(points, settings)
        content["series"].append(as_object(patient, tracked))
    write_tracks(Path(request.out), content)
    _hand_out(request, content)
    if refused or any(p["failed"] for s in content["series"] for p in s["points"]):
        raise SystemExit(SOME_DID_NOT_CONVERGE)


def _check_destinations(request: Request) -> None:
    from eclsim.cli.output_option import destination, output_folder
    from eclsim.report.track_files import SUMMARY

    destination("--json", request.json, request.force)
    output_folder(request.out, None if request.force else SUMMARY)


def _series(request: Request) -> tuple[Series, list[str]]:
    """Points of each patient in order of time, and the rows that were refused."""
    tables = [f for f in request.files if Path(f).suffix.lower() in (".csv", ".tsv")]
    if not tables:
        from eclsim.cli.cases import read_all

        readings = read_all(request.files, ())
        first = readings[0].case.patient.id
        return {first: [(Path(r.file).stem, r.case) for r in readings]}, []
    if len(request.files) > 1:
        fail(f"{tables[0]}: one table alone, or case files alone")
    from eclsim.patients.cohort import read_cohort
    from eclsim.patients.mistakes import CaseError

    try:
        reading = read_cohort(tables[0])
    except CaseError as error:
        fail(*error.mistakes)
    for mistake in reading.refused:
        say(f"refused: {mistake}")
    warn(reading.warnings)
    warn(reading.notes, "note")
    if not reading.points:
        fail(f"{tables[0]}: no row can be used")
    found: Series = {}
    for point in reading.points:
        found.setdefault(point.patient_id, []).append((point.measurement, point.case))
    return found, [str(m) for m in reading.refused]


def _settings(request: Request) -> TrackSettings:
    from eclsim.cli.fit_options import fit_settings
    from eclsim.studies.track import TrackSettings
    from eclsim.uncertainty.filtering import DRIFTS

    fit = fit_settings(
        request.parameters, request.bounds, request.uncertainty, weights="uncertainty", policy=request.policy
    )
    return TrackSettings(fit, request.prior, DRIFTS if request.drift is None else (request.drift,))


def _check_points(series: Series, settings: TrackSettings) -> None:
    from eclsim.studies.fit_settings import checked_fit

    wrong = [
        f"{patient}/{name}: {mistake}"
        for patient, points in series.items()
        for name, case in points
        for mistake in checked_fit(case, settings.fit).mistakes
    ]
    if wrong:
        fail(*wrong)


def _hand_out(request: Request, content: Mapping[str, Any]) -> None:
    from eclsim.report.plain_json import write_plain

    if request.json == "-":
        write_plain(content, "-")
        return
    if request.json is not None:
        write_plain(content, Path(request.json))
    for series in content["series"]:
        typer.echo(_table(series))


def _table(series: Mapping[str, Any]) -> str:
    from eclsim.cli.tables import columns

    points = series["points"]
    names = list(dict.fromkeys(n for p in points for n in p["parameters"]))
    rows = [
        (p["id"], *(_text(p["parameters"].get(n)) for n in names), _number(p["chi_square"]),
         _number(p["probability"]), p["message"])
        for p in points
    ]  # fmt: skip
    head = ("id", *names, "chi2", "p", "what does not fit")
    return f"{series['id']}: median and 90 % after each measurement\n" + columns(
        head, rows, numeric=range(1, len(head) - 1)
    )


def _text(interval: Mapping[str, float] | None) -> str:
    if interval is None:
        return "-"
    return f"{interval['median']:.3g} ({interval['lower']:.3g}-{interval['upper']:.3g})"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"


__all__: Sequence[str] = ("Request", "run")
