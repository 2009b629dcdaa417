"""The page in a browser: skipped with a reason where there is none."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
import urllib.parse
import urllib.request
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from eclsim.app.state import PageState, link_of
from eclsim.cases.presets import PRESETS
from system_browser import LAPTOP, system_browser

SAVES_DATA = "Object.defineProperty(navigator, 'connection', { value: { saveData: true } })"
"""Pages then load the library of the charts only when one is shown: a second of a processor for each page."""
START_SECONDS = 180
"""Patience with a server that starts beside other tests on a small machine."""
PROGRAM = (
    "-c",
    "import eclsim.app.engine as engine; from eclsim.cli import main; engine._warm_states = list; main()",
)
"""`eclsim`, which compiles in advance the first circuit alone: all of them, and what fits need, take
more than a minute of a processor. That they come in turn has a test of its own (`test_beat`)."""
pytest.importorskip("nicegui", reason="the page needs the extra `app`")


@dataclass(frozen=True)
class Served:
    """A page that is being served."""

    url: str
    process: subprocess.Popen[bytes]


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def serve(*options: str, program: Sequence[str] = PROGRAM, port: int | None = None) -> Served:
    port = port or free_port()
    command = [sys.executable, *program, "app", *options, "--port", str(port)]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    url = f"http://127.0.0.1:{port}"
    until = time.monotonic() + START_SECONDS
    while time.monotonic() < until:
        try:
            urllib.request.urlopen(url + "/favicon.ico", timeout=2).close()
            return Served(url, process)
        except urllib.error.HTTPError:
            return Served(url, process)
        except OSError:
            if process.poll() is not None:
                pytest.fail(f"the server ended: {process.stderr.read().decode()[-2000:]}")  # type: ignore[union-attr]
            time.sleep(0.1)
    process.kill()
    pytest.fail(f"the server did not answer within {START_SECONDS} s")


def stop(served: Served) -> None:
    served.process.terminate()
    served.process.wait(20)
    served.process.stderr.close()  # type: ignore[union-attr]


class Restartable:
    """A server that tests stop and kill, and start again at the same address."""

    def __init__(self, start: Callable[..., Served], *options: str):
        self.start, self.options = start, options
        self.served = start(*options)

    @property
    def url(self) -> str:
        return self.served.url

    @property
    def process(self) -> subprocess.Popen[bytes]:
        return self.served.process

    def kill(self) -> None:
        self.process.kill()
        self.process.wait(60)

    def start_again(self) -> None:
        self.served = self.start(*self.options, port=urllib.parse.urlsplit(self.url).port)

    def be_there(self) -> None:
        """For the next test, whatever the last one did to it."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGCONT)
        else:
            self.start_again()


def _starting() -> Iterator[Callable[..., Served]]:
    """Starts servers for single tests, and stops them at the end."""
    started: list[Served] = []

    def start(*options: str, program: Sequence[str] = PROGRAM, port: int | None = None) -> Served:
        started.append(serve(*options, program=program, port=port))
        return started[-1]

    yield start
    for one in started:
        stop(one)


serving = pytest.fixture(_starting, name="serving")
serving_throughout = pytest.fixture(_starting, scope="module", name="serving_throughout")


@pytest.fixture(scope="module")
def own_server(serving_throughout) -> Restartable:
    return Restartable(serving_throughout)


@pytest.fixture(scope="module")
def with_password(serving_throughout, tmp_path_factory) -> Restartable:
    secret = tmp_path_factory.mktemp("secret") / "password.txt"
    secret.write_text("correct horse battery\n")
    secret.chmod(0o600)
    return Restartable(serving_throughout, "--password-file", str(secret))


@pytest.fixture(scope="session")
def served() -> Iterator[Served]:
    one = serve()
    yield one
    stop(one)


@pytest.fixture(scope="module")  # while it is open an event loop runs, and other tests start one of their own
def browser() -> Iterator[object]:
    yield from system_browser()


@pytest.fixture(scope="module")
def contexts(browser) -> Iterator[Callable[..., Any]]:
    """Windows by their options, kept: scripts that one page has loaded are there for the next."""
    kept: dict[str, Any] = {}

    def context(**options: Any) -> Any:
        if repr(options) not in kept:
            kept[repr(options)] = browser.new_context(
                reduced_motion="reduce", accept_downloads=True, **options
            )
            kept[repr(options)].add_init_script(SAVES_DATA)
        return kept[repr(options)]

    yield context
    for one in kept.values():
        one.close()


@pytest.fixture
def open_page(contexts, served) -> Iterator[Callable[..., Any]]:
    """Opens pages and fails if one asked for anything elsewhere or had an error."""
    pages, foreign, errors = [], [], []

    def start(
        preset: str = "paper", viewport: dict[str, int] = LAPTOP, url: str | None = None, **options: Any
    ):
        page = contexts(viewport=viewport, **options).new_page()
        pages.append(page)
        own = (served.url, "data:", "blob:")
        page.on("request", lambda r: None if r.url.startswith(own) else foreign.append(r.url))
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.set_default_timeout(150_000)
        page.goto(url or f"{served.url}/#{link_of(PageState(PRESETS[preset].case(), origin=preset))}")
        page.wait_for_function("window.eclsim?.bus.last('beat')")
        return page

    yield start
    for page in pages:
        page.close()
    assert foreign == []
    assert errors == []


@pytest.fixture(scope="session")
def shots() -> Path | None:
    """Where screenshots go, if somebody wants to look at them (ECLSIM_SCREENSHOTS)."""
    target = os.environ.get("ECLSIM_SCREENSHOTS")
    if not target:
        return None
    folder = Path(target)
    folder.mkdir(parents=True, exist_ok=True)
    return folder
