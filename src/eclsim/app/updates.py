"""Computations after each beat while their view is open: studies, courses, and bands of a posterior."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Coroutine
from functools import partial
from typing import TYPE_CHECKING, Any
from weakref import WeakValueDictionary

from eclsim.app.course import BEATS, LENGTHS, compute_course, plain_course
from eclsim.app.state import key_of
from eclsim.app.texts import in_page_words, text
from eclsim.course.alarms import clock_time
from eclsim.inputs.mistakes import CaseError

if TYPE_CHECKING:
    from eclsim.app.beat import Beat
    from eclsim.app.course import PageCourse
    from eclsim.app.engine import Engine
    from eclsim.app.posterior import PosteriorDraws
    from eclsim.app.session import Session
    from eclsim.app.state import PageState


log = logging.getLogger("eclsim.app")
PAUSE_S = 0.3
"""Time without a turned knob after which bands are computed [s], so that no beat has to wait for them."""
STILL_S = 1.0
"""Time without a new beat after which a second steady beat is sought [s]: no knob waits for that search."""
MOST_POSTERIORS = 6
BANDS = {"ramp": "ramp_bands"} | dict.fromkeys(("monitor", "loops", "gases", "outputs"), "bands")
"""Views that show bands, with the topic under which the bands are sent."""


class _OneAtATime:
    """Works off jobs in a single task; while it runs, no other is started."""

    _task: asyncio.Task[None] | None = None

    def _start(self, wanted: object, run: Callable[[], Coroutine[Any, Any, None]]) -> None:
        if wanted is not None and (self._task is None or self._task.done()):
            self._task = asyncio.get_running_loop().create_task(run())


class ViewStudy(_OneAtATime):
    """Runs one study of `eclsim.app.studies` for the newest state of a session, while its view is open.

    Args:
        engine: runs the study.
        view: name of the view, of the study, and of the topic under which the result is sent.
    """

    def __init__(self, engine: Engine, view: str):
        self.engine, self.view = engine, view
        self._done: dict[str, PageState] = {}

    def __call__(self, session: Session) -> None:
        """React to a new beat of the session, another open view, or a pinned state."""
        self._start(self._next(session), lambda: self._run(session))

    async def _run(self, session: Session) -> None:
        while (job := self._next(session)) is not None:
            topic, state = job
            self._done[topic] = state
            study = await _study(self.engine, state, self.view, partial(_compute, self.view, state))
            if not session.closed:
                session.send(topic, study)

    def _next(self, session: Session) -> tuple[str, PageState] | None:
        """Return topic and state of the next study to compute; None if there is none."""
        if session.view != self.view or session.closed:
            return None
        kept = session.pinned
        pinned = kept.state if kept is not None and not kept.moment.minute else None
        for topic, state in ((self.view, session.state), (f"{self.view}_pinned", pinned)):
            if state is not None and state != self._done.get(topic):
                return topic, state
        return None


def _compute(study: str, *inputs: Any) -> Any:
    from eclsim.app import studies

    return getattr(studies, study)(*inputs)


async def _study(engine: Engine, state: PageState, name: str, work: Callable[[], Any]) -> Any:
    """Run a study; if it fails, return data with which the view reports it, so that the page continues."""
    try:
        return await engine.study(work)
    except Exception:
        log.exception("%s failed", name)
        return {"of": key_of(state), "failed": text("study_failed")}


class CourseStudy(_OneAtATime):
    """Computes the course of a session's newest state while its timeline is open, and beats of this course.

    Args:
        engine: computes courses and beats.
        session: session whose states are followed.
    """

    def __init__(self, engine: Engine, session: Session):
        self.engine, self.session = engine, session
        self.minutes = 0
        self.course: PageCourse | None = None
        self._done: tuple[PageState, int] | None = None
        self._minute: float | None = None
        self._moment: asyncio.Task[None] | None = None

    def open(self, minutes: int) -> None:
        """Set the length of the open timeline [min]; 0 if it is closed."""
        self.minutes = minutes if minutes in LENGTHS else 0
        self.session.minutes = self.minutes
        if not self.minutes:
            self.course = self._done = None
            self.session.record(False)
            self.show(0.0)
        self()

    def __call__(self, _: Session | None = None) -> None:
        """React to a new beat of the session."""
        self._start(self._next_job(), self._run)

    def show(self, minute: float) -> None:
        """Show the beat of a minute (0: of the state); of several waiting minutes, only the last is shown.

        After the end of a course that stopped early, its last beat is shown.
        """
        if self.course is not None:
            minute = min(minute, self.course.end)
        self.session.at_minute(max(minute, 0.0))
        self._minute = minute
        if minute <= 0.0:
            self._minute = None
            self.session.show_start()
        elif self._moment is None or self._moment.done():
            self._moment = asyncio.get_running_loop().create_task(self._show())

    def _next_job(self) -> tuple[PageState, int] | None:
        job = self.session.state, self.minutes
        return job if self.minutes and not self.session.closed and job != self._done else None

    async def _run(self) -> None:
        while job := self._next_job():
            self._done, self.course = job, None
            state, minutes = job
            self.session.send("course_busy", key_of(state))
            try:
                course = await self.engine.study(lambda s=state, m=minutes: compute_course(s, m))
            except CaseError as error:
                self.session.send("course", {"of": key_of(state), "refused": in_page_words(str(error))})
                continue
            except Exception:  # there is no course; the page continues
                log.exception("a course failed")
                self.session.send("course", {"of": key_of(state), "refused": text("course_failed")})
                continue
            if job == (self.session.state, self.minutes) and not self.session.closed:
                self.course = course
                self.session.send("course", plain_course(course, minutes, self.session.own_beat))

    async def _show(self) -> None:
        while (minute := self._minute) is not None and (course := self.course) is not None:
            self._minute = None
            minute = min(minute, course.end)
            try:
                beat = await self.engine.moment(lambda c=course, m=minute: c.beat(m))
            except Exception:  # the page continues with the displayed minute, and reports it
                log.exception("a moment failed")
                time = clock_time(minute, self.minutes in BEATS)
                self.session.send("failed", text("moment_failed", time=time))
                continue
            if course is self.course and self.session.minute > 0.0:  # not back at the start meanwhile
                self.session.show_moment(course.state, beat, minute)


class SecondBeats(_OneAtATime):
    """Seeks second steady beats of what is shown, pinned or saved, once the knobs have been still.

    Args:
        engine: runs the search, which takes about a second where veins collapse.
    """

    def __init__(self, engine: Engine):
        self.engine = engine
        self._examined: WeakValueDictionary[int, Beat] = WeakValueDictionary()

    def __call__(self, session: Session) -> None:
        """React to a new beat, or to one that was pinned or saved."""
        self._start(self._next(session), lambda: self._run(session))

    def _next(self, session: Session) -> Beat | None:
        """Return the next beat to examine, that of the page first; None while a newer one is computed."""
        if session.closed or session.shown is None or session.shown[0] != session.state:
            return None
        kept = (session.seen, session.pinned, *session.saved)
        beats = (one.beat for one in kept if one is not None)
        return next((beat for beat in beats if self._examined.get(id(beat)) is not beat), None)

    async def _run(self, session: Session) -> None:
        while (beat := self._next(session)) is not None:
            await asyncio.sleep(STILL_S)
            if self._next(session) is not beat:
                continue
            state = session.state
            more = await self._search(beat, lambda s=state: not session.closed and session.state == s)
            if more is not None:
                session.replace_beat(beat, more)

    async def _search(self, beat: Beat, wanted: Callable[[], bool]) -> Beat | None:
        """Return the beat with its caution; one whose search was given up is examined again later."""
        from eclsim.app.beat import with_second_beat

        try:
            more = await self.engine.study(partial(with_second_beat, beat, wanted))
        except Exception:  # the page continues without the caution; the error is in the log
            log.exception("the search for a second beat failed")
            more = None
        for known in (beat, more):
            if known is not None and (more is not None or wanted()):
                self._examined[id(known)] = known
        return more


class PosteriorBands(_OneAtATime):
    """Sends bands for the beats of a session whose patient has a posterior.

    Args:
        engine: computes the bands.
        session: session whose beats are followed.
    """

    def __init__(self, engine: Engine, session: Session):
        self.engine, self.session = engine, session
        self.on = True
        self._posteriors: dict[str, PosteriorDraws] = {}
        self._keys = 0
        self._done: dict[str, tuple[Any, PosteriorDraws]] = {}
        self._sent_members: PosteriorDraws | None = None

    def new_key(self) -> str:
        """Return a new key by which a state refers to its posterior, which may be added later."""
        self._keys += 1
        return str(self._keys)

    def add(self, key: str, members: PosteriorDraws) -> None:
        """Add a posterior that was computed or read."""
        self._posteriors[key] = members
        for old in list(self._posteriors)[:-MOST_POSTERIORS]:
            del self._posteriors[old]
        self()

    def members(self, key: str) -> PosteriorDraws | None:
        """Return the posterior with this key; None if there is none."""
        return self._posteriors.get(key)

    def show(self, on: bool) -> None:
        """Show or hide bands."""
        self.on = on
        self._done.clear()
        for topic in set(BANDS.values()):
            self.session.send(topic, None)
        self()

    def __call__(self, _: Session | None = None) -> None:
        """React to a new beat, another view or another posterior of the session."""
        members = self._members()
        if members is not self._sent_members:
            self._sent_members = members
            self.session.send("posterior", members.as_object() if members else None)
        self._start(self._job(), self._run)

    def _members(self) -> PosteriorDraws | None:
        shown = self.session.shown
        return self.members(shown[0].posterior) if shown else None

    def _job(self) -> tuple[tuple[PageState, Beat], PosteriorDraws, str] | None:
        """Return beat, posterior and topic if the displayed beat still lacks its bands; else None."""
        shown, members, topic = self.session.shown, self._members(), BANDS.get(self.session.view)
        if shown is None or members is None or topic is None or not self.on or self.session.closed:
            return None
        done = self._done.get(topic)
        if not shown[1].converged or (done and done[0] is shown and done[1] is members):
            return None
        return shown, members, topic

    async def _run(self) -> None:
        while self._job() is not None:
            before = self.session.shown
            await asyncio.sleep(PAUSE_S)
            job = self._job()
            if job is None or job[0] is not before:
                continue
            shown, members, topic = job
            if not self._is_newest(shown):
                return  # the beat being computed calls again
            self._done[topic] = shown, members
            compute = "ramp_bands" if topic == "ramp_bands" else "beat_bands"
            work = partial(_compute, compute, shown[0], members, partial(self._is_newest, shown))
            bands = await _study(self.engine, shown[0], "bands", work)
            if self.on and self._is_newest(shown):
                self.session.send(topic, bands or {"of": key_of(shown[0])})

    def _is_newest(self, shown: tuple[PageState, Beat]) -> bool:
        """Whether a beat is still displayed and no knob has been turned since."""
        one = self.session
        return not one.closed and one.shown is shown and one.state == shown[0]
