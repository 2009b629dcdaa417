"""How the cost rises when one parameter is held at other values: slices, profiles, and what else moves.

A slice (Figure S-2 of the paper) moves one parameter and leaves the others; in a profile they are fitted
again and make up for it: a flat profile is a parameter that cannot be determined (Raue et al. 2009, doi
10.1093/bioinformatics/btp358). The linear analysis at an optimum cannot see that an undetermined parameter,
which may be a factor of ten from the truth, carries others with it: each of those is held at values well
away from the optimum, and a parameter that then ends elsewhere too, at the same outputs, is not determined.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from eclsim.identification.least_squares import Refinement, Tolerances, refine
from eclsim.identification.multi_start import EXPLORING, MultiStart, sobol
from eclsim.identification.objective import RISE_90, Box, LeastSquaresProblem, Objective, Target
from eclsim.identification.quantities import Scale
from eclsim.identification.verdict import Aspect, Level, Reason, interval_agreement
from eclsim.orbit.equation import OrbitOptions

if TYPE_CHECKING:
    from eclsim.identification.fit import FitResult

REFITTING = Tolerances(
    1e-3, iterations=60, orbits=OrbitOptions(1e-6, 1e-5, newton_iterations=0), resolution=1
)
HELD_SHARES = (0.15, 0.4, 0.65, 0.9)
"""Where a parameter is held to see whether the others follow: shares of the way between its bounds."""
SMALLEST_DISTANCE = 0.15
"""A share nearer to the optimum than this, in widths of the bounds, is left out."""
SAME_OUTPUTS = 3e-3
"""Outputs that differ by less than this share are the same: no measurement tells them apart."""
EXPLORED_PER_PARAMETER, EXPLORED_STARTS = 64, 2
"""Points explored for each parameter to find other valleys, and how many of them are starts of a value."""
MOST_PASSES = 4
"""Passes of further fits of values next to the interval, at most."""
SMALLEST_IMPROVEMENT = 0.1
"""Chi-square by which such a fit must be better for another pass."""
HALVINGS = 3
"""How often the step is halved that an interval ends in: a steep wall behind flat ground looks nearer."""
STEPS = 9
STANDARD_STEPS = (-3.0, -1.65, -0.7, 0.7, 1.65, 3.0)
"""Further values of a parameter, in standard errors from the best one."""


@dataclass(frozen=True)
class CostCurves:
    """Costs along each parameter.

    Args:
        names: of the parameters.
        values: of each in its unit, rising, shape (parameters, steps).
        costs: sum of squared residuals; NaN where there is no steady beat, shape (parameters, steps).
        optimum: value of each parameter at the point that the curves go through.
        cost: there.
        within: coordinates of all points found on the way whose cost is within `RISE_90` of the least, shape
            (points, parameters).
    """

    names: tuple[str, ...]
    values: np.ndarray
    costs: np.ndarray
    optimum: np.ndarray
    cost: float
    within: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))


def slices(
    problem: LeastSquaresProblem, box: Box, x: np.ndarray, point: int = 0, steps: int = 41
) -> CostCurves:
    """Move one parameter after the other from bound to bound, the others held.

    Args:
        problem: data points.
        box: bounds.
        x: coordinates of the parameters that the slices go through.
        point: which data point.
        steps: values of each parameter.
    """
    size = len(box.names)
    along = box.lower[:, None] + np.linspace(0.0, 1.0, steps) * box.width[:, None]
    members = np.tile(x, (size * steps + 1, 1))
    for k in range(size):
        members[k * steps : (k + 1) * steps, k] = along[k]
    costs = _nan_where_infinite(problem.evaluate(np.full(len(members), point), members).costs)
    values = box.scale.values(along.T).T
    best = box.scale.values(x)
    return CostCurves(box.names, values, costs[:-1].reshape(size, steps), best, float(costs[-1]))


def profiles(
    problem: LeastSquaresProblem,
    box: Box,
    x: np.ndarray,
    steps: int,
    further: np.ndarray | None = None,
    other_optima: np.ndarray | None = None,
    explored: np.ndarray | None = None,
) -> CostCurves:
    """Hold one parameter after the other at values from bound to bound, the others fitted again.

    From the optimum alone a fit may end in a worse valley than there is. Values next to the 90 % interval are
    fitted once more, from the ends of other fits within it and from explored points, as long as that helps;
    then the steps that it ends in are halved, with such fits at the new values.

    Args:
        problem: its first data point is meant.
        box: bounds.
        x: coordinates of the parameters at the optimum.
        steps: values of each parameter, besides the optimum's own.
        further: coordinates of each parameter to hold it at as well, shape (parameters, further).
        other_optima: coordinates of other points that may meet the measurements, shape (points, parameters).
        explored: coordinates of points all over the bounds, the best first, shape (points, parameters).
    """
    size = len(box.names)
    along = box.lower[:, None] + np.linspace(0.0, 1.0, steps) * box.width[:, None]
    if further is not None:
        along = np.column_stack([along, np.clip(further, box.lower[:, None], box.upper[:, None])])
    along = np.sort(along, axis=1)
    held = np.repeat(np.arange(size), along.shape[1])
    points = np.zeros(len(held), dtype=int)
    refined = refit(problem, points, box, np.tile(x, (len(held), 1)), held, along.ravel())
    known = x[None] if other_optima is None else np.vstack([x, other_optima])
    known_costs = problem.evaluate(np.zeros(len(known), dtype=int), known, REFITTING.orbits, 1).costs
    fitted = _FittedPoints(np.vstack([refined.x, known]), np.append(refined.costs, known_costs))
    costs = fitted.costs[: len(held)].reshape(along.shape).copy()
    cost = problem.evaluate(points[:1], x[None], resolution=1).costs[0]
    explored = known[:0] if explored is None else explored
    fitted = _refit_near_interval_ends(problem, box, along, costs, fitted, explored)
    along, costs = _with_more_values(along, costs, x[:, None], cost)
    for _ in range(HALVINGS):
        along, costs = _with_more_values(along, costs, _midpoints_at_interval_ends(along, costs), np.inf)
        fitted = _refit_near_interval_ends(problem, box, along, costs, fitted, explored, passes=1)
    costs = _nan_where_infinite(costs)
    return CostCurves(
        box.names, box.scale.values(along.T).T, costs, box.scale.values(x), float(cost), fitted.within
    )


def _refit_near_interval_ends(
    problem: LeastSquaresProblem,
    box: Box,
    along: np.ndarray,
    costs: np.ndarray,
    fitted: _FittedPoints,
    explored: np.ndarray,
    passes: int = MOST_PASSES,
) -> _FittedPoints:
    """Fit values next to the interval again while that helps; lowers `costs`, returns all points found."""
    for _ in range(passes):
        held, step, starts = fitted.values_to_refit(along, costs, explored)
        if not len(held):
            break
        first = np.zeros(len(held), dtype=int)
        again = refit(problem, first, box, starts, held, along[held, step])
        before = costs[held, step]
        np.minimum.at(costs, (held, step), again.costs)
        fitted = fitted.with_more(again)
        if not np.any(costs[held, step] < before - SMALLEST_IMPROVEMENT):
            break
    return fitted


def _with_more_values(
    along: np.ndarray, costs: np.ndarray, more: np.ndarray, cost: float
) -> tuple[np.ndarray, np.ndarray]:
    """Values of each parameter, rising, and costs, with more values, all of one cost."""
    along = np.column_stack([along, more])
    order = np.argsort(along, axis=1, kind="stable")
    costs = np.column_stack([costs, np.full(more.shape, cost)])
    return np.take_along_axis(along, order, axis=1), np.take_along_axis(costs, order, axis=1)


def _midpoints_at_interval_ends(along: np.ndarray, costs: np.ndarray) -> np.ndarray:
    """Middles of the steps that the 90 % intervals end in, below and above, shape (parameters, 2).

    An interval that reaches the last value has no such step: its last one stands in.
    """
    middles = []
    for values, rise in zip(along, map(_rise, costs), strict=True):
        ends = [(_last_within(rise, step), step) for step in (-1, 1)]
        outer = [k + step if 0 <= k + step < len(values) else k - step for k, step in ends]
        middles.append([0.5 * (values[k] + values[o]) for (k, _), o in zip(ends, outer, strict=True)])
    return np.array(middles)


@dataclass(frozen=True)
class _FittedPoints:
    """All points where fits ended, shape (points, ...).

    Attributes:
        x: coordinates of the parameters.
        costs: there; infinite without a steady beat.
    """

    x: np.ndarray
    costs: np.ndarray

    @property
    def within(self) -> np.ndarray:
        """Points within `RISE_90` of the least cost."""
        return self.x[self.costs <= self.costs.min() + RISE_90]

    def with_more(self, fits: Refinement) -> _FittedPoints:
        """These and further ones."""
        return _FittedPoints(np.vstack([self.x, fits.x]), np.append(self.costs, fits.costs))

    def values_to_refit(
        self, along: np.ndarray, costs: np.ndarray, explored: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Values outside of 90 % with a point within it before the next value, and points to start from.

        They are the nearest such point, the furthest from that, and the best explored ones at such values.

        Args:
            along: values of each parameter, rising, shape (parameters, steps).
            costs: there.
            explored: points all over the bounds, the best first, shape (points, parameters).

        Returns:
            Places of the parameters, of the values, and the points to start from, the last of shape (fits,
            parameters).
        """
        within, limit = self.within, self.costs.min() + RISE_90
        held, steps, starts = [], [], []
        for k, s in zip(*np.nonzero(~(costs <= limit)), strict=True):
            low, high = along[k, max(s - 1, 0)], along[k, min(s + 1, along.shape[1] - 1)]
            near = within[(within[:, k] >= low) & (within[:, k] <= high)]
            if len(near):
                nearest = near[np.argmin(np.abs(near[:, k] - along[k, s]))]
                furthest = near[np.argmax(np.sum((near - nearest) ** 2, axis=1))]
                there = explored[(explored[:, k] >= low) & (explored[:, k] <= high)][:EXPLORED_STARTS]
                starts += [nearest, furthest, *there]
                held += [k] * (2 + len(there))
                steps += [s] * (2 + len(there))
        return np.array(held, dtype=int), np.array(steps, dtype=int), np.array(starts)


def _nan_where_infinite(costs: np.ndarray) -> np.ndarray:
    return np.where(np.isfinite(costs), costs, np.nan)


def refit(
    problem: LeastSquaresProblem,
    points: np.ndarray,
    box: Box,
    x: np.ndarray,
    held: np.ndarray,
    values: np.ndarray,
) -> Refinement:
    """Fit again with one parameter held at a value, shape (fits, ...).

    Args:
        problem: data points.
        points: data point of each fit, shape (fits,).
        box: bounds.
        x: coordinates of the parameters that the others start from, shape (fits, parameters).
        held: place of the parameter that each fit holds, -1 for none, shape (fits,).
        values: coordinate that it is held at, shape (fits,).
    """
    mask = held[:, None] == np.arange(x.shape[1])
    starts = np.where(mask, values[:, None], x)
    return refine(problem, points, starts, box, REFITTING, mask)


@dataclass(frozen=True)
class HeldFits:
    """Fits of one data point with one parameter held away from its optimum, shape (fits, ...).

    Args:
        held: place of the parameter that was held.
        x: coordinates of the parameters.
        change: largest relative change of a measured output from the optimum's; NaN without a steady beat.
    """

    held: np.ndarray
    x: np.ndarray
    change: np.ndarray

    def compensation(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How far each parameter moves at the same outputs, and the held parameter that it makes up for.

        Args:
            x: coordinates of the parameters at the optimum, shape (parameters,).
        """
        same = self.change <= SAME_OUTPUTS
        if not same.any():
            return np.zeros(len(x)), np.zeros(len(x), dtype=int)
        moved = np.abs(self.x[same] - x)
        return moved.max(axis=0), self.held[same][moved.argmax(axis=0)]


def held_fits(
    problem: LeastSquaresProblem,
    box: Box,
    optima: Sequence[np.ndarray],
    undetermined: Sequence[Sequence[int]],
) -> list[HeldFits]:
    """Hold undetermined parameters of several data points away from their optima, all side by side."""
    plans = [values_to_hold(x, box, chosen) for x, chosen in zip(optima, undetermined, strict=True)]
    points = np.repeat(np.arange(len(plans)), [len(held) for held, _ in plans])
    if not len(points):
        return [HeldFits(held, np.zeros((0, len(box.names))), np.zeros(0)) for held, _ in plans]
    held, values = (np.concatenate(each) for each in zip(*plans, strict=True))
    stacked = np.stack(optima)
    refined = refit(problem, points, box, stacked[points], held, values)
    chosen = np.unique(points)
    optimal = np.full((len(plans), len(problem.outputs)), np.nan)
    optimal[chosen] = problem.evaluate(chosen, stacked[chosen], REFITTING.orbits, 1).outputs
    scale = np.where(problem.weights > 0.0, np.maximum(np.abs(optimal), 1e-3), np.inf)
    change = np.max(np.abs(refined.outputs - optimal[points]) / scale[points], axis=1)
    each = [points == k for k in range(len(plans))]
    return [HeldFits(held[members], refined.x[members], change[members]) for members in each]


def values_to_hold(x: np.ndarray, box: Box, chosen: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Places of the parameters to hold, and coordinates well away from the optimum to hold them at."""
    plan = [
        (k, value)
        for k in chosen
        for share in HELD_SHARES
        if abs((value := box.lower[k] + share * box.width[k]) - x[k]) >= SMALLEST_DISTANCE * box.width[k]
    ]
    return np.array([k for k, _ in plan], dtype=int), np.array([value for _, value in plan])


@dataclass(frozen=True)
class FitProfiles:
    """Sum of squared differences in standard uncertainties (chi-square) along each parameter.

    Args:
        refitted: the others fitted again.
        held: the others held, through the same point.
        intervals: 90 % interval of each parameter, in its unit: chi-square within `RISE_90` of its least.
        ends_without_beat: ends ("lower", "upper") of intervals with no steady beat beyond, by parameter.
    """

    refitted: CostCurves
    held: CostCurves
    intervals: Mapping[str, tuple[float, float]]
    ends_without_beat: Mapping[str, tuple[str, ...]]


def with_profiles(fit: FitResult) -> tuple[FitResult, FitProfiles | None]:
    """The fit with its profile intervals, judged by whether they agree with its Gaussian ones.

    The profiles go through the parameters that are likeliest, whatever the weights of the fit. There are none
    where the steady beat of the fit is so hard to find that no other can be fitted beside it.
    """
    target = fit.objective.targets[fit.number]
    likelihood = Objective(
        [Target(target.model, target.measured, fit.uncertainties)], fit.box.names, fit.objective.policy
    )
    starts = fit.optimum.distinct_ends
    best = refine(likelihood, np.zeros(len(starts), dtype=int), starts, fit.box, REFITTING)
    if not np.isfinite(best.costs).any():
        return fit.judged(_doubts_without_profile(fit)), None
    # The fit itself, unless another start is better or the fit's beat is too hard to find.
    centre = 0 if best.costs[0] <= best.costs.min() + SMALLEST_IMPROVEMENT else int(np.argmin(best.costs))
    x = best.x[centre]
    scaled = best.jacobians[centre] * likelihood.weights[0][:, None]
    spread = fit.box.covariance(scaled)
    further = x[:, None] + np.outer(np.sqrt(np.diag(spread)), STANDARD_STEPS)
    other_optima = np.vstack([best.x, fit.optimum.starts.end])
    refitted = profiles(likelihood, fit.box, x, STEPS, further, other_optima, _explored(likelihood, fit))
    within = fit.box.scale.values(refitted.within).T
    intervals = {
        name: _interval_including(interval_90(values, costs, Scale.of([name])), points)
        for name, values, costs, points in zip(
            refitted.names, refitted.values, refitted.costs, within, strict=True
        )
    }
    other = {n: {"lower": low, "upper": high} for n, (low, high) in intervals.items()}
    ends = fit.box.scale.values(np.array([fit.box.lower, fit.box.upper])).T.tolist()
    bounds = dict(zip(fit.box.names, map(tuple, ends), strict=True))
    curves = zip(refitted.names, refitted.costs, strict=True)
    ends_without_beat = {name: sides_without_beat(costs) for name, costs in curves}
    gaussian = fit.as_object()["parameters"]
    reasons = interval_agreement(gaussian, other, "profile likelihood", bounds, ends_without_beat)
    curves = FitProfiles(refitted, slices(likelihood, fit.box, x), intervals, ends_without_beat)
    return replace(fit, profile=intervals).judged(reasons), curves


def _explored(likelihood: Objective, fit: FitResult) -> np.ndarray:
    """Points all over the bounds, the best first: the starts of the search were drawn towards its best."""
    search = MultiStart(points_per_parameter=EXPLORED_PER_PARAMETER, seed=fit.settings.multi_start.seed)
    x = sobol(fit.box, search)
    costs = likelihood.evaluate(np.zeros(len(x), dtype=int), x, EXPLORING, REFITTING.resolution).costs
    return x[np.argsort(costs, kind="stable")[: int(np.isfinite(costs).sum())]]


def _interval_including(interval: tuple[float, float], within: np.ndarray) -> tuple[float, float]:
    """An interval that holds all values of points within 90 % too."""
    return min(interval[0], float(within.min())), max(interval[1], float(within.max()))


def _doubts_without_profile(fit: FitResult) -> list[Reason]:
    """Doubts of a fit beside which no profile can be computed, so that it determines no parameter."""
    why = (
        "no profile likelihood could be computed beside this fit, whose steady heartbeat is at the edge of "
        "those that there are: nothing checks the Gaussian intervals"
    )
    determined = [name for name, p in fit.parameters.items() if p.identifiable]
    about = [Reason(Aspect.INTERVALS, Level.DOUBTFUL, "", why)]
    return about + [
        Reason(Aspect.INTERVALS, Level.DOUBTFUL, name, f"{name}: not determined without a profile")
        for name in determined
    ]


def interval_90(values: np.ndarray, costs: np.ndarray, scale: Scale) -> tuple[float, float]:
    """Where a profile has risen by `RISE_90` for good, in the parameter's unit; its ends where it never does.

    Args:
        values: of the parameter, rising.
        costs: chi-square there; NaN without a steady beat: the first such value ends the interval, since the
            last beat lies somewhere before it.
        scale: coordinate of the parameter, along which the interval's ends are interpolated.
    """
    rise, limit = _rise(costs), np.sqrt(RISE_90)
    x = scale.coordinates(values[:, None])[:, 0]
    ends = []
    for step in (-1, 1):
        k = _last_within(rise, step)
        if k + step in (-1, len(x)):
            ends.append(values[k])
        elif not np.isfinite(rise[k + step]):
            ends.append(values[k + step])
        else:
            share = (limit - rise[k]) / (rise[k + step] - rise[k])
            ends.append(scale.value(0, x[k] + share * (x[k + step] - x[k])))
    return float(ends[0]), float(ends[1])


def sides_without_beat(costs: np.ndarray) -> tuple[str, ...]:
    """Ends of the 90 % interval of a profile, "lower" and "upper", that no steady beat was found beyond."""
    rise = np.pad(_rise(costs), 1)
    return tuple(
        side
        for step, side in ((-1, "lower"), (1, "upper"))
        if not np.isfinite(rise[1 + _last_within(rise[1:-1], step) + step])
    )


def _rise(costs: np.ndarray) -> np.ndarray:
    """Square root of the rise of chi-square from its least; infinite without a steady beat."""
    return np.sqrt(np.where(np.isfinite(costs), np.maximum(costs - np.nanmin(costs), 0.0), np.inf))


def _last_within(rise: np.ndarray, step: int) -> int:
    """Place of the last value within the 90 % interval on one side, before any without a beat."""
    least = int(np.argmin(rise))
    # Beyond a ridge there may be another minimum, as of a shunt in place of recirculation.
    side = rise[least::step]
    beats = np.append(np.isinf(side), True).argmax()
    return least + step * int(np.flatnonzero(side[:beats] <= np.sqrt(RISE_90))[-1])
