"""The files of a posterior: NetCDF that ArviZ opens, samples for other commands, JSON, figures."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from eclsim._version import __version__
from eclsim.files import csv_text, whole_file, write_json, write_text
from eclsim.identification.posterior import PosteriorResult, as_object
from eclsim.parameters import thiel2025

if TYPE_CHECKING:
    import xarray as xr

SAMPLES = "samples.csv"
NETCDF = "posterior.nc"
JSON = "posterior.json"
FEWEST_LINES = 1000
STATISTICS = {
    "diverging": "diverging", "num_steps": "n_steps", "accept_prob": "acceptance_rate",
    "potential_energy": "lp", "energy": "energy", "step_size": "step_size",
    "jumped": "jumped", "saturated": "reached_max_treedepth",
}  # fmt: skip
"""The sampler's names and those of ArviZ; `lp` is minus the potential, without constants."""


def write_posterior(folder: Path, result: PosteriorResult) -> list[Path]:
    """Write everything about a posterior into a folder and return what was written."""
    folder.mkdir(parents=True, exist_ok=True)
    write_netcdf(result, folder / NETCDF)
    write_samples(result, folder / SAMPLES)
    write_json(as_object(result), folder / JSON)
    return [folder / NETCDF, folder / SAMPLES, folder / JSON, *write_figures(result, folder / "figures")]


def write_netcdf(result: PosteriorResult, path: Path) -> None:
    """Write draws, statistics of the sampler, predictions and measurements, a group each.

    `arviz.from_netcdf` reads it, in all its versions: the groups and names are those of its schema.
    """
    with whole_file(path) as partial:
        for k, (group, data) in enumerate(_groups(result)):
            data.to_netcdf(partial, mode="a" if k else "w", group=group, engine="h5netcdf")


def write_samples(result: PosteriorResult, path: Path) -> None:
    """Write draws of the parameters as a table, a column each; `eclsim crrt-study --posterior` takes it."""
    flat = result.flat
    kept = flat[:: max(1, len(flat) // FEWEST_LINES)]
    write_text(csv_text(result.names, kept.tolist()), path)


def write_figures(result: PosteriorResult, folder: Path) -> list[Path]:
    """Write pair and predictive plots, and traces where there are chains."""
    from eclsim.identification.posterior_figures import plot_pairs, plot_predictive, plot_traces
    from eclsim.reporting.style import save_figure

    figures = {"pairs": plot_pairs(result), "predictive": plot_predictive(result)}
    if result.chains is not None:
        figures["traces"] = plot_traces(result)
    return [path for name, figure in figures.items() for path in save_figure(figure, folder / name)]


def _groups(result: PosteriorResult) -> Iterator[tuple[str, xr.Dataset]]:
    import xarray as xr

    attributes = {
        "inference_library": "eclsim", "inference_library_version": __version__,
        "sampler": result.settings.method, "prior": result.settings.prior, "trusted": int(result.trusted),
        "doubts": "; ".join(result.doubts), "blood_volume_policy": result.posterior.policy,
    }  # fmt: skip
    chains, draws, _ = result.draws.shape
    both = {"chain": np.arange(chains), "draw": np.arange(draws)}
    parameters = {
        n: (("chain", "draw"), result.draws[:, :, k], {"units": thiel2025.PARAMETERS[n].unit})
        for k, n in enumerate(result.names)
    }
    yield "posterior", xr.Dataset(parameters, both, attributes)
    if result.chains is not None:
        found = result.chains.statistics
        statistics = {
            name: (("chain", "draw"), -found[own] if name == "lp" else found[own])
            for own, name in STATISTICS.items()
        }
        yield "sample_stats", xr.Dataset(statistics, both, attributes)
    yield "posterior_predictive", _replicated(result, attributes)
    yield "predictions", _predictions(result, attributes)
    names = result.posterior.outputs
    measured = {n: ((), result.posterior.measured[n], {"units": _unit(n)}) for n in names}
    yield "observed_data", xr.Dataset(measured, attrs=attributes)
    errors = {n: ((), result.posterior.errors[n], {"units": _unit(n)}) for n in names}
    yield "constant_data", xr.Dataset(errors, attrs=attributes)


def _replicated(result: PosteriorResult, attributes: dict[str, object]) -> xr.Dataset:
    """What would be measured again: outputs of draws, with measurement noise."""
    import xarray as xr

    first = result.predictions[0]
    random = np.random.default_rng(result.settings.sampling.seed)
    data = {}
    for name in result.posterior.outputs:
        values = first.values[:, first.outputs.index(name)]
        noise = result.posterior.errors[name] * random.standard_normal(len(values))
        data[name] = (("chain", "draw"), (values + noise)[None], {"units": _unit(name)})
    count = len(first.values)
    return xr.Dataset(data, {"chain": [0], "draw": np.arange(count)}, attributes)


def _predictions(result: PosteriorResult, attributes: dict[str, object]) -> xr.Dataset:
    """Outputs of draws at all settings, without noise."""
    import xarray as xr

    names = list(dict.fromkeys(n for p in result.predictions for n in p.outputs))
    count = len(result.predictions[0].values)
    data = {}
    for name in names:
        each = [
            p.values[:, p.outputs.index(name)] if name in p.outputs else np.full(count, np.nan)
            for p in result.predictions
        ]
        data[name] = (("chain", "draw", "settings"), np.stack(each, axis=1)[None], {"units": _unit(name)})
    labels = [p.settings or "as measured" for p in result.predictions]
    return xr.Dataset(data, {"chain": [0], "draw": np.arange(count), "settings": labels}, attributes)


def _unit(name: str) -> str:
    from eclsim.outputs.registry import output

    return output(name).unit
