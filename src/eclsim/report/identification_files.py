"""The files of fits: JSON, tables, case files and figures."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eclsim.patients.writing import write_case
from eclsim.report.files import whole_file
from eclsim.report.plain_json import write_plain
from eclsim.studies.cohort_fit import named, r_squared, stem

if TYPE_CHECKING:
    from eclsim.patients.mistakes import Mistake
    from eclsim.studies.identification import Fit

SUMMARY = "identification.json"


def fits_object(
    results: Sequence[Mapping[str, Any]], settings: Mapping[str, Any], refused: Iterable[Mistake] = ()
) -> dict[str, Any]:
    """All data points, R2, rows that were refused, and what the fits were asked for."""
    return {
        "points": list(results),
        "r2": r_squared(results),
        "refused": [{"line": m.line, "column": m.key, "message": str(m)} for m in refused],
        "settings": dict(settings),
    }


def write_fits(folder: Path, content: Mapping[str, Any]) -> None:
    """Write identification.json, outputs.csv and parameters.csv."""
    folder.mkdir(parents=True, exist_ok=True)
    write_plain(content, folder / SUMMARY)
    outputs = [
        (p["id"], name, cell["measured"], cell["simulated"], p["status"])
        for p in content["points"]
        for name, cell in p["outputs"].items()
    ]
    _write(folder / "outputs.csv", ("id", "output", "measured", "simulated", "status"), outputs)
    keys = ("value", "lower", "upper", "at_bound", "identifiable", "reason")
    parameters = [
        (p["id"], name, *(q[key] for key in keys))
        for p in content["points"]
        for name, q in p["parameters"].items()
    ]
    _write(folder / "parameters.csv", ("id", "parameter", *keys), parameters)


def write_fitted_case(folder: Path, fit: Fit) -> Path:
    """Write the fitted case; every command takes it."""
    path = folder / f"{stem(fit.name)}.toml"
    write_case(fit.case if fit.name == fit.case.patient.id else named(fit.case, fit.name), path)
    return path


def write_fit_figures(folder: Path, fit: Fit) -> list[Path]:
    """Slices, profiles, convergence of the starts, residuals and correlation of one fit."""
    from eclsim.identification.profiles import profiles
    from eclsim.identification.slices import slices
    from eclsim.parameters import thiel2025
    from eclsim.plotting.fit_figures import plot_correlation, plot_profiles, plot_residuals
    from eclsim.plotting.identification_figures import plot_slices, plot_starts
    from eclsim.plotting.style import save_figure

    if not len(fit.optimum.starts.agreeing):
        return []
    units = {n: thiel2025.PARAMETERS[n].unit for n in fit.box.names}
    along = slices(fit.objective, fit.box, fit.optimum.x, fit.number)
    profiled = profiles(fit.objective, fit.box, fit.optimum.x, fit.number)
    figures = {
        "slices": plot_slices(along, units),
        "profiles": plot_profiles(profiled, along, units),
        "starts": plot_starts(fit.optimum.starts, fit.box.names, fit.box.lower, fit.box.upper),
        "residuals": plot_residuals(fit.as_object()["outputs"], fit.uncertainties),
        "correlation": plot_correlation(fit.box.names, fit.correlation),
    }
    written = [path for name, figure in figures.items() for path in save_figure(figure, folder / name)]
    table = folder / "profiles.csv"
    rows = [
        (name, value, cost if np.isfinite(cost) else None)
        for name, values, costs in zip(profiled.names, profiled.values, profiled.costs, strict=True)
        for value, cost in zip(values.tolist(), costs.tolist(), strict=True)
    ]
    _write(table, ("parameter", "value", "cost"), rows)
    return [*written, table]


def write_cohort_figures(folder: Path, content: Mapping[str, Any]) -> list[Path]:
    """Scatter and box plots of measured and simulated values."""
    from eclsim.plotting.identification_figures import plot_boxes, plot_scatter
    from eclsim.plotting.style import save_figure

    return [
        *save_figure(plot_scatter(content["points"], content["r2"]), folder / "scatter"),
        *save_figure(plot_boxes(content["points"]), folder / "boxes"),
    ]


def _write(path: Path, head: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    with whole_file(path) as partial, partial.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(head)
        writer.writerows(["" if cell is None else _cell(cell) for cell in row] for row in rows)


def _cell(value: object) -> object:
    """Numbers to eight digits; text that a spreadsheet would take for a formula behind an apostrophe."""
    if isinstance(value, float):
        return f"{value:.8g}"
    return f"'{value}" if isinstance(value, str) and value[:1] in "=+-@" else value
