"""Messages of commands on standard error, their exit statuses, and the progress of long ones."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Collection, Iterable, Mapping
from types import TracebackType
from typing import TYPE_CHECKING, NoReturn

if TYPE_CHECKING:
    from rich.progress import Progress as Bar

INCOMPLETE = 1
"""Exit status: something did not converge, could not be used, or misses its bar."""
BAD_INPUT = 2
"""Exit status: a mistake of the user or of the machine; nothing was computed, or nothing could be written."""
SECONDS_BETWEEN_LINES = 10.0


def say(text: object) -> None:
    """One line on standard error."""
    try:
        print(text, file=sys.stderr)
    except (OSError, ValueError):  # nobody is listening any more
        return


def fail(*lines: object) -> NoReturn:
    """Write mistakes, a line each, and leave with the exit status of bad input."""
    for line in lines:
        say(f"error: {line}")
    raise SystemExit(BAD_INPUT)


def refuse(mistakes: Collection[object]) -> None:
    """Leave with the exit status of bad input if there is any mistake."""
    if mistakes:
        fail(*mistakes)


def mistakes_in(checks: Mapping[str, Callable[[], object]]) -> list[str]:
    """What checks of options raise as ValueError, each behind the option; "" where the message names it."""
    mistakes = []
    for option, check in checks.items():
        try:
            check()
        except ValueError as error:
            mistakes.append(f"{option} {error}".lstrip())
    return mistakes


def warn(lines: Iterable[object], label: str = "warning") -> None:
    """Write doubts that do not stop a command."""
    for line in lines:
        say(f"{label}: {line}")


def note(lines: Iterable[object]) -> None:
    """Write what was assumed or changed."""
    warn(lines, "note")


class Progress:
    """Progress of a long command, on standard error.

    One line that changes on a terminal; in a log a line at most every ten seconds. What it is called with is
    shown as text; a number of finished tasks (`done`, `total`) moves the bar.
    """

    def __init__(self, label: str = ""):
        self.label = f"{label}: " if label else ""
        self._last_line = time.monotonic()
        self._bar: Bar | None = None

    def __enter__(self) -> Progress:
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

            columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn())
            self._bar = Progress(*columns, console=Console(stderr=True), transient=True)
            self._bar.add_task(f"{self.label}...", total=None)
            self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()

    def __call__(self, event: object) -> None:
        """Show what is being done now."""
        text = f"{self.label}{event}"
        if self._bar is not None:
            done, total = getattr(event, "done", 0), getattr(event, "total", None)
            self._bar.update(self._bar.task_ids[0], description=text, completed=done, total=total)
        elif time.monotonic() - self._last_line >= SECONDS_BETWEEN_LINES:
            self._last_line = time.monotonic()
            say(text)
