"""The server: NiceGUI within an application of eclsim, behind the guard."""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import Sequence
from dataclasses import dataclass

import uvicorn
from fastapi import FastAPI
from nicegui import Client, core, ui
from nicegui import app as nicegui_app
from uvicorn.protocols.http.h11_impl import H11Protocol

from eclsim.app.engine import Engine
from eclsim.app.guard import SIGN_OUT, App, Guard, Rules
from eclsim.app.listening import THIS_MACHINE
from eclsim.app.page import BedsidePage
from eclsim.app.sign_in import SignIns
from eclsim.app.state import PageState
from eclsim.app.texts import text

log = logging.getLogger("eclsim.app")
SLOWEST_HEADERS_S = 15.0
LARGEST_MESSAGE = 1_000_000
MOST_CONNECTIONS = 400
MOST_UNCONNECTED = 8
"""Largest number of requested pages without a connection; a further one replaces the oldest."""


@dataclass(frozen=True)
class Options:
    """Options of the server.

    Args:
        state: initial patient.
        root_path: path under which a proxy serves the page, such as "/eclsim".
        hosts: host names under which the page may be requested.
        password: password required before anything is shown; None for none.
        most_sessions: largest number of open tabs.
        proxies: addresses of reverse proxies, whose headers on the sender of a request are trusted.
    """

    state: PageState
    root_path: str = ""
    hosts: frozenset[str] = frozenset(THIS_MACHINE)
    password: str | None = None
    most_sessions: int = 40
    proxies: frozenset[str] = frozenset()


class TimeoutProtocol(H11Protocol):
    """Protocol that closes connections whose first request does not arrive in time."""

    def connection_made(self, transport: asyncio.Transport) -> None:
        """Start the timer."""
        super().connection_made(transport)
        self.loop.call_later(SLOWEST_HEADERS_S, self._close_if_silent, transport)

    def _close_if_silent(self, transport: asyncio.Transport) -> None:
        if transport.get_protocol() is self and self.cycle is None and not transport.is_closing():
            transport.close()


class OpenPages:
    """Pages open in a browser, and pages that were requested but have never connected.

    Only the former count as sessions, so that requests without a browser do not exclude anyone.

    Args:
        most: largest number of sessions.
    """

    def __init__(self, most: int):
        self.most = most
        self.shown: set[Client] = set()
        self.waiting: list[Client] = []

    @property
    def full(self) -> bool:
        """Whether no further session is possible."""
        return len(self.shown) >= self.most

    def add(self, client: Client, page: BedsidePage) -> None:
        """Keep a page until its browser disconnects, or until too many others wait that never connected."""

        def connected() -> None:
            if client in self.waiting:
                self.waiting.remove(client)
                self.shown.add(client)

        def disconnected() -> None:
            self.shown.discard(client)
            if client in self.waiting:
                self.waiting.remove(client)
            page.close()

        self.waiting.append(client)
        client.on_connect(connected)
        client.on_delete(disconnected)
        while len(self.waiting) > MOST_UNCONNECTED:
            self.waiting[0].delete()


def application(options: Options, engine: Engine) -> App:
    """Return the ASGI application behind its guard."""
    visitors = OpenPages(options.most_sessions)
    sign_out = options.root_path + SIGN_OUT if options.password is not None else ""

    @ui.page("/", title=text("title"))
    async def page() -> None:
        if visitors.full:
            ui.label(text("full", most=options.most_sessions)).props("role=alert")
            return
        visitors.add(ui.context.client, BedsidePage(engine, options.state, sign_out))

    nicegui_app.on_startup(lambda: engine.warm(options.state))
    nicegui_app.on_shutdown(engine.stop)
    outer = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    ui.run_with(
        outer, title=text("title"), tailwind=False, show_welcome_message=False, reconnect_timeout=30.0,
        message_history_length=60, binding_refresh_interval=None, language="en-US",
    )  # fmt: skip
    core.sio.eio.max_http_buffer_size = LARGEST_MESSAGE
    signed_in = SignIns(options.password) if options.password is not None else None
    rules = Rules(options.hosts, options.root_path, signed_in, options.proxies)
    return Guard(outer, rules)  # pyright: ignore[reportArgumentType]  # an ASGI application


def serve(options: Options, sockets: Sequence[socket.socket]) -> None:
    """Serve the page on listening sockets until stopped."""
    engine = Engine()
    config = uvicorn.Config(
        application(options, engine),  # pyright: ignore[reportArgumentType]  # likewise
        http=TimeoutProtocol, lifespan="on", log_level="warning", proxy_headers=False,
        access_log=False, ws_max_size=LARGEST_MESSAGE, timeout_graceful_shutdown=2, timeout_keep_alive=15,
        limit_concurrency=MOST_CONNECTIONS, server_header=False,
    )  # fmt: skip
    uvicorn.Server(config).run(sockets=list(sockets))
