"""Run a compiled function over many patients: alone for a few, in lanes of a fixed width for many.

A program compiled for one patient starts sooner and is used up to `FEW` of them; `LANES` patients side by
side fill the processor's vectors and its first-level cache. Chunks run in parallel threads (XLA releases the
interpreter), each chunk the same whatever stands beside it.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property, lru_cache
from typing import Any

import jax
import numpy as np

from eclsim.execution.threads import threads

LANES = 32
FEW = 256
"""Up to so many patients the program for one is quicker: the one for many takes seconds to compile."""
WORTH_LANES = 8
"""From so many patients the program for many is quicker, half empty or not, once it is compiled."""
HANDFUL = 3
"""Below so many patients one after the other is quicker than half-empty lanes."""


@lru_cache(maxsize=1)
def _pool(size: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(size, thread_name_prefix="eclsim")


def map_parallel(function: Callable[[Any], Any], jobs: list[Any], parallel: int | None = None) -> list[Any]:
    """Results of all jobs, in order, in so many threads; left out, as many as `threads` says."""
    count = threads() if parallel is None else parallel
    if len(jobs) < 2 or count < 2:
        return [function(job) for job in jobs]
    return list(_pool(count).map(function, jobs))


class Lanes:
    """One beat of many patients, by the program for one or by the one for many.

    Args:
        program: beat of their circuit.
        packed: their parameters, shape (names, patients).
        wide: True takes the program for many.
    """

    def __init__(self, program: Any, packed: np.ndarray, wide: bool):
        self.program = program
        self.packed = packed
        self.alone = not wide or packed.shape[1] <= HANDFUL

    @cached_property
    def _each(self) -> list[Any]:
        """Parameters of each patient where the program runs: they stay the same from beat to beat."""
        return [jax.device_put(column) for column in np.ascontiguousarray(self.packed.T)]

    def beat(self, states: np.ndarray) -> np.ndarray:
        """State of every patient after one beat, shape (states, patients)."""
        if self.alone:
            step = self.program.alone()
            after = np.empty_like(states)
            for patient, packed in enumerate(self._each):
                after[:, patient] = step(states[:, patient], packed)
            return after
        parts, count = [], states.shape[1]
        for first in range(0, count, LANES):
            lanes = np.arange(first, first + LANES).clip(max=count - 1)
            after = np.asarray(self.program.beat(states[:, lanes], self.packed[:, lanes]))
            parts.append(after[:, : count - first])
        return np.concatenate(parts, axis=1)
