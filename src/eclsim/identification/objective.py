"""What is minimised: differences between the model's steady beat and measurements, for many points at once.

Parameters are sought on a logarithmic scale, on which the paper's bounds (a tenth to ten times the start
value) are symmetric and a step means the same change for all of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from eclsim.beat.resolution import needed_resolution
from eclsim.beat.vectorisation import WORTH_LANES, map_parallel
from eclsim.circuit.assembly import assemble
from eclsim.orbit.equation import Anchor, OrbitOptions
from eclsim.orbit.model import AS_PUBLISHED, Model
from eclsim.orbit.status import NoDerivativesError, Status
from eclsim.orbit.steady import Batch, SteadyBeats, steady_beats
from eclsim.outputs.derivatives import member_tangents
from eclsim.outputs.evaluation import batch_outputs, output_names

OUTPUTS = ("SP", "DP", "MAP", "MPAP", "PCWP", "CO", "PF")
"""What can be fitted."""


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
class Tangent:
    """A steady beat to first order in the parameters.

    Args:
        x: logarithms of the parameters, shape (parameters,).
        anchor: the beat and its inverse Jacobian.
        states: d state / d log parameter, shape (states, parameters).
    """

    x: np.ndarray
    anchor: Anchor
    states: np.ndarray

    def state(self, x: np.ndarray) -> np.ndarray:
        """State at other parameters; no part of it changes by more than half its size and 50 mL."""
        change = self.states @ (x - self.x)
        allowed = 0.5 * np.abs(self.anchor.state) + 50.0
        return self.anchor.state + change / max(float(np.max(np.abs(change) / allowed)), 1.0)


def foreseen(near: Sequence[Tangent], x: np.ndarray) -> Anchor:
    """Where to start the search for the beats of some members from one solved beat close to each."""
    states = [tangent.state(own) for tangent, own in zip(near, x, strict=True)]
    return Anchor(np.stack(states, axis=1), np.stack([t.anchor.inverse for t in near], axis=2))


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
        near: Sequence[Tangent] | None = None,
    ) -> Evaluation:
        """The model at some points.

        Args:
            which: data point of each member, shape (members,).
            x: logarithms of the parameters, shape (members, parameters).
            options: accuracy and effort of the orbit solver.
            resolution: of the grid of a beat; left out, each member gets what it needs, so that outputs jump
                by a thousandth where the need changes.
            near: a solved beat close to each member, from where the search for its own starts.
        """
        batch, wide = self._batch(which, x), len(which) >= WORTH_LANES
        start = None if near is None else foreseen(near, x)
        steady = steady_beats(batch, options, resolution=resolution, start=start, wide=wide, lone=True)
        found = batch_outputs(steady, self.outputs, wide).T.copy()
        found[steady.orbits.status != Status.CONVERGED] = np.nan
        return Evaluation(steady, found, (found - self.measured[which]) * self.weights[which])

    def resolutions(self, which: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Resolution of the grid that each member needs, shape (members,)."""
        batch = self._batch(which, x)
        return np.broadcast_to(needed_resolution(assemble(self.circuit), batch.values), (len(which),))

    def linearise(
        self, evaluation: Evaluation, members: Sequence[int], x: np.ndarray
    ) -> tuple[np.ndarray, list[Any]]:
        """d output / d log parameter of some members, shape (members, outputs, parameters), and their beats.

        NaN where a member has no derivatives: no steady beat was found, or a valve never opens and blood is
        shut in behind it.

        Args:
            evaluation: of the points.
            members: which of its members.
            x: their parameters, shape (members, parameters).

        Returns:
            The derivatives, and for each member what `near` of `evaluate` takes.
        """

        def one(k: int) -> tuple[np.ndarray, Tangent | None]:
            try:
                _, slopes, tangents = member_tangents(
                    evaluation.steady, self.outputs, self.names, int(members[k])
                )
            except NoDerivativesError:
                return np.full((len(self.outputs), len(self.names)), np.nan), None
            unit = np.exp(x[k])
            return slopes * unit, Tangent(x[k], tangents.anchor, tangents.states * unit)

        slopes, near = zip(*map_parallel(one, list(range(len(members)))), strict=True)
        return np.stack(slopes), list(near)

    def _batch(self, which: np.ndarray, x: np.ndarray) -> Batch:
        names = self.targets[0].model.values
        values = {n: np.array([t.model.values[n] for t in self.targets])[which] for n in names}
        values |= {n: np.exp(x[:, k]) for k, n in enumerate(self.names)}
        return Batch(self.circuit, values, len(which), self.policy)
