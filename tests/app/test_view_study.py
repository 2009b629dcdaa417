"""Views that compute more follow the state that is shown, and the pinned one for its shadow."""

import asyncio

import pytest

from eclsim.app import studies
from eclsim.app.course import ShownBeat
from eclsim.app.knobs import turn
from eclsim.app.state import PageState, key_of
from eclsim.app.texts import text
from eclsim.app.updates import ViewStudy
from eclsim.cases.presets import PRESETS

STATE = PageState(PRESETS["paper"].case())
OTHER = STATE.with_case(turn(STATE.case, "ecmo.speed_rpm", 3000))


class StubSession:
    def __init__(self):
        self.view, self.closed, self.state, self.pinned, self.messages = "ramp", False, STATE, None, []

    def send(self, topic, data):
        self.messages.append((topic, data))


class StubEngine:
    async def study(self, work):
        await asyncio.sleep(0)
        return work()


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(studies, "ramp", key_of)


def messages_after(*steps) -> list:
    session = StubSession()

    async def run():
        follower = ViewStudy(StubEngine(), "ramp")  # type: ignore[arg-type]
        for step in steps:
            step(session)
            follower(session)  # type: ignore[arg-type]
            for _ in range(50):  # the follower's task goes on whenever this one waits
                await asyncio.sleep(0)

    asyncio.run(run())
    return session.messages


def test_the_pinned_state_is_computed_once_after_the_one_that_is_shown():
    pin = lambda s: setattr(s, "pinned", ShownBeat(STATE, None))  # noqa: E731
    turned = lambda s: setattr(s, "state", OTHER)  # noqa: E731
    assert messages_after(lambda _: None, turned, pin, pin) == [
        ("ramp", key_of(STATE)), ("ramp", key_of(OTHER)), ("ramp_pinned", key_of(STATE)),
    ]  # fmt: skip


def test_nothing_is_computed_for_a_view_that_is_not_seen():
    assert messages_after(lambda s: setattr(s, "view", "monitor")) == []


def test_what_fails_is_no_circuit_without_a_pump(monkeypatch):
    """A view without numbers says that a pump is missing: where the computation failed it must not."""

    def fails(_state):
        raise ArithmeticError

    monkeypatch.setattr(studies, "ramp", fails)
    assert messages_after(lambda _: None) == [("ramp", {"of": key_of(STATE), "failed": text("study_failed")})]
