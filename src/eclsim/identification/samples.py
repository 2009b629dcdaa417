"""Samples of a patient's parameters as a table, written by a posterior and read by a CRRT study."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eclsim.cases.cohort import read_table
from eclsim.cases.fit_mark import DOUBTS, POSTERIOR
from eclsim.cases.quantities import quantity
from eclsim.devices.registry import parameters
from eclsim.files import csv_text, write_text
from eclsim.inputs.mistakes import CaseError
from eclsim.orbit.model import AS_PUBLISHED
from eclsim.spelling import spelling_hint

if TYPE_CHECKING:
    from eclsim.cases.case import Case

FREE_IN_CASES = ("total_blood_volume_ml", "heart_rate_bpm")
"""Quantities of a patient, besides the tabulated parameters, that may be uncertain."""
MOST_SAMPLES = 1000
MOST_MISTAKES = 20


class SamplesError(ValueError):
    """Raised for a file without valid samples; the message names every mistake."""


def write_samples(names: tuple[str, ...], draws: np.ndarray, path: Path, doubts: Sequence[str] = ()) -> None:
    """Write draws (draws, parameters) as a table with one column each, for `crrt-study --posterior`.

    A last column gives the reason if the draws cannot be trusted.
    """
    rows, remark = draws[:: max(1, len(draws) // MOST_SAMPLES)].tolist(), "; ".join(doubts)
    head = (*names, DOUBTS) if remark else names
    write_text(csv_text(head, ([*row, remark] for row in rows) if remark else rows), path)


def read_samples(path: str | Path) -> dict[str, list[float]]:
    """Read values by parameter, one per sample; of more than 1000 samples every n-th is used.

    Args:
        path: table with a header of parameter names and one row per sample, in the units of the parameter
            tables and separated by commas, semicolons or tabs; or the NetCDF file of a posterior,
            `posterior.nc`.

    Raises:
        SamplesError: The file has mistakes; the message names all of them.
    """
    head, rows, mistakes = _of_posterior(path) if Path(path).suffix == ".nc" else _of_table(path)
    if DOUBTS in head:
        words = head.index(DOUBTS)
        head, *cells = ([*row[:words], *row[words + 1 :]] for row in (head, *(cells for _, cells in rows)))
        rows = [(line, row) for (line, _), row in zip(rows, cells, strict=True)]
    mistakes += [
        f"{path}: column '{name[:40]}' is not a "
        f"parameter{spelling_hint(name, (*parameters(), *FREE_IN_CASES))}"
        for name in head
        if name not in FREE_IN_CASES and quantity(name) is None
    ]
    repeated = sorted({n for n in head if head.count(n) > 1})
    mistakes += [f"{path}: column {name} is there twice" for name in repeated]
    values = []
    for line, cells in rows:
        if len(cells) != len(head):
            mistakes.append(f"{path}:{line}: {len(cells)} values, the header has {len(head)}")
        values.append([_value(cell) for cell in cells])
        result = zip(head, cells, values[-1], strict=False)
        mistakes += [f"{path}:{line}: {wrong}" for each in result if (wrong := _mistake(*each))]
    if mistakes:
        more = len(mistakes) - MOST_MISTAKES
        raise SamplesError("; ".join(mistakes[:MOST_MISTAKES]) + (f"; and {more} more" if more > 0 else ""))
    thinned = values[:: math.ceil(len(values) / MOST_SAMPLES)]
    return {name: [row[k] for row in thinned] for k, name in enumerate(head)}


def doubts_of(path: str | Path, case: Case) -> tuple[str, ...]:
    """Doubts about a study with samples: those of the posterior, and whether they belong to this case.

    A table has doubts in a column of its own; for `samples.csv`, the `posterior.json` beside it is read, too.

    Args:
        path: file with samples that `read_samples` reads.
        case: case that the samples are used with.
    """
    about = _about(Path(path))
    doubts = list(filter(None, about["doubts"]))
    if not doubts and not about["trusted"]:
        doubts = ["nothing shows that its draws can be trusted"]
    name, policy, own = about["id"], about["blood_volume_policy"], case.blood_volume_policy or AS_PUBLISHED
    if name and name != case.patient.id and name.partition("/")[0] != case.patient.id.partition("/")[0]:
        doubts.append(f"its draws are those of patient '{name}', the case is that of '{case.patient.id}'")
    if policy and policy != own:
        doubts.append(f"its draws were fitted with the blood volume policy {policy}, the case has {own}")
    doubts += _doubts_about_reflexes(about["set_points"], case)
    return tuple(f"{POSTERIOR}{doubt}" for doubt in doubts)


def _doubts_about_reflexes(fitted: Mapping[str, float], case: Case) -> list[str]:
    """Doubts where draws were fitted with reflexes whose set points the case does not have."""
    if fitted and case.regulation is None:
        return ["its draws were fitted with reflexes, and the case has no [regulation]"]
    left_open = () if case.regulation is None else case.regulation.open_set_points
    return [
        f"its draws were fitted with {name} = {fitted[name]:g}, which the case leaves open, so that every "
        "draw would have one of its own: use the fitted case, or give it"
        for name in left_open
        if name in fitted
    ]


def _about(path: Path) -> dict[str, Any]:
    """Read the attributes of a posterior: id, volume policy, set points, doubts, whether it is trusted."""
    usual: dict[str, Any] = {
        "id": "", "blood_volume_policy": "", "set_points": {}, "doubts": (), "trusted": True,
    }  # fmt: skip
    if path.suffix == ".nc":
        import xarray as xr

        with xr.open_dataset(path, group="posterior", engine="h5netcdf") as draws:
            attributes = draws.attrs
        points = json.loads(attributes.get("set_points", "{}"))
        doubts = (attributes.get("doubts", ""),)
        return {**usual, "trusted": False, **attributes, "doubts": doubts, "set_points": points}
    if DOUBTS in (table := read_table(path)).header:
        column = table.header.index(DOUBTS)
        usual["doubts"] = tuple(dict.fromkeys(cells[column] for _, cells in table.rows))
    summary = path.with_name("posterior.json")
    if path.name != "samples.csv" or not summary.exists():
        return usual
    try:
        return {**usual, **json.loads(summary.read_text(encoding="utf-8"))}
    except (OSError, ValueError, TypeError):
        return {**usual, "doubts": (f"{summary}, which says whether they can be trusted, cannot be read",)}


_Rows = Sequence[tuple[int, Sequence[str]]]


def _of_table(path: str | Path) -> tuple[Sequence[str], _Rows, list[str]]:
    """Return header, rows with their line numbers, and mistakes of a table."""
    try:
        table = read_table(path)
    except CaseError as error:
        needed = "no samples; needed: a header of parameter names and a row for each sample"
        raise SamplesError(str(error).replace("no patients", needed)) from None
    return table.header, table.rows, [str(mistake) for mistake in table.mistakes]


def _of_posterior(path: str | Path) -> tuple[Sequence[str], _Rows, list[str]]:
    """Return names and draws of the group `posterior` of a NetCDF file, and mistakes."""
    import xarray as xr

    if not Path(path).exists():
        raise SamplesError(f"{path}: no such file")
    try:
        with xr.open_dataset(path, group="posterior", engine="h5netcdf") as draws:
            columns = {str(name): values.to_numpy().ravel().tolist() for name, values in draws.items()}
    except (OSError, ValueError, KeyError) as error:
        raise SamplesError(f"{path}: no posterior can be read: {str(error).splitlines()[0]}") from None
    rows = list(enumerate(zip(*(map(repr, column) for column in columns.values()), strict=True), start=1))
    if not rows:
        raise SamplesError(f"{path}: its group posterior holds no draws")
    return list(columns), rows, []


def _mistake(name: str, cell: str, value: float) -> str:
    """Describe what is wrong with a value; empty if nothing is."""
    known = quantity(name)
    if not (math.isfinite(value) and (value > 0.0 or (known is not None and known.is_linear))):
        comma = math.isfinite(_value(cell.replace(",", ".")))
        hint = f": '{cell}' has a decimal comma; write a decimal point" if "," in cell and comma else ""
        return f"{name} is not a number above 0{hint}"
    if known is not None and not known.accepts(value):
        return f"{name} = {value:g}: outside the allowed range; allowed: {known.allowed}"
    return ""


def _value(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return math.nan
