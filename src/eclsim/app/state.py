"""What a page shows, as values: the state, its history, and its form in a link."""

from __future__ import annotations

import base64
import json
import zlib
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from eclsim.patients.mistakes import CaseError, Mistake
from eclsim.patients.reading import read_mapping

if TYPE_CHECKING:
    from eclsim.patients.case import Case

LONGEST_LINK = 8_000
LARGEST_STATE = 200_000
LONGEST_HISTORY = 100
MOST_SAVED = 6
POLICIES = ("as_published", "patient_held")


@dataclass(frozen=True)
class PageState:
    """Everything that a beat is computed from.

    Args:
        case: patient, devices and parameters; knobs change it.
        policy: blood volume policy.
        origin: key of the preset, or name of the file, that it started from.
        posterior: which of the session's posteriors speaks of this patient; not part of a link.
    """

    case: Case
    policy: str = POLICIES[0]
    origin: str = ""
    posterior: str = ""

    def with_case(self, case: Case) -> PageState:
        """The same page with another case."""
        return replace(self, case=case)

    def as_object(self) -> dict[str, Any]:
        """As plain data."""
        return {"v": 1, "case": self.case.as_mapping(), "policy": self.policy, "origin": self.origin}


def link_of(state: PageState) -> str:
    """A state as the text behind # in a link: it stays in the browser and reaches no log of a server."""
    plain = json.dumps(state.as_object(), separators=(",", ":")).encode()
    return base64.urlsafe_b64encode(zlib.compress(plain, 9)).decode().rstrip("=")


def key_of(state: PageState) -> str:
    """Tells results of one state from those of another."""
    return f"{zlib.crc32(repr((state.case, state.policy)).encode()):08x}"


def state_of(link: str) -> PageState:
    """The state of a link; it is checked like a case file.

    Raises:
        CaseError: If it is no link of this page, or its case cannot be used.
    """
    if len(link) > LONGEST_LINK:
        raise _no_link("too long")
    try:
        packed = base64.urlsafe_b64decode(link + "=" * (-len(link) % 4))
        unpack = zlib.decompressobj()
        plain = unpack.decompress(packed, LARGEST_STATE)
        if not unpack.eof:
            raise _no_link("too large, or cut off")
        found = json.loads(plain)
    except (ValueError, zlib.error, RecursionError) as error:
        if isinstance(error, CaseError):
            raise
        raise _no_link("damaged") from None
    if not isinstance(found, dict) or found.get("v") != 1:
        raise _no_link("of another version")
    if found.get("policy") not in POLICIES:
        raise _no_link("with an unknown blood volume policy")
    case = read_mapping(found.get("case"), "link").case
    return PageState(case, found["policy"], str(found.get("origin", ""))[:64])


def _no_link(why: str) -> CaseError:
    return CaseError([Mistake("", f"the link is {why}", allowed="a link copied from this page", file="link")])


@dataclass
class History:
    """States that were shown, for undo and redo.

    A knob that is turned in many small steps is one step of the history: steps of the same `key` that follow
    each other within `merge_s` seconds are one.
    """

    now: PageState
    past: list[PageState] = field(default_factory=list)
    future: list[PageState] = field(default_factory=list)
    start: PageState = field(init=False)
    merge_s: float = 1.5
    _last: tuple[str, float] = ("", float("-inf"))

    def __post_init__(self) -> None:
        self.start = self.now

    def change(self, state: PageState, key: str, at: float) -> None:
        """Show another state; `key` names what was changed, `at` is the time [s]."""
        if state == self.now:
            return
        same, self._last = self._last, (key, at)
        if not (key and same[0] == key and at - same[1] <= self.merge_s and self.past):
            self.past.append(self.now)
            del self.past[:-LONGEST_HISTORY]
        self.future.clear()
        self.now = state

    def load(self, state: PageState, at: float) -> None:
        """Start from another patient; undo leads back."""
        self.change(state, "", at)
        self.start = state

    def undo(self) -> bool:
        """One step back; whether there was one."""
        return self._move(self.past, self.future)

    def redo(self) -> bool:
        """One step forward; whether there was one."""
        return self._move(self.future, self.past)

    def _move(self, source: list[PageState], target: list[PageState]) -> bool:
        if not source:
            return False
        target.append(self.now)
        self.now = source.pop()
        self._last = ("", float("-inf"))
        return True
