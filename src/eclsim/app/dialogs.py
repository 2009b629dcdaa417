"""Dialogs: opening a file, help, what was refused. All texts are shown as text, never as HTML."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

from nicegui import events, ui

from eclsim.app.opening import LARGEST_FILE, SIZE, Opened, brief, shown_name, with_speeds
from eclsim.app.texts import text
from eclsim.app.uploads import file_apart, posterior_apart
from eclsim.inputs.mistakes import CaseError

if TYPE_CHECKING:
    from eclsim.app.engine import Engine
    from eclsim.app.members import Members
    from eclsim.cases.case import Case


def notify(words: object, kind: str = "positive") -> None:
    """A short note at the top; a bad one, above the notice at the bottom, until it is closed."""
    stays = kind == "negative"
    ui.notify(
        str(words), type=kind, position="bottom" if stays else "top", multi_line=len(str(words)) > 80,  # pyright: ignore[reportArgumentType]  # one of its kinds
        timeout=0 if stays else 5000, close_button=text("close") if stays else False,
    )  # fmt: skip


Labelled = TypeVar("Labelled", bound=ui.element)
Use = Callable[[str, "Case"], None]
_CHOOSE_FILE = """
<div class="ecl-file">
  <button type="button" @click="props.pickFiles($event)">{label}</button>
  <label class="ecl-hidden">{label}<q-uploader-add-trigger></q-uploader-add-trigger></label>
</div>
"""
"""Head of the upload: Quasar's own has neither a label for its file input nor a button with a name."""


def labelled(element: Labelled, words: str) -> Labelled:
    """A dialog or menu with a name for screen readers."""
    element.props(f'aria-label="{words}"')
    return element


class OpenDialog:
    """Choose a file; of a cohort, choose a row.

    Args:
        engine: reads files beside the event loop.
        use: takes the name of the file and the case.
        use_members: takes the name of the file and the members of a posterior.
    """

    def __init__(self, engine: Engine, use: Use, use_members: Callable[[str, Members], None]):
        self.engine, self.use, self.use_members = engine, use, use_members
        self.opened: Opened | None = None
        with labelled(ui.dialog(), text("open_title")) as self.dialog, ui.card().classes("ecl-dialog"):
            ui.label(text("open_title")).classes("ecl-dialog-title")
            ui.label(text("open_text", size=SIZE))
            upload = ui.upload(
                label=text("open_drop"), auto_upload=True, max_file_size=LARGEST_FILE, max_files=1,
                on_upload=self._read, on_rejected=self._rejected,
            )  # fmt: skip
            self.upload = upload.props('accept=".toml,.csv,.nc" flat bordered').classes("ecl-upload")
            self.upload.add_slot("header", _CHOOSE_FILE.replace("{label}", text("open_drop")))
            self.said = ui.column().classes("ecl-said")
            self.rows = ui.select({}, label=text("open_rows")).props("dense outlined").classes("ecl-rows")
            with ui.row().classes("ecl-dialog-actions"):
                self.take = ui.button(text("open_use"), on_click=self._use).props("no-caps unelevated")
                ui.button(text("close"), on_click=self.dialog.close).props("no-caps flat")
        self._show(None, [])

    def open(self) -> None:
        """Show it, empty."""
        self.upload.reset()
        self._show(None, [])
        self.dialog.open()

    async def _read(self, event: events.UploadEventArguments) -> None:
        name, content = event.file.name, await event.file.read()
        try:
            if name.lower().endswith(".nc"):
                members = await self.engine.read(lambda: posterior_apart(name, content))
                self.use_members(shown_name(name), members)
                notify(text("posterior_opened"))
                self.dialog.close()
                return
            parsed = await self.engine.read(lambda: file_apart(name, content))
            opened = await self.engine.study(lambda: with_speeds(parsed))
        except CaseError as error:
            self._show(None, [text("refused"), *brief([str(m) for m in error.mistakes])])
            return
        said = [text("warnings"), *brief(opened.said)] if opened.said else []
        self._show(opened, said)
        if len(opened.cases) == 1 and not said:
            self._use()

    def _rejected(self) -> None:
        self._show(None, [text("refused"), text("rejected", size=SIZE)])

    def _show(self, opened: Opened | None, said: list[str]) -> None:
        self.opened = opened
        self.said.clear()
        with self.said:
            for line in said:
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
        self.use(text("open_source", file=self.opened.name, row=name) if many else self.opened.name, case)
        notify(text("opened", name=name))
        self.dialog.close()


def show_help() -> None:
    """How the page is used."""
    with labelled(ui.dialog(value=True), text("help")), ui.card().classes("ecl-dialog"):
        ui.label(text("help")).classes("ecl-dialog-title")
        ui.label(text("help_text"))
        ui.label(text("help_model"))
        ui.label(text("notice")).classes("ecl-strong")
