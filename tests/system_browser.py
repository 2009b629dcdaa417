"""The system's browser, for tests that look at pages; they are skipped with a reason where there is none."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from typing import Any

import pytest

LAPTOP, TABLET = {"width": 1280, "height": 800}, {"width": 820, "height": 1180}
PHONE = {"width": 390, "height": 844}
BROWSERS = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome", "chrome")
"""The first draws pages as the second does, without a window around them, for two thirds of its time."""


def system_browser() -> Iterator[Any]:
    """To be yielded from by a fixture of a module: while it is open an event loop runs in this thread."""
    api = pytest.importorskip("playwright.sync_api", reason="tests in a browser need playwright")
    path = next((result for name in BROWSERS if (result := shutil.which(name))), None)
    if path is None:
        pytest.skip(f"no browser: none of {', '.join(BROWSERS)} is on the PATH")
    with api.sync_playwright() as player:
        arguments = ["--no-sandbox"] if os.geteuid() == 0 else []
        result = player.chromium.launch(executable_path=path, args=arguments)
        yield result
        result.close()
