"""Steady beats of one or of thousands of patients: the front door of the orbit solver."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from eclsim.circuit.assembly import assemble
from eclsim.circuit.network import Circuit
from eclsim.solver.beat import BeatProgram, beat_program
from eclsim.solver.lanes import FEW, LANES, map_parallel, threads
from eclsim.solver.model import AS_PUBLISHED, POLICIES, Model, nominal_values
from eclsim.solver.orbit import (
    Anchor,
    OrbitOptions,
    OrbitProblem,
    Orbits,
    Volume,
)
from eclsim.solver.resolution import needed_resolution
from eclsim.solver.search import jacobian, solve_orbits
from eclsim.solver.status import Status

SETTLING_BEATS = 20
Values = Mapping[str, Any]


@dataclass(frozen=True)
class Batch:
    """Patients that share a circuit and differ in any parameter.

    Args:
        circuit: the circuit.
        values: a number or an array (patients,) for every parameter.
        count: number of patients.
        policy: blood volume policy.
    """

    circuit: Circuit
    values: Values
    count: int
    policy: str = AS_PUBLISHED

    def packed(self, program: BeatProgram) -> np.ndarray:
        """Parameters in the order of a program, shape (names, patients)."""
        packed = np.empty((len(program.names), self.count))
        for row, name in zip(packed, program.names, strict=True):
            row[:] = self.values[name]
        return packed

    def volume(self) -> Volume:
        """The blood volume condition of the policy."""
        if self.policy not in POLICIES:
            raise ValueError(f"blood volume policy '{self.policy}'; allowed: {', '.join(POLICIES)}")
        assembly = assemble(self.circuit)
        own = [self.policy == AS_PUBLISHED or c.group == "patient" for c in self.circuit.compartments]
        weights = np.r_[np.array(own, dtype=float), np.zeros(len(assembly.inertial))]
        start = assembly.start_volumes(self.values)
        target = sum(np.asarray(v, dtype=float) for v, counted in zip(start, own, strict=True) if counted)
        return Volume(weights, np.broadcast_to(target, (self.count,)).astype(float))


@dataclass(frozen=True)
class SteadyBeats:
    """Orbits of a batch, with the resolution each was solved at, shape (patients,)."""

    batch: Batch
    orbits: Orbits
    resolution: np.ndarray


def steady_beats(
    batch: Batch,
    options: OrbitOptions | None = None,
    near: Values | None = None,
    resolution: int | None = None,
    *,
    start: Anchor | None = None,
    wide: bool | None = None,
) -> SteadyBeats:
    """Solve for the steady beat of every patient of a batch.

    Args:
        batch: the patients.
        options: accuracy and effort.
        near: parameter values of a patient that all of the batch are close to; the search then starts from
            that patient's orbit. Left out, it starts from the circuit's nominal orbit.
        resolution: of the grid; left out, each patient gets what its own time constants need.
        start: where to start each patient instead; those who find nothing from there start as the others.
        wide: whether to take the program for many; left out, with more than `FEW` patients.
    """
    options = options or OrbitOptions()
    assembly = assemble(batch.circuit)
    wanted = np.broadcast_to(needed_resolution(assembly, batch.values), (batch.count,))
    if resolution is not None:
        wanted = np.full(batch.count, resolution)
    n = assembly.n_states
    found = Orbits(
        np.full((n, batch.count), np.nan), np.zeros(batch.count, dtype=int), np.zeros(batch.count, dtype=int),
        np.full(batch.count, np.inf), np.full(batch.count, np.inf),
    )  # fmt: skip
    for level in np.unique(wanted):
        members = np.flatnonzero(wanted == level)
        search = _Level(batch, int(level), len(members) > FEW if wide is None else wide, found)
        beat_program(batch.circuit, int(level)).count_search()
        if start is not None:
            search.solve(members, start.take(members), replace(options, newton_iterations=0))
            members = members[found.status[members] != Status.CONVERGED]
        if len(members):
            search.solve(members, anchor(batch, int(level), near), options)
    return SteadyBeats(batch, found, np.array(wanted))


@dataclass(frozen=True)
class _Level:
    """The search for steady beats on one grid, which writes down what it finds."""

    batch: Batch
    level: int
    wide: bool
    found: Orbits

    def solve(self, members: np.ndarray, start: Anchor, options: OrbitOptions) -> None:
        """Solve some members of the batch."""
        program = beat_program(self.batch.circuit, self.level)
        lone = (
            self.batch.count > 1 or program.searched_before
        )  # in a batch always: identical whatever ran before
        problem = OrbitProblem(program, self.batch.packed(program), self.batch.volume(), self.wide, lone)
        chunks = -(-len(members) // LANES) if self.wide else len(members) // 4
        parts = np.array_split(np.arange(len(members)), max(1, min(threads(), chunks)))

        def solve(part: np.ndarray) -> Orbits:
            whole = len(part) == self.batch.count
            return solve_orbits(problem if whole else problem.take(members[part]), start.take(part), options)

        solved = map_parallel(solve, list(parts))
        for part, orbits in zip(parts, solved, strict=True):
            for name in vars(orbits):
                getattr(self.found, name)[..., members[part]] = getattr(orbits, name)


def anchor(batch: Batch, level: int, near: Values | None = None) -> Anchor:
    """Orbit and inverse Jacobian to start from: of `near`, of the nominal values, or of the first patient."""
    values = near or nominal_values(batch.circuit)
    if values is None:
        values = {k: float(np.ravel(v)[0]) for k, v in batch.values.items()}
    names = beat_program(batch.circuit, level).names
    return _anchor(batch.circuit, level, batch.policy, tuple(float(values[n]) for n in names))


@lru_cache(maxsize=256)
def _anchor(circuit: Circuit, level: int, policy: str, packed: tuple[float, ...]) -> Anchor:
    """Settle for some beats, then Newton's method."""
    program = beat_program(circuit, level)
    values = dict(zip(program.names, packed, strict=True))
    batch = Batch(circuit, values, 1, policy)
    problem = OrbitProblem(program, batch.packed(program), batch.volume())
    states = start_state(Model(circuit, values))[:, None]
    for _ in range(SETTLING_BEATS):
        states = problem.beat(states)
    solved = solve_orbits(
        problem, Anchor(states[:, 0], np.linalg.pinv(jacobian(problem, states))), OrbitOptions()
    )
    return Anchor(solved.states[:, 0], np.linalg.pinv(jacobian(problem, solved.states)))


def start_state(model: Model) -> np.ndarray:
    """The published initial state: start volumes, flows at zero; shape (states,)."""
    assembly = assemble(model.circuit)
    volumes = [float(v) for v in assembly.start_volumes(model.values)]
    return np.r_[volumes, np.zeros(len(assembly.inertial))]
