"""Speed of the bedside page: time until it is ready, and time from a knob to the repainted page.

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
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from playwright.sync_api import Browser, Page, sync_playwright

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
VIEWS = ("Monitor", "PV loops", "Outputs")
GASES = "Gases"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--turns", type=int, default=60, help="turns of the knob in each view")
    parser.add_argument("--gas", action="store_true", help="switch blood gases on first")
    options = parser.parse_args()
    started = time.perf_counter()
    command = ("-m", "eclsim", "app", "--port")
    with served(*command, stdout=subprocess.DEVNULL) as (url, _), launched() as browser:
        result = measure(browser, url, started, options)
    print(json.dumps(result, indent=1))


@contextmanager
def served(*command: str, **pipes: Any) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """Start a Python command that ends in a port as a server: its address, once it answers, and process."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    server = subprocess.Popen([sys.executable, *command, port], text=True, **pipes)
    try:
        url = f"http://127.0.0.1:{port}/"
        while not answers(url):
            if server.poll() is not None:
                sys.exit(f"the server ended with status {server.returncode}")
            time.sleep(0.05)
        yield url, server
    finally:
        server.terminate()
        server.wait(20)


def answers(url: str) -> bool:
    try:
        urllib.request.urlopen(url + "favicon.ico", timeout=1).close()
    except OSError:
        return False
    return True


@contextmanager
def launched() -> Iterator[Browser]:
    """The system's browser."""
    path = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if path is None:
        sys.exit(f"no browser: one of {', '.join(BROWSERS)} must be on the PATH")
    with sync_playwright() as player:
        arguments = ["--no-sandbox"] if os.geteuid() == 0 else []
        browser = player.chromium.launch(executable_path=path, args=arguments)
        yield browser
        browser.close()


def measure(browser: Browser, url: str, started: float, options: argparse.Namespace) -> dict[str, Any]:
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
    page.get_by_role("switch", name="Blood gases: switch on").click()
    page.wait_for_function("Object.keys(eclsim.bus.last('beat').gas?.places ?? {}).length", timeout=120_000)


def latency(page: Page, view: str, turns: int) -> dict[str, float]:
    """Time from the key that changes the pump speed to the frame after the repaint [ms]."""
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
