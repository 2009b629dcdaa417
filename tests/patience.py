"""Waiting in tests for what comes in its own time: no test may depend on how busy the machine is."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import TypeVar

PATIENCE_S = 30.0
"""How long something that should happen may take on a machine that does other work too."""
T = TypeVar("T")


def eventually(check: Callable[[], T]) -> T:
    """Run a check, which reads all that it compares, until it passes; its last failure is the test's."""
    end = time.monotonic() + PATIENCE_S
    while True:
        try:
            return check()
        except AssertionError:
            if time.monotonic() > end:
                raise
        time.sleep(0.1)


async def until(condition: Callable[[], object]) -> None:
    """Let other tasks of the event loop run until the condition holds; it fails where it never does."""
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end, "what the test waits for did not happen"
        await asyncio.sleep(0.005)
