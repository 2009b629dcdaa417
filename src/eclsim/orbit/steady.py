"""Steady beats of one or thousands of patients: the batch, the starts of its searches and its orbits."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache

import numpy as np

from eclsim.beat.grid import (
    RESOLUTIONS,
    grid_warning,
    needed_resolution,
    read_for_resolution,
    resolution_of_one,
)
from eclsim.beat.heartbeat import HEART_RATE, BeatProgram, beat_program
from eclsim.cases.sections import AS_PUBLISHED, POLICIES
from eclsim.circuit.assembly import assemble
from eclsim.circuit.network import Circuit
from eclsim.orbit.equation import Anchor, OrbitOptions, OrbitProblem, Orbits, Volume, by_broyden_only
from eclsim.orbit.execution import Execution, in_threads
from eclsim.orbit.inputs import allowed_values
from eclsim.orbit.iteration import CompiledSearch, compiled_search
from eclsim.orbit.model import Model, nominal_values
from eclsim.orbit.search import anchor_at, inverse_at, solve_orbits
from eclsim.orbit.status import Status

SEMI_IMPLICIT = "semi-implicit"
ADAPTIVE = "adaptive"
SOLVERS = (SEMI_IMPLICIT, ADAPTIVE)
SETTLING_BEATS = 20
COMPLEX_STEP = 1e-30
MEMBERS_PER_THREAD = 4
"""Smallest number of members, computed one after the other, that justifies a thread."""
Values = Mapping[str, float] | Mapping[str, np.ndarray] | Mapping[str, float | np.ndarray]


@dataclass(frozen=True)
class Batch:
    """Patients that share a circuit and may differ in any parameter.

    Args:
        circuit: the circuit.
        values: value of every parameter, a number or an array (members,).
        count: number of members.
        policy: blood volume policy.
    """

    circuit: Circuit
    values: Values
    count: int
    policy: str = AS_PUBLISHED

    def __post_init__(self) -> None:
        object.__setattr__(self, "circuit", self.circuit.canonical)

    def __repr__(self) -> str:
        return f"<Batch of {self.count}: {len(self.circuit.compartments)} compartments, {self.policy}>"

    @classmethod
    def of(cls, model: Model, policy: str | None = None) -> Batch:
        """A model as a batch of one; `policy` is the blood volume policy, by default the model's."""
        return cls(model.circuit, model.values, 1, policy or model.policy)

    def packed(self, program: BeatProgram) -> np.ndarray:
        """Parameters in the order of a program, shape (names, members), read-only."""
        if program.names not in self._packed:
            packed = np.empty((len(program.names), self.count))
            for row, name in zip(packed, program.names, strict=True):
                row[:] = self.values[name]
            packed.flags.writeable = False
            self._packed[program.names] = packed
        return self._packed[program.names]

    @cached_property
    def _packed(self) -> dict[tuple[str, ...], np.ndarray]:
        return {}

    def take(self, members: np.ndarray) -> Batch:
        """A batch of selected members."""
        values = {n: v if np.ndim(v) == 0 else np.asarray(v)[members] for n, v in self.values.items()}
        return replace(self, values=values, count=len(members))

    def member(self, which: int) -> dict[str, float]:
        """Values of the parameters that the beat of one member reads."""
        return {name: self.value_of(name, which) for name in (HEART_RATE, *self.circuit.parameter_names())}

    def all_values_of(self, which: int) -> Mapping[str, float]:
        """All values of one member, including those that its beat does not read."""
        return _Member(self, which)

    def value_of(self, name: str, which: int) -> float:
        """Value of one parameter of one member."""
        value = self.values[name]
        return float(value if np.ndim(value) == 0 else np.asarray(value)[which])

    def read_by_outputs(self, parameters: Sequence[str], members: np.ndarray) -> dict[str, np.ndarray]:
        """Values of those given parameters that have one, for selected members, each of shape (members,)."""
        columns = {n: np.asarray(self.values[n], float) for n in parameters if n in self.values}
        return {n: np.full(len(members), v) if v.ndim == 0 else v[members] for n, v in columns.items()}

    def numbers_for(self, parameters: Sequence[str], member: int = 0) -> dict[str, float]:
        """Values of those given parameters that have one, for one member."""
        return {name: float(v[0]) for name, v in self.read_by_outputs(parameters, np.array([member])).items()}

    def volume(self) -> Volume:
        """Blood volume condition of the policy."""
        return self._volume

    @cached_property
    def _volume(self) -> Volume:
        if self.policy not in POLICIES:
            raise ValueError(f"blood volume policy '{self.policy}'; allowed: {', '.join(POLICIES)}")
        assembly = assemble(self.circuit)
        of_blood = [self.policy == AS_PUBLISHED or c.group == "patient" for c in self.circuit.compartments]
        weights = assembly.layout.conserved(np.array(of_blood, dtype=float))
        with np.errstate(divide="ignore", invalid="ignore"):
            values = {name: np.asarray(self.values[name], dtype=float) for name in assembly.start_names}
            if self.count == 1:  # single numbers take half the time of arrays of one
                values = {name: value.reshape(1)[0] for name, value in values.items()}
            start = assembly.start_volumes(values)
        target = sum(
            np.asarray(v, dtype=float) for v, counted in zip(start, of_blood, strict=True) if counted
        )
        return Volume(weights, np.broadcast_to(target, (self.count,)).astype(float))

    def volume_slopes(self, parameters: Sequence[str], member: int = 0) -> np.ndarray:
        """d blood volume / d parameter of one member [mL per unit] by a complex step; shape (parameters,)."""
        counted = [self.policy == AS_PUBLISHED or c.group == "patient" for c in self.circuit.compartments]
        values = {name: self.value_of(name, member) for name in parameters} | self.member(member)
        shifts = 1j * COMPLEX_STEP * np.eye(len(parameters))
        shifted = values | {
            name: values[name] + shift for name, shift in zip(parameters, shifts, strict=True)
        }
        start = assemble(self.circuit).start_volumes(shifted)
        total = sum(np.imag(v) for v, is_counted in zip(start, counted, strict=True) if is_counted)
        return np.broadcast_to(total, (len(parameters),)) / COMPLEX_STEP

    def resolutions(self) -> np.ndarray:
        """Grid resolution that each member needs, shape (members,)."""
        return self._resolutions

    @cached_property
    def _resolutions(self) -> np.ndarray:
        assembly = assemble(self.circuit)
        if self.count != 1:
            return np.broadcast_to(needed_resolution(assembly, self.values), (self.count,))
        read = read_for_resolution(assembly)
        numbers = tuple(self.value_of(name, 0) for name in read)
        return np.array([resolution_of_one(assembly, numbers)])


@dataclass(frozen=True)
class _Member(Mapping[str, float]):
    """Values of one member, each read from the batch on access."""

    batch: Batch
    which: int

    def __getitem__(self, name: str) -> float:
        return self.batch.value_of(name, self.which)

    def __iter__(self) -> Iterator[str]:
        return iter(self.batch.values)

    def __len__(self) -> int:
        return len(self.batch.values)


@dataclass(frozen=True)
class SolvedOrbits(Orbits):
    """Orbits of a batch.

    Args:
        batch: the batch.
        resolution: resolution of the grid on which each member was solved, shape (members,).
        width: number of members side by side in the programs that solved it.
        adaptive_tolerance: tolerance of the adaptive solver that found it; None for the orbit solver.
    """

    batch: Batch
    resolution: np.ndarray
    width: int
    adaptive_tolerance: float | None = None

    def take(self, members: np.ndarray) -> SolvedOrbits:
        """The orbits of selected members."""
        parts = {field.name: getattr(self, field.name)[..., members] for field in fields(Orbits)}
        batch, resolution = self.batch.take(members), self.resolution[members]
        return replace(self, batch=batch, resolution=resolution, **parts)

    def search(self, member: int) -> CompiledSearch:
        """The program with which a member was solved."""
        return compiled_search(beat_program(self.batch.circuit, int(self.resolution[member])), self.width)

    def wait(self, members: np.ndarray, states: np.ndarray, beats: int = 1) -> np.ndarray:
        """States of selected members after a number of plain beats, shape (states, members)."""
        after = np.empty_like(states)
        for level in np.unique(self.resolution[members]):
            of_level = self.resolution[members] == level
            search = self.search(int(members[of_level][0]))
            packed = self.batch.packed(search.program)[:, members[of_level]]
            after[:, of_level] = search.wait(states[:, of_level], packed, beats)
        return after

    def grid_warning(self, member: int = 0) -> str | None:
        """Warning if the grid is too coarse for the oscillations of a member's circuit, otherwise None."""
        if self.status[member] == Status.INVALID_INPUT or self.adaptive_tolerance is not None:
            return None
        if self._grid_is_fine[member]:
            return None
        if member not in self._grid_warnings:
            values, assembly = self.batch.member(member), assemble(self.batch.circuit)
            self._grid_warnings[member] = grid_warning(assembly, values, int(self.resolution[member]))
        return self._grid_warnings[member]

    @cached_property
    def _grid_warnings(self) -> dict[int, str | None]:
        return {}

    @cached_property
    def _grid_is_fine(self) -> np.ndarray:
        """Whether each grid is certainly fine enough; False where even the finest may be too coarse."""
        needed = self.batch.resolutions()
        return (needed <= self.resolution) & (needed < RESOLUTIONS[-1])


def solve(
    batch: Batch,
    options: OrbitOptions | None = None,
    *,
    start: Mapping[str, float] | Anchor | None = None,
    resolution: int | None = None,
    execution: Execution | None = None,
) -> SolvedOrbits:
    """Solve for the steady beat of every member of a batch.

    A member's result depends only on its own values and these arguments.

    Args:
        batch: the batch.
        options: accuracy and effort.
        start: parameter values at whose steady beat every search begins, or an `Anchor` for each member.
            Members that do not converge from an `Anchor` begin again as by default: at the circuit's nominal
            parameters, or, in a circuit without nominal parameters, at their own values.
        resolution: resolution of the grid; by default as each member's time constants need.
        execution: execution options.
    """
    options, execution = options or OrbitOptions(), execution or Execution()
    width = execution.width_for(batch.count)
    levels = batch.resolutions() if resolution is None else np.full(batch.count, resolution)
    result = _empty_orbits(batch)
    solvable = result.status != Status.INVALID_INPUT
    for level in np.unique(levels[solvable]):
        members = np.flatnonzero(solvable & (levels == level))
        search = _Level(batch, int(level), width, execution.thread_count(), result)
        if isinstance(start, Anchor):
            search.solve(members, start.take(members), by_broyden_only(options))
            members = members[result.status[members] != Status.CONVERGED]
        values = nominal_values(batch.circuit) if start is None or isinstance(start, Anchor) else start
        if values is not None and len(members):
            search.solve(members, anchor(batch, int(level), values, search.width), options)
        elif values is None:
            for member in map(int, members):
                begin = anchor(batch, int(level), batch.member(member), search.width)
                search.solve(np.array([member]), begin, options)
    return SolvedOrbits(**vars(result), batch=batch, resolution=levels, width=width)


def _empty_orbits(batch: Batch) -> Orbits:
    """Empty orbits to be filled in; members with values that are not allowed are marked."""
    n, count = assemble(batch.circuit).layout.size, batch.count
    packed = batch.packed(beat_program(batch.circuit))
    refused = allowed_values(batch.circuit).refused(packed) | ~np.isfinite(batch.volume().target)
    return Orbits(
        np.full((n, count), np.nan), np.where(refused, Status.INVALID_INPUT, Status.NOT_CONVERGED),
        np.zeros(count, dtype=int), np.full(count, np.inf), np.full(count, np.inf),
    )  # fmt: skip


@dataclass(frozen=True)
class _Level:
    """Search for steady beats on one grid; the results are stored in `orbits`."""

    batch: Batch
    level: int
    width: int
    threads: int
    orbits: Orbits

    def solve(self, members: np.ndarray, start: Anchor, options: OrbitOptions) -> None:
        """Solve selected members of the batch in several threads."""
        program = beat_program(self.batch.circuit, self.level)
        problem = OrbitProblem(program, self.batch.packed(program), self.batch.volume()).take(members)
        worth = len(members) // MEMBERS_PER_THREAD if self.width == 1 else -(-len(members) // self.width)
        everyone, count = np.arange(len(members)), max(1, min(self.threads, worth))
        chunks = [everyone] if count == 1 else np.array_split(everyone, count)

        def solved(chunk: np.ndarray) -> Orbits:
            return solve_orbits(problem.take(chunk), start.take(chunk), options, self.width)

        for chunk, orbits in zip(chunks, in_threads(solved, chunks, self.threads), strict=True):
            self.orbits.put(members[chunk], orbits)


def anchor(batch: Batch, level: int, values: Mapping[str, float], width: int = 1) -> Anchor:
    """Steady beat at given parameter values and its inverse Jacobian, as a start for searches."""
    names = beat_program(batch.circuit, level).names
    return _anchor(batch.circuit, level, batch.policy, tuple(float(values[n]) for n in names), width)


def inverse_jacobian(orbits: SolvedOrbits, member: int, held: Sequence[Sequence[str]] = ()) -> np.ndarray:
    """Inverse Jacobian in scaled states at a member's orbit, as a start for searches near it.

    Searches that start with it keep the volumes of the groups of compartments in `held`.
    """
    program = orbits.search(member).program
    problem = OrbitProblem(program, orbits.batch.packed(program), orbits.batch.volume()).take([member])
    return inverse_at(problem, orbits.states[:, member], orbits.width, held)


def inverses_near(
    orbits: SolvedOrbits, start: Mapping[str, float] | None, options: OrbitOptions
) -> np.ndarray:
    """Inverse Jacobians to start searches near orbits, in scaled states, (states, states, members).

    Uses the one with which a member's own search began if that search converged by Broyden's method,
    otherwise the one at its orbit.

    Args:
        orbits: orbits, all finite.
        start: start of their searches (see `solve`).
        options: options of their searches.
    """
    batch, n = orbits.batch, len(orbits.states)
    values = nominal_values(batch.circuit) if start is None else start
    result = np.empty((n, n, batch.count))
    for k in range(batch.count):
        if values is None or orbits.beats[k] > options.quasi_newton_beats:
            result[..., k] = inverse_jacobian(orbits, k)
        else:
            result[..., k] = anchor(batch, int(orbits.resolution[k]), values, orbits.width).inverse
    return result


@lru_cache(maxsize=256)
def _anchor(circuit: Circuit, level: int, policy: str, packed: tuple[float, ...], width: int) -> Anchor:
    """Compute `SETTLING_BEATS` plain beats, then solve."""
    program = beat_program(circuit, level)
    values = dict(zip(program.names, packed, strict=True))
    batch = Batch(circuit, values, 1, policy)
    problem = OrbitProblem(program, batch.packed(program), batch.volume())
    return anchor_at(problem, start_state(Model(circuit, values)), SETTLING_BEATS, width)


def start_state(model: Model) -> np.ndarray:
    """The published initial state: start volumes, flows at zero; shape (states,)."""
    return assemble(model.circuit).start_state(model.values)
