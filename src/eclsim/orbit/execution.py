"""Execution of steady beats: number of members side by side in one program, and number of threads."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeVar

from eclsim.arguments import WholeNumber, check_fields
from eclsim.execution import threads

Job = TypeVar("Job")
Result = TypeVar("Result")

SIDE_BY_SIDE = 32
"""Number of members that fills the processor's vectors and its first-level cache."""
FEWEST_TO_COMPILE = 256
"""Batch size up to which the program for one member is faster; the one for many takes seconds to compile."""


@dataclass(frozen=True)
class Execution:
    """Execution options of a batch; results differ by rounding at most.

    Args:
        threads: number of parallel threads; by default `eclsim.execution.threads()`.
        width: members that one program computes side by side; by default one for up to `FEWEST_TO_COMPILE`
            members and `SIDE_BY_SIDE` for more. A member's result is the same to the last bit, whatever
            members are beside it.
    """

    threads: int | None = None
    width: int | None = None

    def __post_init__(self) -> None:
        check_fields(self, threads=WholeNumber(1), width=WholeNumber(1))

    def width_for(self, members: int) -> int:
        """Number of members side by side for a batch of a given size."""
        if self.width is not None:
            return self.width
        return SIDE_BY_SIDE if members > FEWEST_TO_COMPILE else 1

    def thread_count(self) -> int:
        """Number of parallel threads."""
        return threads() if self.threads is None else self.threads


@lru_cache(maxsize=1)
def _pool(size: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(size, thread_name_prefix="eclsim")


def in_threads(
    function: Callable[[Job], Result], jobs: Sequence[Job], count: int | None = None
) -> list[Result]:
    """Run all jobs in `count` threads (by default `threads()`) and return their results in order."""
    count = threads() if count is None else count
    if len(jobs) < 2 or count < 2:
        return [function(job) for job in jobs]
    return list(_pool(count).map(function, jobs))
