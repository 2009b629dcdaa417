"""Data points of one patient fitted with some parameters in common, the others each point's own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from eclsim.identification.least_squares import EXACT, Refinement, Termination, Tolerances, refine
from eclsim.identification.multi_start import FitStatus, Optimum, SharedEstimate
from eclsim.identification.objective import Box, Evaluation, Objective, Tangents
from eclsim.identification.precision import covariance, prior_deviations
from eclsim.orbit.equation import OrbitOptions
from eclsim.sensitivity.collinearity import ScaledSensitivities, propose

SHARES = (0.2, 0.5, 0.8)
"""Further starts of the common parameters: shares of the way between their bounds."""
SEARCHING = Tolerances(1e-3, orbits=OrbitOptions(1e-6, 1e-5, newton_iterations=0), resolution=1)
LAST = Tolerances(1e-6, 1e-12, 1e-8, 40, EXACT.orbits)


class SharedObjective:
    """The points of an objective as one: residuals one after the other, parameters the common ones first.

    Args:
        objective: its data points are those of one patient.
        common: places of the parameters that all points share.
    """

    def __init__(self, objective: Objective, common: Sequence[int]):
        self.single = objective
        size, self.count = len(objective.names), len(objective.targets)
        own = [k for k in range(size) if k not in common]
        # For each point: where each of its parameters stands among those of all.
        self.places = np.zeros((self.count, size), dtype=int)
        for point in range(self.count):
            self.places[point, list(common)] = np.arange(len(common))
            self.places[point, own] = len(common) + point * len(own) + np.arange(len(own))
        self.size = len(common) + self.count * len(own)
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
        """All points at some sets of common and own parameters, (members, all parameters)."""
        beats = None if tangents is None else [(beat,) for of_member in tangents for beat in of_member]
        single = self.single.evaluate(self._points(points), self.rows(x), options, resolution, beats)
        shape = (len(points), len(self.outputs))
        return Evaluation(single.steady, single.outputs.reshape(shape), single.residuals.reshape(shape))

    def linearise(
        self, evaluation: Evaluation, members: Sequence[int], x: np.ndarray
    ) -> tuple[np.ndarray, list[Tangents | None]]:
        """d output / d log parameter, shape (members, all outputs, all parameters), and the beats."""
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
        """Resolution that the most demanding point of each member needs."""
        single = self.single.resolutions(self._points(points), self.rows(x))
        return single.reshape(len(points), -1).max(axis=1)

    def _points(self, members: np.ndarray) -> np.ndarray:
        return np.tile(np.arange(self.count), len(members))

    def rows(self, x: np.ndarray) -> np.ndarray:
        """Parameters of each member and point, shape (members * points, parameters)."""
        return x[:, self.places].reshape(-1, self.places.shape[1])

    def joined(self, own: np.ndarray) -> np.ndarray:
        """All parameters from those of each point (points, parameters): common ones are averaged."""
        total, times = np.zeros(self.size), np.zeros(self.size)
        np.add.at(total, self.places, own)
        np.add.at(times, self.places, 1.0)
        return total / times

    def box(self, box: Box) -> Box:
        """Bounds of all parameters."""
        ends = (np.tile(v, (self.count, 1)) for v in (box.start, box.lower, box.upper))
        names = np.empty(self.size, dtype=object)
        for point, places in enumerate(self.places):
            for name, place in zip(box.names, places, strict=True):
                common = int((self.places == place).sum()) == self.count
                names[place] = name if common and self.count > 1 else f"{name} of point {point + 1}"
        return Box(tuple(map(str, names)), *(self.joined(v) for v in ends))


def refine_shared(
    objective: Objective, box: Box, common: Sequence[int], own: np.ndarray
) -> tuple[SharedObjective, Refinement]:
    """Fit all points of an objective with common parameters.

    Args:
        objective: data points of one patient.
        box: bounds of the parameters of one point.
        common: places of those that are shared.
        own: best fit of each point by itself, shape (points, parameters).
    """
    problem = SharedObjective(objective, common)
    space = problem.box(box)
    starts = np.tile(problem.joined(own), (1 + len(SHARES), 1))
    first = np.arange(len(common))
    starts[1:, first] = space.lower[first] + np.outer(SHARES, space.width[first])
    points = np.zeros(len(starts), dtype=int)
    rough = refine(problem, points, starts, space, SEARCHING)
    best = rough.x[[np.argmin(rough.costs)]]
    level = int(problem.resolutions(points[:1], best)[0])
    return problem, refine(problem, points[:1], best, space, replace(LAST, resolution=level))


def fit_shared(
    objective: Objective,
    box: Box,
    separate: Sequence[Optimum],
    errors: Sequence[np.ndarray],
    shared: Sequence[str],
) -> list[Optimum]:
    """The optima of points that were fitted one by one, fitted again with common parameters.

    Args:
        objective: the points of one patient.
        box: bounds of the parameters of one point.
        separate: optimum of each point by itself.
        errors: standard uncertainties of the measurements of each point.
        shared: names of the common parameters.
    """
    if any(o.status is FitStatus.NO_STEADY_BEAT for o in separate):
        return list(separate)
    common = [box.names.index(n) for n in shared if n in box.names]
    problem, refined = refine_shared(objective, box, common, np.stack([o.x for o in separate]))
    height, space = len(objective.outputs), problem.box(box)
    jacobian, outputs = refined.jacobians[0], refined.outputs[0]
    scaled = _scaled(objective, jacobian, errors, space)
    spread = covariance(scaled.matrix, prior_deviations(space.lower, space.upper))
    excluded = propose(scaled).excluded
    settled = refined.terminations[0] == Termination.SETTLED
    optima = []
    for k, before in enumerate(separate):
        rows, places = slice(k * height, (k + 1) * height), problem.places[k]
        residuals = (outputs[rows] - objective.measured[k]) * objective.weights[k]
        reasons = {
            name: excluded[space.names[place]]
            for name, place in zip(box.names, places, strict=True)
            if space.names[place] in excluded
        }
        optima.append(
            replace(
                before, x=refined.x[0, places], outputs=outputs[rows], cost=float(np.sum(residuals**2)),
                jacobian=jacobian[rows][:, places],
                status=FitStatus.FITTED if settled else FitStatus.NOT_SETTLED,
                starts=replace(before.starts, agreeing=np.zeros(len(before.starts.agreeing), dtype=bool)),
                shared=SharedEstimate(spread[np.ix_(places, places)], reasons),
            )
        )  # fmt: skip
    return optima


def _scaled(
    objective: Objective, jacobian: np.ndarray, errors: Sequence[np.ndarray], space: Box
) -> ScaledSensitivities:
    """Sensitivities of everything that was measured of the patient, in standard uncertainties."""
    rows, names = [], []
    height = len(objective.outputs)
    for k, (target, own) in enumerate(zip(objective.targets, errors, strict=True)):
        for name, error in zip(target.measured, own, strict=True):
            rows.append(jacobian[k * height + objective.outputs.index(name)] / error)
            names.append(f"{name} of point {k + 1}")
    return ScaledSensitivities(tuple(names), space.names, np.array(rows))
