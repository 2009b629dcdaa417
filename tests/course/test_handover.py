"""Steady beats and every beat in one course: where, how close to every beat all along, and what balances."""

import json
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from eclsim.beat.heartbeat import HEART_RATE
from eclsim.cases import read_case
from eclsim.cases.reading import read_mapping
from eclsim.course.beats import course_beats, shift_ml
from eclsim.course.course import course, course_many
from eclsim.course.engine import CourseOptions
from eclsim.course.files import course_object
from eclsim.course.predictor import settling_time
from eclsim.course.result import spans_in_words
from eclsim.outputs.results import simulate
from small_patient import ON_ECMO

EXAMPLES = Path(__file__).parents[2] / "examples"
SLOW = """[regulation]
baroreflex = 1.0
[fluid]
[solutes]
"""
EVENTS = """[[events]]
at_min = 2
set = { "ecmo.speed_rpm" = 1500, "crrt.net_ultrafiltration_ml_h" = 200 }
[[events]]
at_min = 5
give = { albumin_ml = 250 }
over_min = 2
"""
GENTLE = """[[events]]
at_min = 2
set = { "ecmo.speed_rpm" = 2900 }
[[events]]
at_min = 3
give = { crystalloid_ml = 100 }
over_min = 5
"""
OUTPUTS = ("MAP", "MPAP", "PF", "heart_rate")
STEADY = CourseOptions(hand_over=False)


def case(folder, events):
    file = folder / "case.toml"
    text = ON_ECMO.replace("flow_ml_min = 200\n", "flow_ml_min = 200\nnet_ultrafiltration_ml_h = 0\n")
    file.write_text(text + SLOW + events)
    return read_case(file).case


@pytest.fixture(scope="module")
def fast(tmp_path_factory):
    own = case(tmp_path_factory.mktemp("handover"), EVENTS)
    return own, course(own, minutes=10.0, every_min=1.0), course_beats(own, minutes=10.0, outputs=OUTPUTS)


def spans(result):
    return [(one["from_min"], one["until_min"]) for one in json.loads(result.attrs["spans"])]


@pytest.mark.slow
def test_a_speed_step_and_a_fast_infusion_are_followed_beat_by_beat(fast):
    _, result, _ = fast
    (stop, settled), (begun, over) = spans(result)
    assert (stop, begun) == (2.0, 5.0)
    assert 2.3 < settled < 5.0
    assert over > 7.0
    minute, by_beat = result["time_min"].to_numpy(), result["beat_by_beat"].to_numpy().astype(bool)
    rounded = 1e-6  # of the times of moments
    within = (minute >= stop) & (minute < settled - rounded)
    within |= (minute >= begun) & (minute < over - rounded)
    np.testing.assert_array_equal(by_beat, within)
    assert (np.diff(minute) > 0.0).all()
    assert not result.attrs["approximations"]
    assert sum("coefficient of the membrane, 37" in message for message in result.attrs["warnings"]) == 1
    assert spans_in_words(result).startswith("followed beat by beat 00:02:00 to 00:0")
    first, second = course_object(result)["beat_by_beat"]
    assert f" ({first['reason']}), 00:05:00 to" in spans_in_words(result, reasons=True)
    assert "the circulation shifts" in first["reason"]
    assert "plasma volume changes by" in second["reason"]


@pytest.mark.slow
def test_it_is_every_beat_all_along_and_steady_beats_alone_are_not(fast):
    own, result, beats = fast
    steady = course(own, minutes=10.0, every_min=1.0, outputs=OUTPUTS, options=STEADY)
    assert any("follow these minutes beat by beat" in words for words in steady.attrs["approximations"])
    assert spans(steady) == []

    there = beats["time_min"].to_numpy()

    def worst(found, at, name):
        values = np.interp(at, found["time_min"], found[name]) - np.interp(at, there, beats[name])
        return float(np.abs(values).max())

    shown = result["time_min"].to_numpy()
    # A march of beats alone begins with a sudden event up to a beat later.
    shown = shown[(shown < there[-1]) & ((shown < 2.0) | (shown > 2.25))]
    for name, bar in (("MAP", 0.3), ("MPAP", 0.1), ("heart_rate", 0.3), ("PF", 0.05)):
        assert worst(result, shown, name) < bar
    assert worst(steady, shown, "MAP") > 0.3


@pytest.mark.slow
def test_slow_states_balance_over_the_handover(fast):
    _, result, _ = fast

    def change(*names):
        return sum(float(result[name][-1] - result[name][0]) for name in names)

    balance = json.loads(result.attrs["balance"])
    assert abs(balance["error_ml"]) < 1e-6
    assert balance["given_ml"] == pytest.approx(250.0, abs=1e-6)
    assert balance["removed_ml"] == pytest.approx(200.0 * 8.0 / 60.0, rel=0.01)
    fluid = change("fluid.plasma_ml", "fluid.red_cells_ml", "fluid.interstitium_ml")
    assert fluid == pytest.approx(change("fluid.given_ml") - change("fluid.removed_ml"), abs=1e-6)
    protein = change("fluid.plasma_protein_g", "fluid.interstitial_protein_g")
    assert protein == pytest.approx(change("fluid.protein_given_g"), abs=1e-9)
    urea = change("solutes.urea_outside_mmol", "solutes.urea_inside_mmol")
    through = change("solutes.urea_made_mmol") - change("solutes.urea_removed_mmol")
    assert urea == pytest.approx(through, abs=1e-9 * float(result["solutes.urea_inside_mmol"][0]))


@pytest.mark.slow
def test_alarms_of_the_span_are_those_of_its_beats(fast):
    _, result, _ = fast
    assert len(json.loads(result.attrs["alarms"])) < 12


@pytest.mark.slow
def test_gentle_events_stay_with_steady_beats(tmp_path):
    own = case(tmp_path, GENTLE)
    result = course(own, minutes=6.0, every_min=2.0, outputs=OUTPUTS)
    assert spans(result) == []
    steady = course(own, minutes=6.0, every_min=2.0, outputs=OUTPUTS, options=STEADY)
    np.testing.assert_array_equal(result["MAP"], steady["MAP"])


@pytest.mark.slow
def test_side_by_side_or_alone_is_the_same(fast):
    own, single, _ = fast
    options = CourseOptions(hand_over=True)
    two = course_many([own, own], minutes=10.0, every_min=1.0, outputs=OUTPUTS, options=options)
    for one in two:
        np.testing.assert_allclose(one["MAP"], single["MAP"], rtol=1e-6)


@pytest.mark.slow
def test_a_span_is_no_longer_than_allowed(fast, monkeypatch):
    own, _, _ = fast
    monkeypatch.setattr("eclsim.course.engine.LONGEST_SPAN_S", 70.0)
    result = course(own, minutes=10.0, every_min=1.0, outputs=OUTPUTS)
    assert all(end - begin < 72.0 / 60.0 for begin, end in spans(result))
    assert any("follow these minutes beat by beat" in words for words in result.attrs["approximations"])
    assert abs(json.loads(result.attrs["balance"])["error_ml"]) < 1e-6


def test_a_shift_is_what_compartments_gain_or_lose():
    one, other = {"a": 1.0, "b": 2.0, "c": 3.0, "d": 9.0}, {"a": 4.0, "b": 1.0, "c": 2.5, "e": 0.0}
    assert shift_ml(one, other) == 3.0
    assert shift_ml(other, one) == 3.0


@pytest.mark.slow
def test_what_is_not_followed_is_said_with_its_reason(tmp_path):
    moved = '"crrt.access_site" = "pre_oxy", '
    both = EVENTS.replace('"ecmo.speed_rpm" = 1500,', f'"ecmo.speed_rpm" = 1500, {moved}')
    own = case(tmp_path, both)
    result = course(own, minutes=6.0, every_min=2.0, outputs=OUTPUTS)
    assert spans(result) == []
    (sentence,) = [one for one in result.attrs["warnings"] if one.startswith("not followed")]
    assert sentence.startswith("not followed beat by beat at 00:02")
    assert "because an event connects the circuit in another way" in sentence
    steady = course(own, minutes=6.0, every_min=2.0, outputs=OUTPUTS, options=STEADY)
    assert not any(one.startswith("not followed") for one in steady.attrs["warnings"])


@pytest.mark.slow
def test_a_heart_that_an_event_paces_is_followed_beat_by_beat(tmp_path):
    """The response of the heart rate was a part that the event added, and beats were not followed."""
    paced = """[[events]]
at_min = 2
set = { "regulation.heart_rate_response" = 0, "patient.heart_rate_bpm" = 150 }
"""
    result = course(case(tmp_path, paced), minutes=5.0, every_min=1.0, outputs=(*OUTPUTS, "CO"))
    ((begun, _),) = spans(result)
    assert begun == 2.0
    assert not any(one.startswith("not followed") for one in result.attrs["warnings"])
    before, after = (result["heart_rate"].sel(time_min=t, method="nearest") for t in (1.0, 2.5))
    assert (float(before), float(after)) == pytest.approx((80.0, 150.0), abs=0.01)


AT_ONCE = """[[events]]
at_min = 0
set = { "ecmo.speed_rpm" = 1500, "drugs.noradrenaline" = 0.1 }
"""


@pytest.mark.slow
def test_events_at_minute_0_begin_with_what_was_before(tmp_path):
    own = case(tmp_path, AT_ONCE)
    before = simulate(own)
    result = course(own, minutes=6.0, every_min=1.0)
    ((begun, settled),) = spans(result)
    assert begun == 0.0
    assert 0.5 < settled < 5.0
    assert result.attrs["settling_s"] > 10.0
    beats = course_beats(own, minutes=6.0, outputs=OUTPUTS)
    # The first beat is still filled as before the pump slowed down; a minute later little of it is left.
    assert float(result["MAP"][0]) == pytest.approx(float(beats["MAP"][0]), abs=0.01)
    first, last = float(result["PF"][0]), float(result["PF"][-1])
    assert abs(first - float(before["PF"])) > 0.5 * abs(last - float(before["PF"]))
    assert float(result["drugs.noradrenaline_in_effect"][0]) == 0.0
    assert float(result["drugs.noradrenaline_in_effect"][-1]) > 0.05
    minutes = result["time_min"].to_numpy()
    there = np.interp(minutes, beats["time_min"], beats["MAP"])
    assert np.abs(result["MAP"].to_numpy() - there)[minutes < float(beats["time_min"][-1])].max() < 0.3


@pytest.mark.slow
def test_a_clamp_is_closed_by_an_event_of_a_case_without_one(tmp_path):
    own = case(tmp_path, AT_ONCE.replace('"ecmo.speed_rpm" = 1500', '"ecmo.return_clamp" = 1'))
    result = course_beats(own, minutes=0.5, outputs=("PF", "post_pump_pressure"))
    assert float(simulate(own)["PF"]) > 2.5
    assert abs(float(result["PF"][-1])) < 0.01


@pytest.mark.slow
def test_a_ramp_that_takes_the_steady_beat_away_is_followed_beat_by_beat_until_there_is_one_again():
    """Of a sweep ramped to nothing where the lungs exchange nothing: the course ended before the recovery."""
    raw = read_case(EXAMPLES / "veno_venous_gas.toml").case.as_mapping()
    raw["gas"]["shunt_fraction"] = 1.0
    off = {"at_min": 2, "set": {"ecmo.sweep_l_min": 0.0}, "ramp_min": 3}
    own = read_mapping(raw | {"events": [off, {"at_min": 6, "set": {"ecmo.sweep_l_min": 2.0}}]}).case
    result, every = (
        course(own, minutes=17.0, every_min=1.0),
        course_beats(own, minutes=17.0, outputs=("SaO2",)),
    )
    assert result.attrs["converged"], result.attrs["message"]
    ((begin, until),) = spans(result)
    assert 2.0 <= begin < 5.0
    assert until > 8.0
    minute = result["time_min"].values
    expected = np.interp(minute, every["time_min"].values, every["SaO2"].values)
    lowest = result["SaO2"].values.min()
    assert lowest < 60.0
    # Beat by beat the last beats before a moment stand for it.
    assert np.abs(result["SaO2"].values - expected)[minute > until].max() < 1.0
    assert lowest == pytest.approx(expected.min(), abs=1.5)


def swept(*events, minutes, options=None):
    """A patient without a reflex, whose circulation settles in 2 s and whose blood does not."""
    raw = read_case(EXAMPLES / "veno_venous_gas.toml").case.as_mapping()
    own = read_mapping(raw | {"events": list(events)}).case
    return own, course(own, minutes=minutes, every_min=0.5, outputs=("SaO2", "PaCO2"), options=options)


LOW = {"at_min": 2, "set": {"ecmo.sweep_l_min": 0.05}, "ramp_min": 3}


@pytest.mark.slow
@pytest.mark.parametrize("minutes", [7.0, 10.0])
def test_a_ramp_waits_for_the_blood_where_the_circulation_settles_at_once_and_so_does_the_end(minutes):
    """SaO2 was 60 points ahead as the ramp ended, and where the course ended before it had settled."""
    own, result = swept(LOW, minutes=minutes)
    assert result.attrs["settling_s"] < 10.0
    every = course_beats(own, minutes=minutes, outputs=("SaO2", "PaCO2"), every_min=0.02)
    ((begin, until),) = spans(result)
    assert 2.0 <= begin < 5.0
    assert until > minutes - 0.2
    shown = result["time_min"].to_numpy()
    shown = shown[shown <= float(every["time_min"][-1])]
    for name in ("SaO2", "PaCO2"):
        there = np.interp(shown, every["time_min"], every[name])
        assert np.abs(there - np.interp(shown, result["time_min"], result[name])).max() < 0.7
    assert float(result["SaO2"][-1]) == pytest.approx(float(every["SaO2"][-1]), abs=1.0)
    assert result["beat_by_beat"][-1] == 1
    assert float(result["time_min"][-1]) == minutes


@pytest.mark.slow
@pytest.mark.parametrize(
    ("event", "words"),
    [
        (LOW, "at 00:0[45] steady beats run ahead: SaO2 goes from 97 to .* within 60 s"),
        (LOW | {"at_min": 0}, "at 00:0[23] steady beats run ahead: SaO2 goes from 97 to .* within 60 s"),
        (
            {"at_min": 0, "set": LOW["set"]},
            "at 00:00 steady beats run ahead: SaO2 goes from 97 to .* at once",
        ),
    ],
)
def test_steady_beats_alone_say_where_gases_run_ahead_on_a_ramp_and_at_minute_0(event, words):
    _, result = swept(event, minutes=7.0, options=STEADY)
    (sentence,) = result.attrs["approximations"]
    assert re.match(words, sentence), sentence
    _, gentle = swept(LOW | {"set": {"ecmo.sweep_l_min": 1.5}}, minutes=7.0, options=STEADY)
    assert not gentle.attrs["approximations"]


@pytest.mark.slow
def test_an_event_shortly_before_the_end_is_followed_as_far_as_the_course_goes(tmp_path):
    """Less than the settling time was left: the steady beat stood there at once, and nothing said so."""
    stop = '[[events]]\nat_min = 4.5\nset = { "ecmo.speed_rpm" = 1200 }\n'
    own = case(tmp_path, stop)
    result = course(own, minutes=5.0, every_min=1.0, outputs=OUTPUTS)
    assert result.attrs["settling_s"] > 30.0
    every = course_beats(own, minutes=5.0, outputs=OUTPUTS, every_min=0.005)
    ((begin, until),) = spans(result)
    assert (begin, round(until, 1)) == (4.5, 4.9)
    shown = result["time_min"].to_numpy()
    shown = shown[shown < 4.9]
    there = np.interp(shown, every["time_min"], every["MAP"])
    assert np.abs(there - np.interp(shown, result["time_min"], result["MAP"])).max() < 0.5
    assert result["beat_by_beat"][-1] == 1


@pytest.mark.parametrize("kept", [1.0, 1.0 - 2.0**-52, 1.0 - 1e-12])
def test_what_a_beat_keeps_to_rounding_is_no_mode_that_settles(kept):
    """A heart that hardly ejects was said to settle in 8444249301319680 s."""
    shrink = np.array([0.5, kept])
    beat = SimpleNamespace(values_in_effect=lambda _: {HEART_RATE: 60.0})
    inverse = np.linalg.pinv(np.diag(1.0 - shrink))
    assert settling_time(cast(Any, beat), 0, inverse) == pytest.approx(3.0 / np.log(2.0))
