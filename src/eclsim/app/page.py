"""The page: header, knobs, schematic, views. Puts the parts in place and wires them to the session."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from nicegui import ui

from eclsim.app import parts
from eclsim.app.background import Background
from eclsim.app.dialogs import notify
from eclsim.app.header import Header
from eclsim.app.identify import Identification, fields
from eclsim.app.ranges import output_specs
from eclsim.app.session import Session
from eclsim.app.state import History, PageState, state_of
from eclsim.app.texts import ENGLISH, text
from eclsim.app.uncertain import Uncertain
from eclsim.patients.mistakes import CaseError

if TYPE_CHECKING:
    from eclsim.app.engine import Engine

STYLE = Path(__file__).parent / "web" / "page.css"
VIEWS = ("monitor", "loops", "ramp", "schemes", "outputs", "identify", "compare")


class BedsidePage:
    """One tab.

    Args:
        engine: computes beats.
        state: patient to start with.
    """

    def __init__(self, engine: Engine, state: PageState):
        self.engine = engine
        self.header: Header | None = None
        self.session = Session(engine, state, self._send)
        self.uncertain = Uncertain(engine, self.session)
        self.identification = Identification(self.session, self._send, engine.fits, self.uncertain)
        self._build()

    def close(self) -> None:
        """The tab is gone."""
        self.identification.cancel()
        self.session.close()

    def _send(self, topic: str, data: Any) -> None:
        if topic == "state" and self.header is not None:
            self.header.show(data)
        self.bridge.publish(topic, data)

    def _build(self) -> None:
        ui.add_css(STYLE)
        ui.link(text("skip"), "#knobs").classes("ecl-skip")
        with ui.element("div").classes("ecl-page"):
            with ui.element("header").classes("ecl-header"):
                ui.label(text("brand")).classes("ecl-brand")
                self.bridge = parts.Bridge(dict(ENGLISH))
                self.header = Header(self.session, self.bridge, self.identification)
            with ui.element("aside").classes("ecl-left"):
                self._knobs()
            with ui.element("section").classes("ecl-middle"):
                parts.Schematic().on("move", lambda e: self._move(e.args))
            with ui.element("main").classes("ecl-right"):
                parts.Keys()
                self._views()
            with ui.element("footer").classes("ecl-notice").props("role=note"):
                ui.label(text("notice"))
        self.bridge.on("hello", lambda e: self._hello(e.args))
        self.bridge.on("shortcut", lambda e: self._shortcut(e.args))

    def _knobs(self) -> None:
        knobs = parts.Knobs()
        knobs.on("turn", lambda e: self.session.turn(*_turned(e.args)))
        knobs.on("connect", lambda e: self.session.connect(str(e.args.get("device"))))
        knobs.on("policy", lambda e: self.session.set_policy(str(e.args.get("policy"))))

    def _views(self) -> None:
        self.tabs = ui.tabs().props("dense no-caps inline-label align=left outside-arrows")
        with self.tabs.classes("ecl-tabs").props(f'aria-label="{text("views")}"'):
            for name in VIEWS:
                ui.tab(name, label=text(name))
        self.tabs.on_value_change(lambda e: self.session.open_view(str(e.value)))
        parts.Bands().on("show", lambda e: self.uncertain.show(e.args.get("on") is True))
        panels = ui.tab_panels(self.tabs, value="monitor", animated=False, keep_alive=True)
        with panels.classes("ecl-views"):
            with ui.tab_panel("monitor"):
                parts.Monitor()
            with ui.tab_panel("loops"):
                parts.Loops()
            with ui.tab_panel("ramp"):
                parts.Ramp()
            with ui.tab_panel("schemes"):
                parts.Schemes().on("use", lambda e: self._use_scheme(e.args))
            with ui.tab_panel("outputs"):
                parts.Outputs(output_specs())
            with ui.tab_panel("identify"):
                self._identify()
            with ui.tab_panel("compare"):
                compare = parts.Compare(output_specs())
                compare.on("show", lambda e: self.session.show_saved(_number(e.args)))
                compare.on("remove", lambda e: self.session.remove_saved(_number(e.args)))
        for view in ("ramp", "schemes"):
            self.session.follow(Background(self.engine, view))
        self.session.follow(self.uncertain)

    def _identify(self) -> None:
        form = parts.Identify(fields())
        form.on("fill", self.identification.fill)
        form.on("check", lambda e: self.identification.check(_typed(e.args)))
        form.on("fit", lambda e: self.identification.start(_typed(e.args)))
        form.on("cancel", self.identification.cancel)
        form.on("posterior", self.identification.find_posterior)
        form.on("use", self._use_fit)

    def _use_fit(self) -> None:
        if self.identification.use():
            notify(text("fit_used"))

    def _hello(self, args: Any) -> None:
        """The browser is there; a link it was opened with wins over the first patient."""
        link = str(args.get("link") or "")
        if link:
            try:
                self.session.history = History(state_of(link))
            except CaseError as error:
                notify(error, "negative")
        self.session.start()

    def _move(self, args: Any) -> None:
        line = "access" if args.get("line") == "access" else "return"
        self.session.turn(f"crrt.{line}_site", str(args.get("site")))

    def _use_scheme(self, args: Any) -> None:
        self.session.use_scheme(str(args.get("access")), str(args.get("giving")))

    def _shortcut(self, args: Any) -> None:
        action = args.get("action")
        if action == "view":
            number = args.get("number")
            if isinstance(number, int) and 1 <= number <= len(VIEWS):
                self.tabs.set_value(VIEWS[number - 1])
        elif action in ("undo", "redo", "reset", "pin"):
            getattr(self.session, action)()
        elif action == "save" and self.header is not None:
            self.header.save()


def _turned(args: Any) -> tuple[str, Any, int]:
    """Key, value and number of a turn, as far as they can be trusted."""
    seq = args.get("seq")
    value = args.get("value")
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        value = ""
    return str(args.get("key")), value, seq if isinstance(seq, int) else 0


def _typed(args: Any) -> dict[str, Any]:
    return dict(args) if isinstance(args, dict) else {}


def _number(args: Any) -> int:
    number = args.get("number")
    return number if isinstance(number, int) else -1
