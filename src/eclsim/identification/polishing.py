"""The last bit of the way to an optimum: where an extreme passes a grid point, outputs have kinks.

Diastolic pressure is read off a beat on a fixed grid; its slope changes by a tenth and more where the moment
of the aortic valve's opening passes from one grid cell to the next. A method that follows slopes stops at
such a kink. A cloud of points around it, shaped by the curvature, shows whether there is a way on.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from eclsim.identification.least_squares import Refinement, Tolerances, refine
from eclsim.identification.objective import Box, LeastSquaresProblem

CLOUD = 63
"""Points of a cloud: a chunk of lanes."""
SIZES = (-4.0, -1.0)
"""Decimal logarithms of the smallest and largest cloud: share of its residuals by which a point moves."""
WORTH_WHILE = 1e-6
"""Share by which a cloud must lower the cost for another one."""
IDLE_CLOUDS = 6
"""So many clouds without a better point end the search."""
MOST_CLOUDS = 24
MOST_ITERATIONS = 80
"""Of all refinements between clouds taken together: some seconds."""
PERFECT = 1e-12
"""Sum of squares below which there is nothing left to gain."""


def polish(
    problem: LeastSquaresProblem,
    point: int,
    refined: Refinement,
    box: Box,
    tolerances: Tolerances,
    seed: int = 0,
    most_iterations: int = MOST_ITERATIONS,
) -> Refinement:
    """Go on from a settled optimum as long as a cloud around it holds a better point.

    Args:
        problem: data points.
        point: which of them.
        refined: one refinement of it.
        box: bounds.
        tolerances: of the refinements between clouds.
        seed: of the clouds.
        most_iterations: of the refinements between clouds, in total; 0 for no cloud at all.
    """
    generator, points = np.random.default_rng(seed), np.full(CLOUD, point)
    idle, most = 0, refined.iterations[0] + most_iterations
    for _ in range(MOST_CLOUDS):
        before = refined.costs[0]
        if not before > PERFECT or refined.iterations[0] >= most:
            break
        x = box.clip(refined.x + cloud(problem, point, refined, generator))
        costs = problem.evaluate(points, x, tolerances.orbits, tolerances.resolution).costs
        if costs.min() < before:
            better = refine(problem, points[:1], x[[costs.argmin()]], box, tolerances)
            iterations = refined.iterations + better.iterations
            refined = replace(better, iterations=iterations) if better.costs[0] < before else refined
        idle = idle + 1 if refined.costs[0] >= before * (1.0 - WORTH_WHILE) else 0
        if idle == IDLE_CLOUDS:
            break
    return refined


def cloud(
    problem: LeastSquaresProblem, point: int, refined: Refinement, generator: np.random.Generator
) -> np.ndarray:
    """Steps of many sizes, each as long in every direction as the residuals allow, (points, parameters)."""
    weighted = refined.jacobians[0] * problem.weights[point][:, None]
    if not np.isfinite(weighted).all():  # a beat without derivatives: all directions alike
        weighted = np.zeros_like(weighted)
    _, singular, directions = np.linalg.svd(weighted, full_matrices=True)
    slopes = np.zeros(len(directions))
    slopes[: len(singular)] = singular
    sizes = 10.0 ** generator.uniform(*SIZES, size=(CLOUD, 1)) * np.sqrt(refined.costs[0])
    lengths = sizes / np.maximum(slopes, 1e-300)
    return generator.standard_normal((CLOUD, len(directions))) * np.minimum(lengths, 0.3) @ directions
