"""TikTak multi-start: explore widely, refine the best points, mix each start with the best so far.

Arnoud, Guvenen and Kleineberg 2019, Benchmarking global optimizers, doi 10.3386/w26340. Starts are refined
in rounds side by side, so "the best so far" is the best of the previous rounds.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from eclsim.arguments import FiniteNumber, WholeNumber, check_fields
from eclsim.identification.least_squares import (
    EXACT,
    MOST_ITERATIONS,
    Refinement,
    Termination,
    Tolerances,
    polish,
    refine,
)
from eclsim.identification.objective import (
    Box,
    Explored,
    LeastSquaresProblem,
    Objective,
    SharedObjective,
    within_90,
)
from eclsim.orbit.equation import OrbitOptions
from eclsim.sensitivity.identifiability import ScaledSensitivities, propose

EXPLORING = OrbitOptions(tolerance=3e-2, error_tolerance=1e-1, newton_iterations=0)
"""Accuracy sufficient to rank points: outputs differ by 1e-4 (median), 1 % (99th percentile) from exact."""
COARSE = 1
"""Grid of explored points and of starts; only the optimum is refined on the grid that it needs."""
REFINING = Tolerances(2e-4, 1e-7, orbits=OrbitOptions(1e-6, 1e-5, newton_iterations=0), resolution=COARSE)
SAME_COST = 1e-3
SAME_OUTPUTS = 1e-3
PERFECT_COST = 1e-6
"""Sum of squares below which a fit is perfect: outputs agree within 0.1 %."""
LARGEST_WEIGHT = 0.995
SHARES = (0.2, 0.5, 0.8)
"""Further start values of common parameters, as shares of the distance between their bounds."""
MOST_DISTINCT_ENDS, SAME_END = 5, 0.05
"""Largest number of distinct ends of a search, and smallest difference in a coordinate between them."""
BEST_KEPT = 256
"""Number of the best explored points that are kept, to look for further solutions among them."""
FINAL_SHARED_REFINEMENT = Tolerances(1e-6, 1e-12, 1e-8, 40, EXACT.orbits)
Progress = Callable[[object], None]
"""Called with an object whose text describes the current step."""


def silent(step: object) -> None:
    """Ignore the progress of a computation."""


class FitStatus(StrEnum):
    """How a fit ended."""

    FITTED = "fitted"
    NOT_SETTLED = "not_settled"
    NO_STEADY_BEAT = "no_steady_beat"
    ONE_OF_MANY = "one_of_many"
    NO_STEADY_GASES = "no_steady_gases"
    BROKEN_OFF = "broken_off"

    @property
    def message(self) -> str:
        """Explanation of the status, with advice."""
        return _MESSAGES[self]


_MESSAGES = {
    FitStatus.FITTED: "optimum found",
    FitStatus.NOT_SETTLED: (
        "the search ended while the best start was still improving: a better fit may exist, so the sum of "
        "squares is an upper limit of the smallest one; try another --seed or fewer free parameters"
    ),
    FitStatus.NO_STEADY_BEAT: (
        "no explored set of parameters has a steady heartbeat: check heart rate, devices and fixed parameters"
    ),
    FitStatus.ONE_OF_MANY: (
        "valves stay shut throughout the beat, so that the steady heartbeat is one of many and the "
        "measurements do not "
        "determine what lies behind them: check pump speed, CO and heart rate, and raise the lower bounds of "
        "Emaxlv and Emaxrv"
    ),
    FitStatus.NO_STEADY_GASES: (
        "no explored set of parameters has a steady gas state, which the measured gases need, though the "
        "heartbeat is steady: check sweep, FdO2, ventilation and the sites of the cannulae, or leave out "
        "the gases"
    ),
    FitStatus.BROKEN_OFF: (
        "a program error stopped this fit; the other points are fitted without it: look for a wrong "
        "value among its measurements and devices, and report it"
    ),
}


@dataclass(frozen=True)
class MultiStart:
    """Extent of the multi-start search.

    Args:
        points_per_parameter: number of explored points for each free parameter.
        refined_share: largest share of the explored points that is refined.
        round_size: number of starts refined side by side.
        rediscoveries: the search ends when the best optimum has been found this many times again.
        seed: seed of the Sobol sequence.
        polishing: largest number of iterations of `polish`.
    """

    points_per_parameter: int = 1000
    refined_share: float = 0.01
    round_size: int = 12
    rediscoveries: int = 10
    seed: int = 0
    polishing: int = MOST_ITERATIONS

    def __post_init__(self) -> None:
        check_fields(
            self,
            points_per_parameter=WholeNumber(1),
            refined_share=FiniteNumber(above=0.0, most=1.0),
            round_size=WholeNumber(1),
            rediscoveries=WholeNumber(1),
            seed=WholeNumber(),
            polishing=WholeNumber(),
        )

    @classmethod
    def quick(cls, explored: int) -> MultiStart:
        """Return a modest search: 2 % of the explored sets are refined until one optimum was found twice.

        Args:
            explored: explored sets for each free parameter; 1000 (the default) or more give the usual search.
        """
        if explored >= cls.points_per_parameter:
            return cls(points_per_parameter=explored)
        return cls(points_per_parameter=explored, refined_share=0.02, round_size=2, rediscoveries=1)


@dataclass(frozen=True)
class Starts:
    """All starts that were refined, in order, shape (starts, ...).

    Args:
        end: coordinates of the parameters at the end of the refinement.
        first_costs: sum of squares at the start.
        last_costs: sum of squares at the end.
        agreeing: whether the start ended in the best optimum.
        outputs: outputs of the model at the end, in the order of the objective, shape (starts, outputs).
    """

    end: np.ndarray
    first_costs: np.ndarray
    last_costs: np.ndarray
    agreeing: np.ndarray
    outputs: np.ndarray

    def within_90(
        self, rows: Sequence[int], measured: np.ndarray, errors: np.ndarray, least: float
    ) -> np.ndarray:
        """Whether the chi-square of each end is within `RISE_90` of the smallest, shape (ends,).

        Args:
            rows: indices of the measured outputs.
            measured: measured values.
            errors: standard uncertainties of the measured values.
            least: chi-square of the optimum; an end may have a smaller one if the fit has other weights.
        """
        squares = np.sum(((self.outputs[:, rows] - measured) / errors) ** 2, axis=1)
        return within_90(squares, least)


@dataclass(frozen=True)
class SharedEstimate:
    """Estimate for one data point from a fit of several data points with common parameters.

    Args:
        covariance: covariance of the coordinates of its parameters, shape (parameters, parameters).
        excluded: reason for each of its parameters that the measurements of all points do not determine.
    """

    covariance: np.ndarray
    excluded: Mapping[str, str]


class Exploration(NamedTuple):
    """Numbers of explored points, and of those without a usable beat.

    Attributes:
        points: points explored.
        without_beat: points without a steady beat.
        one_of_many: points whose beat is not unique, because valves stay shut.
        without_gases: points with a steady beat but without a steady gas state, which measured gases need.
    """

    points: int = 0
    without_beat: int = 0
    one_of_many: int = 0
    without_gases: int = 0


@dataclass(frozen=True)
class Optimum:
    """The best fit of one data point.

    Args:
        x: coordinates of the parameters; NaN if no set of parameters has a unique steady beat.
        outputs: outputs of the model, in the order of the objective.
        cost: sum of squared residuals.
        jacobian: d output / d coordinate, shape (outputs, parameters).
        starts: all starts that were refined.
        explored: numbers of explored points.
        status: how the search ended.
        best_explored: the best explored points, with all outputs.
        shared: estimate from a fit together with other data points; None if the point was fitted by itself.
    """

    x: np.ndarray
    outputs: np.ndarray
    cost: float
    jacobian: np.ndarray
    starts: Starts
    explored: Exploration
    status: FitStatus
    best_explored: Explored
    shared: SharedEstimate | None = None

    @property
    def exists(self) -> bool:
        """Whether there is a best fit, even a poor one."""
        return bool(np.isfinite(self.x).all())

    @property
    def agreeing(self) -> int:
        """Number of starts that ended in this optimum."""
        return int(self.starts.agreeing.sum())

    @property
    def distinct_ends(self) -> np.ndarray:
        """The optimum and distinct ends of other starts, the best first, shape (ends, parameters)."""
        chosen = [self.x]
        for end in self.starts.end[np.argsort(self.starts.last_costs, kind="stable")]:
            if len(chosen) < MOST_DISTINCT_ENDS and min(np.abs(end - c).max() for c in chosen) > SAME_END:
                chosen.append(end)
        return np.stack(chosen)


@dataclass
class _Candidates:
    """Starts of one data point, best first, and the results of those that were refined."""

    x: np.ndarray
    costs: np.ndarray
    explored: Exploration
    best_explored: Explored
    first_costs: list[float] = field(default_factory=list)
    refined: list[Refinement] = field(default_factory=list)

    def reason_without_fit(self) -> FitStatus:
        """Return the reason why there is no fit; of several, the one closest to a fit."""
        if self.explored.without_gases:
            return FitStatus.NO_STEADY_GASES
        return FitStatus.ONE_OF_MANY if self.explored.one_of_many else FitStatus.NO_STEADY_BEAT

    def all_refined(self) -> Refinement:
        """Return all refined starts."""
        names = vars(self.refined[0])
        return Refinement(**{n: np.concatenate([getattr(r, n) for r in self.refined]) for n in names})

    def found_often_enough(self, settings: MultiStart) -> bool:
        """Whether the best optimum has been found often enough."""
        return bool(self.refined) and bool(agreeing(self.all_refined()).sum() > settings.rediscoveries)

    def next_starts(self, first: int, settings: MultiStart) -> np.ndarray:
        """Starts of the next round, each mixed with the best so far; in the first round unchanged."""
        starts = self.x[first : first + settings.round_size]
        if not self.refined or not np.isfinite((refined := self.all_refined()).costs).any():
            return starts
        best = refined.x[np.argmin(refined.costs)]
        weights = [mixing_weight(first + i, len(self.x)) for i in range(len(starts))]
        return np.stack([w * best + (1.0 - w) * x for w, x in zip(weights, starts, strict=True)])


def identify(
    problem: LeastSquaresProblem, box: Box, settings: MultiStart | None = None, progress: Progress = silent
) -> list[Optimum]:
    """Fit every data point of a problem; points do not influence each other."""
    settings = settings or MultiStart()
    explored, count = sobol(box, settings), len(problem.weights)
    candidates = []
    for k in range(count):
        progress(f"exploring {len(explored)} sets of parameters (point {k + 1} of {count})")
        candidates.append(_explore(problem, k, explored, settings))
    _refine_all(problem, box, candidates, settings, progress)
    best = []
    for k, of_point in enumerate(candidates):
        progress(f"refining the best start to the end (point {k + 1} of {count})")
        best.append(_best_optimum(problem, box, k, of_point, settings))
    return best


def sobol(box: Box, settings: MultiStart) -> np.ndarray:
    """Start values followed by points of a scrambled Sobol sequence in the box, (points, parameters)."""
    from scipy.stats import qmc

    size = len(box.names)
    count = max(settings.points_per_parameter * size - 1, 1)
    sequence = qmc.Sobol(size, rng=np.random.default_rng(settings.seed))
    unit = sequence.random_base2(int(np.ceil(np.log2(count + 1))))[:count]
    return np.vstack([box.start, box.lower + unit * box.width])


def _explore(
    problem: LeastSquaresProblem, point: int, explored: np.ndarray, settings: MultiStart
) -> _Candidates:
    """Rank sets of parameters for one data point by cost and keep the best share with a steady beat."""
    evaluation = problem.evaluate(np.full(len(explored), point), explored, EXPLORING, COARSE)
    costs = evaluation.costs
    count = max(round(settings.refined_share * len(explored)), 2)
    ranked = np.argsort(costs, kind="stable")
    ranked = ranked[np.isfinite(costs[ranked])]
    order, kept = ranked[:count], ranked[:BEST_KEPT]
    one_of_many, without_gases = int(evaluation.one_of_many.sum()), int(evaluation.without_gases.sum())
    without_beat = int((~np.isfinite(costs)).sum()) - one_of_many - without_gases
    counts = Exploration(len(explored), without_beat, one_of_many, without_gases)
    best = Explored(explored[kept], evaluation.outputs[kept])
    return _Candidates(explored[order], costs[order], counts, best)


def mixing_weight(number: int, total: int) -> float:
    """Weight of the best point so far in start `number` (counted from 0) of `total`."""
    return min(max(0.1, np.sqrt(number / total)), LARGEST_WEIGHT)


def _refine_all(
    problem: LeastSquaresProblem,
    box: Box,
    candidates: list[_Candidates],
    settings: MultiStart,
    progress: Progress,
) -> None:
    """Refine in rounds the starts of all data points side by side."""
    first = 0
    while jobs := [
        k for k, c in enumerate(candidates) if first < len(c.x) and not c.found_often_enough(settings)
    ]:
        starts = {k: candidates[k].next_starts(first, settings) for k in jobs}
        points = np.concatenate([np.full(len(starts[k]), k) for k in jobs])
        last = min(first + settings.round_size, max(len(candidates[k].x) for k in jobs))
        progress(f"refining starts {first + 1} to {last} of each of {len(jobs)} data points")
        refined = refine(problem, points, np.concatenate([starts[k] for k in jobs]), box, REFINING)
        for k in jobs:
            of_point = candidates[k]
            of_point.first_costs += of_point.costs[first : first + settings.round_size].tolist()
            of_point.refined.append(refined.take(points == k))
        first += settings.round_size


def agreeing(refined: Refinement) -> np.ndarray:
    """Whether each start ended in the best optimum: the same cost and the same outputs.

    Parameters are not compared: if measurements cannot distinguish two sets, both are the optimum.
    """
    if not np.isfinite(refined.costs).any():
        return np.zeros(len(refined.costs), dtype=bool)
    best = int(np.nanargmin(refined.costs))
    same_cost = refined.costs <= refined.costs[best] * (1.0 + SAME_COST) + PERFECT_COST
    reference = np.maximum(np.abs(refined.outputs[best]), 1e-3)
    with np.errstate(invalid="ignore"):
        difference = np.max(np.abs(refined.outputs - refined.outputs[best]) / reference, axis=1)
        return same_cost & (difference <= SAME_OUTPUTS)


def _best_optimum(
    problem: LeastSquaresProblem, box: Box, point: int, candidates: _Candidates, settings: MultiStart
) -> Optimum:
    """Refine the best start of a data point to convergence."""
    if not candidates.refined or not np.isfinite((refined := candidates.all_refined()).costs).any():
        reason, size = candidates.reason_without_fit(), len(box.names)
        return optimum_without_fit(size, len(problem.outputs), reason, candidates.explored)
    last = _refine_to_convergence(
        problem, point, refined.x[[np.argmin(refined.costs)]], box, settings.polishing
    )
    first_costs = np.array(candidates.first_costs)
    starts = Starts(refined.x, first_costs, refined.costs, agreeing(refined), refined.outputs)
    settled = last.terminations[0] == Termination.SETTLED
    return Optimum(
        last.x[0], last.outputs[0], float(last.costs[0]), last.jacobians[0], starts, candidates.explored,
        FitStatus.FITTED if settled else FitStatus.NOT_SETTLED, candidates.best_explored,
    )  # fmt: skip


def optimum_without_fit(size: int, count: int, status: FitStatus, explored: Exploration) -> Optimum:
    """Return the optimum of a search that ended without a fit.

    Args:
        size: number of parameters.
        count: number of outputs.
        status: how the search ended.
        explored: numbers of explored points.
    """
    none, flat = np.zeros((0, size)), np.zeros(0)
    starts = Starts(none, flat, flat, np.zeros(0, dtype=bool), np.zeros((0, count)))
    return Optimum(
        np.full(size, np.nan), np.full(count, np.nan), np.inf, np.full((count, size), np.nan), starts,
        explored, status, Explored(none, np.zeros((0, count))),
    )  # fmt: skip


def _refine_to_convergence(
    problem: LeastSquaresProblem, point: int, best: np.ndarray, box: Box, polishing: int
) -> Refinement:
    """Refine on the grid that the optimum needs; all steps share the grid, since outputs depend on it."""
    points = np.array([point])
    level, last = 0, None
    while (needed := int(problem.resolutions(points, best)[0])) > level:
        level = needed
        exact = replace(EXACT, resolution=level)
        last = refine(problem, points, best, box, exact)
        last = polish(problem, point, last, box, exact, most_iterations=polishing)
        best = last.x
    assert last is not None
    return last


# --- data points of one patient with parameters in common --------------------------------------------------


def refine_shared(
    objective: Objective, box: Box, common: Sequence[int], fitted: np.ndarray
) -> tuple[SharedObjective, Refinement]:
    """Fit all points of an objective with common parameters.

    Args:
        objective: data points of one patient.
        box: bounds of the parameters of one point.
        common: indices of the shared parameters.
        fitted: best fit of each point by itself, shape (points, parameters).
    """
    problem = SharedObjective(objective, common)
    space = problem.box(box)
    starts = np.tile(problem.joined(fitted), (1 + len(SHARES), 1))
    first = np.arange(len(common))
    starts[1:, first] = space.lower[first] + np.outer(SHARES, space.width[first])
    points = np.zeros(len(starts), dtype=int)
    rough = refine(problem, points, starts, space, replace(REFINING, cost=1e-3, floor=1e-9))
    best = rough.x[[np.argmin(rough.costs)]]
    level = int(problem.resolutions(points[:1], best)[0])
    return problem, refine(
        problem, points[:1], best, space, replace(FINAL_SHARED_REFINEMENT, resolution=level)
    )


def fit_shared(
    objective: Objective,
    box: Box,
    separate: Sequence[Optimum],
    errors: Sequence[np.ndarray],
    shared: Sequence[str],
) -> list[Optimum]:
    """Fit data points again with common parameters, starting from the optima of the separate fits."""
    if not all(o.exists for o in separate):
        return list(separate)
    common = [box.names.index(n) for n in shared if n in box.names]
    problem, refined = refine_shared(objective, box, common, np.stack([o.x for o in separate]))
    height, space = len(objective.outputs), problem.box(box)
    jacobian, outputs = refined.jacobians[0], refined.outputs[0]
    scaled, weights = _scaled(objective, jacobian, errors, space)
    spread = space.covariance(scaled.matrix, weights)
    excluded = propose(scaled).excluded
    settled = refined.terminations[0] == Termination.SETTLED
    optima = []
    for k, before in enumerate(separate):
        rows, places = slice(k * height, (k + 1) * height), problem.places[k]
        residuals = (outputs[rows] - objective.measured[k]) * objective.weights[k]
        reasons = {
            name: excluded[space.names[place]]
            for name, place in zip(box.names, places, strict=True)
            if space.names[place] in excluded
        }
        optima.append(
            replace(
                before, x=refined.x[0, places], outputs=outputs[rows], cost=float(np.sum(residuals**2)),
                jacobian=jacobian[rows][:, places],
                status=FitStatus.FITTED if settled else FitStatus.NOT_SETTLED,
                starts=replace(before.starts, agreeing=np.zeros(len(before.starts.agreeing), dtype=bool)),
                shared=SharedEstimate(spread[np.ix_(places, places)], reasons),
            )
        )  # fmt: skip
    return optima


def _scaled(
    objective: Objective, jacobian: np.ndarray, errors: Sequence[np.ndarray], space: Box
) -> tuple[ScaledSensitivities, np.ndarray]:
    """Sensitivities of all measurements of the patient and their weights, both in standard uncertainties."""
    rows, names, weights = [], [], []
    height = len(objective.outputs)
    for k, (target, point_errors) in enumerate(zip(objective.targets, errors, strict=True)):
        for name, error in zip(target.measured, point_errors, strict=True):
            place = objective.outputs.index(name)
            rows.append(jacobian[k * height + place] / error)
            names.append(f"{name} of point {k + 1}")
            weights.append(objective.weights[k, place] * error)
    return ScaledSensitivities(tuple(names), space.names, np.array(rows)), np.array(weights)
