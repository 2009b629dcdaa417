"""What tests of the page in a browser do again and again.

The page answers when it can: nothing here or in these tests reads it once and takes that for the answer.
`expect` (playwright's) and `eventually` read again until what is asked holds, and fail after `PATIENCE_S`.
"""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import pytest

from eclsim.app.texts import text
from patience import PATIENCE_S, eventually
from system_browser import LAPTOP, PHONE, TABLET

__all__ = ["LAPTOP", "PHONE", "TABLET", "eventually"]
expect = pytest.importorskip("playwright.sync_api", reason="tests in a browser need playwright").expect
expect.set_options(timeout=1000 * PATIENCE_S)


def beat(page) -> dict[str, Any]:
    return page.evaluate("eclsim.bus.last('beat')")


def wait_for(page, condition: str) -> None:
    """Wait until a condition on `beat` holds; after a restart there is none at first."""
    there = "const beat = eclsim.bus.last('beat'); return beat !== undefined"
    page.wait_for_function(f"(() => {{ {there} && ({condition}); }})()")


def beat_with(page, key: str, value: float | str) -> dict[str, Any]:
    """The beat of the state whose knob stands there, once it is drawn."""
    wait_for(page, f"beat.values[{json.dumps(key)}] === {json.dumps(value)}")
    return beat(page)


def show(page, view: str) -> None:
    tab = page.get_by_role("tab", name=text(view), exact=True)
    tab.click()
    expect(tab).to_have_attribute("aria-selected", "true")


def picture(page, shots: Path | None, name: str) -> None:
    if shots is not None:
        page.wait_for_timeout(700)
        page.screenshot(path=shots / f"{name}.png")


def knob(page, key: str) -> Any:
    """The field of a knob, or its list."""
    return page.locator("#knob-" + key.replace(".", "-"))


def turn(page, key: str, value: str) -> None:
    """Type a value beside a knob."""
    field = knob(page, key)
    field.fill(value)
    field.press("Enter")


def box_at_rest(locator) -> dict[str, float]:
    """Where something is, once it does not move any more."""

    def stays() -> dict[str, float]:
        before = locator.bounding_box()
        time.sleep(0.15)
        assert before is not None
        assert locator.bounding_box() == before
        return before

    return eventually(stays)


def choose(page, preset: str) -> None:
    """Open a preset by its name."""
    page.get_by_label("Patient").first.click()
    page.get_by_role("option", name=preset, exact=True).click()


def open_file(page, path) -> None:
    """Open a case, a cohort or a posterior."""
    page.get_by_role("button", name=text("open")).click()
    page.locator(".ecl-upload input[type=file]").set_input_files(path)
