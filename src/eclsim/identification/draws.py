"""Draws of a posterior: labelled arrays with the groups and names of ArviZ's schema, and where they lie."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from eclsim._version import __version__
from eclsim.identification.density import Gaussian, Prior
from eclsim.identification.quantities import unit_of, unit_of_parameter
from eclsim.identification.verdict import SIDES, possible_limits

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


# --- remarks on where the draws lie ---------------------------------------------------------------

OUTERMOST_LATENT, PILED_UP_SHARE = 1.96, 0.2
"""|z| with 2.5 % of the prior beyond it, and share of draws there above which a bound limits a parameter."""
FURTHEST_FROM_FIT = 0.025
"""Largest distance of the nearest draw from a fitted value, as a share of the distance between the bounds."""


def piled_up(prior: Prior, z: np.ndarray) -> tuple[str, ...]:
    """Return a sentence for each parameter whose draws pile up at a bound, which then limits it.

    Args:
        prior: prior of the parameters.
        z: draws of the latent variables, shape (..., parameters).
    """
    ends = prior.scale.values(np.stack([prior.lower, prior.upper])).T.tolist()
    flat = z.reshape(-1, z.shape[-1])
    return tuple(
        f"{name}: {share:.0%} of the draws are in the last 2.5 % of its range, at the {side} "
        f"bound of {bound:.3g}: the bound limits it, not the measurements, and predictions depend on the "
        "bound; give wider --bounds if such a value is possible"
        for k, name in enumerate(prior.names)
        for side, sign, bound in zip(SIDES, (-1.0, 1.0), ends[k], strict=True)
        if (share := float(np.mean(sign * flat[:, k] > OUTERMOST_LATENT))) > PILED_UP_SHARE
        and bound not in possible_limits(name)
    )


def several_solutions(prior: Prior, z: np.ndarray, gaussian: Gaussian) -> tuple[str, ...]:
    """Return a sentence if the measurements have several solutions, with the share of the draws near each.

    Args:
        prior: prior of the parameters.
        z: draws of the latent variables, shape (..., parameters).
        gaussian: Gaussian approximations at all solutions.
    """
    if not gaussian.others:
        return ()
    centres = np.stack([each.centre for each in gaussian.solutions])
    spread = np.max([np.diag(each.covariance) for each in gaussian.solutions], axis=0)
    k = int(np.argmax(np.ptp(centres, axis=0) ** 2 / spread))
    nearest = gaussian.nearest(z.reshape(-1, z.shape[-1]))
    each = ", ".join(
        f"{prior.scale.value(k, x):.3g} ({np.mean(nearest == number):.0%} of the draws)"
        for number, x in enumerate(prior.x_of(centres)[:, k])
    )
    return (
        f"the measurements have {len(centres)} solutions, which differ most in {prior.names[k]}: {each}. "
        "Medians and intervals are those of all draws together, and values between the solutions may fit "
        "nothing: see the figure pairs; a further measurement, or narrower --bounds, may exclude one",
    )


def away_from_fit(prior: Prior, z: np.ndarray, fitted: np.ndarray) -> tuple[str, ...]:
    """Return a sentence for each parameter whose fitted value no draw is near.

    The measurements may then have a second solution, and the draws describe only one of the two.

    Args:
        prior: prior of the parameters.
        z: draws of the latent variables, shape (..., parameters).
        fitted: coordinates of the fitted values, shape (parameters,).
    """
    x = prior.x_of(z.reshape(-1, z.shape[-1]))
    nearest = x[np.abs(x - fitted).argmin(axis=0), np.arange(len(fitted))]
    far = np.abs(nearest - fitted) > FURTHEST_FROM_FIT * prior.width
    return tuple(
        f"{name}: no draw is near the fitted value of {prior.scale.value(k, fitted[k]):.3g} (the nearest has "
        f"{prior.scale.value(k, nearest[k]):.3g}): the draws describe other patients than the fit, as where "
        "the measurements have two solutions; see the profiles, and narrow --bounds to what is possible"
        for k, name in enumerate(prior.names)
        if far[k]
    )
