"""The table of results that the command line shows."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from eclsim.report.json import OUTPUTS

if TYPE_CHECKING:
    import xarray as xr

_FEW = 3
_SHORT = ("SP", "DP", "MAP", "MPAP", "PCWP", "CO", "PF")
_WIDTH_OF_PIPES = 120


def show(results: Sequence[xr.Dataset]) -> None:
    """Show the outputs on standard output: a column per case for a few, a row per case for many."""
    from rich.console import Console

    width = None if sys.stdout.isatty() else _WIDTH_OF_PIPES
    console = Console(width=width, highlight=False)
    console.print(_side_by_side(results) if len(results) <= _FEW else _one_row_each(results))


def _side_by_side(results: Sequence[xr.Dataset]) -> Any:
    from rich.table import Table
    from rich.text import Text

    table = Table(title="Steady beat", title_justify="left", box=None, pad_edge=False)
    table.add_column("output")
    table.add_column("")
    for result in results:
        table.add_column(Text(str(result.attrs["id"])), justify="right")
    table.add_column("unit")
    for name in OUTPUTS:
        holding = [result for result in results if name in result]
        if holding:
            about = holding[0][name].attrs
            cells = [_number(result, name) for result in results]
            table.add_row(name, about.get("long_name", ""), *cells, about.get("units", ""))
    table.add_row("", "converged", *(_verdict(result) for result in results), "")
    policies = [str(result.attrs["blood_volume_policy"]) for result in results]
    table.add_row("", "blood volume", *policies, "")
    if any("grid_error_percent" in result.attrs for result in results):
        table.add_row(
            "", "largest change on half the step", *(_grid_error(result) for result in results), "%"
        )
    return table


def _one_row_each(results: Sequence[xr.Dataset]) -> Any:
    from rich.table import Table
    from rich.text import Text

    table = Table(title="Steady beat", title_justify="left", box=None, pad_edge=False)
    table.add_column("id", max_width=30)
    for name in _SHORT:
        units = [result[name].attrs.get("units", "") for result in results if name in result]
        table.add_column(f"{name}\n{units[0] if units else ''}", justify="right")
    table.add_column("converged")
    for result in results:
        cells = [_number(result, name) for name in _SHORT]
        table.add_row(Text(str(result.attrs["id"])), *cells, _verdict(result))
    return table


def _verdict(result: xr.Dataset) -> str:
    beats = int(result.attrs["beats"])
    return f"yes, {beats} beats" if result.attrs["converged"] else "no"


def _grid_error(result: xr.Dataset) -> str:
    if "grid_error_percent" not in result.attrs:
        return "-"
    return f"{result.attrs['grid_error_percent']:.2f} ({result.attrs['grid_error_output']})"


def _number(result: xr.Dataset, name: str) -> str:
    if name not in result:
        return "-"
    value = float(result[name])
    if not math.isfinite(value):
        return "-"
    return f"{value:.2f}" if result[name].attrs.get("units") == "L/min" else f"{value:.1f}"
