"""The files of a course: JSON, CSV, NetCDF and the figure."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eclsim.files import file_stem, finite, frame_text, whole_file, write_text

if TYPE_CHECKING:
    import xarray as xr


def course_object(result: xr.Dataset) -> dict[str, Any]:
    """A course as plain data for JSON, in the form of the contract; null where an output is none."""
    about, numeric = result.attrs, [str(n) for n, v in result.data_vars.items() if v.dtype.kind == "f"]
    states = [name for name in numeric if "definition" not in result[name].attrs]
    return {
        "id": str(about["id"]),
        "converged": bool(about["converged"]),
        "status": str(about["status"]),
        "message": str(about["message"]),
        "time_min": finite(result["time_min"].to_numpy()),
        "outputs": {n: finite(result[n].to_numpy()) for n in numeric if n not in states},
        "slow_states": {n: finite(result[n].to_numpy()) for n in states},
        "units": {n: str(result[n].attrs.get("units", "")) for n in numeric},
        "balance": json.loads(about["balance"]),
        "events": json.loads(about["events"]),
        "alarms": finite(json.loads(about["alarms"])),
        "warnings": [str(sentence) for sentence in about["warnings"]],
        "blood_volume_policy": str(about["blood_volume_policy"]),
        "settling_s": finite(float(about["settling_s"])),
        "seconds": finite(float(about["seconds"])),
    }


def course_stem(name: str) -> str:
    """Beginning of the names of all files of a patient's course."""
    return f"{file_stem(name)}_course"


def course_files(name: str) -> tuple[str, str]:
    """Names of the table and of the NetCDF file of a patient's course."""
    return f"{course_stem(name)}.csv", f"{course_stem(name)}.nc"


def write_tables(result: xr.Dataset, folder: Path) -> list[Path]:
    """Write a row for each moment as CSV, units in the head, and everything as NetCDF."""
    folder.mkdir(exist_ok=True)
    table, netcdf = (folder / name for name in course_files(str(result.attrs["id"])))
    frame = result.to_dataframe().reset_index()
    units = {str(n): result[n].attrs.get("units", "") for n in (*result.coords, *result.data_vars)}
    frame.columns = [f"{name} [{units[name]}]" if units.get(name) else name for name in frame.columns]
    write_text(frame_text(frame), table)
    lists = {name: "\n".join(value) for name, value in result.attrs.items() if isinstance(value, list)}
    stored = result.assign_attrs(lists)
    with whole_file(netcdf, stored.nbytes) as partial:
        stored.to_netcdf(partial, engine="h5netcdf")
    return [table, netcdf]


def write_figure(result: xr.Dataset, folder: Path) -> list[Path]:
    """Draw the timeline with its events, as SVG and PNG."""
    from eclsim.course.figures import plot_course
    from eclsim.reporting.style import save_figure

    folder.mkdir(exist_ok=True)
    return save_figure(plot_course(result), folder / course_stem(str(result.attrs["id"])))
