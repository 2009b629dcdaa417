"""Remarks on where the draws of a posterior lie: at a bound, or away from the fit they were made for."""

from __future__ import annotations

import numpy as np

from eclsim.identification.density import Gaussian, Prior
from eclsim.identification.verdict import SIDES, possible_limits

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
