"""Which minute of a course is shown: that of the cursor, and none that is not known."""

import asyncio
from types import SimpleNamespace

import numpy as np

from eclsim.app.course import PageCourse
from eclsim.app.state import preset_state
from eclsim.app.texts import text
from eclsim.app.updates import CourseStudy

STATE = preset_state("healthy")


class StubSession:
    def __init__(self):
        self.state, self.closed, self.minutes, self.sent, self.minute = STATE, False, 0, [], 0.0

    def at_minute(self, minute):
        self.minute = minute
        self.sent.append(("knobs of", minute))

    def show_start(self):
        self.sent.append(("start", 0.0))

    def send(self, topic, data):
        self.sent.append((topic, data))

    def show_moment(self, state, beat, minute):
        self.sent.append((beat, minute))


class StubEngine:
    def __init__(self, takes_s=0.0):
        self.takes_s = takes_s

    async def moment(self, work):
        await asyncio.sleep(self.takes_s)
        return work()


def followed(*times):
    """A course with these moments, whose beats are called by their minute."""
    result = {"time_min": np.array(times)}
    return SimpleNamespace(result=result, at=None)


def shown(course, *minutes, takes_s=0.0):
    session = StubSession()

    async def run():
        study = CourseStudy(StubEngine(takes_s), session)  # type: ignore[arg-type]
        study.course = course
        for minute in minutes:
            study.show(minute)
            await asyncio.sleep(0.01)
        await asyncio.sleep(2.0 * takes_s)

    asyncio.run(run())
    return session.sent


def test_behind_the_end_of_a_course_that_stopped_nothing_is_shown(monkeypatch):
    monkeypatch.setattr(PageCourse, "beat", lambda self, minute: f"beat of {minute:g}")
    course = PageCourse(STATE, followed(0.0, 30.0, 108.10949217))  # type: ignore[arg-type]
    assert course.end == 108.1095
    assert shown(course, 30.0, 288.0) == [
        ("knobs of", 30.0), ("beat of 30", 30.0), ("knobs of", 108.1095), ("beat of 108.109", 108.1095),
    ]  # fmt: skip


def test_a_course_that_did_not_begin_shows_the_start():
    course = PageCourse(STATE, followed())  # type: ignore[arg-type]
    assert shown(course, 12.0) == [("knobs of", 0.0), ("start", 0.0)]


def test_a_moment_that_is_ready_after_the_return_to_the_start_is_not_shown(monkeypatch):
    """The page showed it, with its alarms, beside a cursor at 00:00 and knobs of 00:00."""
    monkeypatch.setattr(PageCourse, "beat", lambda self, minute: f"beat of {minute:g}")
    course = PageCourse(STATE, followed(0.0, 30.0))  # type: ignore[arg-type]
    assert shown(course, 12.0, 0.0, takes_s=0.05) == [("knobs of", 12.0), ("knobs of", 0.0), ("start", 0.0)]


def test_a_moment_that_fails_is_said(monkeypatch):
    monkeypatch.setattr(PageCourse, "beat", lambda *_: 1 / 0)
    course = PageCourse(STATE, followed(0.0, 30.0))  # type: ignore[arg-type]
    assert shown(course, 12.0)[-1] == ("failed", text("moment_failed", time="00:12"))
