"""What the commands say on standard error, and the exit statuses."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import NoReturn

SOME_DID_NOT_CONVERGE = 1
BAD_INPUT = 2


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


def warn(lines: Iterable[object], label: str = "warning") -> None:
    """Say doubts that do not stop a command."""
    for line in lines:
        say(f"{label}: {line}")
