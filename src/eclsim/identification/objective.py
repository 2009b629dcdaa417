"""Objective of a fit: differences between the steady beat and measurements, for many points at once.

The search uses coordinates of the parameters (see `Scale`): for most the logarithm, in which the paper's
bounds (a tenth to ten times the start value) are symmetric and a step means the same relative change for all.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from eclsim.beat.grid import include_switching_times, refined_for_switching_times
from eclsim.circuit.assembly import assemble
from eclsim.identification.quantities import BEAT_OUTPUTS, OUTPUTS, Scale
from eclsim.orbit.equation import Anchor, OrbitOptions
from eclsim.orbit.execution import SIDE_BY_SIDE, Execution, in_threads
from eclsim.orbit.model import AS_PUBLISHED, Model
from eclsim.orbit.status import NoDerivativesError, Status
from eclsim.orbit.steady import Batch
from eclsim.outputs.signals import output_names
from eclsim.outputs.steady_beat import SteadyBeat, steady_beat

FEWEST_SIDE_BY_SIDE = 8
"""From this number of members on, the compiled program for many members is faster, even half empty."""
NORMAL_90 = 1.6448536269514722
"""Half width of the central 90 % interval of a normal distribution, in standard deviations."""
RISE_90 = 2.705543454095404
"""90 % quantile of the chi-square distribution with one degree of freedom."""


def within_90(squares: np.ndarray, least: float) -> np.ndarray:
    """Whether each chi-square is within `RISE_90` of the smallest of all and of `least`; NaN is not."""
    within: np.ndarray = squares <= np.nanmin(squares, initial=least) + RISE_90
    return within


def execution_of(members: int) -> Execution:
    """Return how a given number of members is computed."""
    return Execution(width=SIDE_BY_SIDE if members >= FEWEST_SIDE_BY_SIDE else 1)


@dataclass(frozen=True)
class Target:
    """Target of the fit of one data point.

    Args:
        model: circuit and parameter values; the values of the free parameters are replaced.
        measured: measured value of each output [mmHg, L/min].
        scales: divisor of each difference, in the unit of the output.
    """

    model: Model
    measured: Mapping[str, float]
    scales: Mapping[str, float]


@dataclass(frozen=True)
class Box:
    """Free parameters and their bounds.

    Args:
        names: names of the parameters.
        start: coordinates of the start values (logarithms of most), shape (parameters,).
        lower: coordinates of the lower bounds.
        upper: coordinates of the upper bounds.
    """

    names: tuple[str, ...]
    start: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    @classmethod
    def of(cls, bounds: Mapping[str, tuple[float, float, float]]) -> Box:
        """Return a box from start value, lower and upper bound of each parameter, in the parameter's unit."""
        table = np.array([tuple(b) for b in bounds.values()], dtype=float).reshape(-1, 3)
        return cls(tuple(bounds), *Scale.of(tuple(bounds)).coordinates(table.T))

    @property
    def scale(self) -> Scale:
        """The coordinates of the parameters."""
        return Scale.of(self.names)

    @property
    def width(self) -> np.ndarray:
        """Distance between the bounds in coordinates, shape (parameters,)."""
        return self.upper - self.lower

    @property
    def prior_deviations(self) -> np.ndarray:
        """Standard deviations of coordinates that are uniform between their bounds, shape (parameters,)."""
        return self.width / np.sqrt(12.0)

    def clip(self, x: np.ndarray) -> np.ndarray:
        """Return the nearest point within the bounds."""
        return np.clip(x, self.lower, self.upper)

    def covariance(self, scaled: np.ndarray, weights: np.ndarray | None = None) -> np.ndarray:
        """Covariance of the coordinates at an optimum (Gaussian approximation), (parameters, parameters).

        The prior of each coordinate is uniform between its bounds. Without it, a parameter that the
        measurements say nothing about would make all intervals infinite.

        A fit with other weights than the measurement noise gives them has larger errors. By linear theory
        they are those of the "sandwich" estimator (White 1980, doi 10.2307/1912934), here with the prior as a
        further measurement of each coordinate.

        Args:
            scaled: d output / d coordinate in standard uncertainties, shape (outputs, parameters).
            weights: weight of each difference in standard uncertainties, up to a common factor, shape
                (outputs,); None for equal weights, which give the smallest errors.
        """
        prior = np.diag(1.0 / self.prior_deviations**2)
        if weights is None or np.allclose(weights, weights[0]):
            return np.linalg.inv(scaled.T @ scaled + prior)
        squares = weights[:, None] ** 2 / np.mean(weights**2)
        inverse = np.linalg.inv(scaled.T @ (squares * scaled) + prior)
        return inverse @ (scaled.T @ (squares**2 * scaled) + prior) @ inverse

    def interval(self, k: int, x: float, error: float) -> tuple[float, float]:
        """Central 90 % interval of a parameter from its coordinate and standard error, cut at the bounds."""
        reach, scale = NORMAL_90 * error, self.scale
        ends = max(x - reach, self.lower[k]), min(x + reach, self.upper[k])
        return scale.value(k, ends[0]), scale.value(k, ends[1])


def correlation(covariance: np.ndarray) -> np.ndarray:
    """Convert a covariance matrix to a correlation matrix."""
    deviation = np.sqrt(np.diag(covariance))
    return covariance / np.outer(deviation, deviation)


@dataclass(frozen=True)
class Explored:
    """Sets of parameters at which a search has computed the model.

    Args:
        x: coordinates of the parameters, shape (sets, parameters).
        outputs: outputs of the model, shape (sets, outputs); an accuracy that ranks the sets is enough.
    """

    x: np.ndarray
    outputs: np.ndarray


@dataclass(frozen=True)
class Tangent:
    """First-order expansion of a steady beat in the parameters, from which searches for nearby beats start.

    Args:
        x: coordinates of the parameters, shape (parameters,).
        anchor: the beat and its inverse Jacobian.
        states: d state / d coordinate, shape (states, parameters).
    """

    x: np.ndarray
    anchor: Anchor
    states: np.ndarray

    def state(self, x: np.ndarray) -> np.ndarray:
        """State at other parameters; no entry changes by more than half its size plus 50 mL."""
        change = self.states @ (x - self.x)
        allowed = 0.5 * np.abs(self.anchor.state) + 50.0
        return self.anchor.state + change / max(float(np.max(np.abs(change) / allowed)), 1.0)


Tangents = tuple[Tangent, ...]
"""Tangents of a member of a search: one for each data point that the member represents."""


@dataclass(frozen=True)
class Evaluation:
    """The model evaluated for several members, shape (members, ...).

    Args:
        steady: steady beats of the members.
        outputs: outputs, shape (members, outputs); NaN without a steady beat or if it is not unique.
        residuals: weighted differences, 0 where nothing was measured, shape (members, outputs).
    """

    steady: SteadyBeat
    outputs: np.ndarray
    residuals: np.ndarray

    @cached_property
    def costs(self) -> np.ndarray:
        """Sum of squared residuals, shape (members,); infinite without outputs."""
        total = np.sum(self.residuals**2, axis=1)
        return np.where(np.isfinite(total), total, np.inf)

    @property
    def one_of_many(self) -> np.ndarray:
        """Members whose steady beat is not unique because valves stay shut, shape (members,)."""
        return self.steady.status == Status.ONE_OF_MANY

    @property
    def without_gases(self) -> np.ndarray:
        """Members without the steady gas state that measured gases need, shape (members,)."""
        return self.steady.without_gases & np.isinf(self.costs)


class Objective:
    """Weighted differences of several data points that share a circuit.

    Args:
        targets: the data points.
        names: names of the free parameters.
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
        self.scale = Scale.of(self.names)
        self.has_switching_times = include_switching_times(assemble(self.circuit), self.names)
        known, measured = output_names(self.circuit), {o for t in targets for o in t.measured}
        self.outputs = tuple(o for o in OUTPUTS if o in known and (o in BEAT_OUTPUTS or o in measured))
        missing = measured - {*self.outputs}
        if missing:
            raise ValueError(f"{', '.join(sorted(missing))}: no output of this circuit that can be fitted")
        self.measured = np.array([[float(t.measured.get(o, 0.0)) for o in self.outputs] for t in targets])
        scales = [[t.scales[o] if o in t.measured else np.inf for o in self.outputs] for t in targets]
        self.weights = 1.0 / np.array(scales, dtype=float)

    def evaluate(
        self,
        points: np.ndarray,
        x: np.ndarray,
        options: OrbitOptions | None = None,
        resolution: int | None = None,
        tangents: Sequence[Tangents] | None = None,
    ) -> Evaluation:
        """Evaluate the model for several members.

        If a switching time is free, the grid is finer than asked for, or the slopes by it would be wrong.

        Args:
            points: data point of each member, shape (members,).
            x: coordinates of the parameters, shape (members, parameters).
            options: accuracy and effort of the orbit solver.
            resolution: resolution of the grid of a beat; None gives each member what it needs, so that
                outputs jump by a thousandth where this changes.
            tangents: tangents at solved beats close to each member, from which the searches start.
        """
        if self.has_switching_times:
            usual = int(self.resolutions(points, x).max()) if resolution is None else resolution
            resolution = refined_for_switching_times(usual)
        start = None if tangents is None else _extrapolated([t for (t,) in tangents], x)
        steady = steady_beat(
            self._batch(points, x), self.outputs, options=options, start=start, resolution=resolution,
            execution=execution_of(len(points)),
        ).determined_only()  # fmt: skip
        outputs = steady.values.T
        weights = self.weights[points]
        differences = np.where(weights > 0.0, outputs - self.measured[points], 0.0) * weights
        return Evaluation(steady, outputs, differences)

    def resolutions(self, points: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Resolution of the grid that each member needs, shape (members,)."""
        return self._batch(points, x).resolutions()

    def linearise(
        self, evaluation: Evaluation, members: Sequence[int], x: np.ndarray
    ) -> tuple[np.ndarray, list[Tangents | None]]:
        """d output / d coordinate of some members, shape (members, outputs, parameters), and their tangents.

        NaN where a member has no derivatives: no steady beat was found, or a valve never opens and blood is
        trapped behind it.

        Args:
            evaluation: evaluation that contains the members.
            members: indices of the members in the evaluation.
            x: coordinates of their parameters, shape (members, parameters).
        """

        def linearised(k: int) -> tuple[np.ndarray, Tangents | None]:
            try:
                linear = evaluation.steady.linearise(self.outputs, self.names, int(members[k]))
            except NoDerivativesError:
                return np.full((len(self.outputs), len(self.names)), np.nan), None
            unit = self.scale.slopes(x[k])
            return linear.slopes * unit, (Tangent(x[k], linear.orbit.anchor, linear.orbit.states * unit),)

        slopes, tangents = zip(*in_threads(linearised, list(range(len(members)))), strict=True)
        return np.stack(slopes), list(tangents)

    def _batch(self, points: np.ndarray, x: np.ndarray) -> Batch:
        names = self.targets[0].model.values
        values = {n: np.array([t.model.values[n] for t in self.targets])[points] for n in names}
        values |= dict(zip(self.names, self.scale.values(x).T, strict=True))
        return Batch(self.circuit, values, len(points), self.policy)


def _extrapolated(tangents: Sequence[Tangent], x: np.ndarray) -> Anchor:
    """Start values of the search for the beats of members, each extrapolated from a nearby solved beat."""
    states = [tangent.state(of_member) for tangent, of_member in zip(tangents, x, strict=True)]
    return Anchor(np.stack(states, axis=1), np.stack([t.anchor.inverse for t in tangents], axis=2))


class SharedObjective:
    """The data points of an objective as one problem with common parameters.

    Residuals are concatenated; the common parameters come first.

    Args:
        objective: objective whose data points are those of one patient.
        common: indices of the parameters that all points share.
    """

    def __init__(self, objective: Objective, common: Sequence[int]):
        self.single = objective
        size, self.count = len(objective.names), len(objective.targets)
        separate = [k for k in range(size) if k not in common]
        # For each point, the indices of its parameters among all parameters.
        self.places = np.zeros((self.count, size), dtype=int)
        for point in range(self.count):
            self.places[point, list(common)] = np.arange(len(common))
            self.places[point, separate] = len(common) + point * len(separate) + np.arange(len(separate))
        self.size = len(common) + self.count * len(separate)
        self.weights = objective.weights.reshape(1, -1)
        self.outputs = objective.outputs * self.count

    def evaluate(
        self,
        points: np.ndarray,
        x: np.ndarray,
        options: OrbitOptions | None = None,
        resolution: int | None = None,
        tangents: Sequence[Tangents] | None = None,
    ) -> Evaluation:
        """Evaluate all points at sets of common and individual parameters, (members, all parameters)."""
        beats = None if tangents is None else [(beat,) for of_member in tangents for beat in of_member]
        single = self.single.evaluate(self._points(points), self.rows(x), options, resolution, beats)
        shape = (len(points), len(self.outputs))
        return Evaluation(single.steady, single.outputs.reshape(shape), single.residuals.reshape(shape))

    def linearise(
        self, evaluation: Evaluation, members: Sequence[int], x: np.ndarray
    ) -> tuple[np.ndarray, list[Tangents | None]]:
        """d output / d coordinate, shape (members, all outputs, all parameters), and the tangents."""
        rows = [m * self.count + point for m in members for point in range(self.count)]
        blocks, beats = self.single.linearise(evaluation, rows, self.rows(x))
        jacobian = np.zeros((len(members), self.count, len(self.single.outputs), self.size))
        for k, block in enumerate(blocks):
            member, point = divmod(k, self.count)
            jacobian[member, point][:, self.places[point]] = block
        tangents: list[Tangents | None] = []
        for k in range(0, len(beats), self.count):
            solved = [beat for of_point in beats[k : k + self.count] if of_point for beat in of_point]
            tangents.append(tuple(solved) if len(solved) == self.count else None)
        return jacobian.reshape(len(members), -1, self.size), tangents

    def resolutions(self, points: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Resolution that the most demanding point of each member needs, shape (members,)."""
        single = self.single.resolutions(self._points(points), self.rows(x))
        return single.reshape(len(points), -1).max(axis=1)

    def _points(self, members: np.ndarray) -> np.ndarray:
        return np.tile(np.arange(self.count), len(members))

    def rows(self, x: np.ndarray) -> np.ndarray:
        """Parameters of each member and point, shape (members * points, parameters)."""
        return x[:, self.places].reshape(-1, self.places.shape[1])

    def joined(self, fitted: np.ndarray) -> np.ndarray:
        """Combine the parameters of each point (points, parameters) into all; common ones are averaged."""
        total, times = np.zeros(self.size), np.zeros(self.size)
        np.add.at(total, self.places, fitted)
        np.add.at(times, self.places, 1.0)
        return total / times

    def box(self, box: Box) -> Box:
        """Return the bounds of all parameters."""
        ends = (np.tile(v, (self.count, 1)) for v in (box.start, box.lower, box.upper))
        names = np.empty(self.size, dtype=object)
        for point, places in enumerate(self.places):
            for name, place in zip(box.names, places, strict=True):
                common = int((self.places == place).sum()) == self.count
                names[place] = name if common and self.count > 1 else f"{name} of point {point + 1}"
        return Box(tuple(map(str, names)), *(self.joined(v) for v in ends))


LeastSquaresProblem = Objective | SharedObjective
"""Separate data points, or several with common parameters."""
