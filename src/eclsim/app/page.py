"""The page of one tab: header, knobs, schematic and views, connected to the session."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import nicegui.elements.plotly  # noqa: F401  (puts the Plotly that comes with NiceGUI within reach)
from nicegui import ui
from nicegui.element import Element

from eclsim._version import __version__
from eclsim.app.course import LENGTHS
from eclsim.app.display import output_specs
from eclsim.app.files import shortened
from eclsim.app.header import Header, notify
from eclsim.app.identify import Identification, fields
from eclsim.app.provenance import title_of
from eclsim.app.session import Session
from eclsim.app.state import History, PageState, Snapshot, read_snapshot, state_of
from eclsim.app.texts import ENGLISH, text
from eclsim.app.updates import CourseStudy, PosteriorBands, SecondBeats, ViewStudy
from eclsim.inputs.mistakes import CaseError

if TYPE_CHECKING:
    from eclsim.app.engine import Engine

WEB = Path(__file__).parent / "web"
STYLES = [WEB / f"{name}.css" for name in ("page", "schematic", "views", "gases", "timeline", "print")]
SKIP_TO_KNOBS = "(event) => { event.preventDefault(); document.querySelector('.ecl-knobs').focus(); }"
"""Moves the focus to the knobs without changing the address, whose fragment is the patient of a link."""
VIEWS = ("monitor", "loops", "ramp", "schemes", "gases", "outputs", "identify", "compare")


Message = Mapping[str, Any]
"""Message of a view in the browser; its content cannot be trusted."""


class Heard(Element):
    """An element drawn by a script of web/, whose messages are plain data."""

    def hear(self, topic: str, handle: Callable[[Message], object]) -> None:
        """Register a handler of a message; one that is not plain data, which no script sends, is empty."""
        self.on(topic, lambda event: handle(event.args if isinstance(event.args, dict) else {}))


class Bridge(Heard, component=WEB / "bridge.js", esm={"eclsim-page": str(WEB / "lib")}):
    """Connection between session and browser, and the status beside the brand."""

    def __init__(self, texts: dict[str, str]):
        super().__init__()
        self._props["texts"] = texts

    def publish(self, topic: str, data: object) -> None:
        """Send data to every view that subscribed to the topic."""
        self.run_method("publish", topic, data)


def _component(script: str) -> Callable[..., Heard]:
    """Create a class of elements drawn by a script of web/ with data received through the bridge."""

    class Component(Heard, component=WEB / f"{script}.js"):
        def __init__(self, **properties: object):
            super().__init__()
            self._props.update(properties)

    return Component


MOST_SETTINGS = 10
MOST_REASONS = 3
SCRIPTS = (
    "provenance", "knobs", "schematic", "keys", "limits", "bands", "monitor", "loops", "ramp", "schemes",
    "timeline", "gases", "outputs", "identify", "compare",
)  # fmt: skip
ELEMENTS = {script: _component(script) for script in SCRIPTS}


class BedsidePage:
    """The page of one tab.

    Args:
        engine: computes beats.
        state: initial patient.
        sign_out: address that ends the session of the browser; empty if no password is required.
    """

    def __init__(self, engine: Engine, state: PageState, sign_out: str = ""):
        self.engine = engine
        self.header: Header | None = None
        self.session = Session(engine, state, self._send)
        self.bands = PosteriorBands(engine, self.session)
        self.identification = Identification(self.session, self._send, engine.fits, self.bands)
        self._build(sign_out)

    def close(self) -> None:
        """End the work of the page when its tab is closed."""
        self.identification.cancel()
        self.session.close()
        if self.header is not None:
            self.header.opening.close()

    def _send(self, topic: str, data: Any) -> None:
        if topic == "state" and self.header is not None:
            self.header.show(data)
        self.bridge.publish(topic, data)
        if topic == "state":
            self.identification.follow(data["opened"])

    def _build(self, sign_out: str) -> None:
        for style in STYLES:
            ui.add_css(style)
        skip = ui.link(text("skip"), "#knobs").classes("ecl-skip")
        skip.on("click", js_handler=SKIP_TO_KNOBS)
        ui.dark_mode(None)  # as the reader's system prefers
        with ui.element("div").classes("ecl-page"):
            with ui.element("header").classes("ecl-header"):
                ui.label(text("brand")).classes("ecl-brand").props("role=heading aria-level=1")
                self.bridge = Bridge({**ENGLISH, "version": __version__})
                self.header = Header(self.session, self.bridge, self.identification, sign_out)
            ELEMENTS["provenance"]()
            with ui.element("aside").classes("ecl-left"):
                knobs = ELEMENTS["knobs"]()
                knobs.hear("turn", lambda m: self.session.turn(*_turned(m)))
                knobs.hear("connect", lambda m: self.session.connect(str(m.get("device"))))
                knobs.hear("policy", lambda m: self.session.set_policy(str(m.get("policy"))))
            with ui.element("section").classes("ecl-middle").props(f'aria-label="{text("schematic")}"'):
                ELEMENTS["schematic"]().hear(
                    "move", lambda m: self.session.turn(str(m.get("key")), str(m.get("site")))
                )
            with ui.element("section").classes("ecl-right").props(f'aria-label="{text("views")}"'):
                ELEMENTS["keys"]()
                ELEMENTS["limits"]()
                self._views()
            with ui.element("div").classes("ecl-notice").props("role=note"):
                ui.label(text("notice"))
        self.bridge.hear("hello", self._browser_connected)
        self.bridge.hear("link", self._open_link)
        self.bridge.hear("shortcut", self._shortcut)
        self.bridge.on("ask", lambda: self.bridge.publish("alive", True))
        self.bridge.hear("take_back", self._roll_back)

    def _views(self) -> None:
        self.tabs = ui.tabs().props("dense no-caps inline-label align=left outside-arrows")
        with self.tabs.classes("ecl-tabs").props(f'aria-label="{text("views")}"'):
            for name in VIEWS:
                ui.tab(name, label=text(name))
        self.tabs.on_value_change(lambda e: self.session.open_view(str(e.value)))
        ELEMENTS["bands"]().hear("show", lambda m: self.bands.show(m.get("on") is True))
        panels = ui.tab_panels(self.tabs, value="monitor", animated=False, keep_alive=True)
        specs = {"specs": output_specs()}
        of_view = {"identify": {"fields": fields()}, "gases": specs, "outputs": specs, "compare": specs}
        views: dict[str, Heard] = {}
        with panels.classes("ecl-views"):
            for name in VIEWS:
                with ui.tab_panel(name):
                    views[name] = ELEMENTS[name](**of_view.get(name, {}))
                    if name == "monitor":
                        self._timeline()
        views["schemes"].hear("use", self._use)
        views["gases"].hear("connect", lambda _: self.session.connect("gas"))
        views["compare"].hear("show", lambda m: self.session.show_saved(_number(m)))
        views["compare"].hear("remove", lambda m: self.session.remove_saved(_number(m)))
        self._identify(views["identify"])
        for view in ("ramp", "schemes"):
            self.session.listen(ViewStudy(self.engine, view))
        self.session.listen(SecondBeats(self.engine))
        self.session.listen(self.bands)

    def _timeline(self) -> None:
        self.course = CourseStudy(self.engine, self.session)
        timeline = ELEMENTS["timeline"](lengths=LENGTHS)
        timeline.hear("open", lambda m: self.course.open(_number(m)))
        timeline.hear("record", lambda m: self.session.record(m.get("on") is True))
        timeline.hear("show", lambda m: self.course.show(_minute(m)))
        timeline.hear("add", self.session.add_event)
        timeline.hear("remove", lambda m: self.session.remove_event(_number(m)))
        self.session.listen(self.course)

    def _identify(self, form: Heard) -> None:
        form.on("fill", self.identification.fill)
        form.hear("check", self.identification.check)
        form.hear("fit", self.identification.start)
        form.on("cancel", self.identification.cancel)
        form.hear(
            "posterior",
            lambda m: self.identification.compute_posterior(_link(m), m.get("fit")),
        )
        form.hear("use", lambda m: self._use_fit(_link(m)))

    def _use_fit(self, link: str) -> None:
        if self.identification.use(link):
            notify(text("fit_used"))

    def _browser_connected(self, args: Message) -> None:
        """Start the session: a link precedes the tab's stored state, which precedes the first patient."""
        link, tab, last = (str(args.get(key) or "") for key in ("link", "tab", "last"))
        restored = bool(tab or last) and self._restore(tab, last)
        if not restored and not link and (tab or last or args.get("again") is True):
            notify(text("tab_lost", name=title_of(self.session.state)), "negative")
        if link and (state := self._state_of_link(link)) is not None:
            if restored:
                self.session.history.change(state, "", 0.0)
            else:
                self.session.history = History(state)
        if restored and (view := str(args.get("view"))) in VIEWS:
            self.tabs.set_value(view)
        self.session.start()

    def _restore(self, tab: str, last: str) -> bool:
        """Restore the stored state of the tab; `last` is a state that it showed after being stored."""
        try:
            newest = state_of(last) if last else None
            tab_state = read_snapshot(tab) if tab else Snapshot(History(newest or self.session.state))
        except CaseError:
            return False
        if newest is not None:
            tab_state.history.change(newest, "", 0.0)
        self.session.restore(tab_state)
        counts = {
            "steps": len(tab_state.history.past), "saved": len(tab_state.saved),
            "pinned": int(tab_state.pinned is not None),
        }  # fmt: skip
        notify(text("tab_restored", name=title_of(tab_state.history.now), **counts), "info")
        return True

    def _state_of_link(self, link: str) -> PageState | None:
        """Return the state of a link; an invalid link gives a message and changes nothing."""
        try:
            return state_of(link)
        except CaseError as error:
            reasons = "; ".join(shortened([str(mistake) for mistake in error.mistakes], MOST_REASONS))
            shown = title_of(self.session.state)
            notify(text("link_refused", reason=reasons, name=shown), "negative")
            return None

    def _roll_back(self, args: Message) -> None:
        """Return to the state that the page shows again, after it had waited too long for an answer."""
        if self.session.roll_back(str(args.get("of") or ""), str(args.get("link") or "")):
            notify(text("taken_back"), "warning")

    def _open_link(self, args: Message) -> None:
        """Show the state of a link that was entered into the address of the open page."""
        state = self._state_of_link(str(args.get("link") or ""))
        if state is not None:
            self.session.load(state)
            notify(text("link_opened", name=title_of(state)), "info")

    def _use(self, args: Message) -> None:
        settings = args.get("settings")
        if isinstance(settings, dict) and len(settings) <= MOST_SETTINGS:
            self.session.use(str(args.get("device")), {str(k): str(v) for k, v in settings.items()})

    def _shortcut(self, args: Message) -> None:
        action = args.get("action")
        if action == "view":
            number = args.get("number")
            if isinstance(number, int) and 1 <= number <= len(VIEWS):
                self.tabs.set_value(VIEWS[number - 1])
        elif action in ("undo", "redo", "reset", "pin"):
            getattr(self.session, action)()
        elif action == "save" and self.header is not None:
            self.header.save()


def _turned(args: Message) -> tuple[str, object, int]:
    """Return key, value and sequence number of a turn, with values of the wrong type replaced."""
    seq = args.get("seq")
    value = args.get("value")
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        value = ""
    return str(args.get("key")), value, seq if isinstance(seq, int) else 0


def _link(args: Message) -> str:
    return str(args.get("link") or "")


def _number(args: Message) -> int:
    number = args.get("number")
    return number if isinstance(number, int) else -1


def _minute(args: Message) -> float:
    minute = args.get("minute")
    return float(minute) if isinstance(minute, (int, float)) and math.isfinite(minute) else 0.0
