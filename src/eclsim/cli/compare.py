"""`eclsim simulate --compare`: two steady beats side by side, and what the change is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from eclsim.cli.messages import fail, warn

if TYPE_CHECKING:
    import xarray as xr

    from eclsim.cases import CaseReading
    from eclsim.cli.destinations import Destinations

_HOW = "one case file with --set or --volume-policy (as in the file, and as set), or two case files"


def read(
    files: Sequence[str], settings: Sequence[str], policy: str | None = None
) -> tuple[list[CaseReading], list[str]]:
    """The two cases and what to call them; anything but two leaves with exit status 2."""
    from eclsim.cli.cases import read_all, read_each

    if len(files) == 1 and (settings or policy):
        (file,) = files
        readings = read_each([(file, (), None), (file, settings, policy)])
        for label, said in (("warning", "warnings"), ("note", "notes")):
            warn(dict.fromkeys(str(line) for reading in readings for line in getattr(reading, said)), label)
        before, after = readings
        named = [replace(before, file=f"{file}, before"), replace(after, file=f"{file}, after")]
        changed = [*settings, *([f"blood volume {policy}"] if policy else [])]
        return named, ["as in the file", ", ".join(changed)]
    if len(files) == 2:
        return read_all(files, settings, policy), list(files)
    fail(f"--compare: {len(files)} case file(s){' and no --set' if not settings else ''}; allowed: {_HOW}")


def change(results: Sequence[xr.Dataset]) -> dict[str, float]:
    """The second less the first of every output that both have; nothing unless both have converged."""
    before, after = results
    if not (before.attrs["converged"] and after.attrs["converged"]):
        return {}
    names = [str(name) for name, variable in before.data_vars.items() if variable.ndim == 0 and name in after]
    found = {name: float(after[name]) - float(before[name]) for name in names}
    return {name: value for name, value in found.items() if math.isfinite(value)}


def show(results: Sequence[xr.Dataset], labels: Sequence[str]) -> None:
    """What is before and what after, and the table with the change, on standard output."""
    import typer

    from eclsim.simulation import summary

    typer.echo(f"before: {labels[0]}\nafter:  {labels[1]}")
    summary.show(results, change(results))


def compared_object(results: Sequence[xr.Dataset], labels: Sequence[str]) -> dict[str, Any]:
    """Both cases as `eclsim simulate` writes them, and the change of every output."""
    from eclsim.simulation.json_object import results_object

    comparison = {"before": labels[0], "after": labels[1], "change": change(results)}
    return results_object(results) | {"compare": comparison}


def write(results: Sequence[xr.Dataset], labels: Sequence[str], planned: Destinations) -> None:
    """The JSON with the change, and the table of both."""
    from eclsim.files import write_json

    if planned.json is not None:
        write_json(compared_object(results, labels), planned.json)
    if planned.json != "-":
        show(results, labels)
