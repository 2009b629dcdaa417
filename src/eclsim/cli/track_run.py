"""What `eclsim track` does with its options."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer

from eclsim.cli.messages import SOME_DID_NOT_CONVERGE, Progress, fail, say, warn

if TYPE_CHECKING:
    from eclsim.cases.case import Case
    from eclsim.identification.track import TrackSettings

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
    interval: float
    json: str | None
    policy: str | None
    force: bool


def run(request: Request) -> None:
    """Read, follow, write, show."""
    _check_destinations(request)
    series, refused = _series(request)
    settings = _settings(request)
    _check_points(series, settings)
    times = {patient: _times(patient, points) for patient, points in series.items()}
    _say_assumed([p for p, known in times.items() if not known and len(series[p]) > 1], request.interval)

    from eclsim.identification.track import track
    from eclsim.identification.track_files import as_object, write_tracks

    content: dict[str, Any] = {"series": [], "refused": refused, "settings": settings.as_object()}
    progress = Progress()
    for patient, points in series.items():
        tracked = track(points, settings, lambda text, patient=patient: progress(f"{patient}: {text}"))
        assumed = None if times[patient] else request.interval
        content["series"].append(as_object(patient, tracked, assumed))
    progress("figures and report")
    write_tracks(Path(request.out), content)
    progress.end()
    _hand_out(request, content)
    if refused or any(p["failed"] for s in content["series"] for p in s["points"]):
        raise SystemExit(SOME_DID_NOT_CONVERGE)


def _check_destinations(request: Request) -> None:
    from eclsim.cli.output_option import destination, output_folder
    from eclsim.identification.track_files import SUMMARY

    destination("--json", request.json, request.force, request.files)
    output_folder(request.out, None if request.force else SUMMARY)


def _series(request: Request) -> tuple[Series, list[str]]:
    """Points of each patient in order of time, and the rows that were refused."""
    tables = [f for f in request.files if Path(f).suffix.lower() in (".csv", ".tsv")]
    if not tables:
        from eclsim.cli.cases import read_all

        _check_each_once(request.files)
        readings = read_all(request.files, (), request.policy)
        _check_one_patient([(r.file, r.case.patient.id) for r in readings])
        return {readings[0].case.patient.id: [(Path(r.file).stem, r.case) for r in readings]}, []
    if len(request.files) > 1:
        fail(f"{tables[0]}: one table alone, or case files alone")
    from eclsim.cases.cohort import read_cohort
    from eclsim.inputs.mistakes import CaseError

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


def _check_each_once(files: Sequence[str]) -> None:
    """A measurement that is counted twice would make the filter too sure."""
    twice = [file for file in dict.fromkeys(files) if files.count(file) > 1]
    if twice:
        fail(*(f"{file}: given {files.count(file)} times; a measurement counts once" for file in twice))


def _check_one_patient(files: Sequence[tuple[str, str]]) -> None:
    """Case files are one series: with files of different patients nothing is followed."""
    from eclsim.cases.ids import plain_id

    by_id: dict[str, list[tuple[str, str]]] = {}
    for file, name in files:
        by_id.setdefault(plain_id(name), []).append((file, name))
    if len(by_id) > 1:
        said = "; ".join(f"'{same[0][1]}' in {', '.join(f for f, _ in same)}" for same in by_id.values())
        fail(
            f"patient.id: files of {len(by_id)} patients: {said}. Give the case files of one patient, or a "
            "table with a row for each time, in which patients are told apart"
        )


def _times(patient: str, points: Sequence[tuple[str, Case]]) -> bool:
    """Whether the names of a patient's measurements are times, in their order."""
    from eclsim.identification.observation import elapsed_hours
    from eclsim.inputs.mistakes import CaseError

    try:
        return elapsed_hours([name for name, _ in points]) is not None
    except CaseError as error:
        fail(*(f"{patient}: {mistake}" for mistake in error.mistakes))


def _say_assumed(patients: Sequence[str], interval: float) -> None:
    said = (
        f"{', '.join(patients)}: not all names of the measurements are times such as 2024-03-01T08:00, all "
        f"with a time zone or all without; each "
        f"is taken as {interval:g} h after the one before (--interval)"
    )
    warn([said] if patients else [], "note")


def _settings(request: Request) -> TrackSettings:
    from eclsim.cli.fit_options import fit_settings
    from eclsim.identification.filtering import DRIFTS
    from eclsim.identification.track import TrackSettings

    fit = fit_settings(
        request.parameters, request.bounds, request.uncertainty, weights="uncertainty", policy=request.policy
    )
    drifts = DRIFTS if request.drift is None else (request.drift,)
    return TrackSettings(fit, request.prior, drifts, interval_hours=request.interval)


def _check_points(series: Series, settings: TrackSettings) -> None:
    from eclsim.cases.fitting import common_policy
    from eclsim.identification.settings import checked_fit
    from eclsim.inputs.mistakes import CaseError

    wrong = [
        f"{patient}/{name}: {mistake}"
        for patient, points in series.items()
        for name, case in points
        for mistake in checked_fit(case, settings.fit).mistakes
    ]
    for patient, points in series.items():
        try:
            common_policy([case for _, case in points], settings.fit.policy)
        except CaseError as error:
            wrong += [f"{patient}: {mistake}" for mistake in error.mistakes]
    if wrong:
        fail(*wrong)


def _hand_out(request: Request, content: Mapping[str, Any]) -> None:
    from eclsim.files import write_json

    if request.json == "-":
        write_json(content, "-")
        return
    if request.json is not None:
        write_json(content, Path(request.json))
    for series in content["series"]:
        typer.echo(_table(series))


def _table(series: Mapping[str, Any]) -> str:
    """Medians after each measurement, what is to be said of it, and the parameters as they are now."""
    from eclsim.cli.tables import columns
    from eclsim.parameters import thiel2025

    points = series["points"]
    names = list(dict.fromkeys(n for p in points for n in p["parameters"]))
    rows = [
        (p["id"], *(_median(p["parameters"].get(n)) for n in names), _number(p["probability"]))
        for p in points
    ]
    head = ("id", *names, "p")
    lines = [f"{series['id']}: medians after each measurement, and how probable its deviations were"]
    lines.append(columns(head, rows, numeric=range(1, len(head))))
    lines += [f"  !  {p['id']}: {p['message']}" for p in points if p["message"]]
    if not names:
        return "\n".join(lines)
    known = [p for p in points if p["parameters"]][-1]
    now = [
        (n, *(_number(i[q]) for q in ("median", "lower", "upper")), thiel2025.PARAMETERS[n].unit)
        for n, i in known["parameters"].items()
    ]
    lines += [
        "",
        columns((f"after {known['id']}", "median", "5 %", "95 %", "unit"), now, numeric=range(1, 4)),
    ]
    return "\n".join(lines) + "\n"


def _median(interval: Mapping[str, float] | None) -> str:
    return "-" if interval is None else f"{interval['median']:.3g}"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"


__all__: Sequence[str] = ("Request", "run")
