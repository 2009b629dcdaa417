"""Views that compute more than the beat: they follow it, the newest state first, while they are seen.

The pinned state is computed likewise, after the one that is shown, for its grey shadow.
"""

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
        self._done: dict[str, PageState] = {}
        self._task: asyncio.Task[None] | None = None

    def __call__(self, session: Session) -> None:
        """The session has a new beat, another view is open, or a state is pinned."""
        waiting = self._task is not None and not self._task.done()
        if self._next(session) is not None and not waiting:
            self._task = asyncio.get_running_loop().create_task(self._run(session))

    async def _run(self, session: Session) -> None:
        while (job := self._next(session)) is not None:
            topic, state = job
            self._done[topic] = state
            found = await self._study(state)
            if not session.closed:
                session.send(topic, found)

    def _next(self, session: Session) -> tuple[str, PageState] | None:
        """Topic and state of what is still to be computed."""
        if session.view != self.view or session.closed:
            return None
        pinned = session.pinned[0] if session.pinned else None
        for topic, state in ((self.view, session.state), (f"{self.view}_pinned", pinned)):
            if state is not None and state != self._done.get(topic):
                return topic, state
        return None

    async def _study(self, state: PageState) -> Any:
        def work() -> Any:
            from eclsim.app import studies

            return getattr(studies, self.view)(state)

        try:
            return await self.engine.study(work)
        except Exception:  # the view stays empty; the page goes on
            log.exception("%s failed", self.view)
            return None
