"""The CRRT study as NetCDF: a group for each dataset, written in one go.

Written with h5py: hundreds of variables with shared dimensions take seconds through the usual writers, which
attach every dimension again whenever a group is added.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eclsim.files import whole_file

if TYPE_CHECKING:
    import xarray as xr

    from eclsim.crrt_study.study import CrrtStudy

MORE = (
    "patient_volume",
    "ecmo_volume",
    "crrt_volume",
    "patient_volume_change",
    "converged",
    "status",
    "beats",
)


def write_netcdf(study: CrrtStudy, path: Path) -> None:
    """Write NetCDF with the groups means, without_crrt, waveforms, limits and uptake.

    Of the means, pressures and the quantities of the JSON object are written.
    """
    groups = {
        "means": study.means[_written(study.means)],
        "without_crrt": study.without_crrt[_written(study.without_crrt)],
        "waveforms": study.waveforms,
        "limits": study.limits,
    } | ({} if study.uptake is None else {"uptake": study.uptake})
    with whole_file(path) as partial:
        write_groups(groups, partial)


def _written(data: xr.Dataset) -> list[str]:
    """Names of the variables of the means that go to NetCDF."""
    from eclsim.crrt_study.json_object import MEANS

    names = [str(name) for name in data.data_vars]
    return [n for n in names if n in (*MEANS, *MORE) or (n[0] == "P" and "Q" + n[1:] in names)]


def write_groups(groups: dict[str, xr.Dataset], path: Path) -> None:
    """Write datasets whose dimensions all have coordinates, a group each."""
    import h5py

    with h5py.File(path, "w", track_order=True) as file:
        for name, data in groups.items():
            group = file.create_group(name, track_order=True)
            group.attrs.update(_attributes(data.attrs))
            scales = {}
            for dimension in data.dims:
                scales[dimension] = _write(group, str(dimension), data[dimension])
                scales[dimension].make_scale(str(dimension))
            for key, variable in data.variables.items():
                if key not in scales:
                    _attach(_write(group, str(key), variable, _others(data, variable)), variable, scales)


def _others(data: xr.Dataset, variable: xr.Variable) -> str:
    """Names of the coordinates, besides those of the dimensions, that belong to a variable."""
    if any(variable is data.variables[name] for name in data.coords):
        return ""
    fitting = (str(c) for c in data.coords if c not in data.dims and set(data[c].dims) <= set(variable.dims))
    return " ".join(fitting)


def _write(group: Any, name: str, variable: Any, coordinates: str = "") -> Any:
    values, attributes = variable.values, dict(variable.attrs)
    if values.dtype == bool:
        values, attributes = values.astype("i1"), attributes | {"dtype": "bool"}
    if coordinates:
        attributes["coordinates"] = coordinates
    if values.dtype.kind in "UO":
        import h5py

        written = group.create_dataset(name, data=values.astype(object), dtype=h5py.string_dtype())
    else:
        written = group.create_dataset(name, data=values)
        if values.dtype.kind == "f":
            attributes["_FillValue"] = np.array([np.nan])
    written.attrs.update(_attributes(attributes))
    return written


def _attributes(found: dict[Any, Any]) -> dict[str, Any]:
    return {str(key): value for key, value in found.items() if value is not None}


def _attach(written: Any, variable: xr.Variable, scales: dict[Any, Any]) -> None:
    for axis, dimension in enumerate(variable.dims):
        written.dims[axis].attach_scale(scales[dimension])
