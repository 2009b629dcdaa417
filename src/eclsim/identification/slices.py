"""Slices through the objective: the cost when one parameter moves and the others stay (Figure S-2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eclsim.identification.objective import Box, Objective


@dataclass(frozen=True)
class Slices:
    """Costs along each parameter.

    Args:
        names: of the parameters.
        values: of each in its unit, from bound to bound, shape (parameters, steps).
        costs: sum of squared residuals; NaN where there is no steady beat, shape (parameters, steps).
        optimum: value of each parameter at the point that the slices go through.
        cost: there.
    """

    names: tuple[str, ...]
    values: np.ndarray
    costs: np.ndarray
    optimum: np.ndarray
    cost: float


def slices(objective: Objective, box: Box, x: np.ndarray, target: int = 0, steps: int = 41) -> Slices:
    """Move one parameter after the other from bound to bound.

    Args:
        objective: data points.
        box: bounds.
        x: logarithms of the parameters that the slices go through.
        target: which data point.
        steps: points of each slice.
    """
    size = len(box.names)
    shares = np.linspace(0.0, 1.0, steps)
    along = box.lower[:, None] + shares * (box.upper - box.lower)[:, None]
    points = np.tile(x, (size * steps + 1, 1))
    for k in range(size):
        points[k * steps : (k + 1) * steps, k] = along[k]
    costs = objective.evaluate(np.full(len(points), target), points).costs
    costs = np.where(np.isfinite(costs), costs, np.nan)
    return Slices(box.names, np.exp(along), costs[:-1].reshape(size, steps), np.exp(x), float(costs[-1]))
