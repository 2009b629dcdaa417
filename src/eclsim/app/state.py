"""What a page shows, as values: the state, its history, links, and what the browser keeps of a tab.

The server keeps nothing: a page that is loaded again, or whose server was started again, goes on with the
snapshot that its browser kept.
"""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple

from eclsim.cases.events import LONGEST_MIN
from eclsim.cases.presets import PRESETS
from eclsim.cases.reading import read_mapping
from eclsim.inputs.mistakes import CaseError, Mistake

if TYPE_CHECKING:
    from eclsim.cases.case import Case

VERSION = 2
LONGEST_LINK = 8_000
LONGEST_NAME = 240
LARGEST_STATE = 200_000
LONGEST_HISTORY = 100
MOST_SAVED = 6
MOST_UNDONE = 40
"""Steps of undo, and of redo, that a browser keeps."""
MOST_STATES = 2 * MOST_UNDONE + MOST_SAVED + 2
LONGEST_SNAPSHOT, LARGEST_SNAPSHOT = 120_000, 1_000_000
SNAPSHOT_VERSION = 1
VERDICTS = ("", "good", "doubtful", "poor")
ORIGINS = ("", "file", "cohort", "unfitted", "fit", "posterior", *PRESETS)
POLICIES = ("as_published", "patient_held")


@dataclass(frozen=True)
class PageState:
    """Everything that a beat is computed from, and whose numbers they are.

    Args:
        case: patient, devices and parameters; knobs change it.
        policy: blood volume policy.
        origin: key of a preset, or another one of `ORIGINS`.
        posterior: which of the session's posteriors speaks of this patient; not part of a link.
        source: name of the file that the patient was read from.
        verdict: of the fit, where the parameters were fitted: "good", "doubtful" or "poor".
        subject: whose measurements these are, where not those of the patient as opened: a fitted patient
            is the one that it was fitted to.
        opened: the patient as opened, before any knob was turned; None where this is that state.
    """

    case: Case
    policy: str = POLICIES[0]
    origin: str = ""
    posterior: str = ""
    source: str = ""
    verdict: str = ""
    subject: str = ""
    opened: PageState | None = None

    @property
    def start(self) -> PageState:
        """The patient as opened: where reset leads."""
        return self.opened or self

    @property
    def computed_case(self) -> Case:
        """The case; set points of reflexes that it leaves open are those of the patient as opened."""
        left_open = self.case.regulation is not None and self.case.regulation.open_set_points
        if self.opened is None or not left_open:
            return self.case
        return self.case.model_copy(update={"as_written": self.opened.case})

    @property
    def changed(self) -> bool:
        """Whether a knob, device or policy is another one than in the patient as opened."""
        return self.opened is not None

    def with_case(self, case: Case) -> PageState:
        """The same patient with a case that was changed."""
        return self._changed(case, self.policy)

    def with_policy(self, policy: str) -> PageState:
        """The same patient under another blood volume policy."""
        return self._changed(self.case, policy)

    def _changed(self, case: Case, policy: str) -> PageState:
        start = self.start
        if (case, policy) == (start.case, start.policy):
            return start
        return replace(self, case=case, policy=policy, opened=start)

    def as_object(self) -> dict[str, Any]:
        """Plain data of the state."""
        result = {"case": self.case.as_mapping(), "policy": self.policy}
        result |= {name: getattr(self, name) for name in _NAMES if getattr(self, name)}
        if self.opened is None or self.origin in PRESETS:  # presets are known without
            return result
        return result | {"opened": self.opened.as_object()}


_NAMES = ("origin", "source", "verdict", "subject")
"""Fields of a state that are texts."""


def preset_state(key: str) -> PageState:
    """A preset as it is opened."""
    return PageState(PRESETS[key].case(), origin=key)


def subject_of(state: PageState) -> str:
    """Tells whose measurements are typed: the same for a patient as opened, turned and fitted."""
    start = state.start
    return start.subject or f"{zlib.crc32(repr((start.case, start.origin, start.source)).encode()):08x}"


def key_of(state: PageState) -> str:
    """Tells results of one state from those of another."""
    return f"{zlib.crc32(repr((state.case, state.policy)).encode()):08x}"


def link_of(state: PageState) -> str:
    """A state as the text behind # in a link: it stays in the browser and reaches no log of a server."""
    return packed({"v": VERSION, "state": state.as_object()})


def state_of(link: str) -> PageState:
    """The state of a link; it is checked like a case file.

    Raises:
        CaseError: If it is no link of this page, or its case cannot be used.
    """
    result = unpacked(link, LONGEST_LINK, LARGEST_STATE)
    if result.get("v") == 1:  # links of earlier versions knew no patient as opened
        return read_state({key: value for key, value in result.items() if key != "v"})
    if result.get("v") != VERSION:
        raise refused_link("of another version")
    return read_state(result.get("state"))


def read_state(data: object) -> PageState:
    """A state from plain data of a link.

    Raises:
        CaseError: If it is none, or its case cannot be used.
    """
    if not isinstance(data, dict):
        raise refused_link("damaged")
    if data.get("policy") not in POLICIES:
        raise refused_link("with an unknown blood volume policy")
    case = read_mapping(data.get("case"), "link").case
    if case.targets():  # the page writes speeds alone
        raise refused_link("with a pump flow in place of a speed")
    names = _read_names(data)
    state = replace(PageState(case, data["policy"]), **names)
    if state.origin in PRESETS:
        return preset_state(state.origin)._changed(case, state.policy)
    opened = data.get("opened")
    if opened is None:
        return state
    if not isinstance(opened, dict) or opened.get("opened") is not None:
        raise refused_link("damaged")
    start = read_state(opened)
    if start.case.patient.id != case.patient.id or any(getattr(start, n) != names[n] for n in names):
        raise refused_link("of two patients")
    return replace(state, opened=start)


def _read_names(data: dict[str, Any]) -> dict[str, str]:
    """Texts of a state; an unknown one is an error, never left out or replaced.

    Raises:
        CaseError: A text that this page does not know.
    """
    if data.keys() - {"case", "policy", "opened", *_NAMES}:
        raise refused_link("of another version")
    names = {name: data.get(name, "") for name in _NAMES}
    words = [name for name in names.values() if isinstance(name, str)]
    if len(words) < len(names) or not all(w.isprintable() and len(w) <= LONGEST_NAME for w in words):
        raise refused_link("damaged")
    if names["origin"] not in ORIGINS:
        raise refused_link("of a patient that this version does not have")
    if names["verdict"] not in (VERDICTS if names["origin"] == "fit" else ("",)):
        raise refused_link("damaged")
    return names


def packed(content: object) -> str:
    """Plain data as a text for links and for the browser's storage."""
    plain = json.dumps(content, separators=(",", ":")).encode()
    return base64.urlsafe_b64encode(zlib.compress(plain, 9)).decode().rstrip("=")


def unpacked(text: str, longest: int, largest: int) -> dict[str, Any]:
    """The plain data of such a text.

    Args:
        text: from a browser.
        longest: characters it may have.
        largest: bytes it may unpack to.

    Raises:
        CaseError: If it is damaged or too long.
    """
    if len(text) > longest:
        raise refused_link("too long")
    try:
        zipped = base64.urlsafe_b64decode(text + "=" * (-len(text) % 4))
        unpack = zlib.decompressobj()
        plain = unpack.decompress(zipped, largest)
        if not unpack.eof:
            raise refused_link("too large, or cut off")
        result = json.loads(plain)
    except (ValueError, zlib.error, RecursionError) as error:
        if isinstance(error, CaseError):
            raise
        raise refused_link("damaged") from None
    if not isinstance(result, dict):
        raise refused_link("damaged")
    return result


def refused_link(reason: str) -> CaseError:
    """Message about a link that cannot be used."""
    return CaseError([Mistake("", f"the link is {reason}", allowed="a link copied from this page")])


@dataclass
class History:
    """States that were shown, for undo and redo.

    A knob that is turned in many small steps is one step of the history: steps of the same `key` that follow
    each other within `merge_s` seconds are one.
    """

    now: PageState
    past: list[PageState] = field(default_factory=list)
    future: list[PageState] = field(default_factory=list)
    merge_s: float = 1.5
    _last: tuple[str, float] = ("", float("-inf"))

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

    def undo(self) -> bool:
        """One step back; whether there was one."""
        return self._move(self.past, self.future)

    def redo(self) -> bool:
        """One step forward; whether there was one."""
        return self._move(self.future, self.past)

    def back_to(self, is_meant: Callable[[PageState], bool]) -> bool:
        """Back to the last state of this kind; whether there is one: if not, nothing changes."""
        if not any(is_meant(state) for state in (self.now, *self.past)):
            return False
        while not is_meant(self.now):
            self.undo()
        return True

    def replace(self, state: PageState) -> None:
        """Another state in place of the present one, to which redo leads."""
        self.future.append(self.now)
        self.now, self._last = state, ("", float("-inf"))

    def _move(self, source: list[PageState], target: list[PageState]) -> bool:
        if not source:
            return False
        target.append(self.now)
        self.now = source.pop()
        self._last = ("", float("-inf"))
        return True


class Moment(NamedTuple):
    """A minute of the course of a state.

    Attributes:
        minute: from its start [min]; 0: the steady beat of the state.
        length: of the course [min]; a short one is followed beat by beat.
    """

    minute: float = 0.0
    length: int = 0


START = Moment()


@dataclass(frozen=True)
class Snapshot:
    """A tab as its browser keeps it.

    Args:
        history: what was shown, with undo and redo.
        pinned: state whose beat was pinned.
        saved: states that were saved for the comparison.
        pinned_at: minute of its course that was pinned.
        saved_at: minute of each of those; empty: the start.
    """

    history: History
    pinned: PageState | None = None
    saved: tuple[PageState, ...] = ()
    pinned_at: Moment = START
    saved_at: tuple[Moment, ...] = ()

    def packed(self) -> str:
        """Text for the browser's storage: each state once, and numbers that refer to it."""
        states: list[PageState] = []

        def numbers(of: Iterable[PageState]) -> list[int]:
            for state in of:
                if state not in states:
                    states.append(state)
            return [states.index(state) for state in of]

        history = self.history
        content = {
            "v": SNAPSHOT_VERSION, "now": numbers([history.now])[0],
            "past": numbers(history.past[-MOST_UNDONE:]), "future": numbers(history.future[-MOST_UNDONE:]),
            "pinned": numbers([self.pinned])[0] if self.pinned else None, "saved": numbers(self.saved),
            "pinned_at": self.pinned_at, "saved_at": self.saved_at,
        }  # fmt: skip
        return packed(content | {"states": [state.as_object() for state in states]})


def read_snapshot(text: str) -> Snapshot:
    """A tab from the browser's storage; every state is checked like a case file.

    Raises:
        CaseError: If it is damaged, or of a version that this page does not read.
    """
    content = unpacked(text, LONGEST_SNAPSHOT, LARGEST_SNAPSHOT)
    plain = content.get("states")
    if content.get("v") != SNAPSHOT_VERSION or not isinstance(plain, list) or len(plain) > MOST_STATES:
        raise refused_link("of another version")
    states = [read_state(state) for state in plain]

    def state(number: object) -> PageState:
        if isinstance(number, bool) or not isinstance(number, int) or not 0 <= number < len(states):
            raise refused_link("damaged")
        return states[number]

    def listed(key: str, most: int) -> list[PageState]:
        numbers = content.get(key)
        if not isinstance(numbers, list) or len(numbers) > most:
            raise refused_link("damaged")
        return [state(number) for number in numbers]

    history = History(state(content.get("now")), listed("past", MOST_UNDONE), listed("future", MOST_UNDONE))
    pinned = None if content.get("pinned") is None else state(content["pinned"])
    saved = tuple(listed("saved", MOST_SAVED))
    moments = content.get("saved_at") or []
    if not isinstance(moments, list) or len(moments) not in (0, len(saved)):
        raise refused_link("damaged")
    return Snapshot(
        history, pinned, saved, _moment(content.get("pinned_at", START)), tuple(map(_moment, moments))
    )


def _moment(data: object) -> Moment:
    """A minute of a course from plain data.

    Raises:
        CaseError: If it is none.
    """
    if not isinstance(data, (list, tuple)) or len(data) != 2:
        raise refused_link("damaged")
    minute, length = data
    numbers = isinstance(minute, (int, float)) and isinstance(length, int)
    if not numbers or bool in (type(minute), type(length)) or not 0 <= minute <= length <= LONGEST_MIN:
        raise refused_link("damaged")
    return Moment(float(minute), length)
