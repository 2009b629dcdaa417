"""What the commands say on standard error, and the exit statuses."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import NoReturn

SOME_DID_NOT_CONVERGE = 1
BAD_INPUT = 2
SECONDS_BETWEEN_LINES = 10.0
CLEAR_LINE = "\r\x1b[K"


def say(text: object) -> None:
    """One line on standard error."""
    try:
        print(text, file=sys.stderr)
    except (OSError, ValueError):  # nobody is listening any more
        return


def fail(*lines: object) -> NoReturn:
    """Say what is wrong, a line each, and leave with the exit status of bad input."""
    for line in lines:
        say(f"error: {line}")
    raise SystemExit(BAD_INPUT)


@contextmanager
def resumable(folder: str | os.PathLike[str] | None) -> Iterator[None]:
    """Say how to go on where Ctrl-C or SIGTERM stops a command whose finished parts are kept."""
    try:
        yield
    except (KeyboardInterrupt, SystemExit) as stopped:
        signalled = isinstance(stopped, KeyboardInterrupt) or stopped.code in (130, 143)
        if folder is not None and signalled:
            say(f"{folder}: what is finished is kept; the same command with --resume goes on")
        raise


def warn(lines: Iterable[object], label: str = "warning") -> None:
    """Say doubts that do not stop a command."""
    for line in lines:
        say(f"{label}: {line}")


class Progress:
    """What is being done, on standard error: one line that is written over; in a log a line now and then."""

    def __init__(self) -> None:
        self.on_terminal = sys.stderr.isatty()
        self.last_line = time.monotonic()

    def __call__(self, text: str) -> None:
        """Say it; in a log only if nothing was said for ten seconds."""
        if self.on_terminal:
            sys.stderr.write(f"{CLEAR_LINE}{text}")
            sys.stderr.flush()
        elif time.monotonic() - self.last_line >= SECONDS_BETWEEN_LINES:
            self.last_line = time.monotonic()
            say(text)

    def end(self) -> None:
        """Leave an empty line on a terminal."""
        if self.on_terminal:
            sys.stderr.write(CLEAR_LINE)
