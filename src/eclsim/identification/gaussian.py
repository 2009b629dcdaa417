"""The Gaussian approximation of a posterior: its highest point and the curvature there.

The highest point is found by Levenberg and Marquardt's method on the latent variables, whose prior adds a
residual for each. The curvature is that of Gauss and Newton: J' W J + I, with the exact Jacobian J.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eclsim.identification.beat_derivatives import GradientEvaluator
from eclsim.identification.density import PosteriorDensity

FARTHEST_START = 2.5
"""Starts beyond are drawn in: at a bound a latent variable is infinite and nothing has a slope."""
ITERATIONS = 40
ENOUGH = 1e-4
"""Settled when a step promises to lower the potential by less: a hundredth of a standard deviation."""
LARGEST_DAMPING = 1e8
LONGEST_STEP = 1.0


class NoSteadyBeatError(ValueError):
    """The model has no steady beat where the search for the highest point starts."""


@dataclass(frozen=True)
class Gaussian:
    """A normal distribution of the latent variables.

    Args:
        centre: highest point of the posterior, shape (parameters,).
        covariance: shape (parameters, parameters).
        outputs: of the model at the centre, shape (outputs,).
        jacobian: d output / dz there, shape (outputs, parameters).
        potential: there.
    """

    centre: np.ndarray
    covariance: np.ndarray
    outputs: np.ndarray
    jacobian: np.ndarray
    potential: float

    def draws(self, count: int, seed: int) -> np.ndarray:
        """Random latent variables, shape (count, parameters)."""
        normal = np.random.default_rng(seed).standard_normal((count, len(self.centre)))
        return self.centre + normal @ np.linalg.cholesky(self.covariance).T


def approximate(posterior: PosteriorDensity, starts: np.ndarray) -> Gaussian:
    """The best highest point that is reached from some starts, and the curvature there.

    Args:
        posterior: density.
        starts: logarithms of the parameters, shape (starts, parameters).

    Raises:
        NoSteadyBeatError: From no start.
    """
    found = [g for x in np.atleast_2d(starts) if (g := _climb(posterior, posterior.prior.z_of(x)))]
    if not found:
        raise NoSteadyBeatError(
            "no steady heartbeat at the fitted parameters: check heart rate, devices and fixed parameters"
        )
    return min(found, key=lambda g: g.potential)


def _climb(posterior: PosteriorDensity, start: np.ndarray) -> Gaussian | None:
    z = np.clip(start, -FARTHEST_START, FARTHEST_START)
    evaluator = GradientEvaluator(posterior, z)
    here = evaluator.linear(z)
    if here is None:
        return None
    damping, size = 1e-3, len(z)
    level = float(posterior.potential(z, here[0]))
    for _ in range(ITERATIONS):
        outputs, jacobian = here
        scaled = jacobian / posterior.scale[:, None]
        gradient = scaled.T @ ((outputs - posterior.target) / posterior.scale) + z
        curvature = scaled.T @ scaled + np.eye(size)
        if gradient @ np.linalg.solve(curvature, gradient) < 2.0 * ENOUGH or damping > LARGEST_DAMPING:
            break
        step = -np.linalg.solve(curvature + damping * np.diag(np.diag(curvature)), gradient)
        step *= min(1.0, LONGEST_STEP / np.abs(step).max())
        trial = evaluator.linear(z + step)
        lower = np.inf if trial is None else float(posterior.potential(z + step, trial[0]))
        if trial is not None and lower < level:
            z, here, level, damping = z + step, trial, lower, damping / 5.0
        else:
            damping = max(damping * 4.0, 1e-3)
    outputs, jacobian = here
    scaled = jacobian / posterior.scale[:, None]
    covariance = np.linalg.inv(scaled.T @ scaled + np.eye(size))
    return Gaussian(z, covariance, outputs, jacobian, level)
