"""A course through a circulatory arrest on V-A ECMO: what closed valves leave undetermined is blank."""

import json

import numpy as np
import pytest

from eclsim.cases.reading import read_mapping
from eclsim.course.course import course
from eclsim.course.figures import plot_course
from eclsim.course.files import course_object, write_tables
from eclsim.course.result import undetermined_in_words, undetermined_moments

CASE = {
    "format": 1,
    "patient": {
        "id": "arrest", "sex": "male", "age_years": 60, "height_cm": 175, "weight_kg": 75,
        "heart_rate_bpm": 80,
    },
    "ecmo": {
        "pump": "Rotaflow", "speed_rpm": 3600, "oxygenator": "Quadrox-i Adult", "mode": "VA",
        "drainage_fr": 23, "return_fr": 17,
    },
    "fluid": {},
}  # fmt: skip
NO_HEART = {"Emaxlv": 0.1, "Emaxrv": 0.1}
BLANK, KEPT = ("MAP", "PCWP", "EDVLV", "venous_pressure"), ("CO", "PF", "systemic_flow", "LVO")


@pytest.fixture(scope="module")
def arrest():
    event = {"at_min": 5, "set": {f"parameters.{key}": value for key, value in NO_HEART.items()}}
    return course(read_mapping(CASE | {"events": [event]}).case, minutes=15.0)


def test_undetermined_outputs_are_blank_and_the_others_are_there(arrest, tmp_path):
    """PCWP rose from 8 to 20 mmHg in twenty minutes, with the start of each search."""
    lost, minute = undetermined_moments(arrest), arrest["time_min"].to_numpy()
    assert lost[-1]
    assert not lost[minute < 5.0].any()
    assert arrest.attrs["converged"]
    for name in BLANK:
        assert (np.isnan(arrest[name].to_numpy()) == lost).all(), name
    for name in KEPT:
        assert np.isfinite(arrest[name].to_numpy()).all(), name
    written = course_object(arrest)
    assert written["one_of_many"] == lost.tolist()
    assert written["outputs"]["MAP"][-1] is None
    assert written["outputs"]["PF"][-1] > 4.0
    table = write_tables(arrest, tmp_path)[0].read_text().splitlines()
    places = [table[0].split(",").index(head) for head in ("MAP [mmHg]", "status")]
    assert [table[-1].split(",")[k] for k in places] == ["", "one_of_many"]


def test_no_alarm_is_made_from_them(arrest):
    """Alarms of pressures in the beats before say that they are not known later, not that all is well."""
    lost, minute = undetermined_moments(arrest), arrest["time_min"].to_numpy()
    alarms = [alarm for alarm in json.loads(arrest.attrs["alarms"]) if alarm["kind"] != "caution"]
    begin = minute[lost][0]
    assert {alarm["quantity"] for alarm in alarms if alarm["at_min"] >= begin} == set()
    (low,) = (one for one in alarms if one["quantity"] == "MAP" and one["kind"] == "alarm")
    assert "not determined from 00:05:" in low["sentence"]
    (said,) = (text for text in arrest.attrs["approximations"] if text.startswith("valves stay shut"))
    assert said in arrest.attrs["warnings"]
    assert "from 00:05 on: pressures and volumes that the case does not determine are left blank" in said


def test_the_figure_says_why_its_curves_have_gaps(arrest):
    (legend,) = (text.get_text() for text in plot_course(arrest).texts if "gaps in" in text.get_text())
    assert "valves stay shut, so that the case does not determine the number" in legend


def test_trapped_blood_has_no_settling_time():
    """The circulation was said to settle within 19543103493892 s."""
    still = course(read_mapping(CASE | {"parameters": NO_HEART}).case, minutes=1.0)
    assert undetermined_moments(still).all()
    assert 1.0 < still.attrs["settling_s"] < 300.0
    kinds = {alarm["quantity"] for alarm in json.loads(still.attrs["alarms"]) if alarm["kind"] != "caution"}
    assert kinds == {"aortic_valve_flow"}


def test_the_moments_are_named():
    minute, shut = np.arange(6.0), np.array([0, 1, 1, 0, 1, 1], dtype=bool)
    named = "valves stay shut from 00:01 to 00:03, from 00:04 on: "
    assert undetermined_in_words(minute, shut).startswith(named)
    assert undetermined_in_words(minute, ~shut & shut) == ""
