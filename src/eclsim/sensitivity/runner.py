"""Running a design block by block: in threads of this process, resumable at any moment."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import closing
from dataclasses import dataclass

from eclsim.sensitivity.design import Design
from eclsim.sensitivity.evaluation import Evaluated, Evaluator, evaluate_block
from eclsim.sensitivity.store import Store

Executor = Callable[[Design, Evaluator, "list[int]"], "Generator[tuple[int, Evaluated]]"]
"""Runs blocks and yields each with its number as it is done, in any order."""


@dataclass(frozen=True)
class Progress:
    """How far a run is.

    Args:
        done: blocks done, those of earlier runs included.
        total: blocks to do in all.
        seconds: since this run started.
        left: estimated seconds to go; None before the first block is done.
    """

    done: int
    total: int
    seconds: float
    left: float | None


def run_blocks(
    store: Store,
    evaluator: Evaluator,
    blocks: Iterable[int],
    execute: Executor | None = None,
    report: Callable[[Progress], None] | None = None,
) -> None:
    """Run the blocks that are not done yet and keep each as soon as it is.

    Args:
        store: where finished blocks are kept.
        evaluator: what is run.
        blocks: which blocks.
        execute: where they are run; left out, in threads of this process.
        report: called after every block.
    """
    wanted = list(blocks)
    finished = store.finished()
    missing = [b for b in wanted if b not in finished]
    before, started = len(wanted) - len(missing), time.perf_counter()
    done = 0
    with closing((execute or in_threads)(store.design, evaluator, missing)) as results:
        for block, found in results:
            store.save(block, found)
            done += 1
            seconds = time.perf_counter() - started
            if report is not None:
                report(Progress(before + done, len(wanted), seconds, seconds / done * (len(missing) - done)))


def in_threads(design: Design, evaluator: Evaluator, blocks: list[int]) -> Generator[tuple[int, Evaluated]]:
    """Blocks side by side, one thread each; closing the iterator starts no more."""
    from eclsim.beat.vectorisation import threads

    count = min(threads(), len(blocks))
    # The first block compiles; the others would wait for it or compile the same once more.
    for block in blocks[:1]:
        yield block, evaluate_block(design, evaluator, block)
    if len(blocks) > 1:
        yield from _pooled(design, evaluator, blocks[1:], count)


def _pooled(
    design: Design, evaluator: Evaluator, blocks: list[int], count: int
) -> Generator[tuple[int, Evaluated]]:
    stopped = threading.Event()

    def job(block: int) -> Evaluated | None:
        return None if stopped.is_set() else evaluate_block(design, evaluator, block)

    with ThreadPoolExecutor(count, thread_name_prefix="sensitivity") as pool:
        waiting: dict[Future[Evaluated | None], int] = {}
        queue = iter(blocks)
        try:
            for block in _first(queue, 2 * count):
                waiting[pool.submit(job, block)] = block
            while waiting:
                for future in wait(waiting, return_when=FIRST_COMPLETED).done:
                    block, found = waiting.pop(future), future.result()
                    for following in _first(queue, 1):
                        waiting[pool.submit(job, following)] = following
                    if found is not None:
                        yield block, found
        finally:
            stopped.set()


def _first(queue: Iterator[int], count: int) -> Iterator[int]:
    for _ in range(count):
        block = next(queue, None)
        if block is None:
            return
        yield block
