"""Tasks: a pure function, what it is called with, and how its results are kept."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from itertools import islice
from threading import Event
from typing import Generic, Protocol, TypeVar

_CHOSEN: ContextVar[int | None] = ContextVar("threads", default=None)


def threads() -> int:
    """Number of threads: of `using_threads`, else `ECLSIM_THREADS`, else the processors of this process."""
    if (chosen := _CHOSEN.get()) is not None:
        return chosen
    setting = os.environ.get("ECLSIM_THREADS", "")
    if setting.isdigit() and int(setting) > 0:
        return int(setting)
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)


@contextmanager
def using_threads(count: int | None) -> Iterator[None]:
    """What is computed within, in this thread, uses so many threads; None leaves the number as it is."""
    if count is None:
        yield
        return
    token = _CHOSEN.set(count)
    try:
        yield
    finally:
        _CHOSEN.reset(token)


# --- tasks ------------------------------------------------------------------------------------------


Argument = TypeVar("Argument")
Result = TypeVar("Result")
StoredResult = TypeVar("StoredResult", contravariant=True)

_LISTENER: ContextVar[Callable[[str], None] | None] = ContextVar("listener", default=None)


@dataclass(frozen=True)
class Tasks(Generic[Argument, Result]):
    """Many pieces of work of one kind, done in any order and anywhere.

    Args:
        title: of the work, in progress and messages: "sensitivity", "fits".
        unit: what one task is called, in the plural: "blocks".
        compute: gives the result of an argument: picklable, without side effects, the same bits whatever was
            computed before or is computed beside it. What all tasks share is kept in it.
        arguments: one for each task, small and picklable.
        inputs: all that the results follow from, as plain data for JSON; results of other inputs are refused.
        side_by_side: in one process, a task runs in one thread and several run at a time; otherwise one runs
            after the other, each with all threads.
    """

    title: str
    unit: str
    compute: Callable[[Argument], Result]
    arguments: Sequence[Argument]
    inputs: Mapping[str, object] = field(default_factory=dict)
    side_by_side: bool = False


class Store(Protocol[StoredResult]):
    """Where finished results are kept."""

    def finished(self) -> set[int]:
        """Numbers of the tasks whose results are there."""
        ...

    def save(self, number: int, result: StoredResult) -> None:
        """Keep the result of a task."""
        ...


@dataclass(frozen=True)
class TaskProgress:
    """How far the work is; as text, the line to show.

    Args:
        title: of the work.
        unit: what one task is called, in the plural.
        done: tasks done, those of earlier runs included.
        total: tasks to do in all.
        seconds: since this run started.
        left: estimated seconds to go; None before the first task is done.
        detail: what a task is doing, in its own words.
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
    """Say within a task what is being done; it is shown where the task runs in the user's own process."""
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
    """Run the tasks of these numbers that are not finished, and keep each result as soon as it is there."""
    chosen, finished, started = list(numbers), store.finished(), time.perf_counter()
    missing = [number for number in chosen if number not in finished]
    before = len(chosen) - len(missing)
    state = TaskProgress(tasks.title, tasks.unit, before, len(chosen), 0.0)

    def show(detail: str = "") -> None:
        if progress is not None:
            progress(replace(state, seconds=time.perf_counter() - started, detail=detail))

    with _listening(show):
        results = run(tasks, missing)
        show()
        try:
            for number, result in results:
                store.save(number, result)
                done = state.done + 1
                each = (time.perf_counter() - started) / (done - before)
                state = replace(state, done=done, left=each * (len(chosen) - done))
                show()
        finally:
            results.close()


@contextmanager
def _listening(listener: Callable[[str], None]) -> Iterator[None]:
    token = _LISTENER.set(listener)
    try:
        yield
    finally:
        _LISTENER.reset(token)


def in_process(tasks: Tasks[Argument, Result], numbers: Sequence[int]) -> Results[Result]:
    """Run tasks in this process; closing the generator starts no more."""
    count = min(threads(), len(numbers)) if tasks.side_by_side else 1
    # The first task compiles; the others would wait for it or compile the same once more.
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

    with ThreadPoolExecutor(count, thread_name_prefix=tasks.title) as pool:
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
