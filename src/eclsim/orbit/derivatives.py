"""Exact derivatives of a steady beat by the implicit function theorem.

On the orbit F(y, p) = y - beat(y, p) + u (w . y - c(p)) = 0, so

    dy/dp = (I - dbeat/dy + u w^T)^-1 (dbeat/dp + u dc/dp).

One beat with forward tangents in all states and parameters gives dbeat/dy, dbeat/dp and the tangents of
weighted sums of the signals: exact derivatives of the discrete map, whatever the step.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import jax
import numpy as np

from eclsim.beat.compilation import compiled
from eclsim.beat.heartbeat import BeatProgram, beat_program
from eclsim.circuit.assembly import assemble
from eclsim.orbit.equation import Anchor, OrbitProblem
from eclsim.orbit.model import AS_PUBLISHED
from eclsim.orbit.status import NoDerivativesError, Status
from eclsim.orbit.steady import Batch, SteadyBeats

COMPLEX_STEP = 1e-30
LARGEST_CONDITION = 1e12
"""Condition number of the beat's equation from which fewer than four figures of a derivative are right."""
SINGULAR = (
    "the equation of the steady beat is singular, so that a small change of a parameter need not change the "
    "beat a little: usually a valve that never opens shuts blood in behind it; change the elastances or the "
    "pump speed until every valve opens"
)
LANES = 8
"""Directions are padded to a multiple, so that vector loops have no remainder."""


@dataclass(frozen=True)
class OrbitTangents:
    """Derivatives of a steady beat.

    Args:
        states: d state / d parameter, shape (states, parameters).
        sums: d sum / d parameter for each weighted sum of signals, shape (sums, parameters).
        monodromy: dbeat/dy, shape (states, states).
        anchor: where the search for an orbit close by may start.
    """

    states: np.ndarray
    sums: np.ndarray
    monodromy: np.ndarray
    anchor: Anchor

    @property
    def multipliers(self) -> np.ndarray:
        """Eigenvalues of dbeat/dy (Floquet multipliers), largest first, shape (states,)."""
        found = np.linalg.eigvals(self.monodromy)
        return found[np.argsort(-np.abs(found))]


def orbit_tangents(
    steady: SteadyBeats,
    parameters: tuple[str, ...],
    signals: tuple[str, ...] = (),
    weights: np.ndarray | None = None,
    member: int = 0,
) -> OrbitTangents:
    """Derivatives of one patient's steady beat with respect to any parameters.

    Args:
        steady: solved orbits.
        parameters: names, among those that the circuit reads and `heart_rate_bpm`.
        signals: signal of each weighted sum (see `Recorder`).
        weights: weights of each sum at the end of every step, shape (steps, sums).
        member: which patient.

    Raises:
        NoDerivativesError: no steady beat was found, or its equation is singular.
    """
    steady.require_steady(member)
    batch = steady.batch
    program = beat_program(batch.circuit, int(steady.resolution[member]))
    packed = batch.packed(program)[:, member]
    state = steady.orbits.states[:, member]
    n, m = len(state), len(parameters)
    lanes = -(-(n + m) // LANES) * LANES
    directions = np.zeros((lanes, n)), np.zeros((lanes, len(packed)))
    directions[0][:n] = np.eye(n)
    for k, name in enumerate(parameters):
        directions[1][n + k, program.names.index(name)] = 1.0
    table = np.zeros((program.grid.n_steps, 0)) if weights is None else weights
    end, sums = (
        np.asarray(t)[: n + m].T for t in _tangents(program, signals)(state, packed, *directions, table)
    )
    problem = OrbitProblem(program, packed[:, None], batch.volume())
    spread = problem.spread[:, 0]
    system = np.eye(n) - end[:, :n] + np.outer(spread, problem.volume.weights)
    values = dict(zip(program.names, packed, strict=True))
    right = end[:, n:] + np.outer(spread, _volume_gradient(batch, values, parameters))
    inverse = _inverse(system)
    states = inverse @ right
    anchor = Anchor(state, inverse * problem.scale[:, 0] / problem.scale)
    return OrbitTangents(states, sums[:, n:] + sums[:, :n] @ states, end[:, :n], anchor)


def _inverse(system: np.ndarray) -> np.ndarray:
    """Inverse of a system; `NoDerivativesError` where it is singular to working accuracy."""
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
def _tangents(program: BeatProgram, signals: tuple[str, ...]) -> Any:
    """Compiled map (state, parameters, directions, weights) -> tangents of end state and of sums."""

    def run(state: Any, packed: Any, state_directions: Any, packed_directions: Any, weights: Any) -> Any:
        def one(ds: Any, dp: Any) -> Any:
            return jax.jvp(lambda s, p: program.run(s, p, signals, weights), (state, packed), (ds, dp))[1]

        return jax.vmap(one)(state_directions, packed_directions)

    return compiled(run, ("tangents", program, signals))


def _volume_gradient(batch: Batch, values: dict[str, float], parameters: tuple[str, ...]) -> np.ndarray:
    """d c / d p of the blood volume condition [mL per unit], by a complex step; shape (parameters,)."""
    assembly = assemble(batch.circuit)
    counted = [batch.policy == AS_PUBLISHED or c.group == "patient" for c in batch.circuit.compartments]
    shifted: dict[str, Any] = dict(values)
    for k, name in enumerate(parameters):
        shifted[name] = values[name] + 1j * COMPLEX_STEP * (np.arange(len(parameters)) == k)
    start = assembly.start_volumes(shifted)
    total = sum(np.imag(v) for v, own in zip(start, counted, strict=True) if own)
    return np.broadcast_to(total, (len(parameters),)) / COMPLEX_STEP
