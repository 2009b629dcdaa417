"""Steady beats of one or of thousands of patients: the front door of the orbit solver."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from eclsim.beat.heartbeat import HEART_RATE, BeatProgram, beat_program
from eclsim.beat.resolution import grid_doubt, needed_resolution
from eclsim.beat.vectorisation import FEW, LANES, map_parallel
from eclsim.beat.vectorisation import threads as processors
from eclsim.circuit.assembly import assemble
from eclsim.circuit.network import Circuit
from eclsim.orbit.ejection import judged, recorded_output
from eclsim.orbit.equation import (
    Anchor,
    OrbitOptions,
    OrbitProblem,
    Orbits,
    Volume,
)
from eclsim.orbit.inputs import allowed_values
from eclsim.orbit.model import AS_PUBLISHED, POLICIES, Model, nominal_values
from eclsim.orbit.search import jacobian, solve_orbits
from eclsim.orbit.status import NoDerivativesError, Status

SETTLING_BEATS = 20
CANDIDATES = 8
"""Patients that are tried as a start for the others, in a circuit without nominal values."""
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

    def member(self, which: int) -> dict[str, float]:
        """Parameters of one patient."""
        values = {n: self.values[n] for n in (HEART_RATE, *self.circuit.parameter_names())}
        return {k: float(v if np.ndim(v) == 0 else v[which]) for k, v in values.items()}

    def volume(self) -> Volume:
        """The blood volume condition of the policy."""
        if self.policy not in POLICIES:
            raise ValueError(f"blood volume policy '{self.policy}'; allowed: {', '.join(POLICIES)}")
        assembly = assemble(self.circuit)
        own = [self.policy == AS_PUBLISHED or c.group == "patient" for c in self.circuit.compartments]
        weights = assembly.layout.conserved(np.array(own, dtype=float))
        with np.errstate(divide="ignore", invalid="ignore"):
            start = assembly.start_volumes({k: np.asarray(v, dtype=float) for k, v in self.values.items()})
        target = sum(np.asarray(v, dtype=float) for v, counted in zip(start, own, strict=True) if counted)
        return Volume(weights, np.broadcast_to(target, (self.count,)).astype(float))


@dataclass(frozen=True)
class SteadyBeats:
    """Steady beats of a batch and how the search for each ended.

    Args:
        batch: the patients.
        orbits: states and status of each.
        resolution: of the grid each was solved on, shape (patients,).
        native: native output [L/min] where no steady beat was found, else NaN, shape (patients,).
    """

    batch: Batch
    orbits: Orbits
    resolution: np.ndarray
    native: np.ndarray | None = None

    def status(self, member: int = 0) -> Status:
        """How the search for a member's beat ended."""
        return Status(int(self.orbits.status[member]))

    def message(self, member: int = 0, status: Status | None = None) -> str:
        """The same in words: what it means, the numbers behind it, and what to do.

        Args:
            member: which patient.
            status: what became of the beat since, where its numbers showed more than the search.
        """
        status = self.status(member) if status is None else status
        if status is Status.CONVERGED:
            return status.message
        if status is Status.INVALID_INPUT:
            mistakes = allowed_values(self.batch.circuit).reasons(self.batch.member(member))
            return f"{status.message}: {'; '.join(mistakes)}"
        said = f"residual {self.orbits.residual[member]:.1e}, drift {self.orbits.drift[member]:.2g} mL a beat"
        if status is Status.NO_EJECTION and self.native is not None:
            said = f"native output {self.native[member]:.3g} L/min, {said}"
        return f"{status.message} ({said})"

    def grid_doubt(self, member: int = 0) -> str | None:
        """A sentence where the grid is too coarse for what oscillates in a member; None where it is fine."""
        if self.status(member) is Status.INVALID_INPUT:
            return None
        return grid_doubt(
            assemble(self.batch.circuit), self.batch.member(member), int(self.resolution[member])
        )

    def require_steady(self, member: int = 0, name: str = "") -> None:
        """Raise `NoDerivativesError` unless a member has a steady beat to take derivatives of."""
        status = self.status(member)
        if status is not Status.CONVERGED:
            raise NoDerivativesError(status, self.message(member), name)


def steady_beats(
    batch: Batch,
    options: OrbitOptions | None = None,
    near: Values | None = None,
    resolution: int | None = None,
    *,
    start: Anchor | None = None,
    wide: bool | None = None,
    lone: bool | None = None,
    threads: int | None = None,
) -> SteadyBeats:
    """Solve for the steady beat of every patient of a batch.

    A result depends on these arguments alone, never on what was solved before.

    Args:
        batch: the patients.
        options: accuracy and effort.
        near: parameter values of a patient that all of the batch are close to; the search then starts from
            that patient's orbit. Left out, it starts from the circuit's nominal orbit.
        resolution: of the grid; left out, each patient gets what its own time constants need.
        start: where to start each patient instead; those who find nothing from there start as the others.
        wide: whether to take the program for many; left out, with more than `FEW` patients.
        lone: whether the search for one patient is a compiled program of its own: a third quicker, but one
            more to load (0.2 s) or to compile (seconds); left out, in a batch of more than one.
        threads: how many run in parallel; left out, see `lanes.threads`.
    """
    options = options or OrbitOptions()
    levels = _levels(batch, resolution)
    found = _nothing_found(batch)
    solvable = found.status != Status.INVALID_INPUT
    lone = batch.count > 1 if lone is None else lone
    for level in np.unique(levels[solvable]):
        members = np.flatnonzero(solvable & (levels == level))
        many = len(members) > FEW if wide is None else wide
        search = _Level(batch, int(level), many, lone, threads, found)
        if start is not None:
            search.solve(members, start.take(members), replace(options, newton_iterations=0))
            members = members[found.status[members] != Status.CONVERGED]
        if len(members):
            search.solve(members, anchor(batch, int(level), near), options)
    return SteadyBeats(batch, found, levels, _judge(batch, levels, found))


def _levels(batch: Batch, resolution: int | None) -> np.ndarray:
    """Resolution of the grid of each patient, shape (patients,)."""
    if resolution is not None:
        return np.full(batch.count, resolution)
    wanted = needed_resolution(assemble(batch.circuit), batch.values)
    return np.array(np.broadcast_to(wanted, (batch.count,)))


def _nothing_found(batch: Batch) -> Orbits:
    """Orbits to be filled in; patients with values that are not allowed are marked."""
    n, count = assemble(batch.circuit).layout.size, batch.count
    packed = batch.packed(beat_program(batch.circuit))
    refused = allowed_values(batch.circuit).refused(packed) | ~np.isfinite(batch.volume().target)
    return Orbits(
        np.full((n, count), np.nan), np.where(refused, Status.INVALID_INPUT, Status.NOT_CONVERGED),
        np.zeros(count, dtype=int), np.full(count, np.inf), np.full(count, np.inf),
    )  # fmt: skip


def _judge(batch: Batch, levels: np.ndarray, found: Orbits) -> np.ndarray:
    """Tell hearts that do not eject from others that did not settle; native outputs [L/min], else NaN."""
    native = np.full(batch.count, np.nan)
    for member in np.flatnonzero(found.status == Status.NOT_CONVERGED):
        program = beat_program(batch.circuit, int(levels[member]))
        packed = batch.packed(program)[:, member]
        native[member] = recorded_output(program, found.states[:, member], packed)
        found.status[member] = judged(Status.NOT_CONVERGED, native[member])
    return native


@dataclass(frozen=True)
class _Level:
    """The search for steady beats on one grid, which writes down what it finds."""

    batch: Batch
    level: int
    wide: bool
    lone: bool
    threads: int | None
    found: Orbits

    def solve(self, members: np.ndarray, start: Anchor, options: OrbitOptions) -> None:
        """Solve some members of the batch."""
        program = beat_program(self.batch.circuit, self.level)
        problem = OrbitProblem(program, self.batch.packed(program), self.batch.volume(), self.wide, self.lone)
        chunks = -(-len(members) // LANES) if self.wide else len(members) // 4
        count = processors() if self.threads is None else self.threads
        parts = np.array_split(np.arange(len(members)), max(1, min(count, chunks)))

        def solve(part: np.ndarray) -> Orbits:
            whole = len(part) == self.batch.count
            return solve_orbits(problem if whole else problem.take(members[part]), start.take(part), options)

        solved = map_parallel(solve, list(parts), count)
        for part, orbits in zip(parts, solved, strict=True):
            for name in vars(orbits):
                getattr(self.found, name)[..., members[part]] = getattr(orbits, name)


def anchor(batch: Batch, level: int, near: Values | None = None) -> Anchor:
    """Orbit and inverse Jacobian to start from: of `near`, of the nominal values, or of a patient's own.

    The patient is the first one whose own beat is found, so that a bad one beside the others costs them
    nothing.
    """
    names = beat_program(batch.circuit, level).names
    values = near or nominal_values(batch.circuit)
    if values is not None:
        return _anchor(batch.circuit, level, batch.policy, tuple(float(values[n]) for n in names))[0]
    packed = batch.packed(beat_program(batch.circuit, level))
    able = np.flatnonzero(~allowed_values(batch.circuit).refused(packed))[:CANDIDATES]
    found = (_anchor(batch.circuit, level, batch.policy, tuple(packed[:, k].tolist())) for k in able)
    tried = []
    for candidate, settled in found:
        if settled:
            return candidate
        tried.append(candidate)
    return tried[0]


@lru_cache(maxsize=256)
def _anchor(circuit: Circuit, level: int, policy: str, packed: tuple[float, ...]) -> tuple[Anchor, bool]:
    """Settle for some beats, then Newton's method; whether it led to a steady beat."""
    program = beat_program(circuit, level)
    values = dict(zip(program.names, packed, strict=True))
    batch = Batch(circuit, values, 1, policy)
    problem = OrbitProblem(program, batch.packed(program), batch.volume())
    first = start_state(Model(circuit, values))[:, None]
    states = first
    for _ in range(SETTLING_BEATS):
        states = problem.beat(states)
    if not np.isfinite(states).all():
        return Anchor(first[:, 0], np.eye(len(first))), False
    solved = solve_orbits(
        problem, Anchor(states[:, 0], np.linalg.pinv(jacobian(problem, states))), OrbitOptions()
    )
    if not np.isfinite(solved.states).all():
        return Anchor(first[:, 0], np.eye(len(first))), False
    inverse = np.linalg.pinv(jacobian(problem, solved.states))
    return Anchor(solved.states[:, 0], inverse), bool(solved.status[0] == Status.CONVERGED)


def start_state(model: Model) -> np.ndarray:
    """The published initial state: start volumes, flows at zero; shape (states,)."""
    return assemble(model.circuit).start_state(model.values)
