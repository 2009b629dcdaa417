"""Command `eclsim track`: follow the parameters of patients over their measurements."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from eclsim.cli.cases import is_table, read_all, read_usable_cohort
from eclsim.cli.console import INCOMPLETE, Progress, broken_rules, fail, note, refuse, warn
from eclsim.cli.destination import Destinations, explaining_resume, write_json_output
from eclsim.cli.identify import Prior, fit_settings, free_parameters_text, source_of_mistake
from eclsim.cli.options import Distributed, FreeParameters, VolumePolicy, argument, option
from eclsim.identification import TRACK_SUMMARY
from eclsim.inputs.mistakes import CaseError

if TYPE_CHECKING:
    from eclsim.cases.case import Case
    from eclsim.identification.tracking import TrackSettings

Series = Mapping[str, Sequence[tuple[str, "Case"]]]
"""Names and cases of each patient's points, in order of time."""
_SAME_NAME = "measurements have the names of their files; give each file a name of its own"


@dataclass(frozen=True, kw_only=True)
class TrackOptions(FreeParameters, Distributed):
    """Options of `eclsim track`."""

    files: list[str] = argument(
        ...,
        "SERIES.csv|CASE.toml...",
        "A table with one row per time, or case files of one patient in order of time. Names such as "
        "2024-03-01T08:00 (files: 2024-03-01T08-00.toml) give the times.",
    )
    out: str = option(..., "Write JSON, tables and figures here.", "--out", metavar="DIR")
    prior: Prior = option("log-uniform", "What is known of the parameters before the first measurement.")
    drift: float | None = option(
        None,
        "Drift of the parameters per day: 0.1 is about 18 %. Default: three rates, weighted by the "
        "measurements.",
        minimum=0.001,
        maximum=0.9,
    )
    interval: float = option(
        24.0,
        "Time between measurements whose names are not times [h].",
        metavar="HOURS",
        minimum=0.01,
        maximum=8760.0,
    )
    volume_policy: VolumePolicy | None = option(
        None, "Whose blood fills the circuits, see `eclsim simulate --help`; default: as in the case file."
    )


def track(options: TrackOptions) -> None:
    """Follow a patient's parameters over time, forecast the next outputs, and flag what does not fit.

    Each measurement is compared with its forecast (normalised innovation) and then updates the parameters:
    an iterated unscented Kalman filter on the steady heartbeat. All intervals are 90 %. Each patient of a
    table is stored when done. Exit status: 0 all points followed, 1 some could not be followed or the first
    estimate fits poorly, 2 bad input.
    """
    table = any(map(is_table, options.files))
    resume = options.continues if table else None
    places = Destinations(force=options.force, resume=resume, inputs=options.files)
    target, distribution = places.target("--json", options.json), options.distribution(places.mistakes)
    places.folder("--out", options.out, [TRACK_SUMMARY])
    places.mistakes += broken_rules({
        "--resume, --shard, --dask: work for tables only; the files of a patient are followed as a whole":
            not table and (options.continues or options.dask),
    })  # fmt: skip
    series, refused, left_out = _series(options, places.mistakes)
    places.check()
    settings = _settings(options)
    each = _settings_of_each(options, series, settings)
    _check_points(series, each)
    _note_assumed_times(series, left_out, options.interval)

    from eclsim.identification.files import write_tracks
    from eclsim.identification.track_report import series_text
    from eclsim.identification.tracks import PRELOAD, PatientSeries, follow_patients

    folder = Path(options.out)
    kept = folder if table else None
    asked_of = {
        patient: PatientSeries(tuple(points), each[patient], tuple(left_out.get(patient, ())))
        for patient, points in series.items()
    }
    with Progress() as progress:
        with explaining_resume(kept), distribution.running(PRELOAD) as executor:
            tracks = follow_patients(asked_of, folder=kept, executor=executor, progress=progress)
        progress("figures and report")
        free = list(dict.fromkeys(name for chosen in each.values() for name in chosen.fit.parameters))
        asked = {**settings.as_object(), "parameters": free}
        content = {"series": tracks, "refused": refused, "settings": asked}
        write_tracks(folder, content)
    if write_json_output(content, target):
        typer.echo("\n".join(map(series_text, tracks)))
    unusable = (
        point["failed"] or (point["verdict"] or {}).get("level") == "poor"  # a first estimate with a poor fit
        for followed in tracks
        for point in followed["points"]
    )
    if refused or any(unusable):
        raise typer.Exit(INCOMPLETE)


def _series(
    o: TrackOptions, mistakes: Collection[str] = ()
) -> tuple[Series, list[str], dict[str, list[int]]]:
    """Return each patient's points, the refused rows' errors, and how many were refused before each point.

    Errors in the options are reported together with those of the files.
    """
    tables = list(filter(is_table, o.files))
    if not tables:
        _refuse_duplicates(o.files)
        readings = read_all(o.files, (), o.volume_policy, mistakes)
        _check_one_patient([(r.file, r.case.patient.id) for r in readings])
        return {readings[0].case.patient.id: [(Path(r.file).stem, r.case) for r in readings]}, [], {}
    if len(o.files) > 1:
        fail(f"{tables[0]}: a table cannot be combined with other files; allowed: one table, or case files")
    reading = read_usable_cohort(tables[0], mistakes)
    series: dict[str, list[tuple[str, Case]]] = {}
    lines: dict[str, list[int]] = {}
    for point in reading.points:
        series.setdefault(point.patient_id, []).append((point.measurement, point.case))
        lines.setdefault(point.patient_id, []).append(point.line)
    left_out = {
        patient: [
            sum(name == patient and before < line < own for name, line in reading.refused_rows)
            for before, own in pairwise([rows[0], *rows])
        ]
        for patient, rows in lines.items()
    }
    return series, [str(mistake) for mistake in reading.refused], left_out


def _refuse_duplicates(files: Sequence[str]) -> None:
    """Refuse files of the same name: it is the measurement's, and one counted twice has too much weight."""
    by_name: dict[str, list[str]] = {}
    for file in files:
        by_name.setdefault(Path(file).stem, []).append(file)
    repeated = {", ".join(dict.fromkeys(same)): len(same) for same in by_name.values() if len(same) > 1}
    refuse([
        f"{names}: {f'given {count} times; give each measurement once' if names in files else _SAME_NAME}"
        for names, count in repeated.items()
    ])  # fmt: skip


def _check_one_patient(files: Sequence[tuple[str, str]]) -> None:
    """Check that all case files are of one patient, as they form one series."""
    from eclsim.cases.cohort import plain_id

    by_id: dict[str, list[tuple[str, str]]] = {}
    for file, name in files:
        by_id.setdefault(plain_id(name), []).append((file, name))
    if len(by_id) > 1:
        listed = "; ".join(f"'{same[0][1]}' in {', '.join(f for f, _ in same)}" for same in by_id.values())
        fail(
            f"patient.id: files of {len(by_id)} patients: {listed}. Give the case files of one patient, or "
            "a table with one row per time, which distinguishes patients"
        )


def _note_assumed_times(series: Series, left_out: Mapping[str, Sequence[int]], interval: float) -> None:
    """Note what is assumed where names are not full times; ends the program if they are not in order."""
    from eclsim.identification.series import notes_on_time

    patients: dict[str, list[str]] = {}
    for patient, points in series.items():
        try:
            notes = notes_on_time([name for name, _ in points], interval, left_out.get(patient, ()))
        except CaseError as error:
            fail(*(f"{patient}: {mistake}" for mistake in error.mistakes))
        for sentence in notes:
            patients.setdefault(sentence, []).append(patient)
    note(f"{', '.join(names)}: {sentence}" for sentence, names in patients.items())


def _settings(o: TrackOptions) -> TrackSettings:
    from eclsim.identification.filtering import DRIFTS
    from eclsim.identification.tracking import TrackSettings

    fit = fit_settings(o, policy=o.volume_policy, weights="uncertainty")
    drifts = DRIFTS if o.drift is None else (o.drift,)
    return TrackSettings(fit, o.prior, drifts, interval_hours=o.interval)


def _settings_of_each(o: TrackOptions, series: Series, settings: TrackSettings) -> dict[str, TrackSettings]:
    """Return the settings of each patient, by default with the parameters that any measurement informs on."""
    from eclsim.identification.series import series_parameters

    usual = settings.fit.parameters
    names = dict.fromkeys(series, usual)
    if o.parameters is None:
        names = {patient: series_parameters(points, usual) for patient, points in series.items()}
    free = {name for each in names.values() for name in each}
    result = {}
    for patient, own in names.items():
        if own != usual:
            note([f"{patient}: {free_parameters_text(own)}"])
        bounds = {n: limits for n, limits in settings.fit.bounds.items() if n in own or n not in free}
        result[patient] = replace(settings, fit=replace(settings.fit, parameters=own, bounds=bounds))
    return result


def _check_points(series: Series, settings: Mapping[str, TrackSettings]) -> None:
    from eclsim.identification.series import series_of
    from eclsim.identification.settings import common_policy

    common = {patient: series_of(settings[patient].fit, points) for patient, points in series.items()}
    wrong: dict[str, None] = {}
    doubts: dict[str, None] = {}
    for patient, points in series.items():
        fit, before = settings[patient].fit, f"{patient}: " if len(series) > 1 else ""
        for name, case in points:
            case, checked = common[patient].checked(case)
            wrong |= {
                before + str(source_of_mistake(m, fit, f"{patient}/{name}")): None for m in checked.mistakes
            }
            unread = [
                str(w) for w in checked.warnings if w.key.startswith("measurements.") or w.key in fit.names
            ]
            doubts |= dict.fromkeys(
                f"{patient}: {doubt}" for doubt in (*common[patient].doubts(case, checked), *unread)
            )
        try:
            common_policy([case for _, case in points], fit.volume_policy)
        except CaseError as error:
            wrong |= {f"{patient}: {mistake}": None for mistake in error.mistakes}
    refuse(list(wrong))
    for patient, points in series.items():
        note(f"{patient}: {sentence}" for sentence in common[patient].remarks(points[-1][1]))
    warn(doubts)
