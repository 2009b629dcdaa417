"""Bounded nonlinear least squares for many starts side by side: Levenberg and Marquardt's method.

Simulations cost a tenth when many run side by side, so each iteration tries a ladder of dampings at once, and
then the same ladder again with what the first has shown of the residuals' curvature (the second-order
correction of the geodesic acceleration, Transtrum and Sethna 2012, arXiv:1201.5885, probed with the whole
step): the valleys of this problem are flat and curved. The parameter that a step would carry over its bound
first is put there, and the step of the others is computed again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from eclsim.identification.objective import Box, Evaluation, Objective
from eclsim.identification.outcome import Ending
from eclsim.orbit.equation import OrbitOptions

FIRST_DAMPING = 1e-3
"""As a share of the largest curvature, as all dampings."""
SMALLEST_DAMPING = 1e-11
LARGEST_DAMPING = 1e6
LADDER = 10.0 ** np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
"""Dampings that are tried at once, as multiples of the one that was best before."""
NEXT_LADDER = 1e4
"""Factor of the damping if none of a ladder was good."""
LONGEST_STEP = 1.5
"""Largest change of a logarithm in one step: a factor of 4.5."""


@dataclass(frozen=True)
class Precision:
    """When a refinement has settled.

    Args:
        cost: an iteration lowers the cost by less than this share, whatever the damping.
        floor: the cost is below this sum of squares.
        step: no logarithm of a parameter changes by more than this.
        iterations: at most so many.
        orbits: accuracy of the steady beats.
        resolution: of the grid of all beats; None for what each needs.
    """

    cost: float = 1e-3
    floor: float = 1e-9
    step: float = 1e-4
    iterations: int = 30
    orbits: OrbitOptions | None = None
    resolution: int | None = None


EXACT = Precision(1e-8, 1e-14, 1e-10, 60, OrbitOptions(newton_iterations=3))
"""For the optimum itself."""


@dataclass(frozen=True)
class Refined:
    """Where refinements ended, shape (starts, ...).

    Args:
        x: logarithms of the parameters, shape (starts, parameters).
        outputs: of the model there, shape (starts, outputs).
        costs: sum of squared residuals; infinite where there is no steady beat.
        iterations: until the end.
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
    objective: Objective,
    which: np.ndarray,
    starts: np.ndarray,
    box: Box,
    precision: Precision | None = None,
    held: np.ndarray | None = None,
) -> Refined:
    """Minimise from every start.

    Args:
        objective: data points.
        which: data point of each start, shape (starts,).
        starts: logarithms of the parameters, shape (starts, parameters).
        box: bounds.
        precision: when to stop.
        held: parameters that a start keeps, shape (starts, parameters); left out, none.
    """
    search = _Search(objective, np.asarray(which), box.clip(starts), box, precision or Precision(), held)
    return search.run()


@dataclass(frozen=True)
class _Tried:
    """Steps of some starts: whose, damping, step, and what came of it, shape (tried, ...)."""

    rows: np.ndarray
    dampings: np.ndarray
    steps: np.ndarray
    found: Evaluation


class _Search:
    def __init__(
        self,
        objective: Objective,
        which: np.ndarray,
        x: np.ndarray,
        box: Box,
        precision: Precision,
        held: np.ndarray | None,
    ):
        self.objective, self.which, self.box, self.precision = objective, which, box, precision
        self.x = x
        self.moves = np.ones(x.shape) if held is None else np.where(held, 0.0, 1.0)
        self.near = np.full(len(which), None, dtype=object)
        first = self.evaluate(np.arange(len(which)), x)
        self.outputs, self.residuals, self.costs = first.outputs, first.residuals, first.costs.copy()
        self.jacobians = np.full((len(which), len(objective.outputs), x.shape[1]), np.nan)
        self.iterations = np.zeros(len(which), dtype=int)
        self.endings = np.where(np.isfinite(self.costs), Ending.OUT_OF_ITERATIONS, Ending.NO_STEADY_BEAT)
        self.damping = np.full(len(which), FIRST_DAMPING)
        alive = np.flatnonzero(np.isfinite(self.costs))
        self.differentiate(first, alive, alive)
        without = alive[~np.isfinite(self.jacobians[alive]).all(axis=(1, 2))]
        self.costs[without], self.endings[without] = np.inf, Ending.NO_STEADY_BEAT

    def run(self) -> Refined:
        active = self.above_floor(np.flatnonzero(np.isfinite(self.costs)))
        for _ in range(self.precision.iterations):
            if not len(active):
                break
            self.iterations[active] += 1
            active = self.above_floor(self.advance(active))
        return Refined(self.x, self.outputs, self.costs, self.iterations, self.endings, self.jacobians)

    def evaluate(self, rows: np.ndarray, x: np.ndarray) -> Evaluation:
        p = self.precision
        near = None if any(known is None for known in self.near[rows]) else list(self.near[rows])
        return self.objective.evaluate(self.which[rows], x, p.orbits, p.resolution, near)

    def differentiate(self, found: Evaluation, members: np.ndarray, rows: np.ndarray) -> None:
        """Derivatives of some starts from the members of an evaluation that they stand at."""
        if len(members):
            self.jacobians[rows], near = self.objective.linearise(found, members.tolist(), self.x[rows])
            self.near[rows] = np.fromiter(near, dtype=object)

    def weighted(self, row: int) -> np.ndarray:
        """d residual / d log parameter; 0 for what is held, so that no step moves it."""
        return self.jacobians[row] * self.objective.weights[self.which[row]][:, None] * self.moves[row]

    def above_floor(self, active: np.ndarray) -> np.ndarray:
        low = self.costs[active] <= self.precision.floor
        self.endings[active[low]] = Ending.SETTLED
        return active[~low]

    def advance(self, active: np.ndarray) -> np.ndarray:
        """One iteration of each start; those left that are worth another."""
        before, place = self.costs[active].copy(), self.x[active].copy()
        straight = self.straight(active)
        bent = self.bent(straight)
        better = self.better(active, straight, bent)
        for wave, chosen in ((straight, better >= 0), (bent, better < -1)):
            self.move(wave, active[chosen], np.where(better >= 0, better, -2 - better)[chosen])
        self.damping[active[better == -1]] *= NEXT_LADDER
        moved = np.abs(self.x[active] - place).max(axis=1)
        gained = before - self.costs[active]
        done = np.where(
            (better == -1) | (moved == 0.0),
            self.damping[active] > LARGEST_DAMPING,
            (gained <= self.precision.cost * before) | (moved <= self.precision.step),
        )
        self.endings[active[done]] = Ending.SETTLED
        return active[~done]

    def straight(self, active: np.ndarray) -> _Tried:
        """Steps that the derivatives alone foresee, for a ladder of dampings."""
        rows = np.repeat(active, len(LADDER))
        dampings = np.maximum(np.outer(self.damping[active], LADDER).ravel(), SMALLEST_DAMPING)
        return self.tried(rows, dampings, self.residuals[rows])

    def bent(self, first: _Tried) -> _Tried:
        """The same with the part of the residuals that the first steps have shown not to be linear."""
        seen = np.isfinite(first.found.costs)
        rows, steps = first.rows[seen], first.steps[seen]
        foreseen = [self.weighted(row) @ step for row, step in zip(rows, steps, strict=True)]
        shape = (len(rows), self.residuals.shape[1])
        constant = first.found.residuals[seen] - np.reshape(foreseen, shape)
        return self.tried(rows, first.dampings[seen], constant)

    def tried(self, rows: np.ndarray, dampings: np.ndarray, residuals: np.ndarray) -> _Tried:
        """Evaluate the damped steps from residuals that stand for those of the starts."""
        steps = np.zeros((len(rows), self.x.shape[1]))
        for row in np.unique(rows):
            own = rows == row
            jacobian = self.weighted(row)
            found = bounded_steps(jacobian, residuals[own], self.x[row], self.box, dampings[own])
            steps[own] = found * self.moves[row]
        return _Tried(rows, dampings, steps, self.evaluate(rows, self.x[rows] + steps))

    def better(self, active: np.ndarray, straight: _Tried, bent: _Tried) -> np.ndarray:
        """Place of the best step of each start: k of the straight ones, -2 - k of the bent, -1 for none."""
        best = np.full(len(active), -1)
        for place, row in enumerate(active):
            lowest = self.costs[row]
            for wave, code in ((straight, lambda k: k), (bent, lambda k: -2 - k)):
                own = np.flatnonzero(wave.rows == row)
                if len(own) and wave.found.costs[own].min() < lowest:
                    k = own[np.argmin(wave.found.costs[own])]
                    lowest, best[place] = wave.found.costs[k], code(k)
        return best

    def move(self, wave: _Tried, rows: np.ndarray, chosen: np.ndarray) -> None:
        """Take steps of a wave, but for those to where there are no derivatives to go on with."""
        kept = (self.x, self.outputs, self.residuals, self.costs, self.jacobians, self.near)
        before = [values[rows].copy() for values in kept]
        self.x[rows] += wave.steps[chosen]
        self.outputs[rows], self.residuals[rows] = wave.found.outputs[chosen], wave.found.residuals[chosen]
        self.costs[rows] = wave.found.costs[chosen]
        self.damping[rows] = wave.dampings[chosen]
        self.differentiate(wave.found, chosen, rows)
        stuck = ~np.isfinite(self.jacobians[rows]).all(axis=(1, 2))
        for values, old in zip(kept, before, strict=True):
            values[rows[stuck]] = old[stuck]
        self.damping[rows[stuck]] *= NEXT_LADDER


def bounded_steps(
    jacobian: np.ndarray, residuals: np.ndarray, x: np.ndarray, box: Box, dampings: np.ndarray
) -> np.ndarray:
    """Damped Gauss-Newton steps inside the bounds, shape (dampings, parameters).

    Args:
        jacobian: d residual / d parameter, shape (residuals, parameters).
        residuals: of each damping, shape (dampings, residuals).
        x: shape (parameters,).
        box: bounds.
        dampings: as shares of the largest curvature.
    """
    absolute = dampings * max(float(np.max(np.sum(jacobian**2, axis=0))), 1e-300)
    steps = _damped(jacobian, residuals, absolute)
    inside = ((steps >= box.lower - x) & (steps <= box.upper - x)).all(axis=1)
    for k in np.flatnonzero(~inside):
        steps[k] = bounded_step(jacobian, residuals[k], x, box, absolute[k])[0]
    return steps


def _damped(jacobian: np.ndarray, residuals: np.ndarray, dampings: np.ndarray) -> np.ndarray:
    """Damped steps without bounds, shape (dampings, parameters), no longer than allowed in any direction.

    Each singular direction is cut by itself, so that one which the residuals hardly depend on, along which
    a step may be as long as it likes, does not shorten the others.
    """
    left, singular, right = np.linalg.svd(jacobian, full_matrices=False)
    along = -(residuals @ left) * (singular / (singular**2 + dampings[:, None]))
    return np.clip(along, -LONGEST_STEP, LONGEST_STEP) @ right


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
        rest = residuals + jacobian[:, ~free] @ step[~free]
        step[free] = _damped(jacobian[:, free], rest[None], np.array([damping]))[0]
        over = free & ((step < lower) | (step > upper))
        if not over.any():
            break
        room = np.where(step < lower, lower, upper) / np.where(over, step, 1.0)
        first = int(np.argmin(np.where(over, room, np.inf)))
        step[first] = np.clip(step[first], lower[first], upper[first])
        free[first] = False
    step = np.clip(step, lower, upper)
    after = residuals + jacobian @ step
    return step, float(residuals @ residuals - after @ after)
