"""How much a validation computes, and where its many tasks run."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from eclsim.execution import Distribution, Executor, Format, Progress, Tasks
from eclsim.execution.tasks import in_process

Argument = TypeVar("Argument")
Result = TypeVar("Result")


@dataclass(frozen=True)
class Effort:
    """How much to compute, and where.

    Args:
        quick: a case of each kind of circuit instead of all.
        points: points of the robustness sweep in each configuration.
        executor: runs sweeps.
        folder: keeps their results; None keeps them for this call alone.
        progress: called as their tasks are done.
    """

    quick: bool = False
    points: int = 512
    executor: Executor = field(default=Executor(Distribution(), in_process))
    folder: Path | None = None
    progress: Progress | None = None

    def complete(self, tasks: Tasks[Argument, Result], format: Format[Result]) -> list[Result]:
        """Results of the tasks of a sweep, in a folder of its own."""
        place = None if self.folder is None else self.folder / tasks.title
        return self.executor.complete(tasks, place, format, self.progress)
