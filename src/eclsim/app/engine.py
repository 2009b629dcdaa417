"""Beats off the event loop: two threads, circuits compiled once, the presets' ahead of the first visitor."""

from __future__ import annotations

import asyncio
import gc
import logging
import os
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, TypeVar

from eclsim.app.fitting import FitProcess
from eclsim.app.state import PageState

if TYPE_CHECKING:
    from eclsim.app.beat import Beat, Program

log = logging.getLogger("eclsim.app")
T = TypeVar("T")
FIRST_PAGE_GRACE_S = 4.0
"""After the start only the first patient's circuit is compiled for so long: the first page comes first."""
IDLE_BEFORE_WARMING_S = 1.5
"""Presets are compiled only when no beat was asked for during this time."""
SLOW_RATE_BPM = 60.0
"""A heart rate at which the finer grid of slow hearts is needed."""


class Engine:
    """Computes beats for all sessions.

    Args:
        workers: threads for beats; at least two more do everything that takes longer, so that one visitor's
            study does not keep another's waiting, and two read files.
    """

    def __init__(self, workers: int | None = None):
        count = workers or min(4, os.cpu_count() or 1)
        self._beats = ThreadPoolExecutor(count, thread_name_prefix="beat")
        self._studies = ThreadPoolExecutor(max(2, count - 1), thread_name_prefix="study")
        self._files = ThreadPoolExecutor(2, thread_name_prefix="file")
        self.fits = FitProcess()
        self._known: set[Program] = set()
        self._stopped = threading.Event()
        self._wanted_at = float("-inf")

    async def beat(
        self, state: PageState, start: Beat | None = None, compiling: Callable[[], None] | None = None
    ) -> Beat:
        """The steady beat of a state.

        Args:
            state: case and blood volume policy.
            start: where the search begins, if it is a beat of the same circuit.
            compiling: is called in the event loop where the circuit is new, so that the beat takes a while.
        """
        self._wanted_at = time.monotonic()
        loop = asyncio.get_running_loop()

        def is_new() -> None:
            if compiling is not None:
                loop.call_soon_threadsafe(compiling)

        return await self._in(self._beats, lambda: self._beat(state, start, is_new))

    async def prepare_nearby_searches(self, state: PageState, beat: Beat) -> None:
        """Compute what searches that begin at this beat need of it: a Jacobian, which is then kept."""
        await self.study(lambda: self._beat(state, beat))

    async def moment(self, work: Callable[[], T]) -> T:
        """Another beat that is waited for."""
        return await self._in(self._beats, work)

    async def study(self, work: Callable[[], T]) -> T:
        """Anything longer, beside the beats."""
        return await self._in(self._studies, work)

    async def read(self, work: Callable[[], T]) -> T:
        """Reading a file that somebody chose."""
        return await self._in(self._files, work)

    def warm(self, first: PageState) -> None:
        """Compile the circuit of the first patient now and those of the presets when nobody turns a knob.

        Returns at once: it happens in a thread of its own.
        """
        threading.Thread(target=self._warm_all, args=(first,), name="warm", daemon=True).start()

    def stop(self) -> None:
        """Take no more work, and do not wait for what runs."""
        self._stopped.set()
        self.fits.stop()
        for pool in (self._beats, self._studies, self._files):
            pool.shutdown(wait=False, cancel_futures=True)

    def _beat(
        self, state: PageState, start: Beat | None = None, is_new: Callable[[], None] | None = None
    ) -> Beat:
        from eclsim.app.beat import compute_beat

        programs: list[Program] = []

        def begins(program: Program) -> None:
            programs.append(program)
            if is_new is not None and program not in self._known:
                is_new()

        beat = compute_beat(state, start, begins)
        self._known.update(programs)
        return beat

    def _warm_all(self, first: PageState) -> None:
        self._warm_one(first)
        gc.freeze()  # what is loaded stays: to look through all of it again would stop every page for 0.1 s
        if self._stopped.wait(FIRST_PAGE_GRACE_S):
            return
        for k, state in enumerate(states := _warm_states()):
            if k == len(states) // 2:
                self.fits.prepare()
            while time.monotonic() - self._wanted_at < IDLE_BEFORE_WARMING_S:
                if self._stopped.wait(0.2):
                    return
            if self._stopped.is_set():
                return
            self._warm_one(state)

    def _warm_one(self, state: PageState) -> None:
        try:
            self._beat(state)
        except Exception:  # one circuit that cannot be compiled must not keep the others from it
            log.exception("warming a circuit failed")

    @staticmethod
    async def _in(pool: ThreadPoolExecutor, work: Callable[[], T]) -> T:
        return await asyncio.get_running_loop().run_in_executor(pool, work)


def _warm_states() -> list[PageState]:
    """The presets, also with what is often beside them, then all of them with a slow heart."""
    from eclsim.app.knobs import connect, turn
    from eclsim.cases.presets import PRESETS

    states = [PageState(preset.case(), origin=key) for key, preset in PRESETS.items()]
    more = [PageState(connect(start.case(), key)) for start in PRESETS.values() for key in start.often]
    usual = [*states, *more]
    slow = [s.with_case(turn(s.case, "patient.heart_rate_bpm", SLOW_RATE_BPM)) for s in usual]
    return [*usual, *slow]
