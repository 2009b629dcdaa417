"""Exact derivatives of a steady beat by the implicit function theorem.

On the orbit F(y, p) = y - beat(y, p) + u (w . y - c(p)) = 0, so

    dy/dp = (I - dbeat/dy + u w^T)^-1 (dbeat/dp + u dc/dp).

One beat with forward tangents in all states and parameters gives dbeat/dy, dbeat/dp and the tangents of
weighted sums of the signals: exact derivatives of the discrete map, whatever the step.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import jax
import numpy as np

from eclsim.beat.compilation import compiled
from eclsim.beat.heartbeat import BeatProgram
from eclsim.orbit.equation import Anchor, OrbitProblem
from eclsim.orbit.status import NoDerivativesError, Status

Array = np.ndarray | jax.Array
LARGEST_CONDITION = 1e12
"""Condition number of the beat's equation above which fewer than four digits of a derivative are correct."""
SINGULAR = (
    "the equation of the steady beat is singular, so that a small change of a parameter may not change the "
    "beat smoothly: usually blood is trapped behind a valve that never opens; change the elastances or the "
    "pump speed until every valve opens"
)
DIRECTIONS_PER_VECTOR = 8
"""Number of directions is padded to a multiple of this, so that vector loops have no remainder."""
PARAMETERS_AT_ONCE = 8
"""Parameter directions in a run of the compiled beat; one program (10 s) serves any number of parameters."""


@dataclass(frozen=True)
class OrbitDerivatives:
    """Derivatives of a steady beat with respect to parameters and states.

    Args:
        states: d state / d parameter, shape (states, parameters).
        sums: d sum / d parameter of each weighted sum of signals, shape (sums, parameters).
        sums_of_states: d sum / d state at phase 0, shape (sums, states).
        anchor: start for the search for a nearby orbit.
        step: Newton step from the given state to the orbit, shape (states,).
        sizes: sizes of the states to which their changes are relative, shape (states,).
    """

    states: np.ndarray
    sums: np.ndarray
    sums_of_states: np.ndarray
    anchor: Anchor
    step: np.ndarray
    sizes: np.ndarray

    def combined(self, count: int, following: np.ndarray) -> OrbitDerivatives:
        """Derivatives with respect to the first parameters only, if the others are functions of them.

        Args:
            count: number of the first parameters.
            following: d other / d first, shape (others, count).
        """
        states, sums = (table[:, :count] + table[:, count:] @ following for table in (self.states, self.sums))
        return replace(self, states=states, sums=sums)

    @property
    def distance(self) -> float:
        """Largest change of a state in the Newton step, relative to its size."""
        return float(np.max(np.abs(self.step) / self.sizes))


def orbit_derivatives(
    problem: OrbitProblem,
    state: np.ndarray,
    parameters: Sequence[str],
    volume_slopes: np.ndarray,
    signals: tuple[str, ...] = (),
    weights: np.ndarray | None = None,
) -> OrbitDerivatives:
    """Derivatives of one member's steady beat with respect to any parameters.

    Args:
        problem: problem of one member.
        state: state on its orbit or close to it, shape (states,).
        parameters: names of parameters; the beat depends only on `heart_rate_bpm` and on those that the
            circuit reads.
        volume_slopes: d blood volume / d parameter [mL per unit], shape (parameters,).
        signals: signal of each weighted sum (see `Recorder`).
        weights: weight of each step in each sum, shape (steps, sums).

    Raises:
        NoDerivativesError: the equation of the beat is singular.
    """
    program, packed = problem.program, problem.packed[:, 0]
    n, m = len(state), len(parameters)
    at_once = -(-(n + PARAMETERS_AT_ONCE) // DIRECTIONS_PER_VECTOR) * DIRECTIONS_PER_VECTOR
    padded = -(-(n + m) // at_once) * at_once
    directions = np.zeros((padded, n)), np.zeros((padded, len(packed)))
    directions[0][:n] = np.eye(n)
    for k, name in enumerate(parameters):
        if name in program.names:
            directions[1][n + k, program.names.index(name)] = 1.0
    table = np.zeros((program.grid.n_steps, 0)) if weights is None else weights
    run = _tangents(program, signals)
    blocks = [slice(begin, begin + at_once) for begin in range(0, padded, at_once)]
    results = [run(state, packed, *(one[block] for one in directions), table) for block in blocks]
    after, ends, sums_of_blocks = zip(*results, strict=True)
    end, sums = (np.concatenate(tangents)[: n + m].T for tangents in (ends, sums_of_blocks))
    spread, volume = problem.spread[:, 0], problem.volume
    inverse = _inverse(np.eye(n) - end[:, :n] + np.outer(spread, volume.weights))
    states = inverse @ (end[:, n:] + np.outer(spread, volume_slopes))
    step = -inverse @ (state - np.asarray(after[0]) + spread * (volume.weights @ state - volume.target[0]))
    anchor = Anchor(state, inverse * problem.scale[:, 0] / problem.scale)
    return OrbitDerivatives(
        states,
        sums[:, n:] + sums[:, :n] @ states,
        sums[:, :n],
        anchor,
        step,
        np.maximum(np.abs(state), problem.layout.smallest_sizes),
    )


def exact_jacobian(problem: OrbitProblem, state: np.ndarray) -> np.ndarray:
    """dF/dy of one member at a state, in scaled states, shape (states, states)."""
    n = len(state)
    padded, steps = -(-n // DIRECTIONS_PER_VECTOR) * DIRECTIONS_PER_VECTOR, problem.program.grid.n_steps
    directions = np.eye(padded, n), np.zeros((padded, len(problem.packed)))
    tangents = _tangents(problem.program, ())(state, problem.packed[:, 0], *directions, np.zeros((steps, 0)))
    end = np.asarray(tangents[1])[:n].T
    system = np.eye(n) - end + np.outer(problem.spread[:, 0], problem.volume.weights)
    return system * problem.scale[:, 0] / problem.scale


def _inverse(system: np.ndarray) -> np.ndarray:
    """Inverse of a matrix; raises `NoDerivativesError` if it is singular to working accuracy."""
    try:
        inverse = np.linalg.inv(system)
    except np.linalg.LinAlgError:
        inverse = np.full_like(system, np.inf)
    with np.errstate(invalid="ignore"):
        condition = np.linalg.norm(system, 1) * np.linalg.norm(inverse, 1)
    if not condition <= LARGEST_CONDITION:
        raise NoDerivativesError(Status.CONVERGED, SINGULAR)
    return inverse


@lru_cache(maxsize=64)
def _tangents(program: BeatProgram, signals: tuple[str, ...]) -> Callable[..., tuple[Array, Array, Array]]:
    """Compiled map (state, parameters, directions, weights) -> end state, its tangents, tangents of sums."""

    def run(
        state: Array, packed: Array, of_state: Array, of_packed: Array, weights: Array
    ) -> tuple[Array, Array, Array]:
        def along(ds: Array, dp: Array) -> tuple[Array, tuple[Array, Array]]:
            (end, _), tangents = jax.jvp(
                lambda s, p: program.run(s, p, signals, weights), (state, packed), (ds, dp)
            )
            return end, tangents

        end, tangents = jax.vmap(along, out_axes=(None, 0))(of_state, of_packed)
        return end, *tangents

    return compiled(run, ("tangents", program, signals))
