"""Write results as JSON for other programs, NetCDF, CSV and figures."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from eclsim import files
from eclsim.cases import Case
from eclsim.cases.fit_mark import untrusted, with_doubts
from eclsim.files import finite, frame_text, write_text
from eclsim.orbit.model import CASE, circuit_of
from eclsim.outputs.results import scalars_of
from eclsim.reporting.beat_values import COMPARED, SIDES
from eclsim.simulation.target_flow import solved_speed_of

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


OUTPUTS = (
    "SP", "DP", "MAP", "MPAP", "PCWP", "CO", "PF", "SPAP", "DPAP",
    "EDVLV", "ESVLV", "EDVRV", "ESVRV", "EDVLA", "ESVLA", "EDVRA", "ESVRA",
)  # fmt: skip
"""The outputs of the agreed file format, in its order; PF only with an ECMO circuit."""
COMPARISON = "comparison_pressure_volume"
"""Stem of the figure that shows two compared cases in one."""


def write_json(results: Sequence[xr.Dataset], destination: Path | str) -> None:
    """Write all cases as one JSON object to a file, or to standard output for "-"."""
    files.write_json(results_object(results), destination)


def write_netcdf(
    results: Sequence[xr.Dataset],
    courses: Sequence[xr.Dataset | None],
    path: Path,
    names: Sequence[str] | None,
) -> None:
    """Write NetCDF: one case at the root, several as groups case1, case2 ...; courses in "transient"."""
    groups = {}
    for index, result in enumerate(results):
        group = f"case{index + 1}" if len(results) > 1 else ""
        groups[group] = _selected(result, names)
        course = courses[index] if courses else None
        if course is not None:
            groups[f"{group}/transient" if group else "transient"] = _selected(course, names)
    files.write_netcdf(groups, path)


def write_csv(
    results: Sequence[xr.Dataset],
    courses: Sequence[xr.Dataset | None],
    folder: Path,
    stems: Sequence[str],
    names: Sequence[str] | None,
) -> None:
    """Write outputs.csv with one row per case, and waveforms and courses of each case, with units."""
    folder.mkdir(exist_ok=True)
    for index, (result, stem) in enumerate(zip(results, stems, strict=True)):
        if "phase" not in result.dims:  # no beat, so no waveforms; outputs.csv has its row
            continue
        table = _waveform_table(_selected(result, names), "phase")
        write_text(frame_text(table), folder / f"{stem}_waveforms.csv")
        course = courses[index] if courses else None
        if course is not None:
            table = _waveform_table(_selected(course, names), "time")
            write_text(frame_text(table), folder / f"{stem}_transient.csv")
    write_text(frame_text(_output_table(results)), folder / "outputs.csv")


def write_figures(
    cases: Sequence[Case], results: Sequence[xr.Dataset], folder: Path, stems: Sequence[str]
) -> None:
    """Write all figures of each case; their names begin with the stem of the case."""
    from eclsim.simulation.figures import write_case_figures

    folder.mkdir(exist_ok=True)
    for case, result, stem in zip(cases, results, stems, strict=True):
        if "phase" not in result.dims:
            continue
        write_case_figures(circuit_of(case), result, folder, stem=stem)


def write_comparison(results: Sequence[xr.Dataset], labels: Sequence[str], folder: Path) -> None:
    """Write one figure of the pressure-volume loops before and after a change; none if a beat is missing."""
    from eclsim.reporting.style import save_figure
    from eclsim.simulation.figures import plot_pressure_volume

    if all("phase" in result.dims for result in results):
        named = [f"{which}: {label}" for which, label in zip(SIDES, labels, strict=True)]
        doubts = list(dict.fromkeys(s for r in results for s in untrusted(r.attrs.get("warnings", ()))))
        save_figure(plot_pressure_volume(results, named, atria=True), folder / COMPARISON, above=doubts)


def _selected(result: xr.Dataset, names: Sequence[str] | None) -> xr.Dataset:
    """Return all scalars and the requested waveforms."""
    if names is None:
        return result
    chosen = {*scalars_of(result), *names}
    return result[[name for name in result.data_vars if name in chosen]]


def column_head(result: xr.Dataset, name: str) -> str:
    """Head of a column of a table: the name with its unit, if it has one."""
    unit = result[name].attrs.get("units", "")
    return f"{name} [{unit}]" if unit else name


def _waveform_table(result: xr.Dataset, dimension: str) -> pd.DataFrame:
    import pandas as pd

    variables = (*result.coords, *result.data_vars)
    names = [str(name) for name in variables if result[name].dims == (dimension,)]
    table = pd.DataFrame({column_head(result, name): result[name].to_numpy() for name in names})
    return with_doubts(table, result.attrs.get("warnings", ()))


def _output_table(results: Sequence[xr.Dataset]) -> pd.DataFrame:
    import pandas as pd

    about = ("converged", "status", "message", "beats", "residual", "blood_volume_policy")
    rows = []
    for result in results:
        row = {name: result.attrs[name] for name in ("id", COMPARED) if name in result.attrs}
        row |= {name: result.attrs.get(name) for name in about}
        row |= {"gas_status": status} if (status := result.attrs.get("gas_status")) else {}
        row["impossible"] = int(result.attrs.get("impossible", 0))
        row["warnings"] = "; ".join(result.attrs.get("warnings", ()))
        rows.append(row | {column_head(result, name): result[name].item() for name in scalars_of(result)})
    return pd.DataFrame(rows)


def results_object(results: Iterable[xr.Dataset]) -> dict[str, object]:
    """All cases as one object, in order; values that are not finite are left out."""
    return {"cases": [case_object(result) for result in results]}


def case_object(result: xr.Dataset) -> dict[str, object]:
    """One case: outputs in mmHg, L/min and mL, waveforms as mean, min and max over the beat."""
    scalars = scalars_of(result)
    further = [name for name in scalars if name not in OUTPUTS]
    return {
        "id": str(result.attrs["id"]),
        **({CASE: json.loads(result.attrs[CASE])} if CASE in result.attrs else {}),
        "converged": bool(result.attrs["converged"]),
        "beats": int(result.attrs["beats"]),
        "residual": finite(result.attrs["residual"]),
        "blood_volume_policy": str(result.attrs["blood_volume_policy"]),
        "status": _plain(result.attrs.get("status", "")),
        "message": str(result.attrs.get("message", "")),
        **{n: finite(result.attrs[n]) for n in ("gas_status", "grid_error_percent") if n in result.attrs},
        **_solved(result),
        "impossible": bool(result.attrs.get("impossible", 0)),
        "one_of_many": bool(result.attrs.get("one_of_many", 0)),
        "warnings": [str(sentence) for sentence in result.attrs.get("warnings", ())],
        "outputs": _numbers(result, [name for name in OUTPUTS if name in scalars]),
        "more_outputs": _numbers(result, further),
        "waveforms": {
            str(name): numbers for name in result.data_vars if (numbers := _statistics(result, str(name)))
        },
    }


def _solved(result: xr.Dataset) -> dict[str, object]:
    """Values that were solved for, under the keys of a case file."""
    solved = solved_speed_of(result)
    if solved is None:
        return {}
    return {"target": {solved.flow_key: solved.flow}, "solved": {solved.speed_key: solved.speed_rpm}}


def _statistics(result: xr.Dataset, name: str) -> dict[str, float] | None:
    """Mean, smallest and largest value of a waveform; None if it does not exist or is not finite."""
    variable = result[name]
    if variable.dims != ("phase",):
        return None
    statistics = {"mean": "mean", "min": "minimum", "max": "maximum"}
    values = {key: float(variable.attrs[attribute]) for key, attribute in statistics.items()}
    return values if np.all(np.isfinite(list(values.values()))) else None


def _numbers(result: xr.Dataset, names: Sequence[str]) -> dict[str, float]:
    values = {name: result[name].item() for name in names}
    return {name: float(v) for name, v in values.items() if isinstance(v, int | float) and np.isfinite(v)}


def _plain(value: object) -> str | int:
    return int(value) if isinstance(value, (int, np.integer)) else str(value)
