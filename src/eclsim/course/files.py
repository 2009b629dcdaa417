"""The files of a course: JSON, CSV, NetCDF and the figure."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eclsim.cases.fit_mark import DOUBTS, untrusted, with_doubts
from eclsim.course.drug import drug_record
from eclsim.course.result import TIME, impossible_moments, undetermined_moments
from eclsim.files import (
    PARTIAL,
    csv_text,
    file_stem,
    file_stems,
    finite,
    frame_text,
    write_json,
    write_netcdf,
    write_text,
)  # fmt: skip
from eclsim.goals.result import ALARM_KINDS
from eclsim.orbit.model import CASE
from eclsim.outputs.uncertainty import NOT_THE_MEASURED
from eclsim.simulation.files import column_head

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr

COURSES, GROUPS, SUMMARY, TABLE = "courses", "groups", "courses.json", "courses.csv"
"""In a cohort's folder: courses, results of tasks, and the results of all courses as JSON and table."""


def course_object(result: xr.Dataset) -> dict[str, Any]:
    """A course as plain data for JSON in the agreed format; null for missing outputs."""
    about, numeric = result.attrs, [str(n) for n, v in result.data_vars.items() if v.dtype.kind == "f"]
    states = [name for name in numeric if "definition" not in result[name].attrs]
    return {
        "id": str(about["id"]),
        CASE: json.loads(about[CASE]),
        "case_values": json.loads(about["case_values"]),
        "converged": bool(about["converged"]),
        "status": str(about["status"]),
        "message": str(about["message"]),
        "time_min": finite(result["time_min"].to_numpy()),
        "impossible": impossible_moments(result).tolist(),
        "one_of_many": undetermined_moments(result).tolist(),
        "outputs": {n: finite(result[n].to_numpy()) for n in numeric if n not in states},
        "slow_states": {n: finite(result[n].to_numpy()) for n in states},
        "units": {n: str(result[n].attrs.get("units", "")) for n in numeric},
        "balance": json.loads(about["balance"]),
        **({"drug": finite(drug)} if (drug := drug_record(result)) else {}),
        "events": json.loads(about["events"]),
        "alarms": finite(json.loads(about["alarms"])),
        "beat_by_beat": json.loads(about.get("spans", "[]")),
        "warnings": [str(sentence) for sentence in about["warnings"]],
        "blood_volume_policy": str(about["blood_volume_policy"]),
        "settling_s": finite(float(about["settling_s"])),
        "seconds": finite(float(about["seconds"])),
    }


def cohort_object(results: Sequence[xr.Dataset], refused: Mapping[str, str] | None = None) -> dict[str, Any]:
    """Courses of a cohort as plain data for JSON: the result of each, without its moments.

    `undetermined_from_min` is the first moment whose pressures the case does not determine, as valves stay
    shut; from there on no alarm can be raised. `impossible_from_min` is the first moment whose beat no
    patient can have, or that follows an arrest that is not survived. None if there is none.

    Args:
        results: courses.
        refused: rows of the table that were not followed, with the reason.
    """
    summary = (
        "id",
        "converged",
        "status",
        "message",
        "balance",
        "drug",
        "alarms",
        "warnings",
        "blood_volume_policy",
    )
    courses = [
        {key: value for key, value in course_object(course).items() if key in summary} for course in results
    ]
    for course, result in zip(courses, results, strict=True):
        minute = result[TIME].to_numpy()
        course["minutes"] = float(minute[-1]) if len(minute) else None
        course["undetermined_from_min"] = _first(minute[undetermined_moments(result)])
        course["impossible_from_min"] = _first(minute[impossible_moments(result)])
    failed = sum(not course["converged"] for course in courses)
    return {"courses": courses, "failed": failed, "refused": dict(refused or {})}


def _first(minutes: np.ndarray) -> float | None:
    return float(minutes[0]) if len(minutes) else None


def grave_alarms(course: Mapping[str, Any]) -> list[dict[str, Any]] | None:
    """Alarms and collapses of a course of `cohort_object`, without warnings; None if it did not begin."""
    if course["minutes"] is None:
        return None
    return [alarm for alarm in course["alarms"] if alarm["kind"] in ALARM_KINDS]


def course_stem(name: str) -> str:
    """Stem of the names of all files of a patient's course."""
    return f"{file_stem(name)}_course"


def course_stems(names: Sequence[str]) -> list[str]:
    """Stems for each patient of a cohort; names that would have the same stem get different ones."""
    return [f"{stem}_course" for stem in file_stems(names)]


def course_files(name: str) -> tuple[str, str]:
    """Names of the table and of the NetCDF file of a patient's course."""
    return f"{course_stem(name)}.csv", f"{course_stem(name)}.nc"


def write_tables(result: xr.Dataset, folder: Path, stem: str | None = None) -> list[Path]:
    """Write one row for each moment as CSV, with units in the header, and everything as NetCDF.

    Args:
        result: a course.
        folder: folder of the files, created if necessary.
        stem: stem of the file names; None takes that of the patient.
    """
    frame = result.to_dataframe().reset_index()
    frame.columns = [column_head(result, name) for name in frame.columns]
    frame = with_doubts(frame, result.attrs["warnings"])
    return _written(result, frame_text(frame), folder, stem)


def write_band_tables(band: xr.Dataset, folder: Path) -> list[Path]:
    """Write a band as CSV (one row for each output and moment), its alarms likewise, and all as NetCDF."""
    minutes, followed = band[TIME].to_numpy(), band["draws_followed"].to_numpy()
    said = "; ".join(untrusted(band.attrs["warnings"]))
    last, words = ((DOUBTS,), (said,)) if said else ((), ())
    quantiles = (f"{100.0 * q:g} %" for q in band["quantile"].values)
    head = ("time_min", "quantity", "unit", "draws", *quantiles, *last)
    rows = [
        (minute, name, band[name].attrs.get("units", ""), count, *column, *words)
        for name in map(str, band.data_vars)
        if "quantile" in band[name].dims
        for minute, count, column in zip(minutes, followed, band[name].to_numpy().T, strict=True)
    ]
    alarms = [
        (minute, str(label), share, *words)
        for label, shares in zip(band["alarm"].values, band["alarm_probability"].to_numpy(), strict=True)
        for minute, share in zip(minutes, shares, strict=True)
    ]
    written = _written(band, csv_text(head, rows), folder)
    table = written[0].with_name(written[0].name.replace(".csv", "_alarms.csv"))
    write_text(csv_text(("time_min", "alarm", "probability", *last), alarms), table)
    return [*written, table]


def _written(result: xr.Dataset, table: str, folder: Path, stem: str | None = None) -> list[Path]:
    """Write a table, and a result as NetCDF."""
    folder.mkdir(parents=True, exist_ok=True)
    stem = stem or course_stem(str(result.attrs["id"]))
    csv, netcdf = folder / f"{stem}.csv", folder / f"{stem}.nc"
    write_text(table, csv)
    write_netcdf({"": result}, netcdf)
    return [csv, netcdf]


def write_figure(result: xr.Dataset, folder: Path, stem: str | None = None) -> list[Path]:
    """Draw the timeline of a course or of a band with its events, as SVG and PNG."""
    from eclsim.course.figures import plot_course
    from eclsim.reporting.style import save_figure

    folder.mkdir(exist_ok=True)
    return save_figure(plot_course(result), folder / (stem or course_stem(str(result.attrs["id"]))))


def write_courses(
    results: Sequence[xr.Dataset], folder: Path, refused: Mapping[str, str] | None = None
) -> dict[str, Any]:
    """Write table and NetCDF file of each course of a cohort, and a summary, which is returned.

    Courses of an earlier cohort in the folder are removed, since they would be read as part of this one, and
    so are unfinished files. Only one process at a time may write to the folder.
    """
    content, places = cohort_object(results, refused), folder / COURSES
    stems = course_stems([str(course.attrs["id"]) for course in results])
    begun = [(stem, course) for stem, course in zip(stems, results, strict=True) if course.sizes[TIME]]
    kept = {stem for stem, _ in begun}
    for old in places.glob("*_course.*"):
        if old.suffix in (".csv", ".nc") and old.stem not in kept:
            old.unlink()
    for partial in places.glob(f"{PARTIAL}*"):  # of a process that was killed
        partial.unlink()
    for stem, course in begun:
        write_tables(course, places, stem)
    write_json(content, folder / SUMMARY)
    numbers = ("minutes", "alarms", "impossible_from_min", "MAP_lowest_mmHg")
    head = ("id", "status", *numbers, "message", "approximations")
    rows = []
    for course, result in zip(content["courses"], results, strict=True):
        lowest = float(result["MAP"].min()) if "MAP" in result else math.nan
        count = None if (grave := grave_alarms(course)) is None else len(grave)
        found = course["minutes"], count, course["impossible_from_min"], lowest
        said = course["message"], "; ".join(result.attrs["approximations"])
        others = [one for one in result.attrs["cautions"] if NOT_THE_MEASURED in one]
        doubts = "; ".join([*untrusted(result.attrs["warnings"]), *others])
        rows.append((course["id"], course["status"], *found, *said, doubts))
    unknown = (None,) * len(numbers)
    rows += [(name, "refused", *unknown, why, "", "") for name, why in content["refused"].items()]
    doubted = any(row[-1] for row in rows)
    text = csv_text((*head, DOUBTS), rows) if doubted else csv_text(head, (row[:-1] for row in rows))
    write_text(text, folder / TABLE)
    return content
