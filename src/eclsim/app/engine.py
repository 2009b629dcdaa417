"""Computation of beats off the event loop: thread pools, and circuits that are compiled in advance."""

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
from eclsim.app.knobs import connect, turn
from eclsim.app.state import PageState
from eclsim.cases.presets import PRESETS

if TYPE_CHECKING:
    from eclsim.app.beat import Beat, Program

log = logging.getLogger("eclsim.app")
T = TypeVar("T")
FIRST_PAGE_GRACE_S = 4.0
"""Time after the start for compiling only the first patient's circuit [s], as the first page comes first."""
IDLE_BEFORE_WARMING_S = 1.5
"""Time without a request for a beat after which the presets' circuits are compiled [s]."""
SLOW_RATE_BPM = 60.0
"""Heart rate that requires the finer grid of slow hearts [bpm]."""


class Engine:
    """Computes beats for all sessions.

    Args:
        workers: number of threads for beats. At least two more threads do longer work, so that one visitor's
            study does not delay another's, and two read files.
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
        """Compute the steady beat of a state.

        Args:
            state: case and blood volume policy.
            start: beat from which the search starts, if it is of the same circuit.
            compiling: called in the event loop if the circuit has to be compiled, so that the beat takes a
                while.
        """
        self._wanted_at = time.monotonic()
        loop = asyncio.get_running_loop()

        def is_new() -> None:
            if compiling is not None:
                loop.call_soon_threadsafe(compiling)

        return await self._in(self._beats, lambda: self._beat(state, start, is_new))

    async def prepare_nearby_searches(self, state: PageState, beat: Beat) -> None:
        """Compute and store the Jacobian that searches starting from this beat need."""
        await self.study(lambda: self._beat(state, beat))

    async def moment(self, work: Callable[[], T]) -> T:
        """Compute another beat that a user is waiting for."""
        return await self._in(self._beats, work)

    async def study(self, work: Callable[[], T]) -> T:
        """Run longer work beside the beats."""
        return await self._in(self._studies, work)

    async def read(self, work: Callable[[], T]) -> T:
        """Read a file chosen by a user."""
        return await self._in(self._files, work)

    def warm(self, first: PageState) -> None:
        """Compile the first patient's circuit now, and those of the presets while no knob is turned.

        Returns at once; the compilation runs in its own thread.
        """
        threading.Thread(target=self._warm_all, args=(first,), name="warm", daemon=True).start()

    def stop(self) -> None:
        """Accept no more work, without waiting for running work."""
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
        gc.freeze()  # else garbage collection of the loaded objects stops every page for 0.1 s
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
        except Exception:  # a circuit that cannot be compiled must not prevent the others from being compiled
            log.exception("warming a circuit failed")

    @staticmethod
    async def _in(pool: ThreadPoolExecutor, work: Callable[[], T]) -> T:
        return await asyncio.get_running_loop().run_in_executor(pool, work)


def _warm_states() -> list[PageState]:
    """Return the presets, the presets with devices often added, then all of these with a slow heart."""
    states = [PageState(preset.case(), origin=key) for key, preset in PRESETS.items()]
    more = [PageState(connect(start.case(), key)) for start in PRESETS.values() for key in start.often]
    usual = [*states, *more]
    slow = [s.with_case(turn(s.case, "patient.heart_rate_bpm", SLOW_RATE_BPM)) for s in usual]
    return [*usual, *slow]
