"""`eclsim course`: hours of a case with its events."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import typer

from eclsim.cli.cases import read_all, with_speeds
from eclsim.cli.console import INCOMPLETE, Progress, fail, warn
from eclsim.cli.destination import Destinations, hand_over, locked, writing
from eclsim.cli.options import CaseChanges, Json, argument, option

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True, kw_only=True)
class CourseOptions(CaseChanges, Json):
    """Options of `eclsim course`."""

    case_file: str = argument(..., "CASE.toml", "Case file, with its [[events]].")
    hours: float = option(24.0, "How long [h].", minimum=0.01, maximum=744.0)
    until: float | None = option(None, "How long [min], in place of --hours.", metavar="MINUTES", minimum=0.1)
    every: float | None = option(
        None,
        "Minutes between the moments shown; left out, some 144 of them.",
        metavar="MINUTES",
        minimum=0.01,
    )
    beats: bool = option(
        False,
        "Follow every beat with the lags of reflexes instead of steady beats: a clamp, a pump stop, a bolus; "
        "up to 120 minutes.",
        "--beats",
    )
    out: str | None = option(None, "Folder for the course as CSV and NetCDF.", metavar="DIR")
    figures: str | None = option(None, "Draw the timeline (SVG and PNG) in this folder.", metavar="DIR")


def course(options: CourseOptions) -> None:
    """Follow a case over hours: settings changed, fluid and drugs given, blood lost, ultrafiltration.

    At each moment pressures, flows and volumes are those of the steady beat. Exit status: 0 it reached its
    end, 1 a moment has no steady beat (what came before is written), 2 bad input.
    """
    (reading,) = with_speeds(read_all([options.case_file], options.settings, options.volume_policy))
    minutes = 60.0 * options.hours if options.until is None else options.until
    from eclsim.course import files
    from eclsim.course.beats import LONGEST_MIN, course_beats
    from eclsim.course.course import MOST_MOMENTS
    from eclsim.course.course import course as follow
    from eclsim.inputs.mistakes import CaseError

    name = reading.case.patient.id
    places = Destinations(force=options.force, inputs=[options.case_file])
    target = places.target("--json", options.json)
    folder = places.folder("--out", options.out, files.course_files(name))
    figures = places.folder("--figures", options.figures, stems=[files.course_stem(name)])
    if options.every is not None and minutes / options.every > MOST_MOMENTS:
        places.mistakes.append(
            f"--every {options.every:g}: {minutes / options.every:.0f} moments; allowed: up to {MOST_MOMENTS}"
        )
    if options.beats and minutes > LONGEST_MIN:
        places.mistakes.append(
            f"--beats: {minutes:g} min; allowed: up to {LONGEST_MIN:g} min (--until), hours without it"
        )
    if options.out is None and options.json is None and options.figures is None:
        places.mistakes.append(
            "--out DIR, --json FILE or --figures DIR: give one, where the course is written"
        )
    places.check()
    try:
        with Progress() as progress:
            progress(f"following {name} for {minutes:g} min")
            followed = course_beats if options.beats else follow
            result = followed(reading.case, minutes=minutes, every_min=options.every)
    except CaseError as error:
        fail(*(mistake.at(reading.file, None) for mistake in error.mistakes))
    with locked(options.out), writing():
        if folder is not None:
            files.write_tables(result, folder)
        if figures is not None and result.sizes["time_min"]:
            files.write_figure(result, figures)
        if hand_over(files.course_object(result), target):
            typer.echo(_text(result))
    warn(f"{reading.file}: {sentence}" for sentence in result.attrs["warnings"])
    if not result.attrs["converged"]:
        raise typer.Exit(INCOMPLETE)


SHOWN = ("MAP", "CO", "PF", "heart_rate", "right_atrial_pressure", "PCWP", "drainage_pressure", "DO2")
ROWS = 25


def _text(result: xr.Dataset) -> str:
    """Some moments of the course as a table, and the balance of blood."""
    import json

    from eclsim.course.alarms import clock_time
    from eclsim.reporting.numbers import number, text_table

    def shown_time(minute: float) -> str:
        seconds = f":{int(60.0 * minute % 60.0):02d}" if result.attrs["beat_by_beat"] else ""
        return clock_time(minute) + seconds

    names = [name for name in SHOWN if name in result]
    count = result.sizes["time_min"]
    chosen = sorted({*range(0, count, -(-count // ROWS)), count - 1}) if count else []
    rows = [
        (shown_time(float(result["time_min"][k])), *(number(float(result[name][k])) for name in names))
        for k in chosen
    ]
    head = ("time", *(f"{name} [{result[name].attrs['units']}]" for name in names))
    balance = json.loads(result.attrs["balance"])
    words = (
        f"blood volume {balance['blood_volume_start_ml']:.0f} mL at the start, "
        f"{balance['blood_volume_end_ml']:.0f} mL at the end: given {balance['given_ml']:.0f}, removed "
        f"{balance['removed_ml']:.0f}, refilled {balance['refilled_ml']:.0f} mL"
    )
    took = f"{result.attrs['seconds']:.1f} s"
    if settling := result.attrs["settling_s"]:
        took += f"; the circulation settles within {settling:.0f} s after a sudden change"
    return "\n\n".join((text_table(head, rows, tuple(range(1, len(head)))), words, took))
