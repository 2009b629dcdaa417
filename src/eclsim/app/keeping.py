"""What a browser keeps of its tab: patient, undo, pinned and saved states. The server keeps nothing.

A page that is loaded again, or whose server was started again, goes on with it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from eclsim.app.state import (
    MOST_SAVED,
    History,
    PageState,
    packed,
    read_state,
    refused_link,
    unpacked,
)

MOST_UNDONE = 40
"""Steps of undo, and of redo, that are kept."""
MOST_STATES = 2 * MOST_UNDONE + MOST_SAVED + 2
LONGEST, LARGEST = 120_000, 1_000_000
VERSION = 1


@dataclass(frozen=True)
class Kept:
    """A tab as it was.

    Args:
        history: what was shown, with undo and redo.
        pinned: state whose beat was pinned.
        saved: states that were saved for the comparison.
    """

    history: History
    pinned: PageState | None = None
    saved: tuple[PageState, ...] = ()


def text_of(kept: Kept) -> str:
    """As a text for the browser's storage."""
    states: list[PageState] = []

    def number(state: PageState) -> int:
        if state not in states:
            states.append(state)
        return states.index(state)

    history = kept.history
    content: dict[str, Any] = {
        "v": VERSION, "now": number(history.now),
        "past": [number(state) for state in history.past[-MOST_UNDONE:]],
        "future": [number(state) for state in history.future[-MOST_UNDONE:]],
        "pinned": None if kept.pinned is None else number(kept.pinned),
        "saved": [number(state) for state in kept.saved],
    }  # fmt: skip
    return packed(content | {"states": [state.as_object() for state in states]})


def read_kept(text: str) -> Kept:
    """A tab from the browser's storage; every state is checked like a case file.

    Raises:
        CaseError: If it is damaged, or of a version that this page does not read.
    """
    found = unpacked(text, LONGEST, LARGEST)
    states = found.get("states")
    if (
        found.get("v") != VERSION
        or not isinstance(states, list)
        or len(states) > 2 * MOST_UNDONE + MOST_SAVED + 2
    ):
        raise refused_link("of another version")
    read = [read_state(state) for state in states]

    def one(number: Any) -> PageState:
        if isinstance(number, bool) or not isinstance(number, int) or not 0 <= number < len(read):
            raise refused_link("damaged")
        return read[number]

    def many(key: str, most: int) -> list[PageState]:
        numbers = found.get(key)
        if not isinstance(numbers, list) or len(numbers) > most:
            raise refused_link("damaged")
        return [one(number) for number in numbers]

    history = History(one(found.get("now")), many("past", MOST_UNDONE), many("future", MOST_UNDONE))
    pinned = None if found.get("pinned") is None else one(found["pinned"])
    return Kept(history, pinned, tuple(many("saved", MOST_SAVED)))
