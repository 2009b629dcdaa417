"""The page: header, knobs, schematic, views. Puts the parts in place and wires them to the session."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from nicegui import ui

from eclsim.app.background import Background
from eclsim.app.parts import Bridge, Keys, Knobs, Loops, Monitor, Outputs, Ramp, Schematic, Schemes
from eclsim.app.ranges import output_specs
from eclsim.app.session import Session
from eclsim.app.state import PageState, state_of
from eclsim.app.texts import ENGLISH, text
from eclsim.patients.mistakes import CaseError
from eclsim.patients.presets import PRESETS

if TYPE_CHECKING:
    from nicegui.elements.button import Button

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
        self.bridge: Bridge
        self.buttons: dict[str, Button] = {}
        self.session = Session(engine, state, self._send)
        self._build()

    def _send(self, topic: str, data: Any) -> None:
        if topic == "state":
            self._show_buttons(data)
        self.bridge.publish(topic, data)

    def _build(self) -> None:
        ui.add_css(STYLE)
        ui.link(text("skip"), "#knobs").classes("ecl-skip")
        with ui.element("div").classes("ecl-page"):
            with ui.element("header").classes("ecl-header"):
                self._header()
            with ui.element("aside").classes("ecl-left"):
                knobs = Knobs()
                knobs.on("turn", lambda e: self.session.turn(*_turned(e.args)))
                knobs.on("connect", lambda e: self.session.connect(str(e.args.get("device"))))
                knobs.on("policy", lambda e: self.session.set_policy(str(e.args.get("policy"))))
            with ui.element("section").classes("ecl-middle"):
                Schematic().on("move", lambda e: self._move(e.args))
            with ui.element("main").classes("ecl-right"):
                Keys()
                self._views()
            with ui.element("footer").classes("ecl-notice").props("role=note"):
                ui.label(text("notice"))

    def _header(self) -> None:
        ui.label(text("brand")).classes("ecl-brand")
        self.bridge = Bridge(dict(ENGLISH))
        self.bridge.on("hello", lambda e: self._hello(e.args))
        self.bridge.on("shortcut", lambda e: self._shortcut(e.args))
        options = {key: preset.name for key, preset in PRESETS.items()}
        self.patient = ui.select(
            options, label=text("patient"), value=None, on_change=lambda e: self._preset(e.value)
        )
        self.patient.props("dense outlined options-dense").classes("ecl-patient")
        self.patient_words = ui.label().classes("ecl-patient-words")
        ui.element("div").classes("ecl-space")
        for name, icon, action in (
            ("undo", "undo", self.session.undo), ("redo", "redo", self.session.redo),
            ("reset", "restart_alt", self.session.reset), ("pin", "push_pin", self.session.pin),
            ("save", "bookmark_add", self._save), ("link", "link", self._link),
        ):  # fmt: skip
            button = ui.button(icon=icon, on_click=action).props(f'flat dense aria-label="{text(name)}"')
            button.tooltip(text(f"{name}_hint"))
            self.buttons[name] = button

    def _views(self) -> None:
        with (
            ui.tabs()
            .props("dense no-caps inline-label align=left outside-arrows")
            .classes("ecl-tabs") as self.tabs
        ):
            for name in VIEWS:
                ui.tab(name, label=text(name))
        self.tabs.props(f'aria-label="{text("views")}"')
        self.tabs.on_value_change(lambda e: self.session.open_view(str(e.value)))
        panels = ui.tab_panels(self.tabs, value="monitor", animated=False, keep_alive=True)
        with panels.classes("ecl-views"):
            with ui.tab_panel("monitor"):
                Monitor()
            with ui.tab_panel("loops"):
                Loops()
            with ui.tab_panel("ramp"):
                Ramp()
            with ui.tab_panel("schemes"):
                Schemes().on("use", lambda e: self._use_scheme(e.args))
            with ui.tab_panel("outputs"):
                Outputs(output_specs())
        self.session.follow(Background(self.engine, "ramp"))
        self.session.follow(Background(self.engine, "schemes"))

    def _hello(self, args: Any) -> None:
        """The browser is there; a link it was opened with wins over the first patient."""
        link = str(args.get("link") or "")
        if link:
            try:
                self.session.history.now = self.session.history.start = state_of(link)
            except CaseError as error:
                ui.notify(str(error), type="negative", multi_line=True)
        self.session.start()

    def _move(self, args: Any) -> None:
        line = "access" if args.get("line") == "access" else "return"
        self.session.turn(f"crrt.{line}_site", str(args.get("site")))

    def _use_scheme(self, args: Any) -> None:
        self.session.use_scheme(str(args.get("access")), str(args.get("giving")))

    def _preset(self, key: Any) -> None:
        if key in PRESETS and key != self.session.state.origin:
            self.session.load(PageState(PRESETS[key].case(), self.session.state.policy, key))

    def _shortcut(self, args: Any) -> None:
        action = args.get("action")
        if action == "view":
            number = args.get("number")
            if isinstance(number, int) and 1 <= number <= len(VIEWS):
                self.tabs.set_value(VIEWS[number - 1])
        elif action in ("undo", "redo", "reset", "pin"):
            getattr(self.session, action)()
        elif action == "save":
            self._save()

    def _save(self) -> None:
        case = self.session.state.case
        saved = self.session.save(f"{len(self.session.saved) + 1}: {case.patient.id}")
        if saved:
            ui.notify(text("state_saved"), type="positive")

    async def _link(self) -> None:
        from eclsim.app.state import link_of

        found = await self.bridge.run_method("copyLink", link_of(self.session.state), timeout=5)
        if found and found.get("copied"):
            ui.notify(text("link_copied"), type="positive")
        elif found:
            with ui.dialog(value=True), ui.card():
                ui.label(text("link_shown"))
                ui.textarea(value=found["url"]).props("readonly outlined").classes("ecl-link")

    def _show_buttons(self, data: Any) -> None:
        for name, on in (("undo", data["undo"]), ("redo", data["redo"]), ("reset", data["changed"])):
            self.buttons[name].set_enabled(on)
        self.buttons["pin"].props(f"aria-pressed={str(data['pinned']).lower()}")
        self.buttons["pin"].props("color=accent" if data["pinned"] else "color=primary")
        self.patient.set_value(data["origin"] if data["origin"] in PRESETS else None)
        self.patient_words.set_text("" if data["origin"] in PRESETS else data["name"])


def _turned(args: Any) -> tuple[str, Any, int]:
    """Key, value and number of a turn, as far as they can be trusted."""
    seq = args.get("seq")
    value = args.get("value")
    if not isinstance(value, (int, float, str)):
        value = ""
    return str(args.get("key")), value, seq if isinstance(seq, int) else 0
