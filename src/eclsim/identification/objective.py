"""What is minimised: differences between the model's steady beat and measurements, for many points at once.

Parameters are sought on a logarithmic scale, on which the paper's bounds (a tenth to ten times the start
value) are symmetric and a step means the same change for all of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from eclsim.circuit.assembly import assemble
from eclsim.haemodynamics.derivatives import member_derivatives
from eclsim.haemodynamics.evaluation import batch_outputs, output_names
from eclsim.solver.beat import beat_program
from eclsim.solver.lanes import FEW, LANES, map_parallel, threads
from eclsim.solver.model import AS_PUBLISHED, Model
from eclsim.solver.orbit import OrbitOptions, OrbitProblem, Orbits, solve_orbits
from eclsim.solver.resolution import needed_resolution
from eclsim.solver.status import Status
from eclsim.solver.steady import Batch, SteadyBeats, anchor, steady_beats

OUTPUTS = ("SP", "DP", "MAP", "MPAP", "PCWP", "CO", "PF")
"""What can be fitted."""
WORTH_FILLING = 50
"""From so many members on the program for many is quicker than the one for one, even if it is filled up."""
WORTH_LANES = 16
"""From so many members on one chunk of lanes is quicker than one member after the other."""


@dataclass(frozen=True)
class Target:
    """What one data point is fitted to.

    Args:
        model: circuit and values; those of the free parameters are replaced.
        measured: measured value of each output [mmHg, L/min].
        scales: what a difference is divided by, in the unit of the output.
    """

    model: Model
    measured: Mapping[str, float]
    scales: Mapping[str, float]


@dataclass(frozen=True)
class Box:
    """Free parameters and their bounds.

    Args:
        names: of the parameters.
        start: natural logarithm of the start values, shape (parameters,).
        lower: of the lower bounds.
        upper: of the upper bounds.
    """

    names: tuple[str, ...]
    start: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    @classmethod
    def of(cls, bounds: Mapping[str, tuple[float, float, float]]) -> Box:
        """From start value, lower and upper bound of each, in the parameter's unit."""
        table = np.log(np.array([tuple(b) for b in bounds.values()], dtype=float).reshape(-1, 3))
        return cls(tuple(bounds), table[:, 0], table[:, 1], table[:, 2])

    def clip(self, x: np.ndarray) -> np.ndarray:
        """The nearest point inside."""
        return np.clip(x, self.lower, self.upper)


@dataclass(frozen=True)
class Evaluation:
    """The model at some points, shape (members, ...).

    Args:
        steady: orbits.
        outputs: shape (members, outputs); NaN where no steady beat was found.
        residuals: weighted differences, 0 where nothing was measured, shape (members, outputs).
    """

    steady: SteadyBeats
    outputs: np.ndarray
    residuals: np.ndarray

    @cached_property
    def costs(self) -> np.ndarray:
        """Sum of squared residuals; infinite where no steady beat was found, shape (members,)."""
        found = np.sum(self.residuals**2, axis=1)
        return np.where(np.isfinite(found), found, np.inf)


class Objective:
    """Weighted differences of several data points that share a circuit.

    Args:
        targets: the data points.
        names: free parameters.
        policy: blood volume policy.
    """

    def __init__(self, targets: Sequence[Target], names: Sequence[str], policy: str = AS_PUBLISHED):
        circuits = {t.model.circuit for t in targets}
        if len(circuits) != 1:
            raise ValueError(f"{len(circuits)} different circuits; the points of an objective share one")
        (self.circuit,) = circuits
        self.targets = tuple(targets)
        self.names = tuple(names)
        self.policy = policy
        known = output_names(self.circuit)
        self.outputs = tuple(o for o in OUTPUTS if o in known)
        missing = {o for t in targets for o in t.measured if o not in self.outputs}
        if missing:
            raise ValueError(f"{', '.join(sorted(missing))}: no output of this circuit that can be fitted")
        shape = (len(targets), len(self.outputs))
        self.measured, self.weights = np.zeros(shape), np.zeros(shape)
        for k, target in enumerate(targets):
            for j, name in enumerate(self.outputs):
                if name in target.measured:
                    self.measured[k, j] = target.measured[name]
                    self.weights[k, j] = 1.0 / target.scales[name]

    def evaluate(
        self,
        which: np.ndarray,
        x: np.ndarray,
        options: OrbitOptions | None = None,
        resolution: int | None = None,
    ) -> Evaluation:
        """The model at some points.

        Args:
            which: data point of each member, shape (members,).
            x: logarithms of the parameters, shape (members, parameters).
            options: accuracy and effort of the orbit solver.
            resolution: of the grid of a beat; left out, each member gets what it needs, so that outputs jump
                by a thousandth where the need changes.
        """
        count = len(which)
        full = FEW + 1 if count >= WORTH_FILLING and resolution is None else 0
        filled = np.arange(max(count, full)) % max(count, 1)
        batch = self._batch(which[filled], x[filled])
        if resolution is not None and WORTH_LANES <= count <= FEW:
            steady = _in_lanes(batch, options or OrbitOptions(), resolution)
        else:
            steady = steady_beats(batch, options, resolution=resolution)
        wide = steady if len(filled) > FEW or count < WORTH_LANES else _repeated(steady)
        found = batch_outputs(wide, self.outputs).T[:count].copy()
        found[steady.orbits.status[:count] != Status.CONVERGED] = np.nan
        return Evaluation(steady, found, (found - self.measured[which]) * self.weights[which])

    def resolutions(self, which: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Resolution of the grid that each member needs, shape (members,)."""
        batch = self._batch(which, x)
        return np.broadcast_to(needed_resolution(assemble(self.circuit), batch.values), (len(which),))

    def jacobians(self, evaluation: Evaluation, members: Sequence[int], x: np.ndarray) -> np.ndarray:
        """d output / d log parameter of some members, shape (members, outputs, parameters).

        NaN where an orbit has no derivatives: with a valve that never opens, blood is shut in behind it.

        Args:
            evaluation: of the points.
            members: which of its members.
            x: their parameters, shape (members, parameters).
        """

        def one(member: int) -> np.ndarray:
            try:
                return member_derivatives(evaluation.steady, self.outputs, self.names, member)[1]
            except np.linalg.LinAlgError:
                return np.full((len(self.outputs), len(self.names)), np.nan)

        return np.stack(map_parallel(one, [int(m) for m in members])) * np.exp(x)[:, None, :]

    def _batch(self, which: np.ndarray, x: np.ndarray) -> Batch:
        names = self.targets[0].model.values
        values = {n: np.array([t.model.values[n] for t in self.targets])[which] for n in names}
        values |= {n: np.exp(x[:, k]) for k, n in enumerate(self.names)}
        return Batch(self.circuit, values, len(which), self.policy)


def _in_lanes(batch: Batch, options: OrbitOptions, resolution: int) -> SteadyBeats:
    """Steady beats of some dozens of members on one grid, with the program for many."""
    program = beat_program(batch.circuit, resolution)
    problem = OrbitProblem(program, batch.packed(program), batch.volume(), wide=True)
    start = anchor(batch, resolution)
    parts = np.array_split(np.arange(batch.count), max(1, min(threads(), batch.count // LANES)))
    solved = map_parallel(lambda part: solve_orbits(problem.take(part), start, options), list(parts))
    joined = {n: np.concatenate([getattr(o, n) for o in solved], axis=-1) for n in vars(solved[0])}
    return SteadyBeats(batch, Orbits(**joined), np.full(batch.count, resolution))


def _repeated(steady: SteadyBeats) -> SteadyBeats:
    """The same beats over and over, so many that their outputs are read off with the program for many."""
    batch, orbits = steady.batch, steady.orbits
    filled = np.arange(FEW + 1) % batch.count
    values = {n: v[filled] if np.ndim(v) else v for n, v in batch.values.items()}
    more = Orbits(**{n: v[..., filled] for n, v in vars(orbits).items()})
    return SteadyBeats(replace(batch, values=values, count=FEW + 1), more, steady.resolution[filled])
