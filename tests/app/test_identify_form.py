"""The form of measurements, and a fit that can be cancelled and never runs twice."""

import asyncio
import threading
import time
from dataclasses import replace

import pytest

from eclsim.app import identify
from eclsim.app.fitting import FitError
from eclsim.app.identify import Identification, checked_form, fields, values_of
from eclsim.app.state import PageState
from eclsim.app.uncertain import Uncertain
from eclsim.patients.presets import PRESETS

CASE = PRESETS["paper"].case()
MEASURED = {"SP": "83", "DP": "76", "MAP": "80", "MPAP": "11", "CO": "1.4", "PF": "3.5"}


def form(**changes: object) -> dict[str, object]:
    typed = values_of(CASE) | {f"measurements.{k}": v for k, v in MEASURED.items()}
    return typed | {k.replace("__", "."): v for k, v in changes.items()}


def test_the_form_has_a_value_for_every_field():
    assert {f["key"] for f in fields()} == set(values_of(CASE))


def test_a_good_form_is_a_case_with_the_devices_of_the_page():
    checked = checked_form(CASE, form())
    assert not checked.mistakes
    assert checked.values["measurements"]["SP"] == 83
    assert checked.values["ecmo"]["speed_rpm"] == 3425


@pytest.mark.parametrize(
    ("changes", "key", "said"),
    [
        ({"measurements__SP": "70"}, "measurements.SP", "below diastolic"),
        ({"measurements__SP": "83,5"}, "measurements.SP", "decimal comma"),
        ({"measurements__SP": "120/80"}, "measurements.SP", "two pressures"),
        ({"measurements__CO": "3400"}, "measurements.CO", "mL/min"),
        ({"measurements__MAP": "15 cmH2O"}, "measurements.MAP", "mmHg"),
        ({"measurements__MAP": "300"}, "measurements.MAP", "range"),
        ({"patient__heart_rate_bpm": "1.2"}, "patient.heart_rate_bpm", "range"),
        ({"patient__heart_rate_bpm": ""}, "patient.heart_rate_bpm", "missing"),
        ({"patient__age_years": "70 y"}, "patient.age_years", ""),
        ({"patient__age_years": "3"}, "patient.age_years", "range"),
        ({"patient__id": ""}, "patient.id", ""),
        ({"measurements__SP": "1e400"}, "measurements.SP", "too large"),
        ({"measurements__SP": ["a"], "patient__sex": "other"}, "patient.sex", ""),
    ],
)
def test_bad_values_are_said_at_their_field(changes, key, said):
    mistakes = checked_form(CASE, form(**changes)).mistakes
    assert any(m.key == key and said in str(m) for m in mistakes), [str(m) for m in mistakes]


def test_doubts_do_not_stop_a_fit():
    checked = checked_form(CASE, form(patient__id="Meier, Hans"))
    assert not checked.mistakes
    assert any(m.key == "patient.id" for m in checked.warnings)


def test_missing_values_are_left_out_and_an_empty_form_is_refused():
    some = checked_form(CASE, form(measurements__PCWP="n/a", measurements__CO=""))
    assert "PCWP" not in some.values["measurements"]
    none = checked_form(CASE, {k: v for k, v in form().items() if not k.startswith("measurements")})
    assert any("nothing to fit" in str(m) for m in none.mistakes)


class StubSession:
    def __init__(self):
        self.state = PageState(CASE)
        self.beat = None
        self.loaded = []
        self.shown = None
        self.closed = False
        self.view = "identify"

    def load(self, state):
        self.loaded.append(state)

    def send(self, topic, data):
        pass


class StubFitter:
    """A fit that goes on until it may end."""

    def __init__(self):
        self.may_end, self.running, self.answer = threading.Event(), [], {"usable": True}

    def prepare(self):
        pass

    def fit(self, case, policy, said, stop):
        self.running.append(case)
        self.may_end.wait(5)
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer | {"case": case}

    def posterior(self, case, policy, said, stop):
        self.running.append(case)
        said("draws")
        self.may_end.wait(5)
        return {"names": ["Rmc"], "members": [[0.8], [1.0]], "method": "importance", "doubts": [], "draws": 2}


@pytest.fixture
def slow() -> StubFitter:
    return StubFitter()


def told_by(fitter, action) -> list:
    told: list = []
    tell = lambda topic, data: told.append((topic, data))  # noqa: E731
    session = StubSession()
    uncertain = Uncertain(None, session)  # type: ignore[arg-type]
    asyncio.run(action(Identification(session, tell, fitter, uncertain), told))  # type: ignore[arg-type]
    return told


def test_a_double_press_is_one_fit_and_it_can_be_used(slow):
    async def action(one, told):
        first = asyncio.create_task(one.start(form()))
        await asyncio.sleep(0.05)
        await one.start(form())
        slow.may_end.set()
        await first
        assert one.use()
        assert one.session.loaded[0].origin == "fit"

    told = told_by(slow, action)
    assert len(slow.running) == 1
    assert [t for t, _ in told].count("fit_ended") == 1
    assert any(t == "fit_progress" for t, _ in told)


def test_the_posterior_belongs_to_the_fitted_patient(slow):
    slow.may_end.set()

    async def action(one, told):
        await one.find_posterior()
        assert slow.running == []  # nothing is fitted yet
        typed = form()
        await one.start(typed)
        one.fitted = replace(one.fitted, case=one.fitted.case.model_copy(update={"parameters": {"Rmc": 0.9}}))
        await one.find_posterior()
        assert one.use()
        key = one.session.loaded[0].posterior
        assert one.uncertain.members(key).base == {"Rmc": 0.9}

    topics = told_by(slow, action)
    assert topics[-1][0] == "posterior_ended"
    assert topics[-1][1]["posterior"]["trusted"]


def test_a_posterior_can_be_cancelled(slow):
    async def action(one, told):
        slow.may_end.set()
        await one.start(form())
        slow.may_end.clear()
        search = asyncio.create_task(one.find_posterior())
        await asyncio.sleep(0.05)
        one.cancel()
        await search
        assert not one.running
        slow.may_end.set()

    assert told_by(slow, action)[-1] == ("posterior_ended", {"message": identify.text("fit_cancelled")})


def test_cancel_frees_the_page_at_once(slow):
    async def action(one, told):
        fit = asyncio.create_task(one.start(form()))
        await asyncio.sleep(0.05)
        began = time.monotonic()
        one.cancel()
        await fit
        assert time.monotonic() - began < 1.0
        assert not one.running
        assert not one.use()
        slow.may_end.set()

    told = told_by(slow, action)
    assert told[-1] == ("fit_ended", {"message": identify.text("fit_cancelled")})


def test_a_fit_that_fails_says_why_and_leaves_the_page_usable(slow):
    slow.answer = FitError("no heartbeat")
    slow.may_end.set()

    async def action(one, told):
        await one.start(form())
        assert not one.running
        assert not one.use()

    assert told_by(slow, action)[-1] == ("fit_ended", {"message": "no heartbeat"})


def test_a_form_with_mistakes_is_not_fitted(slow):
    async def action(one, told):
        await one.start(form(measurements__SP="x"))

    told_by(slow, action)
    assert slow.running == []
