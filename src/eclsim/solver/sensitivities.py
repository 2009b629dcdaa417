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

from eclsim.circuit.assembly import assemble
from eclsim.solver.beat import BeatProgram, beat_program
from eclsim.solver.kernel import compiled
from eclsim.solver.model import AS_PUBLISHED
from eclsim.solver.orbit import Anchor, OrbitProblem
from eclsim.solver.steady import Batch, SteadyBeats

COMPLEX_STEP = 1e-30
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
    """
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
    inverse = np.linalg.inv(system)
    states = inverse @ right
    anchor = Anchor(state, inverse * problem.scale[:, 0] / problem.scale)
    return OrbitTangents(states, sums[:, n:] + sums[:, :n] @ states, end[:, :n], anchor)


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
