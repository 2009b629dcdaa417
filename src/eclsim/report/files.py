"""Writing results: NetCDF, CSV, figures and JSON. A file appears whole under its name or not at all."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from eclsim.patients import Case

_FILE_MODE = 0o644


def write_json(results: Sequence[xr.Dataset], destination: Path | str) -> None:
    """Write all cases as one JSON object to a file, or to standard output for "-"."""
    import json

    from eclsim.report.json import results_object

    text = json.dumps(results_object(results), indent=1, allow_nan=False) + "\n"
    if destination == "-":
        sys.stdout.write(text)
        sys.stdout.flush()
        return
    with whole_file(Path(destination)) as partial:
        partial.write_text(text, encoding="utf-8")


def write_netcdf(
    results: Sequence[xr.Dataset], courses: Sequence[xr.Dataset], path: Path, names: Sequence[str] | None
) -> None:
    """Write NetCDF: one case at the root, several as groups case1, case2 ...; courses in "transient"."""
    with whole_file(path) as partial:
        for index, result in enumerate(results):
            group = f"case{index + 1}" if len(results) > 1 else None
            mode = "w" if index == 0 else "a"
            _storable(_selected(result, names)).to_netcdf(partial, mode=mode, group=group, engine="h5netcdf")
            if courses:
                below = f"{group}/transient" if group else "transient"
                course = _storable(_selected(courses[index], names))
                course.to_netcdf(partial, mode="a", group=below, engine="h5netcdf")


def write_csv(
    results: Sequence[xr.Dataset],
    courses: Sequence[xr.Dataset],
    folder: Path,
    stems: Sequence[str],
    names: Sequence[str] | None,
) -> None:
    """Write outputs.csv, a row per case, and the waveforms and courses of each case; units in the head."""
    folder.mkdir(exist_ok=True)
    for index, (result, stem) in enumerate(zip(results, stems, strict=True)):
        _write_table(_waveform_table(_selected(result, names), "phase"), folder / f"{stem}_waveforms.csv")
        if courses:
            table = _waveform_table(_selected(courses[index], names), "time")
            _write_table(table, folder / f"{stem}_transient.csv")
    _write_table(_output_table(results), folder / "outputs.csv")


def write_figures(
    cases: Sequence[Case], results: Sequence[xr.Dataset], folder: Path, stems: Sequence[str]
) -> None:
    """Write all figures of each case; their names begin with the case's stem."""
    from eclsim.plotting.figures import file_name, write_case_figures
    from eclsim.solver.model import model_of

    folder.mkdir(exist_ok=True)
    for case, result, stem in zip(cases, results, stems, strict=True):
        own_stem = file_name(str(result.attrs["id"]))
        with tempfile.TemporaryDirectory(prefix=".eclsim-", dir=folder) as scratch:
            for path in write_case_figures(model_of(case).circuit, result, scratch):
                path.replace(folder / (stem + path.name.removeprefix(own_stem)))


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A temporary file beside the target that takes its name when everything is written."""
    handle, name = tempfile.mkstemp(prefix=".eclsim-", suffix=path.suffix, dir=path.parent)
    os.close(handle)
    partial = Path(name)
    try:
        yield partial
        partial.chmod(_FILE_MODE)
        partial.replace(path)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise


def _selected(result: xr.Dataset, names: Sequence[str] | None) -> xr.Dataset:
    """All scalars, and of the waveforms those asked for."""
    if names is None:
        return result
    kept = [name for name, variable in result.data_vars.items() if variable.ndim == 0 or name in names]
    return result[kept]


def _storable(result: xr.Dataset) -> xr.Dataset:
    """The same with lists of sentences as text, a line each: NetCDF holds no empty list."""
    lists = {name: "\n".join(value) for name, value in result.attrs.items() if isinstance(value, list)}
    return result.assign_attrs(lists)


def _headed(result: xr.Dataset, name: str) -> str:
    unit = result[name].attrs.get("units", "")
    return f"{name} [{unit}]" if unit else name


def _waveform_table(result: xr.Dataset, dimension: str) -> pd.DataFrame:
    import pandas as pd

    variables = (*result.coords, *result.data_vars)
    names = [str(name) for name in variables if result[name].dims == (dimension,)]
    return pd.DataFrame({_headed(result, name): result[name].to_numpy() for name in names})


def _output_table(results: Sequence[xr.Dataset]) -> pd.DataFrame:
    import pandas as pd

    about = ("id", "converged", "beats", "residual", "blood_volume_policy")
    rows = []
    for result in results:
        row = {name: result.attrs.get(name) for name in about}
        scalars = [str(name) for name, variable in result.data_vars.items() if variable.ndim == 0]
        rows.append(row | {_headed(result, name): result[name].item() for name in scalars})
    return pd.DataFrame(rows)


def _write_table(table: pd.DataFrame, path: Path) -> None:
    with whole_file(path) as partial:
        table.to_csv(partial, index=False, lineterminator="\n")
