"""Command `eclsim course`: hours of a case with its events, of a cohort, or of draws of a posterior."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from eclsim.cli.cases import (
    case_files_in,
    is_table,
    read_all,
    read_usable_cohort,
    warn_of_new_findings,
    with_speeds,
)
from eclsim.cli.console import (
    INCOMPLETE,
    Progress,
    broken_rules,
    fail,
    mistakes_in,
    refuse,
    refusing,
    say,
    warn,
)
from eclsim.cli.destination import (
    Destinations,
    Target,
    explaining_resume,
    reporting_write_errors,
    write_json_output,
)
from eclsim.cli.options import CaseChanges, Distributed, argument, option
from eclsim.inputs.mistakes import CaseError
from eclsim.reporting.numbers import MISSING, number, text_table

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr

    from eclsim.cases import Case, CaseReading
    from eclsim.execution import Distribution


MOST_NAMED = 5
"""Largest number of patients named in one message."""


@dataclass(frozen=True, kw_only=True)
class CourseOptions(CaseChanges, Distributed):
    """Options of `eclsim course`."""

    files: list[str] = argument(
        ...,
        "CASE.toml...|COHORT.csv|DIR",
        "Case file with its [[events]]; or several, a table of data points, or a folder of case files.",
    )
    hours: float = option(24.0, "Length of the course [h].", minimum=0.01, maximum=744.0)
    until: float | None = option(
        None, "Length [min], instead of --hours.", metavar="MINUTES", minimum=0.1, maximum=744.0 * 60.0
    )
    every: float | None = option(
        None,
        "Minutes between the moments shown; default: such that about 144 are shown.",
        metavar="MINUTES",
        minimum=0.01,
    )
    events: str | None = option(
        None,
        "Take [[events]] from this file, a case or a file with nothing else, for every patient.",
        "--events",
        metavar="EVENTS.toml",
    )
    posterior: str | None = option(
        None,
        "Follow draws of the patient's parameters and show them as a band: posterior.nc or samples.csv of "
        "`eclsim identify --posterior`.",
        metavar="DRAWS.nc",
    )
    draws: int = option(200, "Largest number of draws of --posterior to follow.", minimum=2, maximum=1000)
    beats: bool = option(
        False,
        "Compute every beat, with the lags of reflexes, instead of steady beats (a clamp, a pump stop, a "
        "bolus); up to 120 minutes.",
        "--beats",
    )
    steady_only: bool = option(
        False,
        "Compute steady beats throughout. Without this option, every beat after a large sudden change is "
        "computed until the circulation has settled.",
        "--steady-only",
    )
    out: str | None = option(None, "Folder for the course as CSV and NetCDF.", metavar="DIR")
    figures: str | None = option(None, "Draw the timeline (SVG and PNG) in this folder.", metavar="DIR")

    @property
    def minutes(self) -> float:
        """Duration of the course [min]."""
        return 60.0 * self.hours if self.until is None else self.until

    @property
    def has_several_patients(self) -> bool:
        """Whether there may be more than one patient."""
        return len(self.files) > 1 or is_table(self.files[0]) or Path(self.files[0]).is_dir()


def course(options: CourseOptions) -> None:
    """Follow a case over hours: changed settings, fluid, drugs, blood loss, ultrafiltration.

    At each moment pressures, flows and volumes are those of the steady beat. Several patients are computed in
    groups, to which --resume, --shard and --dask apply. Exit status: 0 all courses reached their end, 1 a
    moment has no steady beat (everything before it is written), 2 bad input.
    """
    follow = _cohort if options.has_several_patients else _band if options.posterior else _single
    if not follow(options):
        raise typer.Exit(INCOMPLETE)


def _cases(o: CourseOptions, mistakes: Collection[str] = ()) -> tuple[Sequence[CaseReading], dict[str, str]]:
    """Return the cases with events and pump speeds, and why rows of a table were refused.

    Errors in the options are reported together with those of the cases.
    """
    from eclsim.cases.reading import CaseReading
    from eclsim.cases.settings import apply_settings
    from eclsim.identification.cohort import with_name

    refused, tables = dict[str, str](), list(filter(is_table, o.files))
    if tables and len(o.files) > 1:
        fail(
            f"{tables[0]}: a table cannot be combined with other files; allowed: one table, one folder, or "
            "case files"
        )
    if tables:
        reading = read_usable_cohort(o.files[0], mistakes)
        cases, refused = [with_name(p.case, p.name) for p in reading.points], reading.refusals
        with refusing(CaseError, at="--set"):
            cases = [apply_settings(case, o.settings) for case in cases] if o.settings else cases
        solved = [CaseReading(case, (), (), o.files[0]) for case in cases]
    else:
        files = [name for file in o.files for name in case_files_in(file)]
        readings = read_all(files, o.settings, o.volume_policy, mistakes)
        solved = readings if o.has_several_patients else with_speeds(readings, o.volume_policy)
    if o.events is None:
        return solved, refused
    followed, without = _with_events(solved, o.events, refuses_rows=bool(tables))
    return followed, refused | without


def _with_events(
    readings: Sequence[CaseReading], file: str, refuses_rows: bool
) -> tuple[Sequence[CaseReading], dict[str, str]]:
    """Return the cases with a file's events, and the patients of a table for whom these are invalid."""
    from eclsim.cases.reading import read_events

    with refusing(CaseError):
        events = read_events(file)
    wrong, doubtful = dict[str, list[str]](), dict[str, list[str]]()
    followed: list[CaseReading] = []
    for reading in readings:
        case = reading.case
        try:
            checked = events.applied_to(case)
        except CaseError as error:
            for mistake in error.mistakes:
                wrong.setdefault(str(mistake), []).append(case.patient.id)
        else:
            for doubt in (doubt for doubt in checked.warnings if doubt.key.startswith("events[")):
                doubtful.setdefault(str(doubt), []).append(case.patient.id)
            followed.append(replace(reading, case=case.model_copy(update={"events": checked.case.events})))
    lines = [f"{message} (for {_names_text(names)})" for message, names in wrong.items()]
    if lines and not (refuses_rows and followed):
        fail(*lines)
    for line in lines:
        say(f"refused: {line}")
    warn(f"{message} (for {_names_text(names)})" for message, names in doubtful.items())
    refused = dict[str, list[str]]()
    for message, names in wrong.items():
        for name in names:
            refused.setdefault(name, []).append(message)
    return followed, {name: "; ".join(reasons) for name, reasons in refused.items()}


def _names_text(names: Sequence[str]) -> str:
    more = len(names) - MOST_NAMED
    return ", ".join(names[:MOST_NAMED]) + (f" and {more} more" if more > 0 else "")


def _destinations(o: CourseOptions) -> Destinations:
    """Return the destinations of results, together with the errors in the options."""
    from eclsim.course.beats import LONGEST_MIN
    from eclsim.course.course import MOST_MOMENTS

    tasks = o.has_several_patients or o.posterior is not None
    places = Destinations(
        force=o.force, resume=o.continues if tasks else None, inputs=[*o.files, o.events, o.posterior]
    )
    if o.every is not None and o.minutes / o.every > MOST_MOMENTS:
        places.mistakes.append(
            f"--every {o.every:g}: {o.minutes / o.every:.0f} moments; allowed: up to {MOST_MOMENTS}"
        )
    if o.beats and o.minutes > LONGEST_MIN:
        places.mistakes.append(
            f"--beats: {o.minutes:g} min; allowed: up to {LONGEST_MIN:g} min (--until), or longer without "
            "--beats"
        )
    places.mistakes += broken_rules({
        "--beats: works for one patient only, without --posterior": o.beats and tasks,
        "--posterior: works for one case file only; it contains the draws of one patient":
            o.has_several_patients and o.posterior is not None,
        "--resume, --shard, --dask: work only for several patients or with --posterior":
            not tasks and (o.continues or o.dask),
        "--out DIR, --json FILE or --figures DIR: give at least one, to write the course to":
            tasks and o.out is None and o.json is None and o.figures is None,
    })  # fmt: skip
    return places


def _checked(o: CourseOptions, places: Destinations, cases: Sequence[Case]) -> tuple[Target, Distribution]:
    """Return the destination of the JSON and the distribution of tasks.

    Exit with status 2 if there are errors in the options, or an event is after the end of the course.
    """
    from eclsim.course.timeline import MINUTE, Timeline

    target, distribution = places.target("--json", o.json), o.distribution(places.mistakes)
    places.check()
    wrong: dict[str, None] = {}
    for case in cases:
        try:
            Timeline(case, o.minutes * MINUTE)
        except CaseError as error:
            place = o.events or (case.patient.id if o.has_several_patients else o.files[0])
            wrong |= dict.fromkeys(str(mistake.at(place, None)) for mistake in error.mistakes)
    refuse(wrong)
    return target, distribution


def _one_patient(
    o: CourseOptions, places: Destinations
) -> tuple[CaseReading, Path | None, Path | None, Target, Distribution]:
    """Return the case, folders of results and figures, and as `_checked`; exit with status 2 on errors."""
    from eclsim.course import files

    (reading,), _ = _cases(o, places.mistakes)
    name = reading.case.patient.id
    folder = places.folder("--out", o.out, files.course_files(name))
    figures = places.folder("--figures", o.figures, stems=[files.course_stem(name)])
    return reading, folder, figures, *_checked(o, places, [reading.case])


# --- one patient ----------------------------------------------------------------------------------


def _single(o: CourseOptions) -> bool:
    """Follow one patient; return whether the course reached its end."""
    from eclsim.course import files
    from eclsim.course.beats import course_beats
    from eclsim.course.course import course as follow
    from eclsim.course.engine import CourseOptions as EngineOptions

    reading, folder, figures, target, _ = _one_patient(o, _destinations(o))
    case = reading.case
    with refusing(CaseError, at=o.files[0]), Progress() as progress:
        progress(f"following {case.patient.id} for {o.minutes:g} min")
        if o.beats:
            result = course_beats(case, minutes=o.minutes, every_min=o.every)
        else:
            options = EngineOptions(hand_over=not o.steady_only)
            result = follow(case, minutes=o.minutes, every_min=o.every, options=options)
    with reporting_write_errors():
        if folder is not None:
            files.write_tables(result, folder)
        if figures is not None and result.sizes["time_min"]:
            files.write_figure(result, figures)
        if write_json_output(files.course_object(result), target):
            typer.echo(_text(result))
    warn_of_new_findings(reading, result.attrs["warnings"])
    return bool(result.attrs["converged"])


# --- draws of a posterior -------------------------------------------------------------------------


def _band(o: CourseOptions) -> bool:
    """Follow draws of one patient's parameters; return whether all reached their end."""
    from eclsim.course import files
    from eclsim.course.band import band_object, course_band
    from eclsim.course.cohort import PRELOAD
    from eclsim.identification.draws import doubts_of, read_samples

    places, samples = _destinations(o), list[Mapping[str, Sequence[float]]]()
    places.mistakes += mistakes_in({"--posterior": lambda: samples.append(read_samples(o.posterior or ""))})
    reading, folder, figures, target, distribution = _one_patient(o, places)
    case = reading.case
    with (
        refusing(CaseError, at=o.posterior or ""),
        explaining_resume(o.out),
        distribution.running(PRELOAD) as executor,
        Progress() as progress,
    ):
        band = course_band(
            case, samples[0], minutes=o.minutes, every_min=o.every, draws=o.draws,
            folder=folder and folder / files.GROUPS, executor=executor, progress=progress,
        )  # fmt: skip
    doubts = doubts_of(o.posterior or "", case)
    band = band.assign_attrs(warnings=[*doubts, *band.attrs["warnings"]])
    with reporting_write_errors():
        if folder is not None:
            files.write_band_tables(band, folder)
        if figures is not None:
            files.write_figure(band, figures)
        if write_json_output(band_object(band), target):
            typer.echo(_band_text(band))
    warn_of_new_findings(reading, band.attrs["warnings"])
    return bool(band.attrs["converged"])


# --- many patients --------------------------------------------------------------------------------


def _cohort(o: CourseOptions) -> bool:
    """Follow several patients; return whether all reached their end and no row was refused."""
    from eclsim.course import files
    from eclsim.course.band import approximations_of_draws
    from eclsim.course.cohort import PRELOAD, course_cohort

    places = _destinations(o)
    readings, refused = _cases(o, places.mistakes)
    cases = [reading.case for reading in readings]
    folder = places.folder("--out", o.out, [files.SUMMARY])
    stems = files.course_stems([case.patient.id for case in cases])
    figures = places.folder("--figures", o.figures, stems=stems)
    target, distribution = _checked(o, places, cases)
    with (
        refusing(CaseError),
        explaining_resume(o.out),
        distribution.running(PRELOAD) as executor,
        Progress() as progress,
    ):
        results = course_cohort(
            readings, minutes=o.minutes, every_min=o.every, volume_policy=o.volume_policy,
            hand_over=not o.steady_only,
            folder=folder and folder / files.GROUPS, executor=executor, progress=progress,
        )  # fmt: skip
    with reporting_write_errors(o.out):
        content = (
            files.cohort_object(results, refused)
            if folder is None
            else files.write_courses(results, folder, refused)
        )
        for stem, one in zip(stems, results, strict=True):
            if figures is not None and one.sizes["time_min"]:
                files.write_figure(one, figures, stem)
        if write_json_output(content, target):
            typer.echo(_cohort_text(content))
    lost = [f"{one['id']}: {one['message']}" for one in content["courses"] if not one["converged"]]
    warn([*lost, *approximations_of_draws(results, "patients")])
    return not (lost or refused)


# --- as text --------------------------------------------------------------------------------------

SHOWN_OUTPUTS = (
    "MAP", "CO", "PF", "heart_rate", "right_atrial_pressure", "PCWP", "drainage_pressure", "SaO2", "PaCO2",
    "DO2", "potassium", "bicarbonate", "drug_unbound",
)  # fmt: skip
MOST_ROWS = 25
SAME_NUMBER = 1e-6
"""Change, relative or in the unit, below which a number of a course is the same."""
BAND_OUTPUTS = ("MAP", "PF", "drainage_pressure", "DO2")
_DECIMALS = {"L/min": 2, "1": 2, "bpm": 0, "mL/min": 0}
"""Decimals by unit in tables, so that the digits of a column line up; other units have one."""


def _text(result: xr.Dataset) -> str:
    """Format some moments of the course as a table, followed by the blood balance."""
    from eclsim.course.alarms import NO_PATIENT
    from eclsim.course.drug import drug_in_words
    from eclsim.course.result import impossible_moments, spans_in_words, undetermined_moments
    from eclsim.devices.registry import flows_of_own_devices

    if not result.sizes["time_min"]:
        return "no moment of this course has a steady beat"
    spans = spans_in_words(result, reasons=True)
    seconds = bool(result.attrs["beat_by_beat"] or spans)
    own = flows_of_own_devices(map(str, result.data_vars))
    names = [name for name in (*SHOWN_OUTPUTS, *own) if name in result]
    impossible, unchanged = impossible_moments(result), _is_unchanged(result)
    rows = [
        (
            f"{at} *" if impossible[k] else at,
            *(number(float(result[name][k]), _decimals(result[name])) for name in names),
        )
        for k, at in _ends_if(unchanged, _rows(result, seconds, impossible)).items()
    ]
    head = ("time", *(f"{name} [{result[name].attrs['units']}]" for name in names))
    ml = {key: number(value, 0) for key, value in json.loads(result.attrs["balance"]).items()}
    words = (
        f"blood volume {ml['blood_volume_start_ml']} mL at the start, {ml['blood_volume_end_ml']} mL at the "
        f"end: given {ml['given_ml']}, removed {ml['removed_ml']}, refilled {ml['refilled_ml']} mL"
    )
    if unchanged:
        words = f"{_unchanged_text(result)}\n\n{words}"
    took = f"{result.attrs['seconds']:.1f} s"
    if settling := result.attrs["settling_s"]:
        took += f"; the circulation settles within {settling:.0f} s after a sudden change"
    if any(impossible):
        words = f"* a beat {NO_PATIENT}: ignore its numbers\n\n{words}"
    if undetermined_moments(result).any():
        words = f"{MISSING}: not determined by the case, as valves stay shut\n\n{words}"
    if spans:
        words += f"\n{spans}"
    if drug := drug_in_words(result):
        words += f"\n{drug}"
    return "\n\n".join((text_table(head, rows, tuple(range(1, len(head)))), words, took))


def _is_unchanged(result: xr.Dataset) -> bool:
    """Whether a course has several moments, and all its numbers stay those of the first."""
    import numpy as np

    def stays(values: xr.DataArray) -> bool:
        rows = values.transpose("time_min", ...).to_numpy()
        if rows.dtype.kind != "f":
            return bool((rows == rows[:1]).all())
        return np.allclose(rows, rows[:1], rtol=SAME_NUMBER, atol=SAME_NUMBER, equal_nan=True)

    followed = [values for values in result.data_vars.values() if "time_min" in values.dims]
    return result.sizes["time_min"] > 1 and bool(followed) and all(map(stays, followed))


def _unchanged_text(result: xr.Dataset) -> str:
    """Say that nothing changes in a course, and why if it has no events."""
    without = not json.loads(result.attrs.get("events", "[]"))
    why = ": the case has no [[events]], and no fluid enters or leaves the patient" if without else ""
    return f"nothing changes between the first and the last moment{why}"


def _ends_if(unchanged: bool, rows: dict[int, str]) -> dict[int, str]:
    """Return the first and last of the moments shown if nothing changes between them, else all."""
    return {k: rows[k] for k in (min(rows), max(rows))} if unchanged and rows else rows


def _decimals(values: xr.DataArray) -> int:
    return _DECIMALS.get(values.attrs["units"], 1)


def _rows(
    result: xr.Dataset, seconds: bool = False, impossible: Sequence[bool] | np.ndarray = ()
) -> dict[int, str]:
    """Return the moments shown in a table with their times, to the second if minutes do not suffice.

    At least one of the `impossible` moments is among them, if there are any.
    """
    from eclsim.course.alarms import clock_time

    count, minute = result.sizes["time_min"], result["time_min"].to_numpy().tolist()
    shown = {*range(0, count, -(-count // MOST_ROWS)), count - 1} if count else set[int]()
    marked = [k for k, wrong in enumerate(impossible) if wrong]
    places = sorted(shown if shown.intersection(marked) else shown.union(marked[:1]))
    times = {k: clock_time(minute[k], seconds) for k in places}
    same = len(set(times.values())) < len(places)
    return {k: clock_time(minute[k], True) for k in places} if same else times


def _band_text(band: xr.Dataset) -> str:
    """Format median and 90 % interval at some moments as a table, with each alarm's largest probability."""
    from eclsim.course.alarms import clock_time

    names = [name for name in BAND_OUTPUTS if name in band]

    def cell(name: str, k: int) -> str:
        decimals = _decimals(band[name])
        low, _, median, _, high = (number(float(v), decimals) for v in band[name].to_numpy()[:, k])
        return f"{median} ({low} to {high})"

    unchanged = _is_unchanged(band)
    shown = _ends_if(unchanged, _rows(band))
    rows = [(at, *(cell(name, k) for name in names)) for k, at in shown.items()]
    head = ("time", *(f"{name} [{band[name].attrs['units']}]" for name in names))
    words = [_unchanged_text(band)] if unchanged else []
    words.append(f"median (90 % interval) of {band.attrs['draws']} draws")
    for label, shares in zip(band["alarm"].values, band["alarm_probability"].to_numpy(), strict=True):
        at = clock_time(float(band["time_min"][int(shares.argmax())]))
        words.append(f"{label}: in {100.0 * shares.max():.0f} % of the draws at {at}")
    table = text_table(head, rows, tuple(range(1, len(head))))
    return "\n\n".join((table, "\n".join(words), f"{band.attrs['seconds']:.1f} s"))


def _cohort_text(content: Mapping[str, Any]) -> str:
    """Format the outcome and first alarm of each patient as a table."""
    from eclsim.course.alarms import clock_time
    from eclsim.course.files import grave_alarms

    rows = []
    for one in content["courses"]:
        alarms = grave_alarms(one)
        first = min(alarms or (), key=lambda alarm: alarm["at_min"], default=None)
        text = "" if first is None else f"{first['quantity']} at {clock_time(first['at_min'])}"
        if (blank := one["undetermined_from_min"]) is not None:
            unknown = f"valves stay shut from {clock_time(blank)}: alarms unknown there"
            text = f"{text}; {unknown}" if text else unknown
        end = "" if one["minutes"] is None else clock_time(one["minutes"])
        count = "" if alarms is None else str(len(alarms))
        rows.append((str(one["id"]), str(one["status"]), end, count, text))
    return text_table(("patient", "course", "until", "alarms", "first alarm"), rows, (3,))
