"""Profile likelihood: the best cost that is left when one parameter is held and all others are fitted again.

Raue et al. 2009, doi 10.1093/bioinformatics/btp358. Where a slice through the objective moves one parameter
alone, a profile lets the others make up for it: a flat profile is a parameter that cannot be determined.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from eclsim.identification.least_squares import Precision, Refined, refine
from eclsim.identification.objective import Box, Objective
from eclsim.orbit.equation import OrbitOptions

REFITTING = Precision(1e-3, iterations=12, orbits=OrbitOptions(1e-6, 1e-5, newton_iterations=0))

ELSEWHERE = (0.15, 0.4, 0.65, 0.9)
"""Where a parameter is held to see whether the others follow: shares of the way between its bounds."""
APART = 0.15


@dataclass(frozen=True)
class Profiles:
    """Costs along each parameter, the others fitted again.

    Args:
        names: of the parameters.
        values: of each in its unit, rising, shape (parameters, steps).
        costs: sum of squared residuals; NaN where there is no steady beat, shape (parameters, steps).
        optimum: value of each parameter at the optimum.
        cost: there.
    """

    names: tuple[str, ...]
    values: np.ndarray
    costs: np.ndarray
    optimum: np.ndarray
    cost: float


def profiles(
    objective: Objective,
    box: Box,
    x: np.ndarray,
    target: int = 0,
    steps: int = 12,
    resolution: int = 1,
    near: np.ndarray | None = None,
) -> Profiles:
    """Hold one parameter after the other at values from bound to bound.

    Args:
        objective: data points.
        box: bounds.
        x: logarithms of the parameters at the optimum.
        target: which data point.
        steps: values of each parameter, besides the optimum's own.
        resolution: of the grid of the beats.
        near: further logarithms of each parameter, cut at its bounds, shape (parameters, further).
    """
    size = len(box.names)
    along = box.lower[:, None] + np.linspace(0.0, 1.0, steps) * (box.upper - box.lower)[:, None]
    if near is not None:
        along = np.column_stack([along, np.clip(near, box.lower[:, None], box.upper[:, None])])
    steps = along.shape[1]
    held = np.repeat(np.arange(size), steps)
    which = np.full(len(held), target)
    found = held_fits(objective, which, box, np.tile(x, (len(held), 1)), held, along.ravel(), resolution)
    own = objective.evaluate(which[:1], x[None], resolution=resolution).costs[0]
    costs = np.where(np.isfinite(found.costs), found.costs, np.nan).reshape(size, steps)
    values = np.column_stack([along, x])
    order = np.argsort(values, axis=1, kind="stable")
    costs = np.take_along_axis(np.column_stack([costs, np.full(size, own)]), order, axis=1)
    values = np.take_along_axis(values, order, axis=1)
    return Profiles(box.names, np.exp(values), costs, np.exp(x), float(own))


def held_fits(
    objective: Objective,
    which: np.ndarray,
    box: Box,
    x: np.ndarray,
    held: np.ndarray,
    values: np.ndarray,
    resolution: int,
) -> Refined:
    """Fit again with one parameter held at a value, shape (fits, ...).

    Args:
        objective: data points.
        which: data point of each fit, shape (fits,).
        box: bounds.
        x: logarithms of the parameters that the others start from, shape (fits, parameters).
        held: place of the parameter that each fit holds, -1 for none, shape (fits,).
        values: logarithm that it is held at, shape (fits,).
        resolution: of the grid of the beats.
    """
    mask = held[:, None] == np.arange(x.shape[1])
    starts = np.where(mask, values[:, None], x)
    return refine(objective, which, starts, box, replace(REFITTING, resolution=resolution), mask)


def elsewhere(x: np.ndarray, box: Box, chosen: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Parameters, and values to hold them at that are well away from where they are.

    Args:
        x: logarithms of the parameters, shape (parameters,).
        box: bounds.
        chosen: places of the parameters.
    """
    held, values = [], []
    for k in chosen:
        width = box.upper[k] - box.lower[k]
        for share in ELSEWHERE:
            if abs(box.lower[k] + share * width - x[k]) >= APART * width:
                held.append(k)
                values.append(box.lower[k] + share * width)
    return np.array(held, dtype=int), np.array(values)
