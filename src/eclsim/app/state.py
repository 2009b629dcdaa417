"""State of a page as values: the state itself, its history, links, and the snapshot that a browser stores.

The server stores nothing: a page that is reloaded, or whose server was restarted, continues from the snapshot
in its browser.
"""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from eclsim.cases.case import Case
from eclsim.cases.events import LONGEST_MIN
from eclsim.cases.presets import PRESETS
from eclsim.cases.reading import read_mapping
from eclsim.cases.sections import POLICIES
from eclsim.inputs.mistakes import CaseError, Mistake

VERSION = 2
LONGEST_LINK = 8_000
LONGEST_NAME = 240
LARGEST_STATE = 200_000
LONGEST_HISTORY = 100
MOST_SAVED = 6
MOST_UNDONE = 40
"""Largest number of undo steps, and of redo steps, stored by a browser."""
MOST_STATES = 2 * MOST_UNDONE + MOST_SAVED + 2
LONGEST_SNAPSHOT, LARGEST_SNAPSHOT = 120_000, 1_000_000
SNAPSHOT_VERSION = 1
MOST_REMARKS, LONGEST_REMARK, MOST_CONCERNED = 9, 700, 64
"""Largest numbers of remarks of a fit, of their characters, and of outputs or parameters that are named."""
VERDICTS = ("", "good", "doubtful", "poor")
ORIGINS = ("", "file", "cohort", "unfitted", "fit", "posterior", *PRESETS)


class FitRemark(NamedTuple):
    """What a fit says against reading numbers off its patient.

    Attributes:
        sentence: the remark.
        outputs: outputs that it concerns; empty for the first reason of the verdict.
    """

    sentence: str
    outputs: tuple[str, ...] = ()


@dataclass(frozen=True)
class PageState:
    """Everything from which a beat is computed, and the origin of the numbers.

    Args:
        case: patient, devices and parameters; knobs change it.
        policy: blood volume policy.
        origin: key of a preset, or another value of `ORIGINS`.
        posterior: key of the session's posterior for this patient; not part of a link.
        source: name of the file from which the patient was read.
        verdict: verdict on the fit, if the parameters were fitted: "good", "doubtful" or "poor".
        subject: key of the patient whose measurements these are, if not the patient as opened: that of a
            fitted patient is the one to which it was fitted.
        remarks: what the fit says against reading numbers off this patient.
        free: names of the fitted parameters.
        opened: the patient as opened, before any knob was turned; None if this is that state.
    """

    case: Case
    policy: str = POLICIES[0]
    origin: str = ""
    posterior: str = ""
    source: str = ""
    verdict: str = ""
    subject: str = ""
    remarks: tuple[FitRemark, ...] = ()
    free: tuple[str, ...] = ()
    opened: PageState | None = None

    @property
    def start(self) -> PageState:
        """The patient as opened, to which reset returns."""
        return self.opened or self

    @property
    def computed_case(self) -> Case:
        """The case to compute; open set points of its reflexes are those of the patient as opened."""
        left_open = self.case.regulation is not None and self.case.regulation.open_set_points
        if self.opened is None or not left_open:
            return self.case
        return self.case.model_copy(update={"as_written": self.opened.case})

    @property
    def changed(self) -> bool:
        """Whether a knob, device or policy differs from the patient as opened."""
        return self.opened is not None

    def with_case(self, case: Case) -> PageState:
        """Return the same patient with a changed case."""
        return self._changed(case, self.policy)

    def with_policy(self, policy: str) -> PageState:
        """Return the same patient under another blood volume policy."""
        return self._changed(self.case, policy)

    def _changed(self, case: Case, policy: str) -> PageState:
        start = self.start
        if (case, policy) == (start.case, start.policy):
            return start
        return replace(self, case=case, policy=policy, opened=start)

    def as_object(self) -> dict[str, Any]:
        """Return the state as plain data."""
        result = {"case": self.case.as_mapping(), "policy": self.policy}
        result |= {name: getattr(self, name) for name in _NAMES if getattr(self, name)}
        if self.opened is None or self.origin in PRESETS:  # presets can be opened without it
            of_fit = {"remarks": [list(remark) for remark in self.remarks], "free": list(self.free)}
            return result | {name: content for name, content in of_fit.items() if content}
        return result | {"opened": self.opened.as_object()}


_NAMES = ("origin", "source", "verdict", "subject")
"""Fields of a state that are texts."""


def preset_state(key: str) -> PageState:
    """Return the state of a preset as opened."""
    return PageState(PRESETS[key].case(), origin=key)


def subject_of(state: PageState) -> str:
    """Return a key of the measured patient, the same for the patient as opened, turned and fitted."""
    start = state.start
    return start.subject or f"{zlib.crc32(repr((start.case, start.origin, start.source)).encode()):08x}"


def key_of(state: PageState) -> str:
    """Return a key that distinguishes the results of different states."""
    computed = (state.case, state.policy)
    if state.computed_case is not state.case:  # reflexes whose set points are those of the patient as opened
        computed = (*computed, state.start.case)
    return f"{zlib.crc32(repr(computed).encode()):08x}"


def link_of(state: PageState) -> str:
    """Return a state as a link's fragment (after #), which stays in the browser and out of server logs."""
    return packed({"v": VERSION, "state": state.as_object()})


def state_of(link: str) -> PageState:
    """Return the state of a link, checked like a case file.

    Raises:
        CaseError: It is not a link of this page, or its case is invalid.
    """
    result = unpacked(link, LONGEST_LINK, LARGEST_STATE)
    if result.get("v") == 1:  # links of earlier versions did not contain the patient as opened
        return read_state({key: value for key, value in result.items() if key != "v"})
    if result.get("v") != VERSION:
        raise refused_link("from another version")
    return read_state(result.get("state"))


def read_state(data: object) -> PageState:
    """Convert plain data of a link to a state.

    Raises:
        CaseError: The data are not a state, or its case is invalid.
    """
    if not isinstance(data, dict):
        raise refused_link("damaged")
    if data.get("policy") not in POLICIES:
        raise refused_link("invalid: its blood volume policy is unknown")
    case = read_mapping(data.get("case"), "link").case
    if case.targets():  # the page itself writes only speeds
        raise refused_link("invalid: it sets a pump flow instead of a speed")
    names = _read_names(data)
    state = replace(PageState(case, data["policy"]), **names)
    if state.origin in PRESETS:
        return preset_state(state.origin)._changed(case, state.policy)
    opened = data.get("opened")
    if opened is None:
        free = _read_several(data.get("free", []))
        return replace(state, remarks=_read_remarks(data.get("remarks", [])), free=free)
    if not isinstance(opened, dict) or opened.get("opened") is not None:
        raise refused_link("damaged")
    start = read_state(opened)
    if start.case.patient.id != case.patient.id or any(getattr(start, n) != names[n] for n in names):
        raise refused_link("inconsistent: it holds two patients")
    return replace(state, opened=start, remarks=start.remarks, free=start.free)


def _read_names(data: dict[str, Any]) -> dict[str, str]:
    """Return the texts of a state; an unknown one is an error and never omitted or replaced."""
    if data.keys() - {"case", "policy", "opened", "remarks", "free", *_NAMES}:
        raise refused_link("from another version")
    names = {name: data.get(name, "") for name in _NAMES}
    words = [name for name in names.values() if isinstance(name, str)]
    if len(words) < len(names) or not all(w.isprintable() and len(w) <= LONGEST_NAME for w in words):
        raise refused_link("damaged")
    if names["origin"] not in ORIGINS:
        raise refused_link("for a patient that this version does not have")
    if names["verdict"] not in (VERDICTS if names["origin"] == "fit" else ("",)):
        raise refused_link("damaged")
    return names


def _read_remarks(data: object) -> tuple[FitRemark, ...]:
    """Convert plain data to remarks of a fit; anything else is refused."""
    if not isinstance(data, list) or len(data) > MOST_REMARKS:
        raise refused_link("damaged")
    return tuple(map(_read_remark, data))


def _read_remark(data: object) -> FitRemark:
    match data:
        case [str() as sentence, outputs] if sentence.isprintable() and len(sentence) <= LONGEST_REMARK:
            return FitRemark(sentence, _read_several(outputs))
    raise refused_link("damaged")


def _read_several(data: object) -> tuple[str, ...]:
    """Convert plain data to names of outputs or parameters; anything else is refused."""
    if not isinstance(data, list) or len(data) > MOST_CONCERNED:
        raise refused_link("damaged")
    if not all(isinstance(one, str) and one.isprintable() and len(one) <= LONGEST_NAME for one in data):
        raise refused_link("damaged")
    return tuple(data)


def packed(content: object) -> str:
    """Encode plain data as a text for links and for the browser's storage."""
    plain = json.dumps(content, separators=(",", ":")).encode()
    return base64.urlsafe_b64encode(zlib.compress(plain, 9)).decode().rstrip("=")


def unpacked(text: str, longest: int, largest: int) -> dict[str, Any]:
    """Decode a text made by `packed`.

    Args:
        text: text from a browser.
        longest: largest number of characters.
        largest: largest number of bytes after decompression.

    Raises:
        CaseError: The text is damaged or too long.
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
    """Return the error for a link that cannot be used."""
    return CaseError([Mistake("", f"the link is {reason}", allowed="a link copied from this page")])


@dataclass
class History:
    """States that were shown, for undo and redo.

    Many small turns of a knob are one step of the history: changes with the same `key` are merged if each
    follows the previous one within `merge_s` seconds.
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
        """Undo one step; return whether there was one."""
        return self._move(self.past, self.future)

    def redo(self) -> bool:
        """Redo one step; return whether there was one."""
        return self._move(self.future, self.past)

    def back_to(self, is_meant: Callable[[PageState], bool]) -> bool:
        """Go back to the last state that `is_meant` accepts; without one, change nothing and return False."""
        if not any(is_meant(state) for state in (self.now, *self.past)):
            return False
        while not is_meant(self.now):
            self.undo()
        return True

    def replace(self, state: PageState) -> None:
        """Replace the present state by another; redo returns to the replaced one."""
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
        minute: time from the start [min]; 0 for the steady beat of the state.
        length: duration of the course [min]; a short course is computed beat by beat.
    """

    minute: float = 0.0
    length: int = 0


START = Moment()


@dataclass(frozen=True)
class Snapshot:
    """State of a tab as stored by its browser.

    Args:
        history: states that were shown, with undo and redo.
        pinned: state whose beat was pinned.
        saved: states that were saved for the comparison.
        pinned_at: minute of the pinned beat in its course.
        saved_at: minute of each saved beat in its course; empty if all are at the start.
    """

    history: History
    pinned: PageState | None = None
    saved: tuple[PageState, ...] = ()
    pinned_at: Moment = START
    saved_at: tuple[Moment, ...] = ()

    def packed(self) -> str:
        """Encode the snapshot for the browser's storage: each state once, with indices that refer to it."""
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
    """Decode a snapshot from the browser's storage; each state is checked like a case file.

    Raises:
        CaseError: The snapshot is damaged, or of a version that this page does not read.
    """
    content = unpacked(text, LONGEST_SNAPSHOT, LARGEST_SNAPSHOT)
    plain = content.get("states")
    if content.get("v") != SNAPSHOT_VERSION or not isinstance(plain, list) or len(plain) > MOST_STATES:
        raise refused_link("from another version")
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
    """Convert plain data to a minute of a course; anything else is refused."""
    if not isinstance(data, (list, tuple)) or len(data) != 2:
        raise refused_link("damaged")
    minute, length = data
    numbers = isinstance(minute, (int, float)) and isinstance(length, int)
    if not numbers or bool in (type(minute), type(length)) or not 0 <= minute <= length <= LONGEST_MIN:
        raise refused_link("damaged")
    return Moment(float(minute), length)
