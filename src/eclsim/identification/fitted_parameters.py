"""The parameters of a fit, with their 90 % intervals, and whether the measurements determine them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from eclsim.identification.multi_start import Optimum
from eclsim.identification.objective import NORMAL_90, Box, Objective
from eclsim.identification.verdict import Aspect, Level, Reason, intervals_differ
from eclsim.sensitivity.identifiability import ScaledSensitivities, propose

AT_BOUND = 1e-6
LARGEST_DETERMINED_ERROR = 0.5
"""Largest standard error of a determined parameter, relative to the standard deviation between its bounds."""
SAME_PARAMETER_SHARE = 0.05
"""A parameter is not determined if fits that agree differ in it by more than this share."""
LARGEST_GAIN_BEYOND_BOUND = 1.0
"""A bound holds a parameter back if chi-square would fall by more than this beyond the bound."""
GAIN_THAT_SPOILS_FIT = 6.0
"""A bound spoils the fit if chi-square would fall by more than this beyond the bound."""


@dataclass(frozen=True)
class FittedParameter:
    """A parameter with its 90 % interval, in the parameter's unit.

    Args:
        value: the estimate.
        lower: lower end of the interval, which is limited by the bounds.
        upper: upper end of the interval, likewise limited.
        at_bound: whether the estimate is at a bound.
        identifiable: whether the measurements determine the parameter.
        reason: reason why they do not; empty if they do.
    """

    value: float
    lower: float
    upper: float
    at_bound: bool
    identifiable: bool
    reason: str


def _at_bounds(optimum: Optimum, box: Box) -> tuple[np.ndarray, np.ndarray]:
    """Whether each parameter is at its lower bound, and whether at its upper bound."""
    return optimum.x <= box.lower + AT_BOUND, optimum.x >= box.upper - AT_BOUND


def gains_beyond_bounds(
    objective: Objective, number: int, optimum: Optimum, box: Box, chi_square: float
) -> np.ndarray:
    """Predicted decrease of chi-square if each parameter at a bound could move beyond it.

    Computed from the derivatives with the other parameters held, shape (parameters,); 0 inside the bounds.
    """
    low, high = _at_bounds(optimum, box)
    gains = np.zeros(len(box.names))
    if optimum.shared is not None or not optimum.cost > 0.0:
        return gains
    weights = objective.weights[number]
    residuals = (optimum.outputs - objective.measured[number]) * weights
    columns = optimum.jacobian * weights[:, None]
    slopes, lengths = residuals @ columns, np.maximum(np.sum(columns**2, axis=0), 1e-300)
    outward = (low & (slopes > 0.0)) | (high & (slopes < 0.0))
    gains[outward] = (slopes**2 / lengths)[outward] / optimum.cost * chi_square
    return gains


def doubts_of_bounds(parameters: Mapping[str, FittedParameter], gains: np.ndarray) -> list[Reason]:
    """Return doubts about a fit in which a bound prevents agreement with the measurements."""
    return [
        Reason(
            Aspect.AGREEMENT, Level.DOUBTFUL, name,
            f"{name} {p.reason}; try wider --bounds if such a value is possible",
        )
        for (name, p), gain in zip(parameters.items(), gains, strict=True)
        if gain > GAIN_THAT_SPOILS_FIT
    ]  # fmt: skip


def nothing_identifiable(parameters: Mapping[str, FittedParameter]) -> list[Reason]:
    """Return a doubt about a fit whose measurements determine none of its parameters."""
    if not parameters or any(p.identifiable for p in parameters.values()):
        return []
    sentence = (
        f"the measurements determine none of the fitted parameters ({', '.join(parameters)}): each value is "
        "one of many that meet them; measure more, or free fewer parameters"
    )
    return [Reason(Aspect.AGREEMENT, Level.DOUBTFUL, "", sentence)]


def fitted_parameters(
    optimum: Optimum, box: Box, scaled: ScaledSensitivities, errors: np.ndarray, gains: np.ndarray,
    as_good: np.ndarray,
) -> dict[str, FittedParameter]:  # fmt: skip
    """Compute the values and intervals of parameters, and whether the measurements determine them.

    The interval of a parameter includes every start that met the measurements as well, in whichever valley.
    """
    low, high = _at_bounds(optimum, box)
    excluded = propose(scaled).excluded if optimum.shared is None else optimum.shared.excluded
    agreed = optimum.starts.end[optimum.starts.agreeing]
    differ = np.ptp(agreed, axis=0) if len(agreed) else np.zeros(len(box.names))
    gaussian = box.clip(optimum.x + np.outer((-NORMAL_90, NORMAL_90), errors))
    known = gaussian if optimum.shared else np.vstack([gaussian, as_good])
    ends = np.array([known.min(axis=0), known.max(axis=0)])
    parameters = {}
    for k, name in enumerate(box.names):
        reason = excluded.get(name, "")
        if low[k] or high[k]:
            reason = _at_bound("lower" if low[k] else "upper", bool(gains[k] > LARGEST_GAIN_BEYOND_BOUND))
        elif not reason and differ[k] > np.log1p(SAME_PARAMETER_SHARE):
            reason = f"starts that fit equally well differ by {box.scale.difference_text(k, differ[k])}"
        elif not reason and errors[k] > LARGEST_DETERMINED_ERROR * box.prior_deviations[k]:
            reason = f"fitted with the others, its standard error is {box.scale.error(k, errors[k])}"
        lower, upper, value = (box.scale.value(k, x[k]) for x in (*ends, optimum.x))
        if not reason and intervals_differ(ends[:, k], gaussian[:, k]):
            reason = (
                f"other starts of the search fit the measurements equally well (90 %) from {lower:.3g} to "
                f"{upper:.3g}, a far wider interval than the derivatives at the fit give"
            )
        parameters[name] = FittedParameter(value, lower, upper, bool(low[k] or high[k]), not reason, reason)
    return parameters


def _at_bound(side: str, held_back: bool) -> str:
    """Reason why a value at a bound is not determined."""
    beyond = "smaller" if side == "lower" else "larger"
    if held_back:
        return (
            f"at its {side} bound, which limits it: {beyond} values would fit the measurements better, so "
            "the true value may be beyond the bound"
        )
    return f"at its {side} bound, and the measurements hardly distinguish {beyond} values"


def with_wider_intervals(
    fitted: Mapping[str, FittedParameter], reaches: Mapping[str, tuple[float, float]]
) -> dict[str, FittedParameter]:
    """Return the parameters, some with intervals that reach at least to given ends."""
    wider = {
        name: replace(fitted[name], lower=min(low, fitted[name].lower), upper=max(high, fitted[name].upper))
        for name, (low, high) in reaches.items()
    }
    return {**fitted, **wider}
