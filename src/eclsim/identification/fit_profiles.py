"""Profile likelihood of a fit: how far each parameter can move before the measurements speak against it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from eclsim.identification.least_squares import refine
from eclsim.identification.objective import Objective, Target
from eclsim.identification.precision import covariance, prior_deviations
from eclsim.identification.profiles import REFITTING, Profiles, profiles
from eclsim.identification.slices import Slices, slices
from eclsim.identification.verdict import interval_agreement

if TYPE_CHECKING:
    from eclsim.identification.fit import Fit

RISE_90 = 2.705543454095404
"""A chi-square with one degree of freedom stays below this in 90 % of all cases."""
STEPS = 9
NEAR = (-3.0, -1.65, -0.7, 0.7, 1.65, 3.0)
"""Further values of a parameter, in standard errors from the best one."""


@dataclass(frozen=True)
class FitProfiles:
    """Sum of squared differences in standard uncertainties (chi-square) along each parameter.

    Args:
        found: the others fitted again.
        along: the others held, through the same point.
        intervals: 90 % interval of each parameter, in its unit: chi-square within `RISE_90` of its least.
    """

    found: Profiles
    along: Slices
    intervals: Mapping[str, tuple[float, float]]


def fit_profiles(fit: Fit) -> FitProfiles:
    """Profile likelihoods through the parameters that are likeliest, whatever the weights of the fit.

    Args:
        fit: with a steady beat.
    """
    target = fit.objective.targets[fit.number]
    likelihood = Objective(
        [Target(target.model, target.measured, fit.uncertainties)], fit.box.names, fit.objective.policy
    )
    one = np.zeros(1, dtype=int)
    best = refine(likelihood, one, fit.optimum.x[None], fit.box, replace(REFITTING, resolution=1))
    scaled = best.jacobians[0] * likelihood.weights[0][:, None]
    spread = covariance(scaled, prior_deviations(fit.box.lower, fit.box.upper))
    near = best.x[0][:, None] + np.outer(np.sqrt(np.diag(spread)), NEAR)
    found = profiles(likelihood, fit.box, best.x[0], steps=STEPS, near=near)
    along = slices(likelihood, fit.box, best.x[0])
    intervals = {
        name: interval_90(values, costs)
        for name, values, costs in zip(found.names, found.values, found.costs, strict=True)
    }
    return FitProfiles(found, along, intervals)


def with_profiles(fit: Fit) -> tuple[Fit, FitProfiles]:
    """The fit with its profile intervals, judged by whether they agree with its Gaussian ones."""
    found = fit_profiles(fit)
    other = {n: {"lower": low, "upper": high} for n, (low, high) in found.intervals.items()}
    reasons = interval_agreement(fit.as_object()["parameters"], other, "profile likelihood")
    return replace(fit, profile=found.intervals).judged(reasons), found


def interval_90(values: np.ndarray, costs: np.ndarray) -> tuple[float, float]:
    """Where a profile has risen by `RISE_90`, in the parameter's unit; its ends where it never does.

    Args:
        values: of the parameter, rising.
        costs: chi-square there; NaN without a steady beat, which ends the interval.
    """
    least = int(np.nanargmin(costs))
    rise = np.sqrt(np.where(np.isfinite(costs), np.maximum(costs - costs[least], 0.0), np.inf))
    limit, x = np.sqrt(RISE_90), np.log(values)
    ends = []
    for step, last in ((-1, 0), (1, len(x) - 1)):
        k = least
        while k != last and rise[k + step] <= limit:
            k += step
        if k == last or not np.isfinite(rise[k + step]):
            ends.append(values[k])
            continue
        share = (limit - rise[k]) / (rise[k + step] - rise[k])
        ends.append(np.exp(x[k] + share * (x[k + step] - x[k])))
    return float(ends[0]), float(ends[1])
