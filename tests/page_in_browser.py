"""What tests of the page in a browser do again and again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from eclsim.app.texts import text

LAPTOP, TABLET = {"width": 1280, "height": 800}, {"width": 820, "height": 1180}


def beat(page) -> dict[str, Any]:
    return page.evaluate("eclsim.bus.last('beat')")


def wait_for(page, condition: str) -> None:
    page.wait_for_function(f"(() => {{ const beat = eclsim.bus.last('beat'); return {condition}; }})()")


def show(page, view: str) -> None:
    page.get_by_role("tab", name=text(view), exact=True).click()


def picture(page, shots: Path | None, name: str) -> None:
    if shots is not None:
        page.wait_for_timeout(700)
        page.screenshot(path=shots / f"{name}.png")


def turn(page, key: str, value: str) -> None:
    """Type a value beside a knob."""
    field = page.locator("#knob-" + key.replace(".", "-"))
    field.fill(value)
    field.press("Enter")


def choose(page, preset: str) -> None:
    """Open a preset by its name."""
    page.get_by_label("Patient").first.click()
    page.get_by_role("option", name=preset, exact=True).click()


def open_file(page, path) -> None:
    """Open a case, a cohort or a posterior."""
    page.get_by_role("button", name=text("open")).click()
    page.locator(".ecl-upload input[type=file]").set_input_files(path)
