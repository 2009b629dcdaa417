"""Tasks: a pure function, its arguments, and the running of it."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from itertools import islice
from threading import Event
from typing import Generic, Protocol, TypeVar

Setting = TypeVar("Setting")
_CHOSEN: ContextVar[int | None] = ContextVar("threads", default=None)


def threads() -> int:
    """Return the number of threads: from `using_threads`, `ECLSIM_THREADS`, or the CPUs of this process."""
    if (chosen := _CHOSEN.get()) is not None:
        return chosen
    setting = os.environ.get("ECLSIM_THREADS", "")
    if setting.isdigit() and int(setting) > 0:
        return int(setting)
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)


def using_threads(count: int | None) -> AbstractContextManager[None]:
    """Set the number of threads for computations of this thread; None leaves it unchanged."""
    return nullcontext() if count is None else _set(_CHOSEN, count)


@contextmanager
def _set(variable: ContextVar[Setting], value: Setting) -> Iterator[None]:
    """Give a variable another value for a while."""
    token = variable.set(value)
    try:
        yield
    finally:
        variable.reset(token)


# --- tasks ------------------------------------------------------------------------------------------


Argument = TypeVar("Argument")
Result = TypeVar("Result")
StoredResult = TypeVar("StoredResult", contravariant=True)

_LISTENER: ContextVar[Callable[[str], None] | None] = ContextVar("listener", default=None)


@dataclass(frozen=True)
class Tasks(Generic[Argument, Result]):
    """Many tasks of one kind, which can be run in any order and anywhere.

    Args:
        title: title of the work in progress lines and messages: "sensitivity", "fits".
        unit: plural noun for the tasks: "blocks".
        compute: computes the result of an argument. It must be picklable, without side effects, and
            independent to the last bit of what was computed before or is computed beside it. It holds the
            data that tasks share.
        arguments: one argument for each task, small and picklable.
        inputs: everything that determines the results, as plain data for JSON; results of other inputs are
            refused.
        side_by_side: whether, in one process, several tasks run at a time, each in one thread; otherwise
            tasks run one after another, each with all threads.
    """

    title: str
    unit: str
    compute: Callable[[Argument], Result]
    arguments: Sequence[Argument]
    inputs: Mapping[str, object] = field(default_factory=dict)
    side_by_side: bool = False


class Store(Protocol[StoredResult]):
    """Store of finished results."""

    def finished(self) -> set[int]:
        """Return the numbers of the tasks whose results exist."""
        ...

    def save(self, number: int, result: StoredResult) -> None:
        """Store the result of a task."""
        ...


@dataclass(frozen=True)
class TaskProgress:
    """Progress of the work; as text, the line to show.

    Args:
        title: title of the work.
        unit: plural noun for the tasks.
        done: number of tasks done, including those of earlier runs.
        total: total number of tasks.
        seconds: time since this run started, s.
        left: estimated remaining time, s; None before the first task is done.
        detail: message from the running task.
    """

    title: str
    unit: str
    done: int
    total: int
    seconds: float
    left: float | None = None
    detail: str = ""

    def __str__(self) -> str:
        left = "" if self.left is None else f", {self.left:.0f} s left"
        return (
            f"{self.title}: {self.done} of {self.total} {self.unit}{left}{self.detail and '; '}{self.detail}"
        )


Progress = Callable[[TaskProgress], None]


def announce(text: str) -> None:
    """Report what a task is doing; it is shown only where the task runs in the user's own process."""
    if (listener := _LISTENER.get()) is not None:
        listener(text)


Results = Generator[tuple[int, Result]]
"""Results with the numbers of their tasks, in any order."""
Run = Callable[[Tasks[Argument, Result], Sequence[int]], Results[Result]]


def run_tasks(
    tasks: Tasks[Argument, Result],
    store: Store[Result],
    numbers: Iterable[int],
    run: Run[Argument, Result],
    progress: Progress | None = None,
) -> None:
    """Run the numbered tasks that are not finished, storing each result as soon as it is available."""
    chosen, finished, started = list(numbers), store.finished(), time.perf_counter()
    missing = [number for number in chosen if number not in finished]
    before = len(chosen) - len(missing)
    state = TaskProgress(tasks.title, tasks.unit, before, len(chosen), 0.0)

    def show(detail: str = "") -> None:
        if progress is not None:
            seconds = time.perf_counter() - started
            left = None if state.left is None else max(state.left - (seconds - state.seconds), 0.0)
            progress(replace(state, seconds=seconds, left=left, detail=detail))

    with _set(_LISTENER, show):
        results = run(tasks, missing)
        show()
        try:
            for number, result in results:
                store.save(number, result)
                done = state.done + 1
                seconds = time.perf_counter() - started
                left = seconds / (done - before) * (len(chosen) - done)
                state = replace(state, done=done, seconds=seconds, left=left)
                show()
        finally:
            results.close()


def in_process(tasks: Tasks[Argument, Result], numbers: Sequence[int]) -> Results[Result]:
    """Run tasks in this process; once the generator is closed, no further task is started."""
    count = min(threads(), len(numbers)) if tasks.side_by_side else 1
    # The first task compiles; others started beside it would wait for that or compile the same program again.
    in_turn = numbers[:1] if count > 1 else numbers
    for number in in_turn:
        with using_threads(1 if tasks.side_by_side else None):
            result = tasks.compute(tasks.arguments[number])
        yield number, result
    if len(numbers) > len(in_turn):
        yield from _in_threads(tasks, numbers[1:], count)


def _in_threads(tasks: Tasks[Argument, Result], numbers: Sequence[int], count: int) -> Results[Result]:
    stopped = Event()

    def job(number: int) -> tuple[int, Result] | None:
        if stopped.is_set():
            return None
        with using_threads(1):
            return number, tasks.compute(tasks.arguments[number])

    pool = ThreadPoolExecutor(count, thread_name_prefix=tasks.title)
    queue = iter(numbers)
    waiting: set[Future[tuple[int, Result] | None]] = set()
    try:
        waiting |= {pool.submit(job, number) for number in islice(queue, 2 * count)}
        while waiting:
            ready, waiting = wait(waiting, return_when=FIRST_COMPLETED)
            waiting |= {pool.submit(job, number) for number in islice(queue, len(ready))}
            for future in ready:
                if (result := future.result()) is not None:
                    yield result
    finally:
        stopped.set()
        # After Ctrl-C nobody stores what is still running, and a block may take minutes.
        pool.shutdown(wait=False, cancel_futures=True)
