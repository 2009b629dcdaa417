"""One patient's beat with tangents in all states and in some parameters, compiled for many calls.

What `eclsim.orbit.derivatives` does once, a sampler does ten thousand times: so this records what the
outputs need and no more, moves them along a step of Newton's method, and hands back the inverse Jacobian that
the search for the next orbit starts with.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import jax
import numpy as np

from eclsim.beat.compilation import compiled
from eclsim.beat.heartbeat import BeatProgram
from eclsim.orbit.equation import OrbitProblem
from eclsim.outputs.derivatives import LinearMeasures
from eclsim.outputs.evaluation import needed_signals
from eclsim.outputs.registry import output
from eclsim.outputs.signals import whole_beat

LANES = 8
"""Directions are padded to a multiple, so that vector loops have no remainder."""


@dataclass(frozen=True)
class Linearised:
    """A steady beat and its derivatives.

    Args:
        outputs: shape (outputs,).
        slopes: d output / d parameter, shape (outputs, parameters).
        states: d state / d parameter, shape (states, parameters).
        inverse: of dF/dy, as an `Anchor` wants it.
        state: one step of Newton's method from the given one, shape (states,); the outputs are moved along.
        moved: largest relative change of a state in that step.
    """

    outputs: np.ndarray
    slopes: np.ndarray
    states: np.ndarray
    inverse: np.ndarray
    state: np.ndarray
    moved: float


def linearise(
    problem: OrbitProblem,
    state: np.ndarray,
    outputs: Sequence[str],
    parameters: Sequence[str],
    volume_slopes: np.ndarray,
) -> Linearised:
    """Outputs of one patient's orbit and their exact derivatives, by the implicit function theorem.

    Args:
        problem: of one patient.
        state: close to the orbit, shape (states,).
        outputs: names of the registry.
        parameters: names that the circuit reads.
        volume_slopes: d blood volume / d parameter [mL per unit], shape (parameters,).
    """
    program, packed = problem.program, problem.packed[:, 0]
    signals = needed_signals(program.assembly.circuit, tuple(outputs))
    after, recorded = (np.asarray(v) for v in program.trace(signals)(state, packed))
    recorded = whole_beat(recorded)
    measures = LinearMeasures({n: recorded[:, k] for k, n in enumerate(signals)}, program.grid.phases)
    found = [output(name).compute(measures) for name in outputs]
    keys = sorted(measures.sums)
    weights = np.stack([measures.sums[key] for key in keys], axis=1)
    weights[-1] += weights[0]
    n, m = len(state), len(parameters)
    run = _program(program, tuple(name for name, _ in keys), tuple(parameters))
    end, sums = (np.asarray(t)[: n + m].T for t in run(state, packed, weights[1:]))
    spread = problem.spread[:, 0]
    inverse = np.linalg.inv(np.eye(n) - end[:, :n] + np.outer(spread, problem.volume.weights))
    states = inverse @ (end[:, n:] + np.outer(spread, volume_slopes))
    place = {key: k for k, key in enumerate(keys)}
    slopes = np.zeros((len(found), len(keys)))
    for row, number in zip(slopes, found, strict=True):
        for key, slope in number.slopes.items():
            row[place[key]] = slope
    scale = problem.scale[:, 0]
    excess = float(problem.volume.weights @ state - problem.volume.target[0])
    step = -inverse @ (state - after + spread * excess)
    return Linearised(
        np.array([float(d.value) for d in found]) + slopes @ (sums[:, :n] @ step),
        slopes @ (sums[:, n:] + sums[:, :n] @ states),
        states,
        inverse * scale / scale[:, None],
        state + step,
        float(np.max(np.abs(step) / np.maximum(np.abs(state), program.assembly.layout.smallest_sizes))),
    )


@lru_cache(maxsize=32)
def _program(program: BeatProgram, signals: tuple[str, ...], parameters: tuple[str, ...]) -> Any:
    """Compiled map (state, parameters, weights) -> tangents of end state and of sums, directions first."""
    n, count = program.assembly.layout.size, len(program.names)
    lanes = -(-(n + len(parameters)) // LANES) * LANES
    of_state, of_packed = np.zeros((lanes, n)), np.zeros((lanes, count))
    of_state[:n] = np.eye(n)
    for k, name in enumerate(parameters):
        of_packed[n + k, program.names.index(name)] = 1.0

    def run(state: Any, packed: Any, weights: Any) -> Any:
        def one(ds: Any, dp: Any) -> Any:
            return jax.jvp(lambda s, p: program.run(s, p, signals, weights), (state, packed), (ds, dp))[1]

        return jax.vmap(one)(of_state, of_packed)

    return compiled(run, ("linearised", program, signals, parameters))
