"""How the cost rises when one parameter is held at other values: slices, profiles, and what else moves.

A slice (Figure S-2 of the paper) moves one parameter and leaves the others; in a profile they are fitted
again and make up for it: a flat profile is a parameter that cannot be determined (Raue et al. 2009, doi
10.1093/bioinformatics/btp358). The linear analysis at an optimum cannot see that an undetermined parameter,
which may be a factor of ten from the truth, carries others with it: each of those is held at values well
away from the optimum, and a parameter that then ends elsewhere too, at the same outputs, is not determined.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from eclsim.identification.least_squares import Refinement, Tolerances, refine
from eclsim.identification.objective import Box, LeastSquaresProblem, Objective, Target
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
APART = 0.15
"""A share nearer to the optimum than this, in widths of the bounds, is left out."""
SAME_OUTPUTS = 3e-3
"""Outputs that differ by less than this share are the same: no measurement tells them apart."""
RISE_90 = 2.705543454095404
"""A chi-square with one degree of freedom stays below this in 90 % of all cases."""
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
    """

    names: tuple[str, ...]
    values: np.ndarray
    costs: np.ndarray
    optimum: np.ndarray
    cost: float


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
    costs = _nan_for_none(problem.evaluate(np.full(len(members), point), members).costs)
    values = box.scale.values(along.T).T
    best = box.scale.values(x)
    return CostCurves(box.names, values, costs[:-1].reshape(size, steps), best, float(costs[-1]))


def profiles(
    problem: LeastSquaresProblem, box: Box, x: np.ndarray, steps: int, further: np.ndarray | None = None
) -> CostCurves:
    """Hold one parameter after the other at values from bound to bound, the others fitted again.

    Args:
        problem: its first data point is meant.
        box: bounds.
        x: coordinates of the parameters at the optimum.
        steps: values of each parameter, besides the optimum's own.
        further: coordinates of each parameter to hold it at as well, shape (parameters, further).
    """
    size = len(box.names)
    along = box.lower[:, None] + np.linspace(0.0, 1.0, steps) * box.width[:, None]
    if further is not None:
        along = np.column_stack([along, np.clip(further, box.lower[:, None], box.upper[:, None])])
    steps = along.shape[1]
    held = np.repeat(np.arange(size), steps)
    points = np.zeros(len(held), dtype=int)
    refined = refit(problem, points, box, np.tile(x, (len(held), 1)), held, along.ravel())
    cost = problem.evaluate(points[:1], x[None], resolution=1).costs[0]
    costs = _nan_for_none(refined.costs).reshape(size, steps)
    values = np.column_stack([along, x])
    order = np.argsort(values, axis=1, kind="stable")
    costs = np.take_along_axis(np.column_stack([costs, np.full(size, cost)]), order, axis=1)
    values = np.take_along_axis(values, order, axis=1)
    return CostCurves(box.names, box.scale.values(values.T).T, costs, box.scale.values(x), float(cost))


def _nan_for_none(costs: np.ndarray) -> np.ndarray:
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
    plans = [held_values(x, box, chosen) for x, chosen in zip(optima, undetermined, strict=True)]
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


def held_values(x: np.ndarray, box: Box, chosen: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Places of the parameters to hold, and coordinates well away from the optimum to hold them at."""
    plan = [
        (k, value)
        for k in chosen
        for share in HELD_SHARES
        if abs((value := box.lower[k] + share * box.width[k]) - x[k]) >= APART * box.width[k]
    ]
    return np.array([k for k, _ in plan], dtype=int), np.array([value for _, value in plan])


@dataclass(frozen=True)
class FitProfiles:
    """Sum of squared differences in standard uncertainties (chi-square) along each parameter.

    Args:
        refitted: the others fitted again.
        held: the others held, through the same point.
        intervals: 90 % interval of each parameter, in its unit: chi-square within `RISE_90` of its least.
        beatless: "lower" and "upper" ends of intervals that no steady beat was found beyond, by parameter.
    """

    refitted: CostCurves
    held: CostCurves
    intervals: Mapping[str, tuple[float, float]]
    beatless: Mapping[str, tuple[str, ...]]


def with_profiles(fit: FitResult) -> tuple[FitResult, FitProfiles | None]:
    """The fit with its profile intervals, judged by whether they agree with its Gaussian ones.

    The profiles go through the parameters that are likeliest, whatever the weights of the fit. There are none
    where the steady beat of the fit is so hard to find that no other can be fitted beside it.
    """
    target = fit.objective.targets[fit.number]
    likelihood = Objective(
        [Target(target.model, target.measured, fit.uncertainties)], fit.box.names, fit.objective.policy
    )
    point = np.zeros(1, dtype=int)
    best = refine(likelihood, point, fit.optimum.x[None], fit.box, REFITTING)
    if not np.isfinite(best.costs[0]):
        return fit.judged([_WITHOUT]), None
    scaled = best.jacobians[0] * likelihood.weights[0][:, None]
    spread = fit.box.covariance(scaled)
    further = best.x[0][:, None] + np.outer(np.sqrt(np.diag(spread)), STANDARD_STEPS)
    refitted = profiles(likelihood, fit.box, best.x[0], steps=STEPS, further=further)
    intervals = {
        name: interval_90(values, costs, Scale.of([name]))
        for name, values, costs in zip(refitted.names, refitted.values, refitted.costs, strict=True)
    }
    other = {n: {"lower": low, "upper": high} for n, (low, high) in intervals.items()}
    ends = fit.box.scale.values(np.array([fit.box.lower, fit.box.upper])).T.tolist()
    bounds = dict(zip(fit.box.names, map(tuple, ends), strict=True))
    curves = zip(refitted.names, refitted.costs, strict=True)
    beatless = {name: without_beat_beyond(costs) for name, costs in curves}
    gaussian = fit.as_object()["parameters"]
    reasons = interval_agreement(gaussian, other, "profile likelihood", bounds, beatless)
    curves = FitProfiles(refitted, slices(likelihood, fit.box, best.x[0]), intervals, beatless)
    return replace(fit, profile=intervals).judged(reasons), curves


_WITHOUT = Reason(
    Aspect.INTERVALS, Level.DOUBTFUL, "",
    "no profile likelihood could be computed beside this fit, whose steady heartbeat is at the edge of those "
    "that there are: nothing checks the Gaussian intervals",
)  # fmt: skip


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


def without_beat_beyond(costs: np.ndarray) -> tuple[str, ...]:
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
