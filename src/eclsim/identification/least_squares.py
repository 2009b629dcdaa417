"""Bounded nonlinear least squares for many starts side by side: the Levenberg-Marquardt method.

A simulation costs a tenth when many run side by side. Each iteration therefore tries several damping factors
at once, and then the same ones again with a second-order correction for the curvature of the residuals that
the first steps have shown (geodesic acceleration, Transtrum and Sethna 2012, arXiv:1201.5885, probed with the
whole step), because the valleys of this problem are flat and curved. The parameter whose bound a step would
cross first is set to that bound, and the step of the others is computed again.

Diastolic pressure is read from a beat on a fixed grid. Its slope changes by a tenth and more where the
opening of the aortic valve moves from one grid cell to the next. A method that follows slopes stops at such a
kink. `polish` searches for a better point in a cloud of points around it, shaped by the curvature.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np

from eclsim.identification.objective import Box, Evaluation, LeastSquaresProblem
from eclsim.orbit.equation import OrbitOptions

FIRST_DAMPING = 1e-3
"""First damping; all dampings are relative to the largest curvature."""
SMALLEST_DAMPING = 1e-11
LARGEST_DAMPING = 1e6
DAMPING_FACTORS = 10.0 ** np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
"""Dampings that are tried at once, relative to the best one of the previous iteration."""
FURTHER_DAMPING_FACTOR = 1e4
"""Factor by which the damping increases if no trial step was good."""
LONGEST_STEP = 1.5
"""Largest change of a coordinate in one step, for a logarithm a factor of 4.5."""
POINTS_IN_CLOUD = 63
"""Number of points of a cloud."""
CLOUD_SIZES = (-4.0, -1.0)
"""Decimal logarithms of the smallest and largest cloud size, the relative change of its residuals."""
SMALLEST_RELATIVE_GAIN = 1e-6
"""A further cloud is tried only if the last one lowered the cost by more than this share."""
MOST_CLOUDS_WITHOUT_GAIN = 6
"""The search ends after this number of clouds without a better point."""
MOST_CLOUDS = 24
MOST_ITERATIONS = 80
"""Largest total number of iterations of all refinements between clouds; these take some seconds."""
PERFECT_COST = 1e-12
"""Sum of squares below which the search ends."""


class Termination(IntEnum):
    """Reason why a refinement ended."""

    SETTLED = 0
    OUT_OF_ITERATIONS = 1
    NO_STEADY_BEAT = 2


@dataclass(frozen=True)
class Tolerances:
    """Stopping criteria of a refinement.

    Args:
        cost: a refinement has settled if an iteration lowers the cost by less than this share.
        floor: a refinement has settled if the sum of squares is at most this.
        step: a refinement has settled if no coordinate of a parameter changes by more than this.
        iterations: largest number of iterations.
        orbits: accuracy of the steady beats.
        resolution: resolution of the grid of all beats; None selects the resolution that each beat needs.
    """

    cost: float = 1e-3
    floor: float = 1e-9
    step: float = 1e-4
    iterations: int = 30
    orbits: OrbitOptions | None = None
    resolution: int | None = None


EXACT = Tolerances(1e-8, 1e-14, 1e-10, 60, OrbitOptions(newton_iterations=3, exact_iterations=0))
"""Stopping criteria for the optimum itself."""


@dataclass(frozen=True)
class Refinement:
    """Results of refinements, shape (starts, ...).

    Args:
        x: coordinates of the parameters (see `Scale`), shape (starts, parameters).
        outputs: outputs of the model at x, shape (starts, outputs).
        costs: sum of squared residuals; infinite without a steady beat.
        iterations: number of iterations.
        terminations: a `Termination` for each start.
        jacobians: d output / d coordinate, shape (starts, outputs, parameters).
    """

    x: np.ndarray
    outputs: np.ndarray
    costs: np.ndarray
    iterations: np.ndarray
    terminations: np.ndarray
    jacobians: np.ndarray

    def take(self, chosen: np.ndarray) -> Refinement:
        """Return the refinements of the chosen starts."""
        return replace(self, **{name: value[chosen] for name, value in vars(self).items()})


def refine(
    problem: LeastSquaresProblem,
    points: np.ndarray,
    starts: np.ndarray,
    box: Box,
    tolerances: Tolerances | None = None,
    held: np.ndarray | None = None,
) -> Refinement:
    """Minimise the sum of squared residuals from every start.

    Args:
        problem: objective with one or more data points.
        points: data point of each start, shape (starts,).
        starts: coordinates of the parameters, shape (starts, parameters).
        box: bounds of the parameters.
        tolerances: stopping criteria.
        held: whether a start keeps each parameter, shape (starts, parameters); None keeps none.
    """
    return _Search(problem, np.asarray(points), box.clip(starts), box, tolerances or Tolerances(), held).run()


@dataclass(frozen=True)
class _Trial:
    """Trial steps, shape (steps, ...): row of the start, damping, step, and the model evaluated there."""

    rows: np.ndarray
    dampings: np.ndarray
    steps: np.ndarray
    evaluation: Evaluation


class _Search:
    def __init__(
        self,
        problem: LeastSquaresProblem,
        points: np.ndarray,
        x: np.ndarray,
        box: Box,
        tolerances: Tolerances,
        held: np.ndarray | None,
    ):
        self.problem, self.points, self.box, self.tolerances = problem, points, box, tolerances
        self.x = x
        self.moves = np.ones(x.shape) if held is None else np.where(held, 0.0, 1.0)
        self.tangents = np.full(len(points), None, dtype=object)
        first = self.evaluate(np.arange(len(points)), x)
        self.outputs, self.residuals, self.costs = first.outputs, first.residuals, first.costs.copy()
        self.jacobians = np.full((len(points), len(problem.outputs), x.shape[1]), np.nan)
        self.iterations = np.zeros(len(points), dtype=int)
        self.terminations = np.where(
            np.isfinite(self.costs), Termination.OUT_OF_ITERATIONS, Termination.NO_STEADY_BEAT
        )
        self.damping = np.full(len(points), FIRST_DAMPING)
        alive = np.flatnonzero(np.isfinite(self.costs))
        self.differentiate(first, alive, alive)
        without = alive[~np.isfinite(self.jacobians[alive]).all(axis=(1, 2))]
        self.costs[without], self.terminations[without] = np.inf, Termination.NO_STEADY_BEAT

    def run(self) -> Refinement:
        active = self.above_floor(np.flatnonzero(np.isfinite(self.costs)))
        for _ in range(self.tolerances.iterations):
            if not len(active):
                break
            self.iterations[active] += 1
            active = self.above_floor(self.advance(active))
        return Refinement(
            self.x, self.outputs, self.costs, self.iterations, self.terminations, self.jacobians
        )

    def evaluate(self, rows: np.ndarray, x: np.ndarray) -> Evaluation:
        known_tangents, t = self.tangents[rows], self.tolerances
        tangents = None if any(known is None for known in known_tangents) else list(known_tangents)
        return self.problem.evaluate(self.points[rows], x, t.orbits, t.resolution, tangents)

    def differentiate(self, evaluation: Evaluation, members: np.ndarray, rows: np.ndarray) -> None:
        """Compute the derivatives of some starts from the members of an evaluation at the same points."""
        if len(members):
            self.jacobians[rows], tangents = self.problem.linearise(
                evaluation, members.tolist(), self.x[rows]
            )
            self.tangents[rows] = np.fromiter(tangents, dtype=object)

    def weighted(self, row: int) -> np.ndarray:
        """Return d residual / d coordinate; 0 for held parameters, so that no step moves them."""
        return self.jacobians[row] * self.problem.weights[self.points[row]][:, None] * self.moves[row]

    def above_floor(self, active: np.ndarray) -> np.ndarray:
        low = self.costs[active] <= self.tolerances.floor
        self.terminations[active[low]] = Termination.SETTLED
        return active[~low]

    def advance(self, active: np.ndarray) -> np.ndarray:
        """Do one iteration for each start and return the starts that have not settled."""
        before, start = self.costs[active].copy(), self.x[active].copy()
        first_order = self.first_order(active)
        solved = np.isfinite(first_order.evaluation.costs)
        # Without any step that has a steady beat, as in cardiac arrest, the curvature is unknown.
        trials = (first_order, self.second_order(first_order, solved)) if solved.any() else (first_order,)
        best = self.best(active, trials)
        for number, trial in enumerate(trials):
            chosen = best[:, 0] == number
            self.move(trial, active[chosen], best[chosen, 1])
        stuck = best[:, 0] < 0
        self.damping[active[stuck]] *= FURTHER_DAMPING_FACTOR
        moved = np.abs(self.x[active] - start).max(axis=1)
        gained = before - self.costs[active]
        done = np.where(
            stuck | (moved == 0.0),
            self.damping[active] > LARGEST_DAMPING,
            (gained <= self.tolerances.cost * before) | (moved <= self.tolerances.step),
        )
        self.terminations[active[done]] = Termination.SETTLED
        return active[~done]

    def first_order(self, active: np.ndarray) -> _Trial:
        """Evaluate steps from the first derivatives alone, for several dampings."""
        rows = np.repeat(active, len(DAMPING_FACTORS))
        dampings = np.maximum(np.outer(self.damping[active], DAMPING_FACTORS).ravel(), SMALLEST_DAMPING)
        return self.trial(rows, dampings, self.residuals[rows])

    def second_order(self, first: _Trial, solved: np.ndarray) -> _Trial:
        """Evaluate the steps again, corrected for the curvature shown by first steps with a steady beat."""
        rows, steps = first.rows[solved], first.steps[solved]
        linear = [self.weighted(row) @ step for row, step in zip(rows, steps, strict=True)]
        shape = (len(rows), self.residuals.shape[1])
        constant = first.evaluation.residuals[solved] - np.reshape(linear, shape)
        return self.trial(rows, first.dampings[solved], constant)

    def trial(self, rows: np.ndarray, dampings: np.ndarray, residuals: np.ndarray) -> _Trial:
        """Evaluate the damped steps that follow from given residuals, which replace those of the starts."""
        steps = np.zeros((len(rows), self.x.shape[1]))
        for row in np.unique(rows):
            of_member = rows == row
            own_steps = bounded_steps(
                self.weighted(row), residuals[of_member], self.x[row], self.box, dampings[of_member]
            )
            steps[of_member] = own_steps * self.moves[row]
        return _Trial(rows, dampings, steps, self.evaluate(rows, self.x[rows] + steps))

    def best(self, active: np.ndarray, trials: Sequence[_Trial]) -> np.ndarray:
        """Index of the trial and of its step that lowers each start's cost most, -1 for none; (starts, 2)."""
        best, lowest = np.full((len(active), 2), -1), self.costs[active].copy()
        for number, trial in enumerate(trials):
            costs = trial.evaluation.costs
            for k, row in enumerate(active):
                attempts = np.flatnonzero(trial.rows == row)
                if len(attempts) and costs[attempts].min() < lowest[k]:
                    place = attempts[np.argmin(costs[attempts])]
                    lowest[k], best[k] = costs[place], (number, place)
        return best

    def move(self, trial: _Trial, rows: np.ndarray, chosen: np.ndarray) -> None:
        """Accept steps of a trial, except steps to points without derivatives."""
        arrays = (self.x, self.outputs, self.residuals, self.costs, self.jacobians, self.tangents)
        before = [values[rows].copy() for values in arrays]
        evaluation = trial.evaluation
        self.x[rows] += trial.steps[chosen]
        self.outputs[rows], self.residuals[rows] = evaluation.outputs[chosen], evaluation.residuals[chosen]
        self.costs[rows] = evaluation.costs[chosen]
        self.damping[rows] = trial.dampings[chosen]
        self.differentiate(evaluation, chosen, rows)
        stuck = ~np.isfinite(self.jacobians[rows]).all(axis=(1, 2))
        for values, old in zip(arrays, before, strict=True):
            values[rows[stuck]] = old[stuck]
        self.damping[rows[stuck]] *= FURTHER_DAMPING_FACTOR


def bounded_steps(
    jacobian: np.ndarray, residuals: np.ndarray, x: np.ndarray, box: Box, dampings: np.ndarray
) -> np.ndarray:
    """Damped Gauss-Newton steps inside the bounds, shape (dampings, parameters).

    Args:
        jacobian: d residual / d parameter, shape (residuals, parameters).
        residuals: residuals for each damping, shape (dampings, residuals).
        x: coordinates of the parameters, shape (parameters,).
        box: bounds of the parameters.
        dampings: dampings relative to the largest curvature.
    """
    absolute = dampings * max(float(np.max(np.sum(jacobian**2, axis=0))), 1e-300)
    steps = _damped(jacobian, residuals, absolute)
    inside = ((steps >= box.lower - x) & (steps <= box.upper - x)).all(axis=1)
    for k in np.flatnonzero(~inside):
        steps[k] = bounded_step(jacobian, residuals[k], x, box, absolute[k])
    return steps


def _damped(jacobian: np.ndarray, residuals: np.ndarray, dampings: np.ndarray) -> np.ndarray:
    """Damped steps without bounds, shape (dampings, parameters), limited in every singular direction.

    Each singular direction is limited separately. A direction on which the residuals hardly depend, where a
    step may be very long, therefore does not shorten the step in the others.
    """
    left, singular, right = np.linalg.svd(jacobian, full_matrices=False)
    along = -(residuals @ left) * (singular / (singular**2 + dampings[:, None]))
    return np.clip(along, -LONGEST_STEP, LONGEST_STEP) @ right


def bounded_step(
    jacobian: np.ndarray, residuals: np.ndarray, x: np.ndarray, box: Box, damping: float
) -> np.ndarray:
    """Return a damped Gauss-Newton step inside the bounds.

    Args:
        jacobian: d residual / d parameter, shape (residuals, parameters).
        residuals: shape (residuals,).
        x: coordinates of the parameters, shape (parameters,).
        box: bounds of the parameters.
        damping: added to the diagonal of the normal equations.
    """
    gradient = jacobian.T @ residuals
    lower, upper = box.lower - x, box.upper - x
    free = ~((lower >= 0.0) & (gradient >= 0.0)) & ~((upper <= 0.0) & (gradient <= 0.0))
    step = np.zeros(len(x))
    for _ in range(len(x)):
        if not free.any():
            break
        remaining = residuals + jacobian[:, ~free] @ step[~free]
        step[free] = _damped(jacobian[:, free], remaining[None], np.array([damping]))[0]
        over = free & ((step < lower) | (step > upper))
        if not over.any():
            break
        room = np.where(step < lower, lower, upper) / np.where(over, step, 1.0)
        first = int(np.argmin(np.where(over, room, np.inf)))
        step[first] = np.clip(step[first], lower[first], upper[first])
        free[first] = False
    return np.clip(step, lower, upper)


# --- polishing of an optimum ----------------------------------------------------------------------


def polish(
    problem: LeastSquaresProblem,
    point: int,
    refined: Refinement,
    box: Box,
    tolerances: Tolerances,
    most_iterations: int = MOST_ITERATIONS,
) -> Refinement:
    """Continue from a settled optimum as long as a cloud of points around it contains a better one.

    Args:
        problem: objective with one or more data points.
        point: index of the data point.
        refined: refinement of this data point.
        box: bounds of the parameters.
        tolerances: stopping criteria of the refinements between clouds.
        most_iterations: largest total number of iterations of these refinements; 0 tries no cloud at all.
    """
    generator, points = np.random.default_rng(0), np.full(POINTS_IN_CLOUD, point)
    idle, most = 0, refined.iterations[0] + most_iterations
    for _ in range(MOST_CLOUDS):
        before = refined.costs[0]
        if not before > PERFECT_COST or refined.iterations[0] >= most:
            break
        x = box.clip(refined.x + cloud(problem, point, refined, generator))
        costs = problem.evaluate(points, x, tolerances.orbits, tolerances.resolution).costs
        if costs.min() < before:
            better = refine(problem, points[:1], x[[costs.argmin()]], box, tolerances)
            iterations = refined.iterations + better.iterations
            refined = replace(better, iterations=iterations) if better.costs[0] < before else refined
        idle = idle + 1 if refined.costs[0] >= before * (1.0 - SMALLEST_RELATIVE_GAIN) else 0
        if idle == MOST_CLOUDS_WITHOUT_GAIN:
            break
    return refined


def cloud(
    problem: LeastSquaresProblem, point: int, refined: Refinement, generator: np.random.Generator
) -> np.ndarray:
    """Steps of many sizes, scaled by the residuals' sensitivity in each direction, (points, parameters)."""
    weighted = refined.jacobians[0] * problem.weights[point][:, None]
    if not np.isfinite(weighted).all():  # a beat without derivatives: all directions are treated alike
        weighted = np.zeros_like(weighted)
    _, singular, directions = np.linalg.svd(weighted, full_matrices=True)
    slopes = np.zeros(len(directions))
    slopes[: len(singular)] = singular
    sizes = 10.0 ** generator.uniform(*CLOUD_SIZES, size=(POINTS_IN_CLOUD, 1)) * np.sqrt(refined.costs[0])
    lengths = sizes / np.maximum(slopes, 1e-300)
    return (
        generator.standard_normal((POINTS_IN_CLOUD, len(directions))) * np.minimum(lengths, 0.3) @ directions
    )
