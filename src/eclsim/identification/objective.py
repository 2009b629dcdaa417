"""What is minimised: differences between the model's steady beat and measurements, for many points at once.

Parameters are sought on a logarithmic scale, on which the paper's bounds (a tenth to ten times the start
value) are symmetric and a step means the same change for all of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from eclsim.beat.grid import needed_resolution
from eclsim.circuit.assembly import assemble
from eclsim.identification.observation import OUTPUTS
from eclsim.orbit.equation import Anchor, OrbitOptions
from eclsim.orbit.execution import SIDE_BY_SIDE, Execution, in_threads
from eclsim.orbit.model import AS_PUBLISHED, Model
from eclsim.orbit.status import NoDerivativesError
from eclsim.orbit.steady import Batch
from eclsim.outputs.signals import output_names
from eclsim.outputs.steady_beat import SteadyBeat, steady_beat

WORTH_SIDE_BY_SIDE = 8
"""From so many members the program for many is quicker, half empty or not, once it is compiled."""


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

    @property
    def width(self) -> np.ndarray:
        """Logarithm of upper over lower bound, shape (parameters,)."""
        return self.upper - self.lower

    def clip(self, x: np.ndarray) -> np.ndarray:
        """The nearest point inside."""
        return np.clip(x, self.lower, self.upper)


@dataclass(frozen=True)
class Tangent:
    """A steady beat to first order in the parameters: where the search for beats close by starts.

    Args:
        x: logarithms of the parameters, shape (parameters,).
        anchor: the beat and its inverse Jacobian.
        states: d state / d log parameter, shape (states, parameters).
    """

    x: np.ndarray
    anchor: Anchor
    states: np.ndarray

    def state(self, x: np.ndarray) -> np.ndarray:
        """State at other parameters; no entry of it changes by more than half its size and 50 mL."""
        change = self.states @ (x - self.x)
        allowed = 0.5 * np.abs(self.anchor.state) + 50.0
        return self.anchor.state + change / max(float(np.max(np.abs(change) / allowed)), 1.0)


Tangents = tuple[Tangent, ...]
"""Of a member of a search: one for each data point that the member stands for."""


@dataclass(frozen=True)
class Evaluation:
    """The model at some members, shape (members, ...).

    Args:
        steady: their steady beats.
        outputs: shape (members, outputs); NaN where no steady beat was found.
        residuals: weighted differences, 0 where nothing was measured, shape (members, outputs).
    """

    steady: SteadyBeat
    outputs: np.ndarray
    residuals: np.ndarray

    @cached_property
    def costs(self) -> np.ndarray:
        """Sum of squared residuals; infinite where no steady beat was found, shape (members,)."""
        total = np.sum(self.residuals**2, axis=1)
        return np.where(np.isfinite(total), total, np.inf)


class LeastSquaresProblem(Protocol):
    """What a search asks for: separate data points (`Objective`), or several with common parameters."""

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs of one member."""
        ...

    @property
    def weights(self) -> np.ndarray:
        """1 / scale of each difference, 0 where nothing was measured, shape (data points, outputs)."""
        ...

    def evaluate(
        self,
        points: np.ndarray,
        x: np.ndarray,
        options: OrbitOptions | None = None,
        resolution: int | None = None,
        tangents: Sequence[Tangents] | None = None,
    ) -> Evaluation:
        """Residuals of members, each at parameters and for a data point of its own."""
        ...

    def linearise(
        self, evaluation: Evaluation, members: Sequence[int], x: np.ndarray
    ) -> tuple[np.ndarray, list[Tangents | None]]:
        """d output / d log parameter of some members, and what `tangents` of `evaluate` takes."""
        ...

    def resolutions(self, points: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Resolution of the grid that each member needs."""
        ...


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
        points: np.ndarray,
        x: np.ndarray,
        options: OrbitOptions | None = None,
        resolution: int | None = None,
        tangents: Sequence[Tangents] | None = None,
    ) -> Evaluation:
        """The model at some members.

        Args:
            points: data point of each member, shape (members,).
            x: logarithms of the parameters, shape (members, parameters).
            options: accuracy and effort of the orbit solver.
            resolution: of the grid of a beat; left out, each member gets what it needs, so that outputs jump
                by a thousandth where the need changes.
            tangents: a solved beat close to each member, from where the search for its own starts.
        """
        start = None if tangents is None else _extrapolated([t for (t,) in tangents], x)
        execution = Execution(width=SIDE_BY_SIDE if len(points) >= WORTH_SIDE_BY_SIDE else 1)
        steady = steady_beat(
            self._batch(points, x), self.outputs, options=options, start=start, resolution=resolution,
            execution=execution,
        )  # fmt: skip
        outputs = steady.values.T
        return Evaluation(steady, outputs, (outputs - self.measured[points]) * self.weights[points])

    def resolutions(self, points: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Resolution of the grid that each member needs, shape (members,)."""
        batch = self._batch(points, x)
        return np.broadcast_to(needed_resolution(assemble(self.circuit), batch.values), (len(points),))

    def linearise(
        self, evaluation: Evaluation, members: Sequence[int], x: np.ndarray
    ) -> tuple[np.ndarray, list[Tangents | None]]:
        """d output / d log parameter of some members, shape (members, outputs, parameters), and their beats.

        NaN where a member has no derivatives: no steady beat was found, or a valve never opens and blood is
        shut in behind it.

        Args:
            evaluation: of the points.
            members: which of its members.
            x: their parameters, shape (members, parameters).
        """

        def one(k: int) -> tuple[np.ndarray, Tangents | None]:
            try:
                found = evaluation.steady.linearise(self.outputs, self.names, int(members[k]))
            except NoDerivativesError:
                return np.full((len(self.outputs), len(self.names)), np.nan), None
            unit = np.exp(x[k])
            return found.slopes * unit, (Tangent(x[k], found.orbit.anchor, found.orbit.states * unit),)

        slopes, tangents = zip(*in_threads(one, list(range(len(members)))), strict=True)
        return np.stack(slopes), list(tangents)

    def _batch(self, points: np.ndarray, x: np.ndarray) -> Batch:
        names = self.targets[0].model.values
        values = {n: np.array([t.model.values[n] for t in self.targets])[points] for n in names}
        values |= {n: np.exp(x[:, k]) for k, n in enumerate(self.names)}
        return Batch(self.circuit, values, len(points), self.policy)


def _extrapolated(tangents: Sequence[Tangent], x: np.ndarray) -> Anchor:
    """Where the search for the beats of members starts, each from a solved beat close to it."""
    states = [tangent.state(own) for tangent, own in zip(tangents, x, strict=True)]
    return Anchor(np.stack(states, axis=1), np.stack([t.anchor.inverse for t in tangents], axis=2))
