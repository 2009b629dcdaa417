"""Outputs of dozens to thousands of parameter sets of one patient, all close to a known one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from eclsim.circuit.assembly import assemble
from eclsim.haemodynamics.evaluation import batch_outputs, needed_signals
from eclsim.haemodynamics.measures import Measures
from eclsim.haemodynamics.outputs import output
from eclsim.haemodynamics.signals import whole_beat
from eclsim.solver.beat import beat_program
from eclsim.solver.lanes import FEW, LANES, map_parallel
from eclsim.solver.model import AS_PUBLISHED, Model
from eclsim.solver.orbit import OrbitOptions, OrbitProblem, solve_orbits
from eclsim.solver.resolution import needed_resolution
from eclsim.solver.status import Status
from eclsim.solver.steady import Batch, anchor, steady_beats

SETTLED = OrbitOptions(tolerance=1e-5, error_tolerance=1e-4, newton_iterations=6)
"""Enough for a density: outputs differ from those of the exact orbit by 1e-4 of their uncertainty."""
WORTH_LANES = 12
"""From so many members on the program for many is quicker than the one for one, even half empty."""


def simulate_members(
    model: Model,
    values: Mapping[str, Any],
    count: int,
    outputs: tuple[str, ...],
    policy: str = AS_PUBLISHED,
    near: Mapping[str, float] | None = None,
) -> np.ndarray:
    """Outputs of members that share a circuit, shape (members, outputs); NaN without a steady beat.

    Args:
        model: gives the circuit.
        values: a number or an array (members,) for every parameter.
        count: number of members.
        outputs: names of the registry.
        policy: blood volume policy.
        near: values that all members are close to.
    """
    batch = Batch(model.circuit, values, count, policy)
    if not WORTH_LANES <= count <= FEW:
        steady = steady_beats(batch, SETTLED, near)
        found = batch_outputs(steady, outputs).T
        found[steady.orbits.status != Status.CONVERGED] = np.nan
        return found
    wanted = np.broadcast_to(needed_resolution(assemble(model.circuit), values), (count,))
    found = np.full((count, len(outputs)), np.nan)
    jobs = [
        (batch, int(level), part, outputs, near)
        for level in np.unique(wanted)
        for part in _parts(np.flatnonzero(wanted == level))
    ]
    for (_, _, part, *_), values_of in zip(
        jobs, map_parallel(lambda job: _side_by_side(*job), jobs), strict=True
    ):
        found[part] = values_of
    return found


def _parts(members: np.ndarray) -> list[np.ndarray]:
    return np.array_split(members, -(-len(members) // LANES))


def _side_by_side(
    batch: Batch, level: int, part: np.ndarray, outputs: tuple[str, ...], near: Mapping[str, float] | None
) -> np.ndarray:
    """Members of one grid in the lanes of one program, shape (members, outputs)."""
    program = beat_program(batch.circuit, level)
    problem = OrbitProblem(program, batch.packed(program), batch.volume(), wide=True).take(part)
    orbits = solve_orbits(problem, anchor(batch, level, near), SETTLED)
    signals = needed_signals(batch.circuit, outputs)
    lanes = np.resize(np.arange(len(part)), LANES)
    recorded = program.trace(signals)(orbits.states[:, lanes], problem.packed[:, lanes])[1]
    series = whole_beat(np.asarray(recorded))[..., : len(part)]
    measures = Measures({name: series[:, k] for k, name in enumerate(signals)}, program.grid.phases)
    found = np.stack([output(name).compute(measures) for name in outputs], axis=1)
    found[orbits.status != Status.CONVERGED] = np.nan
    return found
