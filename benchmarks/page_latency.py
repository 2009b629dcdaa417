"""How fast the bedside page is: ready after start, and from knob to repaint.

    python benchmarks/page_latency.py                      # page ready, latency of each view
    python benchmarks/page_latency.py --gas                # the same with blood gases

Needs Chromium on the PATH. The compilation cache should be warm: run it twice.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import socket
import subprocess
import sys
import time
import urllib.request
from typing import Any

from playwright.sync_api import Browser, Page, Playwright, sync_playwright

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
VIEWS = ("Monitor", "PV loops", "Outputs")
GASES = "Gases"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--turns", type=int, default=60, help="turns of the knob in each view")
    parser.add_argument("--gas", action="store_true", help="switch blood gases on first")
    options = parser.parse_args()
    port = free_port()
    started = time.perf_counter()
    command = [sys.executable, "-m", "eclsim.cli", "app", "--port", str(port)]
    server = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    try:
        with sync_playwright() as player:
            browser = launched(player)
            result = measure(browser, f"http://127.0.0.1:{port}/", started, options)
            browser.close()
    finally:
        server.terminate()
        server.wait(10)
    print(json.dumps(result, indent=1))


def free_port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


def launched(player: Playwright) -> Browser:
    """The system's browser."""
    path = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if path is None:
        sys.exit(f"no browser: one of {', '.join(BROWSERS)} must be on the PATH")
    return player.chromium.launch(executable_path=path, args=["--no-sandbox"] if os.geteuid() == 0 else [])


def wait_for_answer(url: str) -> None:
    while True:
        try:
            urllib.request.urlopen(url + "favicon.ico", timeout=1).close()
            return
        except OSError:
            time.sleep(0.05)


def measure(browser: Browser, url: str, started: float, options: argparse.Namespace) -> dict[str, Any]:
    wait_for_answer(url)
    result: dict[str, Any] = {
        "load": os.getloadavg()[0],
        "answers_after_s": round(time.perf_counter() - started, 2),
    }
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    foreign: list[str] = []
    page.on("request", lambda r: None if r.url.startswith((url, "data:", "blob:")) else foreign.append(r.url))
    page.goto(url)
    page.wait_for_function("window.eclsim?.bus.last('beat')")
    result["page_ready_after_s"] = round(time.perf_counter() - started, 2)
    page.wait_for_timeout(8000)
    page.get_by_label("Patient").first.click()
    page.get_by_text("V-A ECMO + CRRT").click()
    page.wait_for_function("eclsim.bus.last('beat').waves.Pcrrttuin")
    if options.gas:
        switch_gases_on(page)
    page.wait_for_timeout(3000)
    result["latency_ms"] = {
        view: latency(page, view, options.turns) for view in (*VIEWS, *([GASES] if options.gas else []))
    }
    result["external_requests"] = foreign
    return result


def switch_gases_on(page: Page) -> None:
    page.get_by_role("switch", name="Connect Blood gases").click()
    page.wait_for_function("Object.keys(eclsim.bus.last('beat').gas?.places ?? {}).length", timeout=120_000)


def latency(page: Page, view: str, turns: int) -> dict[str, float]:
    """From the key that turns the pump's speed to the frame after the repaint [ms]."""
    page.get_by_role("tab", name=view).click()
    page.wait_for_timeout(1500)
    page.evaluate("eclsim.latency.times.length = 0")
    page.locator('input[type=range][aria-label="Pump speed"]').focus()
    for turn in range(turns):
        page.keyboard.press("ArrowRight" if turn % 40 < 20 else "ArrowLeft")
        page.wait_for_timeout(250)
    page.wait_for_timeout(500)
    found = sorted(page.evaluate("eclsim.latency.times"))
    pick = lambda share: round(found[min(int(share * len(found)), len(found) - 1)], 1)  # noqa: E731
    return {"count": len(found), "median": pick(0.5), "p95": pick(0.95), "largest": pick(1.0)}


if __name__ == "__main__":
    main()
