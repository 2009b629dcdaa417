"""The files of a sweep: JSON, NetCDF, CSV and the figure."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from eclsim.files import frame_text, whole_file, write_text
from eclsim.simulation.files import case_object
from eclsim.simulation.sweep import Sweep, as_table

if TYPE_CHECKING:
    import pandas as pd


def sweep_object(sweep: Sweep) -> dict[str, Any]:
    """What was varied, and an object for each value, as `eclsim simulate` writes one for each case."""
    about = {"id": sweep.case_id, "key": sweep.key, "unit": sweep.unit, "values": list(sweep.values)}
    cases = [
        {**case_object(result), "swept": {sweep.key: value}}
        for value, result in zip(sweep.values, sweep.results, strict=True)
    ]
    failed = [case["swept"][sweep.key] for case in cases if not case["converged"]]
    return {"sweep": about | {"own_value": sweep.own, "failed": failed}, "cases": cases}


def write_json(sweep: Sweep, destination: Path | str) -> None:
    """Write the object to a file, or to standard output for "-"."""
    from eclsim import files

    files.write_json(sweep_object(sweep), destination)


def write_netcdf(sweep: Sweep, path: Path) -> None:
    """Write the outputs over the values; waveforms are not in it."""
    table = as_table(sweep)
    with whole_file(path, table.nbytes) as partial:
        table.to_netcdf(partial, engine="h5netcdf")


def write_csv(sweep: Sweep, path: Path) -> None:
    """Write a row for each value, outputs with units in the head; cells without a steady beat are empty."""
    path.parent.mkdir(exist_ok=True)
    write_text(frame_text(_frame(sweep)), path)


def write_figure(sweep: Sweep, path_without_suffix: Path) -> list[Path]:
    """Draw the outputs over the values, as SVG and PNG."""
    from eclsim.reporting.style import save_figure
    from eclsim.simulation.sweep_figures import plot_sweep

    return save_figure(plot_sweep(as_table(sweep)), path_without_suffix)


def _frame(sweep: Sweep) -> pd.DataFrame:
    import pandas as pd

    table = as_table(sweep)
    about = ("converged", "impossible", "status", "message", "warnings")
    names = [str(name) for name in table.data_vars if name not in about]
    head = {name: f"{name} [{unit}]" if (unit := table[name].attrs.get("units")) else name for name in names}
    first = f"{sweep.key} [{sweep.unit}]" if sweep.unit else sweep.key
    columns: dict[str, Any] = {first: table["value"].to_numpy()}
    columns |= {name: table[name].to_numpy() for name in about[:4]}
    columns |= {head[name]: table[name].to_numpy() for name in names}
    return pd.DataFrame(columns)
