"""Beat by beat: at rest nothing moves, blood given is there, and the end is the steady beat."""

import json

import numpy as np
import pytest

import eclsim
from eclsim.beat.heartbeat import BeatProgram
from eclsim.cases import read_case
from eclsim.course.beats import RecordedBeat, ShownBeats, course_beats
from eclsim.course.course import course
from eclsim.inputs.mistakes import CaseError
from small_patient import PATIENT

REGULATED = f"""{PATIENT}[regulation]
baroreflex = 1.0
"""
EVENTS = """
[[events]]
at_min = 0.5
give = { blood_ml = 150 }
over_min = 0.5
[[events]]
at_min = 1
set = { Rmc = 0.8 }
"""
OUTPUTS = ("MAP", "CO", "heart_rate", "systemic_resistance_factor")


def case(tmp_path, events=""):
    file = tmp_path / "case.toml"
    file.write_text(REGULATED + events)
    return read_case(file).case


@pytest.fixture(scope="module")
def followed(tmp_path_factory):
    own = case(tmp_path_factory.mktemp("beats"), EVENTS)
    beats = course_beats(own, minutes=6.0, outputs=OUTPUTS)
    return own, beats, course(own, minutes=6.0, every_min=1.0, outputs=OUTPUTS)


@pytest.mark.slow
def test_at_rest_nothing_moves_and_the_beats_are_those_of_the_search(tmp_path, monkeypatch):
    own = case(tmp_path)
    monkeypatch.setattr(BeatProgram, "trace", None)  # a program that records alone takes a second to compile
    result = course_beats(own, minutes=1.0, outputs=OUTPUTS)
    assert result.sizes["time_min"] == 80
    expected = eclsim.simulate(own)
    for name in OUTPUTS:
        np.testing.assert_allclose(result[name], float(expected[name]), rtol=2e-5)


@pytest.mark.slow
def test_the_circulation_ends_at_the_steady_beat(followed):
    _, beats, steady = followed
    for name in OUTPUTS:
        assert float(beats[name][-1]) == pytest.approx(float(steady[name][-1]), rel=2e-3), name


@pytest.mark.slow
def test_a_reflex_lags_behind_a_sudden_change(followed):
    _, beats, _ = followed

    def moved(name, minute):
        before, then = (float(beats[name].sel(time_min=t, method="nearest")) for t in (0.985, minute))
        return abs(then - before)

    later = max(moved("heart_rate", minute) for minute in (1.1, 1.2, 1.5, 3.0))
    assert moved("heart_rate", 1.01) < 0.5 * later
    assert moved("MAP", 1.03) > 1.0


@pytest.mark.slow
def test_what_is_given_is_there(followed):
    balance = json.loads(followed[1].attrs["balance"])
    assert balance["given_ml"] == pytest.approx(150.0, abs=1e-6)
    assert abs(balance["error_ml"]) < 1e-6


@pytest.mark.slow
def test_shown_beats_are_so_far_apart(followed):
    own, beats, _ = followed
    sparse = course_beats(own, minutes=1.2, every_min=0.25, outputs=("MAP",))
    expected = [0.0, 0.25, 0.5, 0.5, 0.75, 1.0, 1.0]  # with the last beat before each event
    np.testing.assert_allclose(sparse["time_min"], expected, atol=0.013)
    shared = beats["MAP"].sel(time_min=sparse["time_min"].to_numpy(), method="nearest").to_numpy()
    np.testing.assert_allclose(sparse["MAP"], shared, rtol=1e-9)


def test_another_circuit_is_refused(tmp_path):
    own = case(tmp_path, '[lvad]\npump = "HM3"\nspeed_rpm = 4000\ninlet_site = "lv"\noutlet_site = "ao"\n')
    moved = own.as_mapping() | {"events": [{"at_min": 0.5, "set": {"lvad.outlet_site": "sart"}}]}
    with pytest.raises(CaseError, match="connects the circuit in another way"):
        course_beats(type(own).model_validate(moved), minutes=1.0)


def test_every_beat_behind_an_event_is_shown_however_many_there_are():
    shown = ShownBeats(None, most=8, events=(100.0,))
    times = times_shown(shown, 0.5 * np.arange(400))
    assert times == sorted(times)
    assert [t for t in times if 100.0 <= t < 115.0] == [100.0 + 0.5 * k for k in range(30)]
    assert len(times) <= 1 + 8 + 30


@pytest.mark.parametrize("every", [None, 30.0])
def test_the_beats_on_both_sides_of_an_event_are_shown(every):
    """With a heart rate that varied, the flow of a pump fell over the minute before the pump stopped."""
    begins = 0.683 * np.arange(600)
    shown = ShownBeats(every, most=8, events=(100.0, 300.0, 307.0))
    times = times_shown(shown, begins)
    assert len(times) == len(set(times))
    for event in shown.events:
        assert {begins[begins < event][-1], begins[begins >= event][0]} <= set(times)


def test_a_beat_that_begins_at_an_event_is_the_first_after_it():
    times = times_shown(ShownBeats(30.0, events=(0.0, 10.0)), np.arange(20.0))
    assert times == [0.0, 9.0, 10.0]


def times_shown(shown, begins):
    for time in begins.tolist():
        shown.add_if_due(time, RecordedBeat(time, *(np.zeros(1),) * 3, {}, {}, np.zeros(1), None))
    return [beat.time for beat in shown.beats]
