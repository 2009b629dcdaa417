"""A session computes the newest state only, tells mistakes beside the knob, and shares nothing."""

import asyncio
import threading
from collections.abc import Callable
from dataclasses import replace

import pytest

from eclsim.app import beat as beat_of_page
from eclsim.app import updates
from eclsim.app.beat import Beat
from eclsim.app.session import BEATS_WORTH_A_CLOSER_START
from eclsim.app.state import (
    MOST_SAVED,
    START,
    FitRemark,
    PageState,
    key_of,
    link_of,
    preset_state,
    read_snapshot,
)
from eclsim.app.updates import SecondBeats
from eclsim.cases.case import Measurements
from eclsim.cases.presets import PRESETS
from eclsim.devices.description import Finding
from patience import until
from stub_session import StubEngine, beats, session


def test_of_many_turns_only_the_newest_is_computed():
    engine, messages = StubEngine(), []

    async def turns():
        one = session(engine, messages)
        one.start()
        for rate in range(60, 100):
            one.turn("patient.heart_rate_bpm", float(rate), rate)
        await until(lambda: beats(messages) and beats(messages)[-1]["seq"] == 99)

    asyncio.run(turns())
    assert len(engine.computed) <= 3
    assert 99 in engine.computed
    assert beats(messages)[-1]["seq"] == 99


def test_a_value_that_cannot_be_is_told_and_changes_nothing():
    engine, messages = StubEngine(), []

    async def turns():
        one = session(engine, messages)
        assert not one.turn("patient.heart_rate_bpm", "1.2 x", 7)
        assert one.state.case.patient.heart_rate_bpm == 70

    asyncio.run(turns())
    (error,) = [data for topic, data in messages if topic == "error"]
    assert error["key"] == "patient.heart_rate_bpm"
    assert "not a number" in error["messages"][0]


def test_a_beat_that_fails_is_told_and_the_next_one_comes():
    engine, messages = StubEngine(fail=True), []

    async def turns():
        one = session(engine, messages)
        one.start()
        await until(lambda: any(topic == "failed" for topic, _ in messages))
        engine.fail = False
        one.turn("patient.heart_rate_bpm", 88.0, 1)
        await until(lambda: beats(messages))

    asyncio.run(turns())
    assert any(topic == "failed" for topic, _ in messages)
    assert beats(messages)[-1]["outputs"]["MAP"] == 88


def test_sessions_share_nothing():
    engine = StubEngine()
    heard: list[list] = [[], []]

    async def turns():
        first, second = (session(engine, messages) for messages in heard)
        for one in (first, second):
            one.start()
        first.turn("patient.heart_rate_bpm", 61.0, 1)
        second.turn("patient.heart_rate_bpm", 99.0, 1)
        await until(lambda: all(beats(messages) for messages in heard))
        first.undo()
        await until(lambda: beats(heard[0])[-1]["outputs"]["MAP"] == 70)
        assert second.state.case.patient.heart_rate_bpm == 99

    asyncio.run(turns())
    assert {b["outputs"]["MAP"] for b in beats(heard[0])} <= {70, 61}
    assert {b["outputs"]["MAP"] for b in beats(heard[1])} <= {70, 99}


def test_a_closed_session_says_nothing_more():
    engine, messages = StubEngine(delay=0.05), []

    async def turns():
        one = session(engine, messages)
        one.start()
        one.close()
        count = len(messages)
        await asyncio.sleep(0.15)
        assert len(messages) == count

    asyncio.run(turns())


@pytest.mark.parametrize(
    ("effort", "begun_at"),
    [(BEATS_WORTH_A_CLOSER_START, [None, 70, 70, 70]), (BEATS_WORTH_A_CLOSER_START + 1, [None, 70, 71, 72])],
)
def test_searches_begin_at_a_newer_beat_where_the_last_one_was_far(effort, begun_at):
    """They began where the patient was opened, however far knobs were turned: each turn needed a Jacobian."""
    engine, messages = StubEngine(effort=effort), []

    async def turns():
        one = session(engine, messages)
        one.start()
        for rate in (71.0, 72.0, 73.0):
            await until(
                lambda: (
                    one.beat is not None and one._preparing_start is not None and one._preparing_start.done()
                )
            )
            one.turn("patient.heart_rate_bpm", rate, int(rate))
            await until(lambda r=rate: beats(messages)[-1]["seq"] == r)

    asyncio.run(turns())
    assert engine.begun_at == begun_at


def test_pin_and_save_keep_the_beat_with_its_own_state():
    engine, messages = StubEngine(delay=0.05), []

    async def turns():
        one = session(engine, messages)
        one.start()
        await until(lambda: beats(messages))
        one.turn("patient.heart_rate_bpm", 95.0, 1)
        one.pin()
        assert one.save()
        state, beat, moment = one.saved[0]
        assert state.case.patient.heart_rate_bpm == beat.outputs["MAP"] == 70
        assert one.pinned == (state, beat, moment) == one.saved[0]
        assert moment == START
        await until(lambda: len(beats(messages)) == 2)
        while one.save():
            pass
        assert len(one.saved) == MOST_SAVED
        one.remove_saved(0)
        one.remove_saved(99)
        assert len(one.saved) == MOST_SAVED - 1
        one.pin()
        assert one.pinned is None

    asyncio.run(turns())
    assert messages[-2:][0][0] == "pinned"


LATER = {"at_min": 30, "set": {"patient.heart_rate_bpm": 100}}


@pytest.mark.slow
def test_pin_and_save_keep_the_minute_that_is_seen():
    """Also after the tab was loaded again: the browser keeps the minute, and the course is followed again."""
    engine, messages, other = StubEngine(), [], []

    async def before():
        one = session(engine, messages)
        one.start()
        one.add_event(LATER)
        await until(lambda: beats(messages) and beats(messages)[-1]["of"] == key_of(one.state))
        one.minutes = 60
        one.at_minute(40.0)
        later = replace(one.shown[1], outputs={"MAP": 55.0})
        one.show_moment(one.state, later, 40.0)
        one.pin()
        one.save()
        one.at_minute(0.0)
        one.show_start()
        one.save()
        assert [kept.beat.outputs["MAP"] for kept in (one.pinned, *one.saved)] == [55.0, 55.0, 70.0]
        one.show_saved(0)
        await until(lambda: any(topic == "keep" for topic, _ in messages))

    async def after():
        one = session(engine, other)
        one.restore(read_snapshot([data["tab"] for topic, data in messages if topic == "keep"][-1]))
        one.engine.study = at_once
        one.start()
        await until(lambda: one.pinned and one.saved)
        assert [kept.moment for kept in (one.pinned, *one.saved)] == [(40.0, 60), (40.0, 60), (0.0, 0)]
        assert one.pinned.beat.outputs["MAP"] != 70.0

    async def at_once(work):
        return work()

    asyncio.run(before())
    saved = [data for topic, data in messages if topic == "saved"][-1]
    assert [one["values"]["patient.heart_rate_bpm"] for one in saved] == [100, 70]
    assert [one["minute"] for one in saved] == [40.0, 0.0]
    assert saved[0]["of"] != saved[1]["of"]
    moments = [data["values_then"]["patient.heart_rate_bpm"] for data in beats(messages) if data["minute"]]
    assert moments == [100]
    assert ("go_to", {"minute": 40.0, "length": 60}) in messages
    asyncio.run(after())


def test_nothing_is_added_at_the_end_of_the_timeline_where_no_course_could_show_it():
    engine, messages = StubEngine(), []

    async def turns():
        one = session(engine, messages)
        one.minutes = 360
        before = one.state
        assert not one.add_event({"at_min": 360, "give": {"bleed_ml": "300"}, "over_min": "15"})
        one.record(True)
        one.at_minute(360.0)
        assert not one.turn("patient.heart_rate_bpm", 110)
        assert one.state == before
        one.at_minute(359.0)
        assert one.turn("patient.heart_rate_bpm", 110)

    asyncio.run(turns())
    refused = {data["key"]: data["messages"] for topic, data in messages if topic == "error"}
    assert set(refused) == {"events", "patient.heart_rate_bpm"}
    assert all("06:00 is the end of the timeline" in words[0] for words in refused.values())


def test_what_is_no_event_is_refused_while_knobs_are_recorded_at_a_later_minute():
    engine, messages = StubEngine(), []

    async def turns():
        one = session(engine, messages)
        one.record(True)
        one.at_minute(30.0)
        before = one.state
        assert not one.connect("lvad")
        assert not one.use("crrt", {"crrt.access_site": "ra"})
        one.set_policy("patient_held")
        assert one.state == before
        one.at_minute(0.0)
        assert one.connect("lvad")
        one.set_policy("patient_held")
        assert one.state.policy == "patient_held"

    asyncio.run(turns())
    refused = {data["key"]: data["messages"] for topic, data in messages if topic == "error"}
    assert set(refused) == {"lvad", "crrt.access_site", "policy"}
    assert all("from 00:00" in words[0] for words in refused.values())


@pytest.mark.parametrize("policy", ["patient_held", "nonsense"])
def test_only_known_volume_policies_are_taken(policy):
    engine, messages = StubEngine(), []

    async def turns():
        one = session(engine, messages)
        one.set_policy(policy)
        return one.state.policy

    assert asyncio.run(turns()) == ("patient_held" if policy == "patient_held" else "as_published")


def test_a_tab_that_is_restored_has_its_undo_its_pin_and_its_saved_states():
    """The server was started again: what the browser kept is all there is."""
    engine, messages, other = StubEngine(), [], []

    async def before():
        one = session(engine, messages)
        one.start()
        await until(lambda: len(beats(messages)) == 1)
        one.pin()
        one.turn("patient.heart_rate_bpm", 81.0, 1)
        await until(lambda: len(beats(messages)) == 2)
        one.save()
        one.turn("patient.heart_rate_bpm", 92.0, 2)
        await until(lambda: key_of(one.state) in [data["of"] for topic, data in messages if topic == "keep"])

    async def after():
        one = session(engine, other)
        kept = [data["tab"] for topic, data in messages if topic == "keep"]
        one.restore(read_snapshot(kept[-1]))
        one.start()
        await until(lambda: one.pinned and one.saved and any(topic == "base" for topic, _ in other))
        assert one.state.case.patient.heart_rate_bpm == 92
        assert one.pinned is not None
        assert one.pinned[1].outputs["MAP"] == 70
        assert [beat.outputs["MAP"] for _, beat, _ in one.saved] == [81]
        one.undo()
        assert one.state.case.patient.heart_rate_bpm == 70  # turns within 1.5 s are one step
        assert not one.state.changed

    asyncio.run(before())
    asyncio.run(after())
    bases = [data for topic, data in other if topic == "base"]
    assert bases[-1]["outputs"]["MAP"] == 70  # changes are measured from the patient as opened


def test_undo_then_reset_stays_with_the_same_patient():
    engine, messages = StubEngine(), []

    async def turns():
        one = session(engine, messages)
        one.start()
        one.turn("patient.heart_rate_bpm", 81.0, 1)
        one.load(PageState(PRESETS["lvad"].case()))
        one.undo()
        one.reset()
        await until(lambda: beats(messages))
        return one.state

    assert asyncio.run(turns()) == preset_state("healthy")
    states = [data for topic, data in messages if topic == "state"]
    assert [s["name"] for s in states][-1] == "Healthy adult"


def test_a_fit_that_is_judged_again_is_so_in_all_its_states():
    engine, messages = StubEngine(), []
    fitted = PageState(PRESETS["paper"].case(), origin="fit", verdict="good")

    async def turns():
        one = session(engine, messages)
        one.load(fitted)
        one.turn("patient.heart_rate_bpm", 81.0, 1)
        await until(lambda: beats(messages))
        one.judge(fitted, replace(fitted, verdict="poor"))
        assert one.state.start.verdict == one.state.verdict == "poor"
        assert one.shown[0] == one.state
        one.undo()
        assert one.state.verdict == "poor"
        one.undo()
        assert one.state == preset_state("healthy")

    asyncio.run(turns())
    names = [data["provenance"]["badge"] for topic, data in messages if topic == "state"]
    assert names[-2:] == ["Poor fit", "Preset"]


def test_numbers_say_where_their_knobs_stood():
    engine, messages = StubEngine(), []

    async def turns():
        one = session(engine, messages)
        one.start()
        await asyncio.sleep(0)  # the first beat is being computed
        one.turn("patient.heart_rate_bpm", 81.0, 1)
        await until(lambda: len(beats(messages)) == 2)

    asyncio.run(turns())
    assert {b["outputs"]["MAP"] == b["values"]["patient.heart_rate_bpm"] for b in beats(messages)} == {True}


def test_a_scheme_connects_the_crrt_where_there_is_none():
    engine, messages = StubEngine(), []

    async def turns():
        one = session(engine, messages)
        one.load(PageState(PRESETS["vv-ecmo"].case()))
        assert one.use("crrt", {"crrt.access_site": "post_oxy", "crrt.return_site": "pre_pump"})
        lines = one.state.case.crrt
        assert (lines.access_site, lines.return_site) == ("post_oxy", "pre_pump")

    asyncio.run(turns())


def test_what_the_page_took_back_does_not_happen_later():
    """A turn without an answer is undone when the server hears of it, and redo makes it."""
    engine, messages = StubEngine(), []

    async def turns():
        one = session(engine, messages)
        one.start()
        shown = key_of(one.state)
        one.turn("patient.heart_rate_bpm", 90.0, 1)
        one.history._last = ("", float("-inf"))  # later than turns that count as one
        one.turn("patient.heart_rate_bpm", 99.0, 2)
        assert one.roll_back(shown)
        assert one.state.case.patient.heart_rate_bpm == 70
        await until(lambda: beats(messages) and beats(messages)[-1]["of"] == shown)
        assert not one.roll_back(shown)
        one.redo()
        one.redo()
        assert one.state.case.patient.heart_rate_bpm == 99

    asyncio.run(turns())
    assert [topic for topic, _ in messages].count("taken_back") == 2


def test_what_was_taken_back_may_have_become_one_step_with_what_was_shown():
    engine, messages = StubEngine(), []

    async def turns():
        one = session(engine, messages)
        one.turn("patient.heart_rate_bpm", 90.0, 1)
        shown, link = key_of(one.state), link_of(one.state)
        one.turn("patient.heart_rate_bpm", 99.0, 2)  # the same step of the history
        assert one.roll_back(shown, link)
        assert one.state.case.patient.heart_rate_bpm == 90
        one.redo()
        assert one.state.case.patient.heart_rate_bpm == 99
        one.undo()
        one.undo()
        assert one.state.case.patient.heart_rate_bpm == 70
        now = one.state
        assert not one.roll_back("00000000", "no link")
        assert one.state == now

    asyncio.run(turns())


@pytest.fixture
def second_beats(monkeypatch):
    """Every heart rate from 90 on has two beats; the pause is short."""
    caution = Finding.without_limit("caution", "MAP", 0.0, "two steady beats", "MAP")

    def with_second(beat: Beat, _: Callable[[], bool]) -> Beat | None:
        return replace(beat, findings=(caution,)) if beat.outputs["MAP"] >= 90 else None

    monkeypatch.setattr(beat_of_page, "with_second_beat", with_second)
    monkeypatch.setattr(updates, "STILL_S", 0.05)


def test_a_second_beat_is_named_for_the_state_that_has_it_and_for_no_other(second_beats):
    engine, messages = StubEngine(), []

    async def turns():
        one = session(engine, messages)
        one.listen(SecondBeats(engine))  # type: ignore[arg-type]
        one.start()
        one.turn("patient.heart_rate_bpm", 95.0, 1)
        await until(lambda: beats(messages)[-1:] and beats(messages)[-1]["notes"])
        one.pin()
        one.save()
        one.turn("patient.heart_rate_bpm", 60.0, 2)
        await until(lambda: beats(messages)[-1]["seq"] == 2)
        await asyncio.sleep(0.3)

    asyncio.run(turns())
    last = beats(messages)
    assert [(beat["seq"], bool(beat["notes"])) for beat in last[-3:]] == [(1, False), (1, True), (2, False)]
    assert last[-2]["of"] == last[-3]["of"]
    assert last[-2]["cautions"] == {"MAP": "two steady beats"}
    for topic in ("pinned", "saved"):
        kept = [data for name, data in messages if name == topic][-1]
        assert (kept if topic == "pinned" else kept[0])["cautions"]


def test_a_second_beat_that_was_found_too_late_is_that_of_the_pinned_one_alone(second_beats, monkeypatch):
    engine, messages, slow = StubEngine(), [], threading.Event()
    now = beat_of_page.with_second_beat
    late = lambda beat, wanted: slow.wait(5) and now(beat, wanted)  # noqa: E731
    monkeypatch.setattr(beat_of_page, "with_second_beat", late)

    async def turns():
        one = session(engine, messages)
        one.listen(SecondBeats(engine))  # type: ignore[arg-type]
        one.start()
        one.turn("patient.heart_rate_bpm", 95.0, 1)
        await until(lambda: engine.studying)
        one.pin()
        one.turn("patient.heart_rate_bpm", 60.0, 2)
        await until(lambda: beats(messages)[-1]["seq"] == 2)
        slow.set()
        await until(lambda: [data for topic, data in messages if topic == "pinned"][-1]["cautions"])

    asyncio.run(turns())
    assert not any(beat["notes"] for beat in beats(messages))


@pytest.mark.slow
def test_of_knobs_that_do_not_rest_no_second_beat_is_sought(second_beats, monkeypatch):
    engine, messages = StubEngine(), []
    monkeypatch.setattr(updates, "STILL_S", 0.6)

    async def turns():
        one = session(engine, messages)
        one.listen(SecondBeats(engine))  # type: ignore[arg-type]
        one.start()
        for rate in range(90, 110):
            one.turn("patient.heart_rate_bpm", float(rate), rate)
            await asyncio.sleep(0.02)
        await until(lambda: beats(messages)[-1]["notes"])

    asyncio.run(turns())
    assert engine.studying == 1


def test_what_a_fit_left_open_stands_at_its_numbers_and_at_those_of_later_turns():
    """Once used, a pressure that was "not to be read off this fit" stood in its tile like a measured one."""
    engine, messages = StubEngine(), []
    case, remark = PRESETS["healthy"].case(), FitRemark("MAP 70 (40 to 90 mmHg)", ("MAP",))

    async def turns():
        one = session(engine, messages)
        one.load(PageState(case, origin="fit", verdict="doubtful", remarks=(remark,)))
        await until(lambda: beats(messages))
        one.pin()
        one.turn("patient.heart_rate_bpm", 88.0, 7)
        await until(lambda: beats(messages)[-1]["seq"] == 7)
        one.load(PageState(case, origin="file"))
        await until(lambda: beats(messages)[-1]["cautions"] == {})

    asyncio.run(turns())
    said = [beat["cautions"].get("MAP") for beat in beats(messages)]
    assert said == ["MAP 70 (40 to 90 mmHg)", "At the fitted settings: MAP 70 (40 to 90 mmHg)", None]
    pinned = next(data for topic, data in messages if topic == "pinned")
    assert pinned["cautions"] == {"MAP": said[0]}


def test_a_beat_has_the_measurements_of_its_own_patient():
    """Beside the numbers of the last patient stood what had been measured in one still compiling."""
    engine, messages = StubEngine(delay=0.05), []
    case = PRESETS["healthy"].case().model_copy(update={"measurements": Measurements(MAP=72.0)})

    async def turns():
        one = session(engine, messages)
        one.start()
        await asyncio.sleep(0.01)
        one.load(PageState(case, origin="file"))
        await until(lambda: len(beats(messages)) > 1)
        one.turn("patient.heart_rate_bpm", 88.0, 7)
        await until(lambda: beats(messages)[-1]["seq"] == 7)

    asyncio.run(turns())
    told = [(beat["measured"], beat["measured_before"]) for beat in beats(messages)]
    assert told == [({}, False), ({"MAP": 72.0}, False), ({"MAP": 72.0}, True)]
