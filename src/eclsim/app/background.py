"""Views that compute more than the beat: they follow it, the newest state first, while they are seen."""

from __future__ import annotations

import asyncio
import logging
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from eclsim.app.engine import Engine
    from eclsim.app.session import Session
    from eclsim.app.state import PageState

log = logging.getLogger("eclsim.app")


class Background:
    """Runs one study of `eclsim.app.studies` for the newest state of a session, while its view is open.

    Args:
        engine: where it is computed.
        view: name of the view, of the study, and of the topic it is sent under.
    """

    def __init__(self, engine: Engine, view: str):
        self.engine, self.view = engine, view
        self._done: PageState | None = None
        self._task: asyncio.Task[None] | None = None

    def __call__(self, session: Session) -> None:
        """The session has a new beat, or another view is open."""
        waiting = self._task is not None and not self._task.done()
        if session.view == self.view and session.state != self._done and not waiting:
            self._task = asyncio.get_running_loop().create_task(self._run(session))

    async def _run(self, session: Session) -> None:
        while session.view == self.view and session.state != self._done and not session.closed:
            state = session.state
            self._done = state
            found = await self._study(state)
            if not session.closed:
                session.send(self.view, found)

    async def _study(self, state: PageState) -> Any:
        def work() -> Any:
            from eclsim.app import studies

            return getattr(studies, self.view)(state)

        try:
            return await self.engine.study(work)
        except Exception:  # the view stays empty; the page goes on
            log.exception("%s failed", self.view)
            return None
