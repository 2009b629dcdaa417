"""The files of fits, posteriors and followed patients: JSON, tables, case files, NetCDF, figures, reports."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from eclsim.cases.fit_mark import DOUBTS
from eclsim.files import csv_text, file_stem, file_stems, write_json, write_netcdf, write_text, write_texts
from eclsim.identification import SUMMARY, TRACK_SUMMARY
from eclsim.identification.cohort import fitted_text, r_squared
from eclsim.identification.draws import write_samples
from eclsim.identification.objective import RISE_90
from eclsim.identification.profiles import slices
from eclsim.identification.quantities import unit_of, unit_of_parameter
from eclsim.identification.report import REPORT, differences_of, wider_interval
from eclsim.identification.track_report import doubts_of_first, doubts_of_point, track_page
from eclsim.identification.verdict import DOUBTFUL_DIFFERENCE, POOR_DIFFERENCE, Level

if TYPE_CHECKING:
    from eclsim.cases.cohort import CohortReading
    from eclsim.identification.fit import FitResult
    from eclsim.identification.posterior import PosteriorResult
    from eclsim.identification.profiles import FitProfiles

REFUSED = "refused"
"""Verdict in the table of verdicts on a row that could not be used."""
_QUANTILES = ("median", "lower", "upper")
_NONE: Mapping[str, str] = MappingProxyType({})


def fits_object(
    results: Sequence[Mapping[str, Any]], settings: Mapping[str, Any], reading: CohortReading | None = None
) -> dict[str, Any]:
    """Collect all data points, R2, refused rows and the settings of the fits as one object.

    Args:
        results: fits, as plain data.
        settings: settings of the fits, as plain data.
        reading: the table of the data points; None for a single case.
    """
    patients = {} if reading is None else {line: patient for patient, line in reading.refused_rows}
    return {
        "points": list(results),
        "r2": r_squared(results),
        "refused": [
            {"line": m.line, "patient_id": patients.get(m.line or 0, ""), "column": m.key, "message": str(m)}
            for m in (() if reading is None else reading.refused)
        ],
        "settings": dict(settings),
    }


def write_fits(folder: Path, content: Mapping[str, Any], refusals: Mapping[str, str] = _NONE) -> None:
    """Write identification.json, outputs.csv, parameters.csv and verdicts.csv.

    Args:
        folder: folder of the files, created if necessary.
        content: as returned by `fits_object`.
        refusals: rows that could not be used, such as "line 3 (P01)", with the reason.
    """
    folder.mkdir(parents=True, exist_ok=True)
    write_json(content, folder / SUMMARY)
    outputs = (
        "id", "output", "unit", "measured", "simulated", "lower", "upper", "determined",
        "standard_uncertainties_off", "status", "verdict",
    )  # fmt: skip
    keys = ("measured", "simulated", "lower", "upper", "determined")
    rows = [
        (p["id"], name, unit_of(name), *map(cell.get, keys), differences_of(p).get(name), p["status"],
         p["verdict"]["level"])
        for p in content["points"]
        for name, cell in p["outputs"].items()
    ]  # fmt: skip
    keys = ("at_bound", "identifiable", "reason")
    parameters = [
        (p["id"], name, unit_of_parameter(name), q["value"], *wider_interval(q), *(q[key] for key in keys),
         p["verdict"]["level"], q["lower"], q["upper"], *(q["profile"] or (None, None)))
        for p in content["points"]
        for name, q in p["parameters"].items()
    ]  # fmt: skip
    head = (
        "id", "parameter", "unit", "value", "lower", "upper", *keys, "verdict",
        "gaussian_lower", "gaussian_upper", "profile_lower", "profile_upper",
    )  # fmt: skip
    keys = ("level", "aspect", "about", "sentence")
    reasons = [
        (p["id"], p["verdict"]["level"], *(r[key] for key in keys))
        for p in content["points"]
        for r in p["verdict"]["reasons"] or [dict.fromkeys(keys, "")]
    ]
    reasons += [(row, REFUSED, "", "", "", why) for row, why in refusals.items()]
    write_texts(folder, {
        "outputs.csv": csv_text(outputs, rows), "parameters.csv": csv_text(head, parameters),
        "verdicts.csv": csv_text(("id", "verdict", *keys), reasons),
    })  # fmt: skip


def write_fitted_case(folder: Path, fit: FitResult) -> Path:
    """Write the fitted case file, with the verdict on the fit; every command accepts it."""
    path = folder / f"{file_stem(fit.name)}.toml"
    write_text(fitted_text(fit), path)
    return path


def write_fit_figures(folder: Path, fit: FitResult, profiled: FitProfiles | None) -> list[Path]:
    """Write slices, profiles, starts, residuals and correlation of one fit; None deletes earlier profiles.

    The patient's id, and the verdict unless it is good, stand above each figure.
    """
    from eclsim.identification import figures as plots
    from eclsim.reporting.style import plain_text, save_figures, write_above

    if not len(fit.optimum.starts.agreeing):
        return []
    along = slices(fit.objective, fit.box, fit.optimum.x, fit.number)
    figures = {
        "slices": plots.plot_slices(along),
        "starts": plots.plot_starts(fit.optimum.starts, fit.box.names, fit.box.lower, fit.box.upper),
        "residuals": plots.plot_residuals(
            fit.as_object()["outputs"],
            fit.uncertainties,
            {"doubtful": DOUBTFUL_DIFFERENCE, "poor": POOR_DIFFERENCE},
        ),
        "correlation": plots.plot_correlation(fit.box.names, fit.correlation),
    }
    if profiled is not None:
        figures["profiles"] = plots.plot_profiles(profiled.refitted, profiled.held, RISE_90)
    doubts = [fit.verdict.headline] if fit.verdict.level != Level.GOOD else []
    for figure in figures.values():
        write_above(figure, doubts, f"{plain_text(fit.name, 50)} – fit")
    if profiled is None:
        for earlier in folder.glob("profiles.*"):
            earlier.unlink()
        return save_figures(figures, folder)
    written = save_figures(figures, folder)
    table, refitted = folder / "profiles.csv", profiled.refitted
    rows = [
        (name, value, cost if np.isfinite(cost) else None)
        for name, values, costs in zip(refitted.names, refitted.values, refitted.costs, strict=True)
        for value, cost in zip(values.tolist(), costs.tolist(), strict=True)
    ]
    write_text(csv_text(("parameter", "value", "chi_square"), rows), table)
    return [*written, table]


def write_cohort_figures(folder: Path, content: Mapping[str, Any]) -> list[Path]:
    """Scatter and box plots of measured and simulated values."""
    from eclsim.identification.figures import plot_boxes, plot_scatter
    from eclsim.reporting.style import save_figures

    points = content["points"]
    return save_figures({"scatter": plot_scatter(points, content["r2"]), "boxes": plot_boxes(points)}, folder)


def write_posterior(folder: Path, result: PosteriorResult) -> list[Path]:
    """Write everything about a posterior into a folder and return the paths of the files.

    `arviz.from_netcdf` reads the NetCDF file; `eclsim crrt-study --posterior` takes the samples.
    """
    from eclsim.identification.figures import plot_pairs, plot_predictive, plot_traces
    from eclsim.reporting.style import save_figures

    folder.mkdir(parents=True, exist_ok=True)
    netcdf, samples, summary = (folder / f for f in ("posterior.nc", "samples.csv", "posterior.json"))
    groups = {node.path.strip("/"): node.to_dataset(inherit=False) for node in result.draws.subtree}
    write_netcdf(groups, netcdf)
    write_samples(result.names, result.flat, samples, result.doubts)
    write_json(result.as_object(), summary)
    figures = {"pairs": plot_pairs(result), "predictive": plot_predictive(result)}
    if result.chains is not None:
        figures["traces"] = plot_traces(result)
    return [netcdf, samples, summary, *save_figures(figures, folder / "figures")]


def write_tracks(folder: Path, content: Mapping[str, Any]) -> list[Path]:
    """Write track.json, report.html, parameters.csv, outputs.csv and figures; return the figures."""
    from eclsim.identification.track_figures import plot_outputs, plot_parameters
    from eclsim.reporting.style import plain_text, save_figure, write_above

    folder.mkdir(parents=True, exist_ok=True)
    write_json(content, folder / TRACK_SUMMARY)
    each = [(s["id"], p) for s in content["series"] for p in s["points"]]
    head = ("patient", "id", "parameter", "unit", *_QUANTILES, DOUBTS)
    rows = (
        (s, p["id"], n, unit_of_parameter(n), *(i[q] for q in _QUANTILES), doubts_of_point(p))
        for s, p in each
        for n, i in p["parameters"].items()
    )
    figures, drawings = [], {}
    stems = file_stems([series["id"] for series in content["series"]])
    for stem, series in zip(stems, content["series"], strict=True):
        for key, plot in (("parameters", plot_parameters), ("outputs", plot_outputs)):
            if not any(point[key] for point in series["points"]):
                continue
            figure = plot(series)
            write_above(figure, doubts_of_first(series), f"{plain_text(series['id'], 50)} – followed")
            saved = save_figure(figure, folder / "figures" / f"{stem}_{key}")
            figures += saved
            (svg,) = (path for path in saved if path.suffix == ".svg")
            drawings[series["id"], key] = svg.read_text(encoding="utf-8")
    write_texts(folder, {
        "parameters.csv": csv_text(head, rows), "outputs.csv": csv_text(_TRACKED_HEAD, _tracked_rows(each)),
        REPORT: track_page(content, drawings),
    })  # fmt: skip
    return figures


_TRACKED_HEAD = (
    "patient", "id", "output", "unit", "measured", "deviation", "unusual", "used", "met",
    *(f"forecast_{q}" for q in _QUANTILES), *(f"expected_{q}" for q in _QUANTILES), *_QUANTILES,
    DOUBTS,
)  # fmt: skip


def _tracked_rows(each: Iterable[tuple[str, Mapping[str, Any]]]) -> Iterable[Sequence[object]]:
    for patient, point in each:
        names = dict.fromkeys([*point["outputs"], *point["measurements"]])
        for name in names:
            measurement = point["measurements"].get(name, {})
            kinds = (point["forecast"], point["expected"], point["outputs"])
            quantiles = [kind.get(name, {}).get(q) for kind in kinds for q in _QUANTILES]
            columns = [measurement.get(k) for k in ("measured", "deviation", "unusual", "used", "met")]
            doubts = doubts_of_point(point, name)
            yield (patient, point["id"], name, unit_of(name), *columns, *quantiles, doubts)
