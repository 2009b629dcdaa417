"""Load test of the bedside page: many sessions for minutes change knobs, play courses and lose connections.

    python benchmarks/page_soak.py                          # 20 sessions, 3 minutes
    python benchmarks/page_soak.py --sessions 8 --seconds 60

Of every four sessions one plays courses and adds events, and one repeatedly loses its connection and is
reloaded; all change knobs. Then all are closed, and the sessions left on the server are counted.
Needs Chromium on the PATH.
"""

from __future__ import annotations

import argparse
import gc
import json
import os
import signal
import statistics
import subprocess
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path
from typing import Any

from page_latency import launched, served
from playwright.sync_api import Browser, Page

LEFT_S = 45.0
"""Wait before counting [s]: the server keeps a page that lost its browser for half a minute."""
COUNTED = ("Session", "BedsidePage", "CourseStudy", "PosteriorBands", "PageCourse", "Client", "Beat")
TURN = """([rate]) => {
  const field = document.getElementById("knob-patient-heart_rate_bpm");
  if (!field || field.disabled) return;
  field.value = rate;
  field.dispatchEvent(new Event("change"));
}"""
WATCH = """([mine]) => {
  window.soak = { beats: 0, failed: 0, foreign: 0, courses: 0 };
  const first = eclsim.bus.last("beat").period;
  eclsim.bus.on("beat", ({ converged, period }) => {
    soak.beats += 1;
    soak.failed += !converged;
    soak.foreign += ![first, ...mine.map((rate) => 60 / rate)].some((p) => Math.abs(p - period) < 1e-4);
  });
  eclsim.bus.on("failed", () => (soak.failed += 1));
  eclsim.bus.on("course", () => (soak.courses += 1));
}"""
PLAY = """() => {
  const press = (which) => document.querySelector(`.ecl-timeline ${which}`)?.click();
  if (!document.querySelector(".ecl-timeline .play")) return press(".toggle");
  const count = document.querySelectorAll(".ecl-timeline ol li").length;
  press(count < 5 ? ".new button[type=submit]" : "ol li button:last-child");
  if (!document.querySelector(".ecl-timeline .play").disabled) press(".play");
}"""


class Visit:
    """One session and its results."""

    def __init__(self, browser: Browser, url: str, number: int):
        self.url, self.number = url, number
        self.plays, self.drops = number % 4 == 2, number % 4 == 3
        self.context = browser.new_context(reduced_motion="reduce", viewport={"width": 1280, "height": 800})
        self.page: Page = self.context.new_page()
        self.rates = [70 + 3 * number + k for k in range(3)]  # nobody else's
        self.problems: list[str] = []
        self.page.on("pageerror", lambda error: self.problems.append(str(error)))
        self.sums, self.times, self.turns = Counter[str](), list[float](), 0
        self.offline = False
        self.load()

    def load(self) -> None:
        """Open the page, or load it again, and watch it."""
        self.page.goto(self.url) if not self.turns else self.page.reload()
        self.page.wait_for_function("window.eclsim?.bus.last('beat')", timeout=120_000)
        self.page.evaluate(WATCH, [self.rates])

    def read(self) -> None:
        """Add what the page has counted, before it is loaded again or closed."""
        self.sums.update(self.page.evaluate("window.soak ?? {}"))
        self.times += self.page.evaluate("eclsim.latency.times")

    def act(self) -> None:
        """Run the actions of this second."""
        self.turns += 1
        if self.drops and self.turns % 20 in (8, 14):
            self.offline = self.turns % 20 == 8
            self.context.set_offline(self.offline)
        elif self.drops and self.turns % 60 == 0:
            self.read()
            self.load()
        if self.plays and self.turns % 5 == 0:
            self.page.evaluate(PLAY)
        self.page.evaluate(TURN, [self.rates[self.turns % len(self.rates)]])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--sessions", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=180.0, help="for so long [s]")
    parser.add_argument("--serve", type=int, metavar="PORT", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.serve:
        serve(options.serve)
        return
    with tempfile.TemporaryFile("w+") as log:
        pipes = {"stdout": subprocess.PIPE, "stderr": log}
        with served(__file__, "--serve", **pipes) as (url, server), launched() as browser:
            result = soak(browser, url, options, server)
        log.seek(0)
        lines = log.read().splitlines()
    result["log"] = {"lines": len(lines), "tracebacks": sum(line.startswith("Traceback") for line in lines)}
    print(json.dumps(result | {"log_end": lines[-5:]}, indent=1))


def soak(
    browser: Browser, url: str, options: argparse.Namespace, server: subprocess.Popen[str]
) -> dict[str, Any]:
    visits, memory = [Visit(browser, url, k) for k in range(options.sessions)], dict[int, float]()
    begun, rounds = time.monotonic(), 0
    while (passed := time.monotonic() - begun) < options.seconds:
        for visit in visits:
            visit.act()
        rounds += 1
        memory[round(passed)] = resident_mb(server.pid)
        visits[0].page.wait_for_timeout(max(0.0, 1000.0 * (begun + rounds - time.monotonic())))
    for visit in visits:
        visit.context.set_offline(False)
        visit.read()
    open_then = counted(server)
    for visit in visits:
        visit.context.close()
    time.sleep(LEFT_S)
    times, sums = sorted(time for visit in visits for time in visit.times), Counter[str]()
    for visit in visits:
        sums.update(visit.sums)
    return {
        "load": os.getloadavg()[0],
        "sessions": len(visits),
        "turns": sum(visit.turns for visit in visits),
        **sums,
        "page_errors": [problem for visit in visits for problem in visit.problems],
        "latency_ms": {"median": statistics.median(times), "p95": times[int(0.95 * len(times))]},
        "memory_mb": {
            "after_a_minute": next((mb for at, mb in memory.items() if at >= 60), None),
            "at_the_end": list(memory.values())[-1],
            "after_all_closed": resident_mb(server.pid),
        },
        "while_open": open_then,
        "after_all_closed": counted(server),
    }


def resident_mb(pid: int) -> float:
    (line,) = (o for o in Path(f"/proc/{pid}/status").read_text().splitlines() if o.startswith("VmRSS"))
    return round(int(line.split()[1]) / 1024, 1)


def counted(server: subprocess.Popen[str]) -> dict[str, int]:
    """Numbers of objects, tasks and threads of the server."""
    server.send_signal(signal.SIGUSR1)
    assert server.stdout is not None
    while not (line := server.stdout.readline()).startswith("{"):
        pass
    return json.loads(line)


def serve(port: int) -> None:
    """Run the server, which reports these numbers on a signal."""
    import asyncio

    from eclsim.app.server import Options
    from eclsim.app.server import serve as serve_page
    from eclsim.app.state import preset_state

    def count(*_: object) -> None:
        gc.collect()
        found = Counter(type(one).__name__ for one in gc.get_objects())
        held: dict[str, int] = {name: found[name] for name in COUNTED}
        tasks = {"tasks": len(asyncio.all_tasks(asyncio.get_running_loop()))}
        print(json.dumps(held | tasks | {"threads": threading.active_count()}), flush=True)

    async def ready() -> None:
        asyncio.get_running_loop().add_signal_handler(signal.SIGUSR1, count)

    from nicegui import app

    app.on_startup(ready)
    serve_page(Options(preset_state("healthy"), port=port, most_sessions=100))


if __name__ == "__main__":
    main()
