"""The header: patient, buttons and dialogs. All text is shown as text, never as HTML."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

from nicegui import events, ui

from eclsim.app.files import (
    KINDS,
    LARGEST_CASE_TEXT,
    LARGEST_FILE,
    LARGEST_FILE_TEXT,
    MOST_ROWS,
    ExportError,
    OpenedFile,
    export,
    read_file,
    read_posterior_file,
    shortened,
    shown_name,
    with_speeds,
)
from eclsim.app.provenance import opened_state
from eclsim.app.state import LONGEST_NAME, MOST_SAVED, link_of, preset_state
from eclsim.app.texts import ENGLISH, in_page_words, text
from eclsim.cases.presets import PRESETS
from eclsim.inputs.mistakes import CaseError

if TYPE_CHECKING:
    from nicegui.elements.button import Button

    from eclsim.app.engine import Engine
    from eclsim.app.identify import Identification
    from eclsim.app.page import Bridge
    from eclsim.app.posterior import PosteriorDraws
    from eclsim.app.session import Session
    from eclsim.cases.case import Case
    from eclsim.cases.fit_mark import FitMark


def notify(message: object, kind: str = "positive") -> None:
    """Show a short message at the top; an error is shown at the bottom until it is closed."""
    stays = kind == "negative"
    ui.notify(
        str(message), type=kind, position="bottom" if stays else "top", multi_line=len(str(message)) > 80,  # pyright: ignore[reportArgumentType]  # one of its kinds
        timeout=0 if stays else 5000, close_button=text("close") if stays else False,
    )  # fmt: skip


Labelled = TypeVar("Labelled", bound=ui.element)
Use = Callable[[str, "Case", "FitMark | None"], None]
_CHOOSE_FILE = """
<div class="ecl-file">
  <button type="button" @click="props.pickFiles($event)">{label}</button>
  <label class="ecl-hidden">{label}<q-uploader-add-trigger></q-uploader-add-trigger></label>
</div>
"""
"""Header of the upload: Quasar's own has no label for its file input and no button with a name."""


_ARROWS = """(event) => {
  const items = [...event.currentTarget.querySelectorAll('[role=menuitem]')];
  const now = items.indexOf(document.activeElement);
  const next = { ArrowDown: now + 1, ArrowUp: now < 0 ? -1 : now - 1, Home: 0, End: -1 }[event.key];
  if (next === undefined) return;
  event.preventDefault();
  items.at(next % items.length).focus();
}"""
"""Arrow-key navigation of a menu, also for screen readers: Quasar's menus support only Tab."""


def labelled(element: Labelled, label: str) -> Labelled:
    """Give a dialog or menu a name for screen readers."""
    element.props(f'aria-label="{label}"')
    return element


class OpenDialog:
    """Dialog to choose a file, and a row if the file is a cohort.

    Args:
        engine: reads files off the event loop.
        use: called with the file's name, the case and the file's verdict on its fit.
        use_members: called with the file's name and the draws of a posterior.
    """

    def __init__(self, engine: Engine, use: Use, use_members: Callable[[str, PosteriorDraws], None]):
        self.engine, self.use, self.use_members = engine, use, use_members
        self.opened: OpenedFile | None = None
        with labelled(ui.dialog(), text("open_title")) as self.dialog, ui.card().classes("ecl-dialog"):
            ui.label(text("open_title")).classes("ecl-dialog-title")
            ui.label(text("open_text", case=LARGEST_CASE_TEXT, rows=MOST_ROWS, size=LARGEST_FILE_TEXT))
            rejected = text("rejected", size=LARGEST_FILE_TEXT)
            upload = ui.upload(
                label=text("open_drop"), auto_upload=True, max_file_size=LARGEST_FILE, max_files=1,
                on_upload=self._read, on_rejected=lambda: self._show(None, [text("refused"), rejected]),
            )  # fmt: skip
            self.upload = upload.props('accept=".toml,.csv,.nc" flat bordered').classes("ecl-upload")
            self.upload.add_slot("header", _CHOOSE_FILE.replace("{label}", text("open_drop")))
            self.messages = ui.column().classes("ecl-messages")
            self.rows = ui.select({}, label=text("open_rows")).props("dense outlined").classes("ecl-rows")
            with ui.row().classes("ecl-dialog-actions"):
                self.take = ui.button(text("open_use"), on_click=self._use).props("no-caps unelevated")
                ui.button(text("close"), on_click=self.dialog.close).props("no-caps flat")
        self._show(None, [])

    def open(self) -> None:
        """Show the empty dialog."""
        self.upload.reset()
        self._show(None, [])
        self.dialog.open()

    def close(self) -> None:
        """Drop the callbacks on closing: FastAPI keeps upload routes, which would keep the session alive."""
        self.use = self.use_members = lambda *_: None

    async def _read(self, event: events.UploadEventArguments) -> None:
        name, content = event.file.name, await event.file.read()
        self._show(None, [text("open_reading", name=shown_name(name))])
        try:
            if name.lower().endswith(".nc"):
                members = await self.engine.read(lambda: read_posterior_file(name, content))
                self.use_members(shown_name(name), members)
                notify(text("posterior_opened"))
                self.dialog.close()
                return
            parsed = await self.engine.read(lambda: read_file(name, content))
            opened = await self.engine.study(lambda: with_speeds(parsed))
        except CaseError as error:
            self._show(None, [text("refused"), *shortened([str(m) for m in error.mistakes])])
            return
        finally:
            self.upload.reset()  # otherwise a second file would be one too many
        remarks = [text("warnings"), *shortened(opened.remarks)] if opened.remarks else []
        self._show(opened, remarks)
        if len(opened.cases) == 1 and not remarks:
            self._use()

    def _show(self, opened: OpenedFile | None, messages: list[str]) -> None:
        self.opened = opened
        self.messages.clear()
        with self.messages:
            for line in messages:
                ui.label(line)
        many = opened is not None and len(opened.cases) > 1
        self.rows.set_visibility(many)
        if opened is not None and many:
            names = {k: name for k, (name, _) in enumerate(opened.cases)}
            self.rows.set_options(names, value=0)
        self.take.set_enabled(opened is not None)

    def _use(self) -> None:
        if self.opened is None:
            return
        chosen = self.rows.value if len(self.opened.cases) > 1 else 0
        name, case = self.opened.cases[chosen if isinstance(chosen, int) else 0]
        many = len(self.opened.cases) > 1
        source = text("open_source", file=self.opened.name, row=name) if many else self.opened.name
        self.use(source[:LONGEST_NAME], case, self.opened.fit)
        notify(text("opened", name=name))
        self.dialog.close()


def show_help() -> None:
    """Show the help dialog."""
    with labelled(ui.dialog(value=True), text("help")), ui.card().classes("ecl-dialog"):
        ui.label(text("help")).classes("ecl-dialog-title")
        ui.label(text("help_text"))
        ui.label(text("help_model"))
        ui.label(text("notice")).classes("ecl-strong")


log = logging.getLogger("eclsim.app")


class Header:
    """Buttons and the choice of the patient.

    Args:
        session: session on which the buttons act.
        bridge: connection to the browser, created here so that the status is shown beside the brand.
        identification: receives an opened posterior.
        sign_out: address that ends the session of the browser; empty if no password is required.
    """

    def __init__(self, session: Session, bridge: Bridge, identification: Identification, sign_out: str = ""):
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
        with self._button("export", "download", lambda: None), labelled(ui.menu(), text("export")) as menu:
            menu.on("keydown", js_handler=_ARROWS)
            for kind in KINDS:
                item = ui.menu_item(text(f"export_{kind}"), on_click=partial(self._export, kind))
                item.props("role=menuitem")
        self._button("help", "help_outline", show_help)
        if sign_out:
            self._button("sign_out", "logout", lambda: bridge.run_method("signOut", sign_out))

    def _button(self, name: str, icon: str, action: Callable[[], object]) -> Button:
        button = ui.button(icon=icon, on_click=action).props(f'flat dense aria-label="{text(name)}"')
        with button:
            ui.tooltip(text(f"{name}_hint") if f"{name}_hint" in ENGLISH else text(name))
        self.buttons[name] = button
        return button

    def show(self, data: Mapping[str, Any]) -> None:
        """Update which buttons are enabled, and the selected patient."""
        for name, on in (("undo", data["undo"]), ("redo", data["redo"]), ("reset", data["changed"])):
            if self.buttons[name].enabled != on:
                self.buttons[name].set_enabled(on)
        pinned = str(data["pinned"]).lower()
        colour = "accent" if data["pinned"] else "primary"
        self.buttons["pin"].props(f"aria-pressed={pinned} color={colour}")
        known = data["origin"] in PRESETS and not data["changed"]
        self.patient.set_value(data["origin"] if known else None)

    def save(self) -> None:
        """Store the state for the comparison."""
        saved = self.session.save()
        message = text("state_saved") if saved else text("states_full", most=MOST_SAVED)
        notify(message, "positive" if saved else "warning")

    def _preset(self, key: object) -> None:
        if isinstance(key, str) and key in PRESETS and preset_state(key) != self.session.state:
            self.session.load(preset_state(key), opened=True)

    def _use(self, name: str, case: Case, fit: FitMark | None) -> None:
        self.session.load(opened_state(case, name, fit), opened=True)

    async def _link(self) -> None:
        result = await self.bridge.run_method("copyLink", link_of(self.session.state), timeout=5)
        if result and result.get("copied"):
            notify(text("link_copied"))
        elif result:
            with labelled(ui.dialog(value=True), text("link")), ui.card().classes("ecl-dialog"):
                ui.label(text("link_shown"))
                area = ui.textarea(value=result["url"])
                area.props(f'readonly outlined aria-label="{text("link")}"').classes("ecl-link")

    async def _export(self, kind: str) -> None:
        state, minutes, beat = self.session.state, self.session.minutes, self.session.own_beat
        of_start = self.session.minute > 0.0 and kind not in ("case", "course")
        notify(text("exporting_start" if of_start else "exporting"), "info")
        try:
            name, content = await self.session.engine.study(lambda: export(state, kind, minutes, beat))
        except ExportError as error:
            notify(text("export_failed", reason=in_page_words(str(error))), "negative")
        except Exception:  # the page continues; the error is in the log
            log.exception("an export failed")
            notify(text("export_failed", reason=text("unknown")), "negative")
        else:
            ui.download.content(content, name)
