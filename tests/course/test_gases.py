"""Gases beat by beat: where they lead, what they change on the way, and what is handed over."""

import json

import numpy as np
import pytest

from eclsim.cases.reading import read_mapping
from eclsim.circuit.volumes import total_volumes
from eclsim.course.beats import beat_by_beat_course, course_beats
from eclsim.course.course import course
from eclsim.course.engine import CourseOptions
from eclsim.devices.ecmo_parts import OXYGENATORS
from eclsim.inputs.mistakes import CaseError
from eclsim.orbit.model import model_of
from eclsim.orbit.steady import Batch
from eclsim.outputs.steady_beat import steady_beat

CASE = {
    "format": 1,
    "patient": {"id": "gases", "sex": "male", "age_years": 60, "height_cm": 178, "weight_kg": 80,
                "heart_rate_bpm": 90},
    "ecmo": {"pump": "Rotaflow", "speed_rpm": 3200, "oxygenator": "Quadrox-i Adult", "mode": "VV",
             "sweep_l_min": 2.0, "fdo2": 1.0},
    "gas": {"haemoglobin_g_dl": 10.0, "vo2_ml_min": 220.0, "fio2": 0.5, "alveolar_ventilation_l_min": 2.0,
            "shunt_fraction": 0.77},
    "fluid": {"capillary_refill": False}, "solutes": {},
    "regulation": {"baroreflex": 0.5, "chemoreflex": 0.7, "hypoxic_vasodilation": 1.0,
                   "hypoxic_vasoconstriction": 1.0},
    "events": [{"at_min": 1, "set": {"ecmo.speed_rpm": 1500}}],
}  # fmt: skip
OUTPUTS = ("MAP", "heart_rate", "SaO2", "PaO2", "PaCO2", "VO2", "local_resistance_factor")
STEADY = CourseOptions(hand_over=False)
MINUTES = 7.0


@pytest.fixture(scope="module")
def march():
    """A pump turned down, every beat."""
    return beat_by_beat_course(read_mapping(CASE).case, MINUTES, outputs=OUTPUTS)


@pytest.fixture(scope="module")
def courses(march):
    """The same handed over, every beat, and steady beats alone."""
    case, shown = read_mapping(CASE).case, {"minutes": MINUTES, "outputs": OUTPUTS, "every_min": 0.5}
    return course(case, **shown), march.result, course(case, options=STEADY, **shown)


def at(result, minute, name):
    return float(np.interp(minute, result["time_min"], result[name]))


def test_beats_without_a_steady_gas_state_to_start_from_say_so():
    """The message was "no steady beat to start from: steady beat found"."""
    gas, ecmo = CASE["gas"] | {"shunt_fraction": 1.0}, CASE["ecmo"] | {"sweep_l_min": 0.0}
    case = {name: CASE[name] for name in ("format", "patient")} | {"ecmo": ecmo, "gas": gas}
    with pytest.raises(CaseError, match=r"^no steady state to start from: steady beat found, but no"):
        course_beats(read_mapping(case).case, minutes=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("oxygenator", OXYGENATORS)
def test_blood_in_every_oxygenator_has_a_volume(oxygenator):
    """One that is not known was not a number, and courses with gases ended at the first event."""
    ecmo = {**CASE["ecmo"], "oxygenator": oxygenator}
    crrt = {"flow_ml_min": 200, "access_site": "post_oxy", "return_site": "pre_oxy"}
    read = read_mapping({**CASE, "ecmo": ecmo, "crrt": crrt})
    model = model_of(read.case)
    volumes = total_volumes(model.circuit, model.values, [0.0] * len(model.circuit.compartments))
    assert np.isfinite(np.asarray(volumes, dtype=float)).all()
    assumed = OXYGENATORS[oxygenator].priming_volume_ml is None
    assert any("its blood volume is not known" in note.message for note in read.notes) is assumed


@pytest.mark.slow
def test_every_beat_leads_to_the_steady_beat_that_is_solved_with_its_gases(march):
    last, marching = march.beats[-1], march.marching
    values = {**last.values, **dict.fromkeys(marching.in_time.answers, np.nan)}
    goal = steady_beat(Batch(marching.circuit, values, 1, marching.policy), OUTPUTS)
    assert len(goal.coupled) == 3
    for name in OUTPUTS:
        assert float(march.result[name][-1]) == pytest.approx(float(goal.output(name)[0]), rel=2e-3)
        assert abs(at(march.result, 0.5, name) / float(goal.output(name)[0]) - 1.0) > 2e-3 or name == "VO2"


@pytest.mark.slow
def test_oxygen_falls_as_blood_is_renewed_and_the_circulation_follows(courses):
    _, beats, steady = courses
    start, end = (at(steady, minute, "SaO2") for minute in (0.5, MINUTES))
    left = [(at(beats, minute, "SaO2") - end) / (start - end) for minute in (1.2, 1.5, 2.0, 3.0, 5.0)]
    assert left[0] > 0.6
    assert left == sorted(left, reverse=True)
    assert 0.15 < left[2] < 0.75
    assert abs(left[4]) < 0.05
    # Steady beats have the blood and its reflexes of minutes later at once.
    assert abs(at(beats, 1.5, "heart_rate") - at(steady, 1.5, "heart_rate")) > 2.0


@pytest.mark.slow
def test_it_is_handed_over_and_goes_on_where_every_beat_does(courses):
    handed, beats, _ = courses
    (span,) = json.loads(handed.attrs["spans"])
    assert span["from_min"] == 1.0
    assert 2.5 < span["until_min"] < 7.0
    assert not any(sentence.startswith("not followed") for sentence in handed.attrs["warnings"])
    shown = handed["time_min"].to_numpy()
    shown = shown[(shown < 1.0) | (shown > 1.25)]
    for name, bar in (("MAP", 0.4), ("heart_rate", 0.6), ("SaO2", 0.7), ("PaCO2", 0.3)):
        distance = [abs(at(handed, t, name) - at(beats, t, name)) for t in shown if t < MINUTES - 0.1]
        assert max(distance) < bar


@pytest.mark.slow
def test_without_answers_to_gases_the_circulation_is_as_without_gases():
    bare = {key: value for key, value in CASE.items() if key not in ("gas", "solutes", "regulation")}
    oxygenator = {key: value for key, value in CASE["ecmo"].items() if key not in ("sweep_l_min", "fdo2")}
    gases = {**bare, "gas": CASE["gas"], "ecmo": CASE["ecmo"]}
    with_gas, without = (
        course_beats(read_mapping(raw).case, minutes=1.2) for raw in (gases, {**bare, "ecmo": oxygenator})
    )
    np.testing.assert_array_equal(with_gas["MAP"], without["MAP"])
    assert np.isfinite(with_gas["SaO2"]).all()
    assert float(with_gas["SaO2"][-1]) < float(with_gas["SaO2"][0]) - 1.0


@pytest.mark.slow
@pytest.mark.parametrize("ramp_min", [0, 6])
def test_apnoea_on_ecmo_is_followed_while_the_lungs_still_hold_oxygen(ramp_min):
    """Blood hardly changes until the oxygen is used up: that is not rest, and no steady beat is near."""
    ecmo = {**CASE["ecmo"], "mode": "VA", "speed_rpm": 3300, "sweep_l_min": 3.0}
    gas = {**CASE["gas"], "shunt_fraction": 0.4, "lung_volume_ml": 1000.0}
    event = {"at_min": 1, "set": {"gas.alveolar_ventilation_l_min": 0.0}, "ramp_min": ramp_min}
    own = {"fluid": CASE["fluid"], "ecmo": ecmo, "gas": gas, "parameters": {"Emaxlv": 0.6, "P0svn": 8.0}}
    read = read_mapping({key: CASE[key] for key in ("format", "patient")} | own | {"events": [event]})
    handed, every = (how(read.case, minutes=12.0, outputs=("SaO2",)) for how in (course, course_beats))
    for minute in (3.5, 5.0, 7.0, 8.0, 9.0):
        assert at(handed, minute, "SaO2") == pytest.approx(at(every, minute, "SaO2"), abs=0.5)
    assert at(every, 7.0, "SaO2") > 95.0
    assert float(handed["SaO2"][-1]) == pytest.approx(float(every["SaO2"][-1]), abs=0.5)


def test_without_a_section_gas_none_are_followed():
    """The oxygenator's law is there in any ECMO circuit; without lungs and tissue it means nothing."""
    case = {key: CASE[key] for key in ("format", "patient", "ecmo", "fluid", "events")}
    march = beat_by_beat_course(read_mapping(case).case, 1.05, outputs=("MAP",))
    assert march.marching.in_time is None
    assert march.marching.circuit.exchanges
    assert all(beat.gases is None for beat in march.beats)


LUNG = {**CASE, "ecmo": CASE["ecmo"] | {"mode": "VA", "speed_rpm": 3000, "sweep_l_min": 3.0}}
SWEPT = LUNG | {"events": [
    {"at_min": 1, "set": {"ecmo.sweep_l_min": 8}}, {"at_min": 1, "give": {"bleed_ml": 400}, "over_min": 3}
]}  # fmt: skip


def step_where_handed_back(result, name):
    """From the last beat of the only span, continued, to the first steady beat."""
    (span,) = json.loads(result.attrs["spans"])
    minute = result["time_min"].to_numpy()
    k, values = int(np.searchsorted(minute, span["until_min"] - 1e-6)), result[name].to_numpy()
    slope = (values[k - 1] - values[k - 2]) / (minute[k - 1] - minute[k - 2])
    return abs(values[k] - values[k - 1] - slope * (minute[k] - minute[k - 1]))


@pytest.mark.slow
def test_carbon_dioxide_goes_on_where_beats_hand_back_though_stores_still_empty(courses):
    case, shown = read_mapping(SWEPT).case, ("PaCO2",)
    swept = course(case, minutes=20.0, outputs=shown, every_min=0.5)
    every = course_beats(case, minutes=20.0, outputs=("PaCO2",), every_min=0.1)
    for result in (swept, courses[0]):
        assert step_where_handed_back(result, "PaCO2") < 0.1
    assert step_where_handed_back(swept, "solutes.tissue_pco2_mmHg") < 0.1
    (span,) = json.loads(swept.attrs["spans"])
    then = span["until_min"] + 0.5
    assert at(swept, then, "PaCO2") - at(swept, 20.0, "PaCO2") > 0.5
    for minute in np.arange(then, 19.5):
        assert at(swept, minute, "PaCO2") == pytest.approx(at(every, minute, "PaCO2"), abs=0.25)
