"""How many threads a computation may use."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_CHOSEN: ContextVar[int | None] = ContextVar("threads", default=None)


def threads() -> int:
    """Number of threads: of `using_threads`, else `ECLSIM_THREADS`, else the processors of this process."""
    if (chosen := _CHOSEN.get()) is not None:
        return chosen
    wanted = os.environ.get("ECLSIM_THREADS", "")
    if wanted.isdigit() and int(wanted) > 0:
        return int(wanted)
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
