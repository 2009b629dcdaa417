"""The server: NiceGUI in a FastAPI application of our own, behind the guard."""

from __future__ import annotations

import logging
from dataclasses import dataclass

import uvicorn
from fastapi import FastAPI
from nicegui import app as nicegui_app
from nicegui import ui

from eclsim.app.engine import Engine
from eclsim.app.page import BedsidePage
from eclsim.app.state import PageState
from eclsim.app.texts import text

log = logging.getLogger("eclsim.app")


@dataclass(frozen=True)
class Options:
    """How the page is served.

    Args:
        state: patient to start with.
        host: address to listen on.
        port: port to listen on.
        root_path: path under which a proxy serves the page, such as "/eclsim".
    """

    state: PageState
    host: str = "127.0.0.1"
    port: int = 8080
    root_path: str = ""


def application(options: Options, engine: Engine) -> FastAPI:
    """The ASGI application."""

    @ui.page("/", title=text("title"))
    async def page() -> None:
        page = BedsidePage(engine, options.state)
        ui.context.client.on_delete(page.session.close)

    nicegui_app.on_startup(lambda: engine.warm(options.state))
    nicegui_app.on_shutdown(engine.stop)
    outer = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    ui.run_with(
        outer, title=text("title"), tailwind=False, show_welcome_message=False, reconnect_timeout=10.0,
        message_history_length=100, binding_refresh_interval=None, language="en-US",
    )  # fmt: skip
    return outer


def serve(options: Options) -> None:
    """Serve until stopped."""
    engine = Engine()
    served = application(options, engine)
    config = uvicorn.Config(
        served, host=options.host, port=options.port, root_path=options.root_path, log_level="warning",
        access_log=False, ws_max_size=2_000_000, timeout_graceful_shutdown=2,
    )  # fmt: skip
    uvicorn.Server(config).run()
