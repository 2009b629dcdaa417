"""A linearly implicit step with error control, because refill and drugs are stiff compared with a day.

ROS34PW2 (Rang and Angermann 2005, doi 10.1007/s10543-005-0035-y): four stages, order 3, an embedded solution
of order 2, stiffly accurate. As a W-method it keeps its order with any approximation of the Jacobian. One
from finite differences, kept over many steps, can therefore only reduce stability. Linear invariants of the
laws (a balance of volumes) are conserved to rounding, since the approximation conserves them, too.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

GAMMA = 0.435866521508459
ALPHA = (
    (),
    (0.87173304301691801,),
    (0.84457060015369423, -0.11299064236484185),
    (0.0, 0.0, 1.0),
)
COUPLING = (
    (),
    (-0.87173304301691801,),
    (-0.90338057013044082, 0.054180672388095326),
    (0.24212380706095346, -1.2232505839045147, 0.54526025533510214),
)
WEIGHTS = (0.24212380706095346, -1.2232505839045147, 1.5452602553351020, 0.435866521508459)
EMBEDDED = (0.37810903145819369, -0.096042292212423178, 0.5, 0.21793326075422950)
TIMES = tuple(sum(row) for row in ALPHA)
"""Times of the stages, as shares of the step."""

Rates = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Maps (time, states) to rates and whether each member has rates; members are the last dimension."""


class Step(NamedTuple):
    """Steps of some members.

    Attributes:
        states: states at the ends of the steps, shape (states, members).
        error: estimated errors, shape (states, members).
        done: whether all stages of a member had rates, shape (members,).
    """

    states: np.ndarray
    error: np.ndarray
    done: np.ndarray


def step(
    rates: Rates, first: np.ndarray, time: np.ndarray, states: np.ndarray, length: np.ndarray,
    jacobian: np.ndarray,
) -> Step:  # fmt: skip
    """Advance every member by one step.

    Args:
        rates: function for the rates of change.
        first: rates at the beginning of the steps, shape (states, members).
        time: times at the beginning, shape (members,).
        states: states at the beginning, shape (states, members).
        length: lengths of the steps, shape (members,).
        jacobian: Jacobians of the rates, shape (members, states, states).
    """
    n = len(states)
    matrix = np.eye(n) - GAMMA * length[:, None, None] * jacobian
    solved, stages = np.ones(len(length), dtype=bool), list[np.ndarray]()
    for k, (alpha, coupling) in enumerate(zip(ALPHA, COUPLING, strict=True)):
        slope = first
        if k:
            place = states + sum(a * s for a, s in zip(alpha, stages, strict=True))
            slope, has_rates = rates(time + TIMES[k] * length, place)
            solved &= has_rates
        right = length * slope
        if coupling:
            mixed = sum(c * s for c, s in zip(coupling, stages, strict=True))
            right = right + length * np.einsum("mij,jm->im", jacobian, mixed)
        right = np.where(np.isfinite(right), right, 0.0)
        stages.append(np.linalg.solve(matrix, right.T[..., None])[..., 0].T)
    end = states + sum(w * s for w, s in zip(WEIGHTS, stages, strict=True))
    difference = [w - e for w, e in zip(WEIGHTS, EMBEDDED, strict=True)]
    return Step(end, np.asarray(sum(d * s for d, s in zip(difference, stages, strict=True))), solved)


def between(
    time: np.ndarray, ends: tuple[float, float], states: tuple[np.ndarray, np.ndarray],
    rates: tuple[np.ndarray, np.ndarray],
) -> np.ndarray:  # fmt: skip
    """States of a member within a step by cubic Hermite interpolation, shape (states, times)."""
    length = ends[1] - ends[0]
    u = np.clip((time - ends[0]) / length, 0.0, 1.0) if length > 0.0 else np.ones_like(time)
    (a, b), (da, db) = ([x[:, None] for x in pair] for pair in (states, rates))
    rise = b - a
    return a + u * rise + u * (1.0 - u) * ((1.0 - u) * (length * da - rise) - u * (length * db - rise))
