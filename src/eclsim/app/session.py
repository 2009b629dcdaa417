"""One browser tab: its state, its beats, and the messages sent to it. Nothing is shared between tabs."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable, Coroutine, Mapping
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from eclsim.app.course import (
    BEATS,
    ShownBeat,
    case_at_minute,
    knobs_at,
    plain_events,
    possible_events,
    recomputed,
    with_event,
    with_turn,
    without_event,
)
from eclsim.app.display import display, figures_of, panel_of, waves_of
from eclsim.app.fit_remarks import with_remarks
from eclsim.app.knobs import connect, connected, knobs_of, switchable, turn
from eclsim.app.provenance import measured_values, provenance, title_of
from eclsim.app.remarks import beside_knob, remarks_of
from eclsim.app.state import (
    MOST_SAVED,
    START,
    History,
    Moment,
    PageState,
    Snapshot,
    key_of,
    link_of,
    state_of,
    subject_of,
)
from eclsim.app.texts import text
from eclsim.cases.resolve import circuit_of
from eclsim.cases.sections import POLICIES
from eclsim.course.alarms import clock_time
from eclsim.inputs.mistakes import CaseError, Mistake

if TYPE_CHECKING:
    from eclsim.app.beat import Beat
    from eclsim.app.engine import Engine
    from eclsim.cases.case import Case

log = logging.getLogger("eclsim.app")
STORE_AFTER_S = 0.5
"""Time without changes after which the browser receives a snapshot to store [s]."""
BEATS_WORTH_A_CLOSER_START = 12
"""Longest search [beats] without a nearer start for later ones: at 25 each turn would need a Jacobian."""
Send = Callable[[str, Any], None]
Listener = Callable[["Session"], None]


class Session:
    """State and beats of one tab.

    Args:
        engine: computes beats.
        state: initial state.
        send: sends a topic and plain data to the browser.
    """

    def __init__(self, engine: Engine, state: PageState, send: Send):
        self.engine = engine
        self.send = send
        self.history = History(state)
        self.shown: tuple[PageState, Beat] | None = None
        self.later: ShownBeat | None = None
        self.pinned: ShownBeat | None = None
        self.saved: list[ShownBeat] = []
        self.base: tuple[PageState, Beat] | None = None
        self.listeners: list[Listener] = []
        self.view = "monitor"
        self.minutes = 0
        self.minute = 0.0
        self.recording = False
        self.closed = False
        self._requested: tuple[PageState, int] = (state, 0)
        self._running = False
        self._anchor: Beat | None = None
        self._preparing_start: asyncio.Task[None] | None = None
        self._drawn: object = None
        self._panel: object = None
        self._display: object = None
        self._keep_timer: asyncio.TimerHandle | None = None
        self._restored: Snapshot | None = None
        self._completing: asyncio.Task[None] | None = None

    @property
    def state(self) -> PageState:
        """State that is displayed or being computed."""
        return self.history.now

    @property
    def beat(self) -> Beat | None:
        """The displayed beat, which belongs to an older state while a newer one is computed."""
        return self.shown[1] if self.shown else None

    @property
    def own_beat(self) -> Beat | None:
        """The displayed beat if it belongs to the state; None while a newer one is computed."""
        return self.shown[1] if self.shown is not None and self.shown[0] == self.state else None

    @property
    def seen(self) -> ShownBeat | None:
        """The beat displayed on the page: that of the state, or of a later minute of its course."""
        return self.later or (ShownBeat(*self.shown) if self.shown else None)

    def start(self) -> None:
        """Send everything to the browser, and compute the first beat."""
        self._panel = self._drawn = self._display = None
        self.send("view", self.view)
        self.show_state()
        self._request(0)

    def restore(self, snapshot: Snapshot) -> None:
        """Continue the ended session of the same tab; pinned and saved beats are recomputed."""
        self.history = snapshot.history
        if snapshot.pinned is not None or snapshot.saved:
            self._restored = snapshot

    def turn(self, key: str, value: object, seq: int = 0) -> bool:
        """Turn a knob or set a picker; a value that is not allowed is reported beside the knob."""

        def turned() -> Case:
            case = self.state.case
            later = self.recording and self.minute > 0.0
            if later:
                self._check_end(key, self.minute)
            return with_turn(case, key, value, self.minute) if later else turn(case, key, value)

        return self._try(key, lambda: self.state.with_case(turned()), seq)

    def record(self, on: bool) -> None:
        """Set whether turning a knob adds an event at the displayed minute or changes the start."""
        self.recording = on
        self.show_state()

    def at_minute(self, minute: float) -> None:
        """Set the displayed minute; while turns are recorded, the knobs show the values at that minute."""
        before, self.minute = self._values() if self.recording else None, minute
        if self.recording and self._values() != before:
            self.show_state()

    def connect(self, device: str) -> bool:
        """Connect or disconnect a device."""

        def changed() -> PageState:
            self._check_start(device)
            return self.state.with_case(connect(self.state.case, device))

        return self._try(device, changed, 0)

    def use(self, device: str, settings: Mapping[str, Any]) -> bool:
        """Set several knobs of a device at once, after connecting the device if necessary."""

        def changed() -> PageState:
            self._check_start(device)
            case = self.state.case
            if device not in connected(case):
                case = connect(case, device)
            for key, value in settings.items():
                case = turn(case, key, value)
            return self.state.with_case(case)

        return self._try(next(iter(settings), device), changed, 0)

    def add_event(self, event: object) -> bool:
        """Add an event to the course of the case."""

        def added() -> PageState:
            at = event.get("at_min") if isinstance(event, dict) else None
            self._check_end("events", at if isinstance(at, (int, float)) else 0.0)
            return self.state.with_case(with_event(self.state.case, event))

        return self._try("events", added, 0)

    def remove_event(self, number: int) -> bool:
        """Remove an event from the course of the case."""
        return self._try("events", lambda: self.state.with_case(without_event(self.state.case, number)), 0)

    def show_moment(self, state: PageState, beat: Beat, minute: float) -> None:
        """Show the beat of a later minute of the course; knobs keep the values of its start."""
        if state == self.state and not self.closed:
            self.later = ShownBeat(state, beat, Moment(minute, self.minutes))
            self._send_beat(state, beat, self._requested[1], minute)
            self._notify()

    def show_start(self) -> None:
        """Show the beat of the state again, after one of a later minute."""
        self.later = None
        if self.shown is not None and not self.closed:
            self._send_beat(*self.shown, 0)

    def replace_beat(self, old: Beat, new: Beat) -> None:
        """Replace a beat wherever it is shown, pinned or saved by the same with more findings."""
        if self.closed:
            return

        def replaced(kept: ShownBeat) -> ShownBeat:
            return kept._replace(beat=new) if kept.beat is old else kept

        seen = self.seen
        if self.shown is not None and self.shown[1] is old:
            self.shown = self.shown[0], new
        self.later = replaced(self.later) if self.later else None
        if seen is not None and seen.beat is old and self._is_displayed(seen):
            self._send_beat(seen.state, new, self._requested[1], seen.moment.minute)
        if self.pinned is not None and self.pinned.beat is old:
            self.pinned = replaced(self.pinned)
            self._send_pinned()
        if any(kept.beat is old for kept in self.saved):
            self.saved = [replaced(kept) for kept in self.saved]
            self._send_saved()

    def _is_displayed(self, seen: ShownBeat) -> bool:
        """Whether a beat is of the present state and minute, and not to be followed by one of the course."""
        return seen.state == self.state and (seen.moment.minute > 0.0 or self.minute == 0.0)

    def set_policy(self, policy: str) -> None:
        """Set the blood volume policy."""

        def changed() -> PageState:
            self._check_start("policy")
            return self.state.with_policy(policy)

        if policy in POLICIES:
            self._try("policy", changed, 0)

    def _check_start(self, key: str) -> None:
        """Refuse a change that cannot be an event while turns are recorded at a later minute."""
        if self.recording and self.minute > 0.0:
            raise CaseError([Mistake(key, text("timeline_of_start"))])

    def _check_end(self, key: str, minute: float) -> None:
        """Refuse an event at or after the end of the open timeline, which would have no course then."""
        if 0 < self.minutes <= minute:
            raise CaseError(
                [Mistake(key, text("timeline_end", time=clock_time(minute, self.minutes in BEATS)))]
            )

    def load(self, state: PageState, opened: bool = False) -> None:
        """Show another patient; undo returns to the previous one.

        Args:
            state: state of the patient.
            opened: whether the patient was newly opened, so that earlier entries for it are discarded.
        """
        self.history.change(state, "", time.monotonic())
        self._anchor = None
        self.show_state(opened=opened)
        self._request(0)

    def judge(self, old: PageState, new: PageState) -> None:
        """Replace an opened patient by the same with a later verdict, in all states that started from it."""

        def rejudged(state: PageState) -> PageState:
            if state.start != old:
                return state
            judged = replace(state, verdict=new.verdict, remarks=new.remarks, opened=new)
            return judged if state.opened else new

        history = self.history
        history.now = rejudged(history.now)
        for steps in (history.past, history.future):
            steps[:] = [rejudged(state) for state in steps]
        if self.shown is not None:
            self.shown = rejudged(self.shown[0]), self.shown[1]
        if self.later is not None:
            self.later = self.later._replace(state=rejudged(self.later.state))
        self._requested = rejudged(self._requested[0]), self._requested[1]
        self.show_state()

    def undo(self) -> None:
        """Undo one change."""
        self._show_again(self.history.undo())

    def redo(self) -> None:
        """Redo one change."""
        self._show_again(self.history.redo())

    def roll_back(self, of: str, link: str = "") -> bool:
        """Return to the state that the page shows, if it had no answer to later changes.

        Args:
            of: `key_of` that state.
            link: link that restores the state if it is not in the history.

        Returns:
            Whether a change was undone; redo repeats it.
        """
        before = self.state
        if not self.history.back_to(lambda state: key_of(state) == of) and link:
            with suppress(CaseError):
                self.history.replace(state_of(link))
        self._show_again(changed := self.state is not before)
        self.send("taken_back", key_of(self.state))
        return changed

    def _show_again(self, changed: bool) -> None:
        if changed:
            self.show_state()
            self._request(0)

    def reset(self) -> None:
        """Return to the patient as loaded."""
        self._change(self.state.start, "", 0)

    def pin(self) -> None:
        """Pin the displayed beat as a shadow, or remove the pinned one."""
        self.pinned = self.seen if self.pinned is None else None
        self._send_pinned()
        self.show_state()
        self._notify()

    def save(self) -> bool:
        """Save the displayed beat for the comparison; return False if there are too many."""
        if self.seen is None or len(self.saved) >= MOST_SAVED:
            return False
        self.saved.append(self.seen)
        self._send_saved()
        return True

    def show_saved(self, number: int) -> None:
        """Show a saved state again, at the minute of its course."""
        if 0 <= number < len(self.saved):
            kept = self.saved[number]
            self._change(kept.state, "", 0)
            self.send("go_to", kept.moment._asdict())

    def remove_saved(self, number: int) -> None:
        """Delete a saved state."""
        if 0 <= number < len(self.saved):
            del self.saved[number]
            self._send_saved()

    def _send_saved(self) -> None:
        self.send("saved", [kept.plain() for kept in self.saved])
        self._store_snapshot_soon()

    def _send_pinned(self) -> None:
        self.send("pinned", self.pinned.plain() if self.pinned else None)

    def listen(self, listener: Listener) -> None:
        """Register a function to be called after each beat, on opening a view and on pinning a state."""
        self.listeners.append(listener)

    def open_view(self, view: str) -> None:
        """Set the visible view; views that compute do so only while visible."""
        self.view = view
        self.send("view", view)
        self._notify()

    def close(self) -> None:
        """End the session when the tab is closed; no further work is started."""
        self.closed = True
        self.listeners.clear()
        if self._keep_timer is not None:
            self._keep_timer.cancel()

    def _try(self, key: str, make: Callable[[], PageState], seq: int) -> bool:
        try:
            state = make()
        except CaseError as error:
            messages = [beside_knob(mistake, self.state.case) for mistake in error.mistakes]
            self.send("error", {"key": key, "messages": messages, "seq": seq})
            return False
        self._change(state, key, seq)
        return True

    def _change(self, state: PageState, key: str, seq: int) -> None:
        self.history.change(state, key, time.monotonic())
        self.show_state(key, seq)
        self._request(seq)

    def _request(self, seq: int) -> None:
        """Compute the beat of the state; of requests made during a computation, only the newest is kept."""
        self._requested = (self.state, seq or self._requested[1])
        if not self._running and not self.closed:
            self._running = True
            _started(self._run())

    async def _run(self) -> None:
        try:
            done: tuple[PageState, int] | None = None
            while done is not self._requested and not self.closed:
                done = requested = self._requested
                state, seq = requested
                try:
                    beat = await self.engine.beat(state, self._anchor, self._compiling)
                except Exception:  # a failed beat must not end the page; the error is in the log
                    log.exception("a beat failed")
                    self.send("failed", text("failed"))
                    continue
                if not self.closed:
                    self._show(state, beat, seq)
        finally:
            self._running = False

    def _send_beat(self, state: PageState, beat: Beat, seq: int, minute: float = 0.0) -> None:
        from eclsim.app.beat import plain

        beat = with_remarks(beat, state)
        about = {"seq": seq, "of": key_of(state), "values": self._values(state), "minute": minute}
        about |= measured_values(state)
        case = case_at_minute(state.case, minute)
        if minute:
            about["values_then"] = knobs_of(case)
        self._send_circuit(case)
        self.send("beat", {**plain(beat, waves_of(case), figures_of(case)), **about})

    def _show(self, state: PageState, beat: Beat, seq: int) -> None:
        self.shown = (state, beat)
        self._update_search_start(state, beat)
        if not state.changed and (self.base is None or self.base[0] != state):
            self._set_base(state, beat)
        if not self.minute:  # else the course follows, with the beat of the displayed minute
            self._send_beat(state, beat, seq)
        self._complete_soon()
        self._notify()

    def _update_search_start(self, state: PageState, beat: Beat) -> None:
        """Make searches start from this beat if they start too far away; the knobs do not wait for this."""
        known = self._anchor is not None and self._anchor.circuit is beat.circuit
        idle = self._preparing_start is None or self._preparing_start.done()
        if beat.converged and idle and not (known and beat.effort <= BEATS_WORTH_A_CLOSER_START):
            self._preparing_start = _started(self._prepare_search_start(state, beat))

    async def _prepare_search_start(self, state: PageState, beat: Beat) -> None:
        await self.engine.prepare_nearby_searches(state, beat)
        self._anchor = beat

    def _complete_soon(self) -> None:
        """Start `_complete` if the page lacks beats other than the displayed one."""
        if self._completing is None and not self.closed and self._incomplete():
            self._completing = _started(self._complete())

    def _incomplete(self) -> bool:
        return self._restored is not None or self.base is None or self.base[0] != self.state.start

    async def _complete(self) -> None:
        """Compute beats pinned or saved before a reload, and the beat with which changes are compared."""
        try:
            while self._incomplete() and not self.closed:
                if self._restored is not None:
                    await self._compute_restored(self._restored)
                else:
                    start = self.state.start
                    self._set_base(start, await self.engine.beat(start, None))
        finally:
            self._completing = self._restored = None

    async def _compute_restored(self, snapshot: Snapshot) -> None:
        moments = snapshot.saved_at or [START] * len(snapshot.saved)
        saved = [
            await recomputed(self.engine, state, moment)
            for state, moment in zip(snapshot.saved, moments, strict=True)
        ]
        if snapshot.pinned is not None and self.pinned is None:
            self.pinned = await recomputed(self.engine, snapshot.pinned, snapshot.pinned_at)
        self._restored = None
        self.saved = [*saved, *self.saved][:MOST_SAVED]
        self._send_pinned()
        self._send_saved()
        self.show_state()
        self._notify()

    def _set_base(self, start: PageState, beat: Beat) -> None:
        self.base = start, beat
        if not self.closed:
            self.send("base", {"of": subject_of(start)} | _compared(beat))

    def _compiling(self) -> None:
        if not self.closed:
            self.send("busy", text("compiling"))

    def _notify(self) -> None:
        for listener in list(self.listeners):
            listener(self)

    def show_state(self, key: str = "", seq: int = 0, opened: bool = False) -> None:
        """Send the values of the knobs to the browser and, if the circuit changed, its drawing."""
        state, case = self.state, self.state.case
        self._send_circuit(case_at_minute(case, self.minute))
        panel = panel_of(case)
        if panel != self._panel:
            self._panel = panel
            self.send("panel", panel)
            self.send("possible_events", possible_events(case))
        values = self._values()
        self.send("state", {
            "values": values, "remarks": remarks_of(case, values),
            "of": key_of(state), "start": key_of(state.start), "subject": subject_of(state),
            "provenance": provenance(state),
            "devices": {key: key in connected(case) for key in switchable()},
            "events": plain_events(case),
            "policy": state.policy, "recording": self.recording, "key": key, "seq": seq, "opened": opened,
            "name": title_of(state),
            "origin": state.origin, "link": link_of(state),
            "undo": bool(self.history.past), "redo": bool(self.history.future),
            "changed": state.changed, "pinned": self.pinned is not None,
        })  # fmt: skip
        self._store_snapshot_soon()

    def _send_circuit(self, case: Case) -> None:
        """Send drawing and labels of a case's circuit, unless the browser has them."""
        from eclsim.app.drawing import drawing_of

        shape = circuit_of(case)
        parts = connected(case), [instance.key for instance in case.instances()], shape
        if parts != self._display:
            self._display = parts
            self.send("display", display(case))
        if shape != self._drawn:
            self._drawn = shape
            self.send("drawing", drawing_of(case))

    def _values(self, state: PageState | None = None) -> dict[str, Any]:
        """Return the values of the knobs, now or in a given state, whose beat may arrive after more turns."""
        case = (state or self.state).case
        return knobs_at(case, self.minute if self.recording else 0.0)

    def _store_snapshot_soon(self) -> None:
        """Have the browser store this tab once nothing changes for a while."""
        if self._keep_timer is not None:
            self._keep_timer.cancel()
        if self._restored is None and not self.closed:
            self._keep_timer = asyncio.get_running_loop().call_later(STORE_AFTER_S, self._store_snapshot)

    def _store_snapshot(self) -> None:
        pinned, pinned_at = (self.pinned.state, self.pinned.moment) if self.pinned else (None, START)
        states, moments = (tuple(getattr(kept, of) for kept in self.saved) for of in ("state", "moment"))
        snapshot = Snapshot(self.history, pinned, states, pinned_at, moments)
        self.send("keep", {"tab": snapshot.packed(), "of": key_of(self.state)})


def _compared(beat: Beat) -> dict[str, Any]:
    """Return the data with which changes are compared, as plain data."""
    from eclsim.app.beat import plain

    everything = plain(beat, ())
    return {name: everything[name] for name in ("outputs", "possible", "undetermined")}


def _started(work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
    """Start work in the event loop; an error in it goes to the log."""
    task = asyncio.get_running_loop().create_task(work)
    task.add_done_callback(_report)
    return task


def _report(task: asyncio.Task[None]) -> None:
    if not task.cancelled() and task.exception() is not None:
        log.error("a session failed", exc_info=task.exception())
