"""Cost along single parameters (slices and profiles), and parameters that compensate for others.

A slice (Figure S-2 of the paper) varies one parameter and keeps the others. In a profile the others are
fitted again and compensate: a parameter with a flat profile cannot be determined (Raue et al. 2009, doi
10.1093/bioinformatics/btp358). The linear analysis at an optimum cannot show that an undetermined parameter,
which may be a factor of ten from the truth, changes others with it. Each undetermined parameter is therefore
held at values well away from the optimum. A parameter that then ends elsewhere, too, at the same outputs, is
not determined.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

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
"""Values at which a parameter is held to see whether others follow, relative to the range of its bounds."""
SMALLEST_DISTANCE = 0.15
"""Values closer to the optimum than this, relative to the distance between the bounds, are left out."""
SAME_OUTPUTS = 3e-3
"""Outputs with a smaller relative difference count as the same: no measurement can distinguish them."""
EXPLORED_PER_PARAMETER, EXPLORED_STARTS = 64, 2
"""Number of points explored per parameter to find other valleys, and of those used as starts for a value."""
MOST_PASSES = 4
"""Largest number of passes of further fits at values next to the interval."""
SMALLEST_IMPROVEMENT = 0.1
"""A further pass follows if a fit lowers chi-square by more than this."""
HALVINGS = 3
"""Number of times that the step at the end of an interval is halved, to resolve a steep rise."""
STEPS = 9
STANDARD_STEPS = (-3.0, -1.65, -0.7, 0.7, 1.65, 3.0)
"""Further values of a parameter, in standard errors from the optimum."""


@dataclass(frozen=True)
class CostCurves:
    """Cost along each parameter.

    Args:
        names: names of the parameters.
        values: increasing values of each parameter in its unit, shape (parameters, steps).
        costs: sum of squared residuals; NaN where there is no steady beat, shape (parameters, steps).
        optimum: values of the parameters at the point that the curves pass through.
        cost: cost at this point.
        within: coordinates of all evaluated points whose cost is within `RISE_90` of the smallest, shape
            (points, parameters).
        lowest: coordinates of the evaluated point with the smallest cost.
        lowest_cost: cost there.
    """

    names: tuple[str, ...]
    values: np.ndarray
    costs: np.ndarray
    optimum: np.ndarray
    cost: float
    within: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    lowest: np.ndarray = field(default_factory=lambda: np.zeros(0))
    lowest_cost: float = np.inf


def slices(
    problem: LeastSquaresProblem,
    box: Box,
    x: np.ndarray,
    point: int = 0,
    steps: int = 41,
    further: np.ndarray | None = None,
) -> CostCurves:
    """Vary one parameter after the other from bound to bound, with the others held.

    Each curve also has a value at the point that it goes through: a valley may be narrower than a step.

    Args:
        problem: objective with one or more data points.
        box: bounds of the parameters.
        x: coordinates of the parameters that the slices go through.
        point: index of the data point.
        steps: number of equally spaced values of each parameter.
        further: further coordinates of each parameter, shape (parameters, further).
    """
    size = len(box.names)
    along = box.lower[:, None] + np.linspace(0.0, 1.0, steps) * box.width[:, None]
    along = np.column_stack([along, x, *([] if further is None else [further])])
    along = np.sort(along, axis=1)
    count = along.shape[1]
    members = np.tile(x, (size * count + 1, 1))
    for k in range(size):
        members[k * count : (k + 1) * count, k] = along[k]
    costs = _nan_where_infinite(problem.evaluate(np.full(len(members), point), members).costs)
    values = box.scale.values(along.T).T
    best = box.scale.values(x)
    return CostCurves(box.names, values, costs[:-1].reshape(size, count), best, float(costs[-1]))


def profiles(
    problem: LeastSquaresProblem,
    box: Box,
    x: np.ndarray,
    steps: int,
    further: np.ndarray | None = None,
    other_optima: np.ndarray | None = None,
    explored: np.ndarray | None = None,
) -> CostCurves:
    """Hold one parameter after the other at values from bound to bound and fit the others again.

    A fit that starts only from the optimum may end in a local minimum. Values next to the 90 % interval are
    therefore fitted again, from the results of other fits within it and from explored points, as long as that
    helps. Then the steps that contain the ends of the interval are halved, with such fits at the new values.

    Args:
        problem: objective; its first data point is used.
        box: bounds of the parameters.
        x: coordinates of the parameters at the optimum.
        steps: number of values of each parameter, in addition to the optimum.
        further: further coordinates at which each parameter is held, shape (parameters, further).
        other_optima: coordinates of other points that may meet the measurements, shape (points, parameters).
        explored: coordinates of points throughout the bounds, the best first, shape (points, parameters).
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
    lowest = int(np.argmin(fitted.costs))
    return CostCurves(
        box.names, box.scale.values(along.T).T, costs, box.scale.values(x), float(cost), fitted.within,
        fitted.x[lowest], float(fitted.costs[lowest]),
    )  # fmt: skip


def _refit_near_interval_ends(
    problem: LeastSquaresProblem,
    box: Box,
    along: np.ndarray,
    costs: np.ndarray,
    fitted: _FittedPoints,
    explored: np.ndarray,
    passes: int = MOST_PASSES,
) -> _FittedPoints:
    """Refit values next to the interval as long as that helps; updates `costs`, returns all points."""
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
    """Insert more values of each parameter, all with the same cost; values remain sorted."""
    along = np.column_stack([along, more])
    order = np.argsort(along, axis=1, kind="stable")
    costs = np.column_stack([costs, np.full(more.shape, cost)])
    return np.take_along_axis(along, order, axis=1), np.take_along_axis(costs, order, axis=1)


def _midpoints_at_interval_ends(along: np.ndarray, costs: np.ndarray) -> np.ndarray:
    """Midpoints of the steps that contain the lower and upper 90 % interval ends, shape (parameters, 2).

    If an interval reaches the last value, there is no such step, and its last step is used.
    """
    middles = []
    for values, rise in zip(along, map(_rise, costs), strict=True):
        ends = [(_last_within(rise, step), step) for step in (-1, 1)]
        outer = [k + step if 0 <= k + step < len(values) else k - step for k, step in ends]
        middles.append([0.5 * (values[k] + values[o]) for (k, _), o in zip(ends, outer, strict=True)])
    return np.array(middles)


@dataclass(frozen=True)
class _FittedPoints:
    """All points at which fits ended, shape (points, ...).

    Attributes:
        x: coordinates of the parameters.
        costs: costs of the points; infinite without a steady beat.
    """

    x: np.ndarray
    costs: np.ndarray

    @property
    def within(self) -> np.ndarray:
        """Points whose cost is within `RISE_90` of the smallest."""
        return self.x[self.costs <= self.costs.min() + RISE_90]

    def with_more(self, fits: Refinement) -> _FittedPoints:
        """Return these points and those of further fits."""
        return _FittedPoints(np.vstack([self.x, fits.x]), np.append(self.costs, fits.costs))

    def values_to_refit(
        self, along: np.ndarray, costs: np.ndarray, explored: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Values outside the 90 % interval but next to points within it, with starts for further fits.

        The starts are the nearest such point, the one furthest from it, and the best explored points near the
        value.

        Args:
            along: increasing values of each parameter, shape (parameters, steps).
            costs: costs at these values.
            explored: points throughout the bounds, the best first, shape (points, parameters).

        Returns:
            Indices of the parameters, indices of the values, and the starts, the last of shape (fits,
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
    """Fit again with one parameter held at a value; results have shape (fits, ...).

    Args:
        problem: objective with one or more data points.
        points: data point of each fit, shape (fits,).
        box: bounds of the parameters.
        x: coordinates from which the other parameters start, shape (fits, parameters).
        held: index of the parameter that each fit holds, -1 for none, shape (fits,).
        values: coordinate at which it is held, shape (fits,).
    """
    mask = held[:, None] == np.arange(x.shape[1])
    starts = np.where(mask, values[:, None], x)
    return refine(problem, points, starts, box, REFITTING, mask)


@dataclass(frozen=True)
class HeldFits:
    """Fits of one data point with one parameter held away from its optimum, shape (fits, ...).

    Args:
        held: index of the parameter that was held.
        x: coordinates of the parameters.
        change: largest relative change of a measured output from its value at the optimum; NaN without a
            steady beat.
        outputs: outputs of the problem.
    """

    held: np.ndarray
    x: np.ndarray
    change: np.ndarray
    outputs: np.ndarray

    def compensation(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Largest change of each parameter at the same outputs, and the held parameter it compensates.

        Args:
            x: coordinates of the parameters at the optimum, shape (parameters,).
        """
        same = self.change <= SAME_OUTPUTS
        if not same.any():
            return np.zeros(len(x)), np.zeros(len(x), dtype=int)
        moved = np.abs(self.x[same] - x)
        return moved.max(axis=0), self.held[same][moved.argmax(axis=0)]

    def intervals(
        self, names: Sequence[str], x: np.ndarray, squares: np.ndarray, least: float
    ) -> dict[str, tuple[float, float]]:
        """90 % interval of each held parameter in its unit, by the few values at which it was held.

        Args:
            names: names of the parameters.
            x: coordinates of the parameters at the optimum, shape (parameters,).
            squares: chi-square of each fit; NaN without a steady beat.
            least: chi-square at the optimum.
        """
        reach = {}
        for k in map(int, np.unique(self.held)):
            own, scale = self.held == k, Scale.of([names[k]])
            along, costs = np.append(self.x[own, k], x[k]), np.append(squares[own], least)
            order = np.argsort(along)
            values = np.array([scale.value(0, each) for each in along[order]])
            reach[names[k]] = interval_90(values, costs[order], scale)
        return reach


def held_fits(
    problem: LeastSquaresProblem,
    box: Box,
    optima: Sequence[np.ndarray],
    undetermined: Sequence[Sequence[int]],
) -> list[HeldFits]:
    """Hold undetermined parameters of several data points away from their optima, side by side."""
    plans = [values_to_hold(x, box, chosen) for x, chosen in zip(optima, undetermined, strict=True)]
    points = np.repeat(np.arange(len(plans)), [len(held) for held, _ in plans])
    if not len(points):
        nothing = np.zeros((0, len(box.names))), np.zeros(0), np.zeros((0, len(problem.outputs)))
        return [HeldFits(held, *nothing) for held, _ in plans]
    held, values = (np.concatenate(each) for each in zip(*plans, strict=True))
    stacked = np.stack(optima)
    refined = refit(problem, points, box, stacked[points], held, values)
    chosen = np.unique(points)
    optimal = np.full((len(plans), len(problem.outputs)), np.nan)
    optimal[chosen] = problem.evaluate(chosen, stacked[chosen], REFITTING.orbits, 1).outputs
    scale = np.where(problem.weights > 0.0, np.maximum(np.abs(optimal), 1e-3), np.inf)
    change = np.max(np.abs(refined.outputs - optimal[points]) / scale[points], axis=1)
    each = [points == k for k in range(len(plans))]
    return [
        HeldFits(held[members], refined.x[members], change[members], refined.outputs[members])
        for members in each
    ]


def values_to_hold(x: np.ndarray, box: Box, chosen: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the parameters to hold, and coordinates, well away from the optimum, to hold them at."""
    plan = [
        (k, value)
        for k in chosen
        for share in HELD_SHARES
        if abs((value := box.lower[k] + share * box.width[k]) - x[k]) >= SMALLEST_DISTANCE * box.width[k]
    ]
    return np.array([k for k, _ in plan], dtype=int), np.array([value for _, value in plan])


class FitProfiles(NamedTuple):
    """Chi-square (sum of squared differences in standard uncertainties) along each parameter.

    Attributes:
        refitted: curves with the other parameters fitted again.
        held: curves through the same point with the other parameters held.
    """

    refitted: CostCurves
    held: CostCurves


def with_profiles(fit: FitResult) -> tuple[FitResult, FitProfiles | None]:
    """Return the fit with profile intervals, judged by their agreement with the Gaussian ones.

    The profiles pass through the point of maximum likelihood, whatever the weights of the fit. There are none
    if the steady beat of the fit is so hard to find that no neighbouring one can be fitted.
    """
    target = fit.objective.targets[fit.number]
    likelihood = Objective(
        [Target(target.model, target.measured, fit.uncertainties)], fit.box.names, fit.objective.policy
    )
    starts = fit.optimum.distinct_ends
    best = refine(likelihood, np.zeros(len(starts), dtype=int), starts, fit.box, REFITTING)
    if not np.isfinite(best.costs).any():
        return fit.judged(_doubts_without_profile(fit)), None
    # Use the fit itself, unless another start is better or the fit's beat is too hard to find.
    centre = 0 if best.costs[0] <= best.costs.min() + SMALLEST_IMPROVEMENT else int(np.argmin(best.costs))
    refitted = _centred_profiles(likelihood, fit, best, centre)
    x = fit.box.scale.coordinates(refitted.optimum)
    within = fit.box.scale.values(refitted.within).T
    intervals, without_beat = {}, {}
    for name, values, costs, points in zip(
        refitted.names, refitted.values, refitted.costs, within, strict=True
    ):
        low, high = interval_90(values, costs, Scale.of([name]))
        intervals[name] = min(low, float(points.min())), max(high, float(points.max()))
        without_beat[name] = sides_without_beat(costs)
    other = {n: {"lower": low, "upper": high} for n, (low, high) in intervals.items()}
    ends = fit.box.scale.values(np.array([fit.box.lower, fit.box.upper])).T.tolist()
    bounds = dict(zip(fit.box.names, map(tuple, ends), strict=True))
    gaussian = fit.as_object()["parameters"]
    reasons = interval_agreement(gaussian, other, "profile likelihood", bounds, without_beat)
    reasons += doubts_of_a_lower_point(float(best.costs[0]), float(np.nanmin(refitted.costs)))
    along = fit.box.scale.coordinates(refitted.values.T).T
    curves = FitProfiles(refitted, slices(likelihood, fit.box, x, further=along))
    return replace(fit, profile=intervals).judged(reasons), curves


def _centred_profiles(likelihood: Objective, fit: FitResult, best: Refinement, centre: int) -> CostCurves:
    """Profiles through the most likely of the refined starts, or through a likelier point that they find."""
    others, explored = np.vstack([best.x, fit.optimum.starts.end]), _explored(likelihood, fit)

    def through(refined: Refinement, which: int, others: np.ndarray) -> CostCurves:
        spread = fit.box.covariance(refined.jacobians[which] * likelihood.weights[0][:, None])
        further = refined.x[which][:, None] + np.outer(np.sqrt(np.diag(spread)), STANDARD_STEPS)
        return profiles(likelihood, fit.box, refined.x[which], STEPS, further, others, explored)

    curves = through(best, centre, others)
    if curves.lowest_cost >= curves.cost - SMALLEST_IMPROVEMENT:
        return curves
    lower = refine(likelihood, np.zeros(1, dtype=int), curves.lowest[None], fit.box, REFITTING)
    if lower.costs[0] >= curves.cost - SMALLEST_IMPROVEMENT:
        return curves
    return through(lower, 0, np.vstack([curves.within, others]))


def doubts_of_a_lower_point(fitted: float, lowest: float) -> list[Reason]:
    """Doubt about a fit whose chi-square, refined, lies outside the 90 % region of the lowest one found."""
    if not fitted > lowest + RISE_90:
        return []
    sentence = (
        f"the profile likelihood found parameters with a chi-square of {lowest:.3g}; a search from the fit "
        f"ends at {fitted:.3g}, a local optimum: the values and Gaussian intervals of the fit are not the "
        "likeliest; repeat it with another seed (--seed), and free fewer parameters"
    )
    return [Reason(Aspect.INTERVALS, Level.DOUBTFUL, "", sentence)]


def _explored(likelihood: Objective, fit: FitResult) -> np.ndarray:
    """Points throughout the bounds, the best first; starts of the search were mixed with the best point."""
    search = MultiStart(points_per_parameter=EXPLORED_PER_PARAMETER, seed=fit.settings.multi_start.seed)
    x = sobol(fit.box, search)
    costs = likelihood.evaluate(np.zeros(len(x), dtype=int), x, EXPLORING, REFITTING.resolution).costs
    return x[np.argsort(costs, kind="stable")[: int(np.isfinite(costs).sum())]]


def _doubts_without_profile(fit: FitResult) -> list[Reason]:
    """Doubts about a fit for which no profile can be computed; it then determines no parameter."""
    why = (
        "no profile likelihood could be computed around this fit, as it is at the edge of the region with a "
        "steady heartbeat: the Gaussian intervals are unchecked"
    )
    sentences = {"": why} | {
        n: f"{n}: not determined without a profile" for n, p in fit.parameters.items() if p.identifiable
    }
    return [Reason(Aspect.INTERVALS, Level.DOUBTFUL, *each) for each in sentences.items()]


def interval_90(values: np.ndarray, costs: np.ndarray, scale: Scale) -> tuple[float, float]:
    """Values beyond which a profile stays above its minimum + `RISE_90`, else its ends, in their unit.

    Args:
        values: increasing values of the parameter.
        costs: chi-square at these values; NaN without a steady beat. The first such value ends the interval,
            since the last beat lies somewhere before it.
        scale: coordinate of the parameter, in which the ends of the interval are interpolated.
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
    """Ends ("lower", "upper") of a profile's 90 % interval beyond which no steady beat was found."""
    rise = np.pad(_rise(costs), 1)
    return tuple(
        side
        for step, side in ((-1, "lower"), (1, "upper"))
        if not np.isfinite(rise[1 + _last_within(rise[1:-1], step) + step])
    )


def _rise(costs: np.ndarray) -> np.ndarray:
    """Square root of chi-square above its minimum; infinite without a steady beat."""
    return np.sqrt(np.where(np.isfinite(costs), np.maximum(costs - np.nanmin(costs), 0.0), np.inf))


def _last_within(rise: np.ndarray, step: int) -> int:
    """Index of the last value within the 90 % range on one side, before any value without a steady beat."""
    least = int(np.argmin(rise))
    # Beyond a ridge there may be another minimum, such as a shunt instead of recirculation.
    side = rise[least::step]
    beats = np.append(np.isinf(side), True).argmax()
    return least + step * int(np.flatnonzero(side[:beats] <= np.sqrt(RISE_90))[-1])
