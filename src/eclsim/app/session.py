"""One browser tab: its state, its beats, and what it is told. Nothing here is shared between tabs."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from eclsim.app.knobs import connect, controls, turn, value_of
from eclsim.app.panel import described, shape_of
from eclsim.app.state import MOST_SAVED, POLICIES, History, PageState, key_of, link_of
from eclsim.app.texts import text
from eclsim.patients.mistakes import CaseError, Mistake

if TYPE_CHECKING:
    from eclsim.app.beat import Beat
    from eclsim.app.engine import Engine

log = logging.getLogger("eclsim.app")
WAVES = (
    "Pao", "Ppas", "Pra", "Plv", "Prv", "Vlv", "Vrv", "Qecmopump", "Qlvadpump", "Pcrrttuin", "Pcrrttuout",
    "Pecmodrain",
)  # fmt: skip
"""Waveforms that the browser draws."""
Send = Callable[[str, Any], None]
Follower = Callable[["Session"], None]


class Session:
    """What one tab shows.

    Args:
        engine: where beats are computed.
        state: what to start with.
        send: hands a topic and plain data to the browser.
    """

    def __init__(self, engine: Engine, state: PageState, send: Send):
        self.engine = engine
        self.send = send
        self.history = History(state)
        self.shown: tuple[PageState, Beat] | None = None
        self.pinned: tuple[PageState, Beat] | None = None
        self.saved: list[tuple[PageState, Beat]] = []
        self.started: Beat | None = None
        self.followers: list[Follower] = []
        self.view = "monitor"
        self.closed = False
        self._wanted: tuple[PageState, int] = (state, 0)
        self._running = False
        self._near: tuple[Any, Mapping[str, float]] | None = None
        self._drawn: Any = None
        self._panel: Any = None

    @property
    def state(self) -> PageState:
        """What is shown, or being computed."""
        return self.history.now

    @property
    def beat(self) -> Beat | None:
        """The beat that is shown; that of an older state while a newer one is computed."""
        return self.shown[1] if self.shown else None

    def start(self) -> None:
        """Tell the browser everything, and compute the first beat."""
        self._panel = self._drawn = None
        self.send("view", self.view)
        self.show_state()
        self._want(0)

    def turn(self, key: str, value: Any, seq: int = 0) -> bool:
        """Turn a knob or set a picker; a value that cannot be is told beside the knob."""
        return self._try(key, lambda: self.state.with_case(turn(self.state.case, key, value)), seq)

    def connect(self, device: str) -> bool:
        """Connect or disconnect a device."""
        return self._try(device, lambda: self.state.with_case(connect(self.state.case, device)), 0)

    def use_scheme(self, access: str, giving: str) -> bool:
        """Connect the CRRT at two positions of the ECMO circuit; without CRRT, connect one first."""

        def changed() -> PageState:
            case = self.state.case if self.state.case.crrt else connect(self.state.case, "crrt")
            for key, site in (("crrt.access_site", access), ("crrt.return_site", giving)):
                case = turn(case, key, site)
            return self.state.with_case(case)

        return self._try("crrt.access_site", changed, 0)

    def set_policy(self, policy: str) -> None:
        """Choose who fills the circuits."""
        if policy in POLICIES:
            self._change(replace(self.state, policy=policy), "policy", 0)

    def load(self, state: PageState) -> None:
        """Show another patient."""
        self.history.load(state, time.monotonic())
        self._near, self.started = None, None
        self.show_state()
        self._want(0)

    def undo(self) -> None:
        """One change back."""
        if self.history.undo():
            self.show_state()
            self._want(0)

    def redo(self) -> None:
        """One change forward."""
        if self.history.redo():
            self.show_state()
            self._want(0)

    def reset(self) -> None:
        """Back to the patient as loaded."""
        self._change(self.history.start, "", 0)

    def pin(self) -> None:
        """Keep the beat as a shadow, or let it go."""
        if self.pinned is not None:
            self.pinned = None
        elif self.shown is not None:
            self.pinned = self.shown
        self.send("pinned", _kept(*self.pinned) if self.pinned else None)
        self.show_state()
        self._follow()

    def save(self) -> bool:
        """Keep the state for the comparison; False if there are too many."""
        if self.shown is None or len(self.saved) >= MOST_SAVED:
            return False
        self.saved.append(self.shown)
        self._tell_saved()
        return True

    def show_saved(self, number: int) -> None:
        """Show a saved state again."""
        if 0 <= number < len(self.saved):
            self._change(self.saved[number][0], "", 0)

    def remove_saved(self, number: int) -> None:
        """Let go of a saved state."""
        if 0 <= number < len(self.saved):
            del self.saved[number]
            self._tell_saved()

    def _tell_saved(self) -> None:
        self.send("saved", [_kept(*one) for one in self.saved])

    def follow(self, follower: Follower) -> None:
        """Call after every beat, and when another view is open or a state is pinned."""
        self.followers.append(follower)

    def open_view(self, view: str) -> None:
        """Another view is seen; those that compute do so only while they are seen."""
        self.view = view
        self.send("view", view)
        self._follow()

    def close(self) -> None:
        """The tab is gone: start nothing more."""
        self.closed = True
        self.followers.clear()

    def _try(self, key: str, make: Callable[[], PageState], seq: int) -> bool:
        try:
            state = make()
        except CaseError as error:
            self.send("error", {"key": key, "messages": [_beside(m) for m in error.mistakes], "seq": seq})
            return False
        self._change(state, key, seq)
        return True

    def _change(self, state: PageState, key: str, seq: int) -> None:
        self.history.change(state, key, time.monotonic())
        self.show_state(key, seq)
        self._want(seq)

    def _want(self, seq: int) -> None:
        """Compute the beat of the state; while one is being computed only the newest is kept."""
        self._wanted = (self.state, seq or self._wanted[1])
        if not self._running and not self.closed:
            self._running = True
            task = asyncio.get_running_loop().create_task(self._run())
            task.add_done_callback(_report)

    async def _run(self) -> None:
        try:
            done: Any = None
            while done is not self._wanted and not self.closed:
                done = wanted = self._wanted
                state, seq = wanted
                if not self.engine.knows(state):
                    self.send("busy", text("compiling"))
                try:
                    beat = await self.engine.beat(state, self._near_values(state))
                except Exception:  # a beat that fails must not end the page; what failed is in the log
                    log.exception("a beat failed")
                    self.send("failed", text("failed"))
                    continue
                if not self.closed:
                    self._show(state, beat, seq)
        finally:
            self._running = False

    def _show(self, state: PageState, beat: Beat, seq: int) -> None:
        from eclsim.app.beat import plain
        from eclsim.app.ranges import levels

        self.shown = (state, beat)
        if beat.converged:
            self._near = (
                self._near if self._near and self._near[0] is beat.circuit else (beat.circuit, beat.values)
            )
        if self.started is None or state == self.history.start:
            self.started = beat
            self.send("base", {"outputs": plain(beat, ())["outputs"]})
        told = {"levels": levels(dict(beat.means)), "seq": seq, "of": key_of(state)}
        self.send("beat", {**plain(beat, WAVES), **told})
        self._follow()

    def _near_values(self, state: PageState) -> Mapping[str, float] | None:
        from eclsim.app.circuits import page_circuit

        if self._near is None or page_circuit(state.case)[0] is not self._near[0]:
            return None
        return self._near[1]

    def _follow(self) -> None:
        for follower in list(self.followers):
            follower(self)

    def show_state(self, key: str = "", seq: int = 0) -> None:
        """Tell the browser where knobs stand, and, where the circuit changed, how it is drawn."""
        from eclsim.app.drawing import drawing_of

        case = self.state.case
        found = controls(case)
        panel = [described(control) for control in found]
        if panel != self._panel:
            self._panel = panel
            self.send("panel", panel)
        shape = shape_of(case)
        if shape != self._drawn:
            self._drawn = shape
            self.send("drawing", drawing_of(case))
        self.send("state", {
            "values": {control.key: value_of(case, control.key) for control in found},
            "devices": {d: getattr(case, d) is not None for d in ("ecmo", "crrt", "lvad")},
            "policy": self.state.policy, "key": key, "seq": seq, "name": case.patient.id,
            "origin": self.state.origin, "link": link_of(self.state),
            "undo": bool(self.history.past), "redo": bool(self.history.future),
            "changed": self.state != self.history.start, "pinned": self.pinned is not None,
        })  # fmt: skip


def _kept(state: PageState, beat: Beat) -> dict[str, Any]:
    """A beat with the name and the knobs of its state, as plain data."""
    from eclsim.app.beat import plain

    knobs = {c.key: value_of(state.case, c.key) for c in controls(state.case)}
    return {**plain(beat, WAVES), "of": key_of(state), "name": state.case.patient.id, "values": knobs}


def _beside(mistake: Mistake) -> str:
    """A mistake as it stands beside its knob: without the key."""
    return str(Mistake("", mistake.message, mistake.value, mistake.allowed, mistake.suggestion))


def _report(task: asyncio.Task[None]) -> None:
    if not task.cancelled() and task.exception() is not None:
        log.error("a session failed", exc_info=task.exception())
