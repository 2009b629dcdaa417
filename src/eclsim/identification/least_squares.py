"""Bounded nonlinear least squares for many starts side by side: Levenberg and Marquardt's method.

Damping follows Nielsen 1999 (Damping parameter in Marquardt's method, IMM-REP-1999-05). The parameter
that a step would carry over its bound first is put there, and the step of the others is computed again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np

from eclsim.identification.objective import Box, Evaluation, Objective

FIRST_DAMPING = 1e-3
LARGEST_DAMPING = 1e12
PROBED_DAMPING = (1e-9, 1e-6, 1e-4, 1e-2, 1.0)
"""Where no step of these shares of the largest curvature promises anything, the search has settled."""
LONGEST_STEP = 1.5
"""Largest change of a logarithm in one step: a factor of 4.5."""


class Ending(IntEnum):
    """Why a refinement ended."""

    SETTLED = 0
    OUT_OF_ITERATIONS = 1
    NO_STEADY_BEAT = 2


@dataclass(frozen=True)
class Precision:
    """When a refinement has settled.

    Args:
        cost: the next step promises to lower the cost by less than this share.
        floor: the cost is below this sum of squares.
        step: no logarithm of a parameter changes by more than this.
        iterations: at most so many steps are tried.
    """

    cost: float = 1e-4
    floor: float = 1e-9
    step: float = 1e-5
    iterations: int = 30


EXACT = Precision(1e-12, 1e-24, 1e-10, 60)
"""For the optimum itself."""


@dataclass(frozen=True)
class Refined:
    """Where refinements ended, shape (starts, ...).

    Args:
        x: logarithms of the parameters, shape (starts, parameters).
        outputs: of the model there, shape (starts, outputs).
        costs: sum of squared residuals; infinite where there is no steady beat.
        iterations: steps tried.
        endings: an `Ending` each.
        jacobians: d output / d log parameter, shape (starts, outputs, parameters).
    """

    x: np.ndarray
    outputs: np.ndarray
    costs: np.ndarray
    iterations: np.ndarray
    endings: np.ndarray
    jacobians: np.ndarray

    def take(self, chosen: np.ndarray) -> Refined:
        """Some of them."""
        return replace(self, **{name: value[chosen] for name, value in vars(self).items()})


def refine(
    objective: Objective, which: np.ndarray, starts: np.ndarray, box: Box, precision: Precision | None = None
) -> Refined:
    """Minimise from every start.

    Args:
        objective: data points.
        which: data point of each start, shape (starts,).
        starts: logarithms of the parameters, shape (starts, parameters).
        box: bounds.
        precision: when to stop.
    """
    return _Search(objective, np.asarray(which), box.clip(starts), box, precision or Precision()).run()


class _Search:
    def __init__(
        self, objective: Objective, which: np.ndarray, x: np.ndarray, box: Box, precision: Precision
    ):
        self.objective, self.which, self.box, self.precision = objective, which, box, precision
        self.x = x
        first = objective.evaluate(which, x)
        self.outputs, self.residuals, self.costs = first.outputs, first.residuals, first.costs.copy()
        self.jacobians = np.full((len(which), len(objective.outputs), x.shape[1]), np.nan)
        self.iterations = np.zeros(len(which), dtype=int)
        self.endings = np.where(np.isfinite(self.costs), Ending.OUT_OF_ITERATIONS, Ending.NO_STEADY_BEAT)
        self.differentiate(first, np.flatnonzero(np.isfinite(self.costs)), np.arange(len(which)))
        weighted = self.weighted(np.arange(len(which)))
        largest = np.max(np.sum(weighted**2, axis=1), axis=1)
        self.damping = FIRST_DAMPING * np.where(np.isfinite(largest), np.maximum(largest, 1e-12), 1.0)
        self.growth = np.full(len(which), 2.0)

    def run(self) -> Refined:
        active = np.flatnonzero(np.isfinite(self.costs))
        for _ in range(self.precision.iterations):
            active = self.unsettled(active)
            if not len(active):
                break
            self.iterations[active] += 1
            active = self.advance(active)
        self.unsettled(active)
        return Refined(self.x, self.outputs, self.costs, self.iterations, self.endings, self.jacobians)

    def weighted(self, members: np.ndarray) -> np.ndarray:
        """d residual / d log parameter."""
        return self.jacobians[members] * self.objective.weights[self.which[members]][:, :, None]

    def differentiate(self, evaluation: Evaluation, members: np.ndarray, places: np.ndarray) -> None:
        if len(members):
            where = places[members]
            self.jacobians[where] = self.objective.jacobians(evaluation, members.tolist(), self.x[where])

    def unsettled(self, active: np.ndarray) -> np.ndarray:
        """Those that some step still promises to improve; the others are marked as settled."""
        left = []
        for m, jacobian in zip(active, self.weighted(active), strict=True):
            largest = float(np.max(np.sum(jacobian**2, axis=0)))
            promised = max(
                bounded_step(jacobian, self.residuals[m], self.x[m], self.box, share * largest)[1]
                for share in PROBED_DAMPING
            )
            if promised <= self.precision.cost * self.costs[m] or self.costs[m] <= self.precision.floor:
                self.endings[m] = Ending.SETTLED
            else:
                left.append(m)
        return np.array(left, dtype=int)

    def advance(self, active: np.ndarray) -> np.ndarray:
        """One step of each; those whose steps have become too small are settled."""
        tried = [
            bounded_step(jacobian, self.residuals[m], self.x[m], self.box, float(self.damping[m]))
            for m, jacobian in zip(active, self.weighted(active), strict=True)
        ]
        steps, promised = np.stack([s for s, _ in tried]), np.array([p for _, p in tried])
        trial = self.objective.evaluate(self.which[active], self.x[active] + steps)
        gain = (self.costs[active] - trial.costs) / np.maximum(promised, 1e-300)
        better = (trial.costs < self.costs[active]) & (promised > 0.0)
        taken = active[better]
        self.x[taken] += steps[better]
        self.outputs[taken], self.residuals[taken] = trial.outputs[better], trial.residuals[better]
        self.costs[taken] = trial.costs[better]
        self.differentiate(trial, np.flatnonzero(better), active)
        shrink = np.maximum(1.0 / 3.0, 1.0 - (2.0 * np.minimum(gain[better], 2.0) - 1.0) ** 3)
        self.damping[taken] *= shrink
        self.growth[taken] = 2.0
        refused = active[~better]
        self.damping[refused] *= self.growth[refused]
        self.growth[refused] *= 2.0
        still = (np.abs(steps).max(axis=1) <= self.precision.step) | (self.damping[active] > LARGEST_DAMPING)
        self.endings[active[still]] = Ending.SETTLED
        return active[~still]


def bounded_step(
    jacobian: np.ndarray, residuals: np.ndarray, x: np.ndarray, box: Box, damping: float
) -> tuple[np.ndarray, float]:
    """A damped Gauss-Newton step inside the bounds and the decrease of the cost that it promises.

    Args:
        jacobian: d residual / d parameter, shape (residuals, parameters).
        residuals: shape (residuals,).
        x: shape (parameters,).
        box: bounds.
        damping: added to the diagonal of the normal equations.
    """
    gradient = jacobian.T @ residuals
    lower, upper = box.lower - x, box.upper - x
    free = ~((lower >= 0.0) & (gradient >= 0.0)) & ~((upper <= 0.0) & (gradient <= 0.0))
    step = np.zeros(len(x))
    for _ in range(len(x)):
        if not free.any():
            break
        columns = jacobian[:, free]
        stacked = np.vstack([columns, np.sqrt(damping) * np.eye(int(free.sum()))])
        right = np.r_[-(residuals + jacobian[:, ~free] @ step[~free]), np.zeros(int(free.sum()))]
        step[free] = np.linalg.lstsq(stacked, right, rcond=1e-14)[0]
        over = free & ((step < lower) | (step > upper))
        if not over.any():
            break
        room = np.where(step < lower, lower, upper) / np.where(over, step, 1.0)
        first = int(np.argmin(np.where(over, room, np.inf)))
        step[first] = np.clip(step[first], lower[first], upper[first])
        free[first] = False
    step = np.clip(step, lower, upper)
    step *= min(1.0, LONGEST_STEP / max(float(np.abs(step).max(initial=0.0)), 1e-300))
    after = residuals + jacobian @ step
    return step, float(residuals @ residuals - after @ after)
