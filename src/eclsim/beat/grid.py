"""The grid of one beat in phase, shared by all patients of a batch, and the resolution that a patient needs.

Systole and the opening of the valves to the ventricles happen in the first six tenths of the beat, the atrial
kick in the last; the grid is fine there and coarse in diastasis. Resolution r has 400 r steps: 240 r on
0..0.45, 60 r on 0.45..0.6, 30 r on 0.6..0.9 and 70 r on 0.9..1. The published break points of the activation
curves fall on grid points.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

STEPS_PER_BLOCK = 10
SEGMENTS = ((0.45, 24), (0.6, 6), (0.9, 3), (1.0, 7))
"""End of each segment and its number of blocks at resolution 1."""


@dataclass(frozen=True)
class PhaseGrid:
    """Blocks of equal steps that cover one beat."""

    resolution: int = 1

    @cached_property
    def block_steps(self) -> np.ndarray:
        """Step of each block, in phase, shape (blocks,)."""
        steps, start = [], 0.0
        for end, blocks in SEGMENTS:
            count = blocks * self.resolution
            steps += [(end - start) / (count * STEPS_PER_BLOCK)] * count
            start = end
        return np.array(steps)

    @cached_property
    def phases(self) -> np.ndarray:
        """Grid points from 0 to 1 inclusive, shape (steps + 1,)."""
        nodes, start = [np.zeros(1)], 0.0
        for end, blocks in SEGMENTS:
            count = blocks * self.resolution * STEPS_PER_BLOCK
            nodes.append(start + (end - start) * np.arange(1, count + 1) / count)
            start = end
        return np.concatenate(nodes)

    @property
    def n_steps(self) -> int:
        """Number of steps of a beat."""
        return len(self.phases) - 1

    @property
    def systolic_step(self) -> float:
        """Step in systole, in phase."""
        return float(self.block_steps[0])
