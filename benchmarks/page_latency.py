"""How fast the bedside page is: ready after start, knob to repaint, and many sessions turning knobs.

    python benchmarks/page_latency.py                      # page ready, latency of each view
    python benchmarks/page_latency.py --gas                # the same with blood gases
    python benchmarks/page_latency.py --sessions 20 --seconds 120

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
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

from playwright.sync_api import Browser, Page, sync_playwright

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
VIEWS = ("Monitor", "PV loops", "Outputs")
GASES = "Gases"
# Turns one knob of a session again and again, and watches that every beat is one of its own.
SOAK = """([mine, pause]) => {
  const own = (period) => mine.some((rate) => Math.abs(period - 60 / rate) < 1e-4);
  const found = (window.soak = { beats: 0, foreign: 0, errors: 0 });
  eclsim.bus.on("beat", (beat) => {
    if (!window.soak.started) return;
    found.beats += 1;
    if (!own(beat.period)) found.foreign += 1;
    if (!beat.converged) found.errors += 1;
  });
  eclsim.bus.on("failed", () => (found.errors += 1));
  const field = document.getElementById("knob-patient-heart_rate_bpm");
  let k = 0;
  window.soak.timer = setInterval(() => {
    field.value = mine[k++ % mine.length];
    field.dispatchEvent(new Event("change"));
    if (k === 6) window.soak.started = true;
  }, pause);
}"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--turns", type=int, default=60, help="turns of the knob in each view")
    parser.add_argument("--gas", action="store_true", help="switch blood gases on first")
    parser.add_argument("--sessions", type=int, default=0, help="pages that turn knobs side by side")
    parser.add_argument("--seconds", type=float, default=120.0, help="for so long [s]")
    parser.add_argument("--pause", type=int, default=500, help="between turns of one session [ms]")
    options = parser.parse_args()
    browser_path = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if browser_path is None:
        sys.exit(f"no browser: one of {', '.join(BROWSERS)} must be on the PATH")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    started = time.perf_counter()
    command = [sys.executable, "-m", "eclsim.cli", "app", "--port", str(port), "--max-sessions", "100"]
    server = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    try:
        with sync_playwright() as player:
            arguments = ["--no-sandbox"] if os.geteuid() == 0 else []
            browser = player.chromium.launch(executable_path=browser_path, args=arguments)
            result = measure(browser, f"http://127.0.0.1:{port}/", started, options, server.pid)
            browser.close()
    finally:
        server.terminate()
        server.wait(10)
    print(json.dumps(result, indent=1))


def measure(
    browser: Browser, url: str, started: float, options: argparse.Namespace, pid: int
) -> dict[str, Any]:
    while not _answers(url):
        time.sleep(0.05)
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
    if options.sessions:
        page.close()
        result["sessions"] = soak(browser, url, options, pid)
    else:
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


def soak(browser: Browser, url: str, options: argparse.Namespace, pid: int) -> dict[str, Any]:
    """Sessions that turn knobs; the server's memory after a minute and at the end [MB]."""
    context = browser.new_context(reduced_motion="reduce", viewport={"width": 1280, "height": 800})
    pages = [context.new_page() for _ in range(options.sessions)]
    problems: list[str] = []
    for k, page in enumerate(pages):
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.goto(url)
        page.wait_for_function("window.eclsim?.bus.last('beat')", timeout=60_000)
        if options.gas:
            switch_gases_on(page)
        page.evaluate(SOAK, [[70 + 3 * k, 71 + 3 * k, 72 + 3 * k], options.pause])
    memory, begun = [], time.monotonic()
    while time.monotonic() - begun < options.seconds:
        pages[0].wait_for_timeout(5000)
        memory.append((round(time.monotonic() - begun), _resident_mb(pid)))
    lost = {"beats": 0, "foreign": 0, "errors": 1}  # the page was loaded again: its connection was lost
    found = [page.evaluate("window.soak ? {...window.soak, timer: 0} : null") or lost for page in pages]
    context.close()
    minute = next((m for at, m in memory if at >= 60), memory[-1][1])
    return {
        "sessions": len(found),
        "beats": sum(f["beats"] for f in found),
        "fewest_beats": min(f["beats"] for f in found),
        "beats_of_another_session": sum(f["foreign"] for f in found),
        "errors": sum(f["errors"] for f in found) + len(problems),
        "memory_after_a_minute_mb": minute,
        "memory_at_the_end_mb": memory[-1][1],
        "memory_samples": len(memory),
        "growth_percent": round(100 * (memory[-1][1] / minute - 1), 1),
    }


def _answers(url: str) -> bool:
    try:
        with urllib.request.urlopen(url + "favicon.ico", timeout=1):
            return True
    except (OSError, urllib.error.URLError):
        return False


def _resident_mb(pid: int) -> float:
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return round(int(line.split()[1]) / 1024, 1)
    return float("nan")


if __name__ == "__main__":
    main()
