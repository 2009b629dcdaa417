"""Exact derivatives of a steady beat by the implicit function theorem.

On the orbit F(y, p) = y - beat(y, p) + u (w . y - c(p)) = 0, so

    dy/dp = (I - dbeat/dy + u w^T)^-1 (dbeat/dp + u dc/dp).

One recorded beat with forward tangents in all states and parameters gives dbeat/dy, dbeat/dp and the tangents
of every signal: exact derivatives of the discrete map, whatever the step.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import jax
import numpy as np

from eclsim.circuit.assembly import assemble
from eclsim.solver.beat import BeatProgram, beat_program
from eclsim.solver.kernel import as_single_kernel
from eclsim.solver.model import AS_PUBLISHED
from eclsim.solver.orbit import OrbitProblem
from eclsim.solver.steady import Batch, SteadyBeats

COMPLEX_STEP = 1e-30
LANES = 16
"""Directions are padded to a multiple, so that vector loops have no remainder."""
QUICK_TO_COMPILE = {"xla_backend_optimization_level": 1}


@dataclass(frozen=True)
class OrbitTangents:
    """Derivatives of a steady beat.

    Args:
        states: d state / d parameter, shape (states, parameters).
        signals: the signals at the end of every step, shape (steps, signals).
        signal_tangents: their total derivatives, shape (signals, parameters, steps).
        multipliers: eigenvalues of dbeat/dy (Floquet multipliers), largest first, shape (states,).
    """

    states: np.ndarray
    signals: np.ndarray
    signal_tangents: np.ndarray
    multipliers: np.ndarray


def orbit_tangents(
    steady: SteadyBeats, parameters: tuple[str, ...], signals: tuple[str, ...], member: int = 0
) -> OrbitTangents:
    """Derivatives of one patient's steady beat with respect to any parameters.

    Args:
        steady: solved orbits.
        parameters: names, among those that the circuit reads and `heart_rate_bpm`.
        signals: what to differentiate (see `Recorder`).
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
    recorded, end_tangents, signal_tangents = _tangents(program, signals)(state, packed, *directions)
    end_tangents, signal_tangents = np.asarray(end_tangents)[: n + m], np.asarray(signal_tangents)[: n + m]
    monodromy = end_tangents[:n].T
    problem = OrbitProblem(program, packed[:, None], batch.volume())
    spread = problem.spread[:, 0]
    system = np.eye(n) - monodromy + np.outer(spread, problem.volume.weights)
    values = dict(zip(program.names, packed, strict=True))
    right = end_tangents[n:].T + np.outer(spread, _volume_gradient(batch, values, parameters))
    states = np.linalg.solve(system, right)
    flat = signal_tangents.reshape(n + m, -1)
    total = (flat[n:] + states.T @ flat[:n]).reshape(m, *signal_tangents.shape[1:])
    total = np.ascontiguousarray(total.transpose(2, 0, 1))
    multipliers = np.linalg.eigvals(monodromy)
    order = np.argsort(-np.abs(multipliers))
    return OrbitTangents(states, np.asarray(recorded), total, multipliers[order])


@lru_cache(maxsize=64)
def _tangents(program: BeatProgram, signals: tuple[str, ...]) -> Any:
    """Compiled map (state, parameters, directions) -> signals, tangents of end state and signals."""

    def run(state: Any, packed: Any, state_directions: Any, packed_directions: Any) -> Any:
        def one(ds: Any, dp: Any) -> Any:
            return jax.jvp(lambda s, p: program.run(s, p, signals), (state, packed), (ds, dp))

        (_, recorded), (end, signal) = jax.vmap(one, out_axes=((None, None), 0))(
            state_directions, packed_directions
        )
        return recorded, end, signal

    return jax.jit(as_single_kernel(run), compiler_options=QUICK_TO_COMPILE)


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
