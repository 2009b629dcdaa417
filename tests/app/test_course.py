"""Events of a course that are set on the page, and the beats of its minutes."""

from __future__ import annotations

import io
import json
import re
import zipfile
from dataclasses import replace

import pytest

from eclsim.app.beat import compute_beat
from eclsim.app.course import (
    BEATS,
    HOURS,
    case_at,
    compute_course,
    plain_course,
    plain_events,
    possible_events,
    usual_length,
    with_event,
    with_turn,
    without_event,
)
from eclsim.app.files import export
from eclsim.app.knobs import VOLUME, connect, value_of
from eclsim.app.state import PageState, link_of, preset_state, state_of
from eclsim.app.texts import text
from eclsim.cases.presets import PRESETS
from eclsim.inputs.mistakes import CaseError

HEALTHY = PRESETS["healthy"].case()
BLEEDING = {"at_min": 30, "give": {"bleed_ml": 400}, "over_min": 10}


def test_events_stand_in_their_order_and_go_again():
    case = with_event(with_event(HEALTHY, BLEEDING), {"at_min": 5, "give": {"crystalloid_ml": 250}})
    assert [one["at"] for one in plain_events(case)] == [5, 30]
    assert plain_events(case)[1]["words"] == f"{text('give_bleed_ml')} 400 mL"
    assert without_event(without_event(case, 0), 0) == HEALTHY
    assert without_event(case, 7) == case


@pytest.mark.parametrize("preset", PRESETS)
def test_everything_that_is_offered_can_happen(preset):
    case = connect(connect(PRESETS[preset].case(), "gas"), "fluid")
    for one in possible_events(case):
        assert one["label"]
        change = {"give": {one["key"]: 100.0}} if one["give"] else {"set": {one["key"]: one["value"]}}
        assert len(with_event(case, {"at_min": 60, **change}).events) == 1, one


@pytest.mark.parametrize(
    ("event", "said"),
    [
        ({"at_min": 5, "give": {"bleed_ml": 9000}}, "more blood than the patient has"),
        ({"at_min": -5, "give": {"bleed_ml": 90}}, "outside"),
        ({"at_min": "x", "give": {"bleed_ml": 90}}, "number"),
        ({"at_min": 5, "set": {"patient.nonsense": 1}}, "unknown"),
        ({"at_min": 5, "set": {"ecmo.speed_rpm": float("nan")}}, "events"),
        ({"at_min": 5, "__class__": 1}, "nothing happens"),
        ("no event", "one event at a time"),
        (None, "one event at a time"),
    ],
)
def test_what_cannot_be_an_event_is_refused(event, said):
    with pytest.raises(CaseError, match=said):
        with_event(PRESETS["paper"].case(), event)


PAPER = PRESETS["paper"].case()


def _typed(amount, minutes="0", give=False):
    kind, key, over = ("give", "bleed_ml", "over_min") if give else ("set", "ecmo.speed_rpm", "ramp_min")
    return {"at_min": 30, kind: {key: amount}, over: minutes}


@pytest.mark.parametrize(
    ("event", "said"),
    [
        (_typed("1,000", give=True), "1,000 may mean 1.000 or 1000"),
        (_typed("1.000", give=True), "1.000 may mean 1 or 1000"),
        (_typed("2000", "1.500"), "1.500 may mean 1.5 or 1500"),
        (_typed("3,425"), "3,425 may mean 3.425 or 3425"),
        (_typed("2000", "1,500"), "1,500 may mean 1.500 or 1500"),
        (_typed(""), "type how much"),
        (_typed("  ", give=True), "type how much"),
        (_typed(None), "type how much"),
        (_typed("2000", ""), "0 for at once"),
        (_typed("3 000"), "3000"),
        (_typed("fast"), "not a number"),
        (_typed("500", "soon", give=True), "not a number"),
        (_typed("1.000,5"), "a thousands separator and a decimal sign"),
    ],
)
def test_an_amount_that_may_be_misread_is_asked_about(event, said):
    with pytest.raises(CaseError, match=re.escape(said)) as refused:
        with_event(PAPER, event)
    assert "NoneType" not in str(refused.value)


def test_an_amount_is_read_as_beside_a_knob():
    def added(event):
        return with_event(PAPER, event).events[0].as_object()

    assert added(_typed("3425")) == {"at_min": 30, "set": {"ecmo.speed_rpm": 3425.0}, "ramp_min": 0.0}
    assert added(_typed(" 2500,5 ", "7,5")) == added(_typed(2500.5, 7.5))
    assert added(_typed("0,3", "0", give=True))["give"] == {"bleed_ml": 0.3}
    assert added(_typed("1000", "15", give=True))["over_min"] == 15.0


def test_a_choice_that_is_recorded_stands_there_in_words():
    case = with_turn(connect(PAPER, "gas"), "ecmo.pump", "DP3", 30)
    (words,) = (one["words"] for one in plain_events(case))
    assert words.startswith("ECMO Pump: ")
    assert "ecmo.pump" not in words


def test_a_link_and_an_export_hold_the_events():
    state = preset_state("healthy").with_case(with_event(HEALTHY, BLEEDING))
    assert state_of(link_of(state)) == state
    name, content = export(state, "case")
    assert name.endswith(".toml")
    assert b"[[events]]" in content


def test_a_timeline_that_is_too_short_for_an_event_says_what_to_do():
    state = PageState(with_event(HEALTHY, {**BLEEDING, "at_min": 540}))
    with pytest.raises(
        CaseError, match=r"an event at 09:00 .* end of the timeline at 06:00: choose a longer"
    ):
        compute_course(state, 360)


def test_a_course_is_long_enough_for_its_events():
    assert usual_length(HEALTHY) == HOURS[1]
    assert usual_length(with_event(HEALTHY, {**BLEEDING, "at_min": 540})) == 720
    assert usual_length(with_event(HEALTHY, {**BLEEDING, "at_min": 1440})) == HOURS[-1]


@pytest.mark.slow
def test_the_page_follows_the_minutes_of_a_course():
    named = HEALTHY.model_copy(update={"patient": HEALTHY.patient.model_copy(update={"id": "Case 7 (b)"})})
    state = PageState(with_event(named, BLEEDING))
    course = compute_course(state, 60)
    found = plain_course(course, 60)
    rows = {row["name"]: row["values"] for row in found["rows"]}
    assert found["time"][0] == 0.0
    assert found["time"][-1] == 60.0
    assert rows["MAP"][0] - rows["MAP"][-1] > 3.0, "blood was lost"
    assert found["balance"]["removed_ml"] == pytest.approx(400.0, abs=1e-3)
    assert abs(found["balance"]["error_ml"]) < 1e-6
    assert not found["message"]
    for k in (0, len(found["time"]) // 2, -1):
        shown = course.beat(found["time"][k])
        assert shown.converged
        assert shown.outputs["MAP"] == pytest.approx(rows["MAP"][k], rel=1e-3)
    first = course.beat(0.0)
    other = replace(first, outputs={**first.outputs, "MAP": first.outputs["MAP"] - 12.0})
    said = plain_course(course, 60, other)["approximations"]
    assert f"(Arterial {other.outputs['MAP']:.0f} mmHg) than one computed anew" in said[0]
    assert plain_course(course, 60, first)["approximations"] == said[1:]
    name, content = export(PageState(state.case), "course")
    files = zipfile.ZipFile(io.BytesIO(content))
    assert name.endswith("_course.zip")
    stem = name.removesuffix("_course.zip")
    assert {file.partition(".")[0] for file in files.namelist()} == {stem, f"{stem}_course"}
    assert {file.rpartition(".")[2] for file in files.namelist()} == {
        "toml",
        "json",
        "csv",
        "nc",
        "svg",
        "png",
    }
    (written,) = (file for file in files.namelist() if file.endswith(".toml"))
    about, command, *_ = files.read(written).splitlines()
    assert about == b"# Simulated with the parameters in the case."
    assert b"--until 360 --steady-only" in command
    (plain,) = (file for file in files.namelist() if file.endswith(".json"))
    assert json.loads(files.read(plain))["events"][0]["give"] == {"bleed_ml": 400.0}


@pytest.mark.slow
def test_recirculation_at_a_minute_is_that_of_the_sites_at_that_minute():
    """Flows of the moved line were followed through the circuit of the start: 5.6 % for 0 %."""
    state = preset_state("paper")
    moved = with_event(state.case, {"at_min": 30, "set": {"crrt.access_site": "post_dc"}})
    course = compute_course(state.with_case(moved), 60)
    shares = [course.beat(minute).outputs["crrt_recirculated_fraction"] for minute in (0.0, 40.0)]
    assert shares[0] > 0.04
    assert shares[1] == pytest.approx(0.0, abs=1e-6)


def test_an_oxygenator_that_clots_later_is_an_event():
    case = with_turn(connect(PAPER, "gas"), "parameters.ecmo.oxygenator.clotted_fraction", 0.7, 30.0)
    assert case.events[0].set == {"ecmo.oxygenator.clotted_fraction": 0.7}
    later = case_at(case, 31.0)
    assert value_of(later, "parameters.ecmo.oxygenator.clotted_fraction") == 0.7


def test_a_knob_that_is_turned_later_is_an_event_of_its_minute():
    turned = with_turn(HEALTHY, "parameters.Rmc", 1.2, 12.34567)
    again = with_turn(turned, "parameters.Rmc", 1.4, 12.34567)
    both = with_turn(again, "patient.heart_rate_bpm", "80", 12.34567)
    assert [(e.at_min, dict(e.set)) for e in both.events] == [
        (12.345, {"Rmc": 1.4}), (12.345, {"patient.heart_rate_bpm": 80.0}),
    ]  # fmt: skip
    assert case_at(both, 12.34567).parameters["Rmc"] == 1.4
    assert case_at(both, 12.0).parameters["Rmc"] == HEALTHY.parameters["Rmc"]
    with pytest.raises(CaseError, match="outside"):
        with_turn(HEALTHY, "patient.heart_rate_bpm", 9000, 5.0)
    with pytest.raises(CaseError, match="given at the start"):
        with_turn(HEALTHY, VOLUME, 100, 5.0)


@pytest.mark.slow
def test_a_patient_who_was_long_without_circulation_stays_none_on_the_page():
    """Given blood half an hour after it stopped, he stood there as healthy, with no limit broken."""
    back = {"at_min": 40, "give": {"blood_ml": 3300}, "over_min": 5}
    bled = with_event(HEALTHY, {"at_min": 10, "give": {"bleed_ml": 3200}, "over_min": 5})
    course = compute_course(PageState(with_event(bled, back)), 60)
    before, after = course.beat(5), course.beat(60)
    assert before.possible
    assert (after.possible, after.outputs["MAP"] > 50.0) == (False, True)
    assert "does not survive" in after.findings[0].sentence
    rows = plain_course(course, 60)["rows"]
    (pressure,) = [row for row in rows if row["name"] == "MAP"]
    assert pressure["values"][-1] is None


@pytest.mark.slow
def test_minutes_are_followed_beat_by_beat():
    case = with_event(HEALTHY, {"at_min": 1, "set": {"Rmc": 0.35}})
    course = compute_course(PageState(case), BEATS[0])
    plain = plain_course(course, BEATS[0])
    assert len(plain["time"]) == 140
    assert {"MAP", "blood_volume", "haematocrit"} <= {row["name"] for row in plain["rows"]}
    lowest = next(one for one in plain["alarms"] if one["quantity"] == "MAP")
    assert 1.0 <= lowest["at_min"] < 1.3
    assert "at 00:01:" in lowest["sentence"]
    before, after = course.beat(0.5), course.beat(1.9)
    assert before.transient
    assert before.outputs["MAP"] == pytest.approx(compute_beat(PageState(HEALTHY)).outputs["MAP"], rel=1e-4)
    assert after.means["Pao"] == pytest.approx(after.outputs["MAP"], rel=1e-4)
    assert after.outputs["MAP"] < before.outputs["MAP"] - 20
