"""Data points of one patient fitted together: some parameters are common, the others each point's own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from eclsim.identification.least_squares import EXACT, Precision, Refined, refine
from eclsim.identification.objective import Box, Evaluation, Objective, Tangent
from eclsim.orbit.equation import OrbitOptions

SHARES = (0.2, 0.5, 0.8)
"""Further starts of the common parameters: shares of the way between their bounds."""
SEARCHING = OrbitOptions(1e-6, 1e-5, newton_iterations=0)


@dataclass(frozen=True)
class _Expanded(Evaluation):
    """An evaluation that keeps that of the single points."""

    single: Evaluation


class JointObjective:
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
        self.targets = (objective.targets,)

    def evaluate(
        self,
        which: np.ndarray,
        x: np.ndarray,
        options: OrbitOptions | None = None,
        resolution: int | None = None,
        near: Sequence[Sequence[Tangent]] | None = None,
    ) -> Evaluation:
        """All points at some joint parameters (members, joint parameters)."""
        points = np.tile(np.arange(self.count), len(which))
        beats = None if near is None else [beat for of_member in near for beat in of_member]
        found = self.single.evaluate(points, self.rows(x), options, resolution, beats)
        shape = (len(which), len(self.outputs))
        return _Expanded(found.steady, found.outputs.reshape(shape), found.residuals.reshape(shape), found)

    def linearise(
        self, evaluation: Evaluation, members: Sequence[int], x: np.ndarray
    ) -> tuple[np.ndarray, list[Any]]:
        """d output / d log parameter of some members, shape (members, all outputs, joint parameters).

        And for each member what `near` of `evaluate` takes.
        """
        assert isinstance(evaluation, _Expanded)
        rows = [m * self.count + point for m in members for point in range(self.count)]
        blocks, beats = self.single.linearise(evaluation.single, rows, self.rows(x))
        height = len(self.single.outputs)
        found = np.zeros((len(members), self.count, height, self.size))
        for k, block in enumerate(blocks):
            member, point = divmod(k, self.count)
            found[member, point][:, self.places[point]] = block
        near = [beats[k : k + self.count] for k in range(0, len(beats), self.count)]
        whole = [None if any(beat is None for beat in of_member) else of_member for of_member in near]
        return found.reshape(len(members), -1, self.size), whole

    def resolutions(self, which: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Resolution that the most demanding point of each member needs."""
        points = np.tile(np.arange(self.count), len(which))
        return self.single.resolutions(points, self.rows(x)).reshape(len(which), -1).max(axis=1)

    def rows(self, x: np.ndarray) -> np.ndarray:
        """Parameters of each member and point, shape (members * points, parameters)."""
        return x[:, self.places].reshape(-1, self.places.shape[1])

    def joint(self, own: np.ndarray) -> np.ndarray:
        """Joint parameters from those of each point (points, parameters): common ones are averaged."""
        total, times = np.zeros(self.size), np.zeros(self.size)
        np.add.at(total, self.places, own)
        np.add.at(times, self.places, 1.0)
        return total / times

    def box(self, box: Box) -> Box:
        """Bounds of the joint parameters."""
        wide = (np.tile(v, (self.count, 1)) for v in (box.start, box.lower, box.upper))
        names = np.empty(self.size, dtype=object)
        for point, places in enumerate(self.places):
            for name, place in zip(box.names, places, strict=True):
                first = int((self.places == place).sum()) == self.count
                names[place] = name if first and self.count > 1 else f"{name} of point {point + 1}"
        return Box(tuple(map(str, names)), *(self.joint(v) for v in wide))


def fit_together(
    objective: Objective, box: Box, common: Sequence[int], own: np.ndarray
) -> tuple[JointObjective, Refined]:
    """Fit all points of an objective with common parameters.

    Args:
        objective: data points of one patient.
        box: bounds of the parameters of one point.
        common: places of those that are shared.
        own: best fit of each point alone, shape (points, parameters).
    """
    joint = JointObjective(objective, common)
    space = joint.box(box)
    first = joint.joint(own)
    starts = [first]
    for share in SHARES:
        elsewhere = first.copy()
        few = np.arange(len(common))
        elsewhere[few] = space.lower[few] + share * (space.upper[few] - space.lower[few])
        starts.append(elsewhere)
    search: Objective = joint  # pyright: ignore[reportAssignmentType]  # all that the search calls is there
    which = np.zeros(len(starts), dtype=int)
    rough = refine(search, which, np.stack(starts), space, Precision(1e-3, orbits=SEARCHING, resolution=1))
    best = rough.x[[np.argmin(rough.costs)]]
    level = int(joint.resolutions(which[:1], best)[0])
    last = refine(search, which[:1], best, space, Precision(1e-6, 1e-12, 1e-8, 40, EXACT.orbits, level))
    return joint, last
