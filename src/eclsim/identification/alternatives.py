"""What else moves when a parameter that the measurements do not determine is somewhere else.

The linear analysis at the optimum cannot see this: an undetermined parameter may end a factor of ten from
the truth, and carry others with it. So each of them is held elsewhere between its bounds and the others are
fitted again; a parameter that ends elsewhere too, at the same outputs, is not determined either.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eclsim.identification.objective import Box, Objective
from eclsim.identification.profiles import REFITTING, elsewhere, held_fits

SAME_OUTPUTS = 3e-3
"""Outputs that differ by less than this share are the same: no measurement tells them apart."""


@dataclass(frozen=True)
class Alternatives:
    """Fits of one data point with one parameter held elsewhere, shape (fits, ...).

    Args:
        held: place of the parameter that was held.
        x: logarithms of the parameters.
        change: largest relative change of a measured output from the optimum's; NaN without a steady beat.
    """

    held: np.ndarray
    x: np.ndarray
    change: np.ndarray

    def followers(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How far each parameter moves at the same outputs, and which held parameter it follows.

        Args:
            x: logarithms of the parameters at the optimum, shape (parameters,).
        """
        same = self.change <= SAME_OUTPUTS
        if not same.any():
            return np.zeros(len(x)), np.zeros(len(x), dtype=int)
        moved = np.abs(self.x[same] - x)
        return moved.max(axis=0), self.held[same][moved.argmax(axis=0)]


def alternatives(
    objective: Objective, box: Box, optima: Sequence[np.ndarray], undetermined: Sequence[Sequence[int]]
) -> list[Alternatives]:
    """Hold undetermined parameters of several data points elsewhere, all side by side.

    Args:
        objective: data points.
        box: bounds.
        optima: logarithms of the parameters of each data point.
        undetermined: places of its undetermined parameters.
    """
    plans = [elsewhere(x, box, chosen) for x, chosen in zip(optima, undetermined, strict=True)]
    counts = [len(held) for held, _ in plans]
    which = np.repeat(np.arange(len(plans)), counts)
    if not len(which):
        return [
            Alternatives(np.zeros(0, dtype=int), np.zeros((0, len(box.names))), np.zeros(0)) for _ in plans
        ]
    stacked = np.stack(optima)
    found = held_fits(
        objective, which, box, stacked[which],
        np.concatenate([h for h, _ in plans]), np.concatenate([v for _, v in plans]), 1,
    )  # fmt: skip
    points = np.unique(which)
    here = np.full((len(plans), len(objective.outputs)), np.nan)
    here[points] = objective.evaluate(points, stacked[points], REFITTING.orbits, 1).outputs
    scale = np.where(objective.weights > 0.0, np.maximum(np.abs(here), 1e-3), np.inf)
    change = np.max(np.abs(found.outputs - here[which]) / scale[which], axis=1)
    return [Alternatives(held, found.x[which == k], change[which == k]) for k, (held, _) in enumerate(plans)]
