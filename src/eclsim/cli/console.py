"""Messages of commands on standard error, exit statuses, and progress of long commands."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from types import TracebackType
from typing import TYPE_CHECKING, NoReturn

from eclsim.inputs.mistakes import Mistake

if TYPE_CHECKING:
    from rich.progress import Progress as Bar

INCOMPLETE = 1
"""Exit status: something did not converge, could not be used, or failed its acceptance criterion."""
BAD_INPUT = 2
"""Exit status: an error of the user or the system; nothing was computed, or nothing could be written."""
SECONDS_BETWEEN_LINES = 10.0


def open_closed_streams() -> None:
    """Replace standard streams that are closed (`>&-`) by the null device, so that text may be written."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115 - until the end


def is_output_closed() -> bool:
    """Whether standard output is closed, so that nobody can read what is written to it."""
    return sys.stdout is None or getattr(sys.stdout, "name", None) == os.devnull


def say(text: object) -> None:
    """Write one line to standard error."""
    try:
        print(text, file=sys.stderr)
    except (OSError, ValueError):  # standard error is closed
        return


def fail(*lines: object) -> NoReturn:
    """Write errors, one per line, and exit with the status of bad input."""
    for line in lines:
        say(f"error: {line}")
    raise SystemExit(BAD_INPUT)


def refuse(mistakes: Collection[object]) -> None:
    """Exit with the status of bad input if there are errors."""
    if mistakes:
        fail(*mistakes)


@contextmanager
def refusing(*kinds: type[ValueError], at: str | None = None) -> Iterator[None]:
    """Exit with the status of bad input for an error of these kinds: all its mistakes, with their place."""
    try:
        yield
    except kinds as error:
        mistakes = getattr(error, "mistakes", [error])
        fail(*(m.at(at, None) if isinstance(m, Mistake) and at is not None else m for m in mistakes))


def mistakes_in(checks: Mapping[str, Callable[[], object]]) -> list[str]:
    """Return the ValueErrors of option checks, each after its option; "" if the message names the option."""
    mistakes = []
    for option, check in checks.items():
        try:
            check()
        except ValueError as error:
            mistakes.append(f"{option} {error}".lstrip())
    return mistakes


def broken_rules(rules: Mapping[str, object]) -> list[str]:
    """Return the messages of the rules that are broken, of rules as message and whether it is broken."""
    return [message for message, broken in rules.items() if broken]


def warn(lines: Iterable[object]) -> None:
    """Write warnings, which do not stop a command; alarms and cautions have the labels of their own."""
    from eclsim.devices.description import has_label

    for line in map(str, lines):
        say(line if has_label(line) else f"warning: {line}")


def note(lines: Iterable[object]) -> None:
    """Write notes on what was assumed or changed."""
    for line in lines:
        say(f"note: {line}")


class Progress:
    """Progress of a long command, on standard error.

    On a terminal it is one line that changes; in a log it is a line at most every ten seconds. Each event is
    shown as text; if it has numbers of tasks (`done`, `total`), they move the bar.
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
        """Show an event, such as the step that is running."""
        text = f"{self.label}{event}"
        if self._bar is not None:
            done, total = getattr(event, "done", 0), getattr(event, "total", None)
            self._bar.update(self._bar.task_ids[0], description=text, completed=done, total=total)
        elif time.monotonic() - self._last_line >= SECONDS_BETWEEN_LINES:
            self._last_line = time.monotonic()
            say(text)
