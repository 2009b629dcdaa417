"""The draws of a posterior as a tree of labelled arrays, with the groups and names of ArviZ's schema."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from eclsim._version import __version__
from eclsim.identification.quantities import unit_of, unit_of_parameter

if TYPE_CHECKING:
    import xarray as xr

    from eclsim.identification.posterior import PosteriorResult

ARVIZ_NAMES = {
    "diverging": "diverging", "num_steps": "n_steps", "accept_prob": "acceptance_rate",
    "potential_energy": "lp", "energy": "energy", "step_size": "step_size",
    "jumped": "jumped", "saturated": "reached_max_treedepth",
}  # fmt: skip
"""The sampler's statistics and their names in ArviZ; `lp` is minus the potential, without constants."""


def draws_as_tree(result: PosteriorResult) -> xr.DataTree:
    """Draws, statistics of the sampler, predictions and measurements of a posterior, a group each."""
    import xarray as xr

    density, first = result.density, result.predictions[0]
    chains, draws, _ = result.samples.shape
    of_chains = {"chain": np.arange(chains), "draw": np.arange(draws)}
    of_predictions = {"chain": [0], "draw": np.arange(len(first.values))}
    pair, outputs = ("chain", "draw"), tuple(dict.fromkeys(n for p in result.predictions for n in p.outputs))
    attributes = {
        "inference_library": "eclsim", "inference_library_version": __version__,
        "sampler": result.settings.method, "prior": result.settings.prior, "trusted": int(result.trusted),
        "doubts": "; ".join(result.doubts), "warnings": "; ".join(first.warnings),
        "id": result.name, "blood_volume_policy": density.policy,
        "set_points": json.dumps(density.set_points),
    }  # fmt: skip

    def of_outputs(dims: tuple[str, ...], values: Mapping[str, Any]) -> dict[str, xr.Variable]:
        return {n: xr.Variable(dims, v, {"units": unit_of(n)}) for n, v in values.items()}

    random = np.random.default_rng(result.settings.sampling.seed)
    replicated = {  # what would be measured again: outputs of draws, with measurement noise
        n: (first.column(n) + density.errors[n] * random.standard_normal(len(first.values)))[None]
        for n in density.outputs
    }
    predicted = {n: np.stack([p.column(n) for p in result.predictions], axis=1)[None] for n in outputs}
    labels = {
        **of_predictions, "settings": [p.label for p in result.predictions],
        "doubts": ("settings", ["; ".join((*result.doubts, *p.doubts)) for p in result.predictions]),
    }  # fmt: skip
    groups: dict[str, tuple[dict[str, xr.Variable], Mapping[str, Any]]] = {
        "posterior": (
            {
                n: xr.Variable(pair, result.samples[:, :, k], {"units": unit_of_parameter(n)})
                for k, n in enumerate(result.names)
            },
            of_chains,
        ),
        "sample_stats": ({}, of_chains),
        "posterior_predictive": (of_outputs(pair, replicated), of_predictions),
        "predictions": (of_outputs((*pair, "settings"), predicted), labels),
        "observed_data": (of_outputs((), density.measured), {}),
        "constant_data": (of_outputs((), density.errors), {}),
    }
    if result.chains is None:
        del groups["sample_stats"]
    else:
        for numpyro_name, name in ARVIZ_NAMES.items():
            values = result.chains.statistics[numpyro_name]
            groups["sample_stats"][0][name] = xr.Variable(pair, -values if name == "lp" else values)
    return xr.DataTree.from_dict(
        {group: xr.Dataset(data, coords, attributes) for group, (data, coords) in groups.items()}
    )
