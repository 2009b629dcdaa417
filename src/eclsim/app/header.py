"""The header: brand, status, patient, and everything that is done with the whole state."""

from __future__ import annotations

import logging
from functools import partial
from typing import TYPE_CHECKING, Any

from nicegui import ui

from eclsim.app.dialogs import OpenDialog, labelled, notify, show_help
from eclsim.app.exports import KINDS, ExportError, export
from eclsim.app.state import MOST_SAVED, PageState, link_of, preset_state
from eclsim.app.texts import ENGLISH, text
from eclsim.cases.presets import PRESETS

if TYPE_CHECKING:
    from nicegui.elements.button import Button

    from eclsim.app.identify import Identification
    from eclsim.app.parts import Bridge
    from eclsim.app.session import Session
    from eclsim.cases.case import Case

log = logging.getLogger("eclsim.app")


class Header:
    """Buttons and the choice of the patient.

    Args:
        session: what they act on.
        bridge: the line to the browser, made here so that the status stands beside the brand.
        identification: takes a posterior that is opened.
    """

    def __init__(self, session: Session, bridge: Bridge, identification: Identification):
        self.session, self.bridge = session, bridge
        self.buttons: dict[str, Button] = {}
        self.opening = OpenDialog(session.engine, self._use, identification.use_members)
        options = {key: preset.name for key, preset in PRESETS.items()}
        self.patient = ui.select(options, label=text("patient"), on_change=lambda e: self._preset(e.value))
        self.patient.props("dense outlined options-dense").classes("ecl-patient")
        self._button("open", "folder_open", self.opening.open)
        ui.element("div").classes("ecl-space")
        self._button("undo", "undo", session.undo)
        self._button("redo", "redo", session.redo)
        self._button("reset", "restart_alt", session.reset)
        self._button("pin", "push_pin", session.pin)
        self._button("save", "bookmark_add", self.save)
        self._button("link", "link", self._link)
        with self._button("export", "download", lambda: None), labelled(ui.menu(), text("export")):
            for kind in KINDS:
                item = ui.menu_item(text(f"export_{kind}"), on_click=partial(self._export, kind))
                item.props("role=menuitem")
        self._button("help", "help_outline", show_help)

    def _button(self, name: str, icon: str, action: Any) -> Button:
        button = ui.button(icon=icon, on_click=action).props(f'flat dense aria-label="{text(name)}"')
        with button:
            ui.tooltip(text(f"{name}_hint") if f"{name}_hint" in ENGLISH else text(name))
        self.buttons[name] = button
        return button

    def show(self, data: Any) -> None:
        """Which buttons do something now, and who the patient is."""
        for name, on in (("undo", data["undo"]), ("redo", data["redo"]), ("reset", data["changed"])):
            if self.buttons[name].enabled != on:
                self.buttons[name].set_enabled(on)
        pinned = str(data["pinned"]).lower()
        colour = "accent" if data["pinned"] else "primary"
        self.buttons["pin"].props(f"aria-pressed={pinned} color={colour}")
        known = data["origin"] in PRESETS and not data["changed"]
        self.patient.set_value(data["origin"] if known else None)

    def save(self) -> None:
        """Keep the state for the comparison."""
        saved = self.session.save()
        words = text("state_saved") if saved else text("states_full", most=MOST_SAVED)
        notify(words, "positive" if saved else "warning")

    def _preset(self, key: Any) -> None:
        if key in PRESETS and preset_state(key) != self.session.state:
            self.session.load(preset_state(key), opened=True)

    def _use(self, name: str, case: Case) -> None:
        self.session.load(PageState(case, case.volume_policy, origin="file", source=name), opened=True)

    async def _link(self) -> None:
        found = await self.bridge.run_method("copyLink", link_of(self.session.state), timeout=5)
        if found and found.get("copied"):
            notify(text("link_copied"))
        elif found:
            with labelled(ui.dialog(value=True), text("link")), ui.card().classes("ecl-dialog"):
                ui.label(text("link_shown"))
                area = ui.textarea(value=found["url"])
                area.props(f'readonly outlined aria-label="{text("link")}"').classes("ecl-link")

    async def _export(self, kind: str) -> None:
        state = self.session.state
        notify(text("exporting"), "info")
        try:
            name, content = await self.session.engine.study(lambda: export(state, kind))
        except ExportError as error:
            notify(text("export_failed", reason=error), "negative")
        except Exception:  # the page goes on; what failed is in the log
            log.exception("an export failed")
            notify(text("export_failed", reason=text("unknown")), "negative")
        else:
            ui.download.content(content, name)
