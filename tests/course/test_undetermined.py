"""Courses through a circulatory arrest on V-A ECMO: blood behind closed valves follows from the beats before.

Where no beat before determines it, what depends on it is blank.
"""

import json

import numpy as np
import pytest

from eclsim.app.course import compute_course
from eclsim.app.state import PageState
from eclsim.cases.reading import read_mapping
from eclsim.cli.course import _cohort_text
from eclsim.course.beats import course_beats
from eclsim.course.course import course
from eclsim.course.figures import plot_course
from eclsim.course.files import cohort_object, course_object, write_tables
from eclsim.course.result import undetermined_in_words, undetermined_moments
from eclsim.outputs.gas import of_moving_blood

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
NO_HEART, HEART = {"Emaxlv": 0.1, "Emaxrv": 0.1}, {"Emaxlv": 2.5, "Emaxrv": 0.9}
BLANK, KEPT = ("MAP", "PCWP", "EDVLV", "venous_pressure"), ("CO", "PF", "systemic_flow", "LVO")


def heart_at(minute, values):
    return {"at_min": minute, "set": {f"parameters.{key}": value for key, value in values.items()}}


ARREST = CASE | {"parameters": HEART, "events": [heart_at(5, NO_HEART), heart_at(20, HEART)]}


@pytest.fixture(scope="module")
def arrest():
    return course(read_mapping(ARREST).case, minutes=25.0, every_min=1.0)


@pytest.fixture(scope="module")
def arrested():
    """A patient whose heart stands still from the first moment on."""
    return course(
        read_mapping(CASE | {"parameters": NO_HEART, "events": [heart_at(5, HEART)]}).case, minutes=8.0
    )


@pytest.mark.slow
def test_an_arrest_agrees_with_the_beats_one_after_the_other(arrest):
    """Steady beats are a minute ahead of the patient: the lungs fill as fluid returns to the blood."""
    names = ("MAP", "PCWP", "EDVLV", "venous_pressure", "PF")
    beats = course_beats(read_mapping(ARREST).case, minutes=25.0, every_min=0.25, outputs=names)
    assert not undetermined_moments(arrest).any()
    for minute, ahead in ((8.0, 0.3), (12.0, 0.2), (19.0, 0.15), (24.0, 0.1)):
        now = arrest.sel(time_min=minute, method="nearest")
        then = beats.sel(time_min=minute, method="nearest")
        for name, scale in (("MAP", 1.0), ("PCWP", 1.0), ("EDVLV", 4.0), ("venous_pressure", 1.0)):
            assert float(now[name]) == pytest.approx(float(then[name]), abs=ahead * scale), (minute, name)
        assert float(now["PF"]) == pytest.approx(float(then["PF"]), abs=0.01)
    settled = arrest["PCWP"].sel(time_min=19.0, method="nearest")
    assert float(settled) > float(arrest["PCWP"][0]) + 5.0, "blood gathers in the lungs"


@pytest.mark.slow
def test_alarms_are_made_of_the_pressures_of_an_arrest(arrest):
    alarms = json.loads(arrest.attrs["alarms"])
    (low,) = (one for one in alarms if one["quantity"] == "MAP" and one["kind"] == "alarm")
    assert "below 55 mmHg at 00:05:00, until 00:20:00" in low["sentence"]
    (trapped,) = (one for one in alarms if "gathered there when the valves closed" in one["sentence"])
    assert trapped["kind"] == "caution"
    assert "mL in the pulmonary vessels with the left atrium" in trapped["sentence"]
    assert not [text for text in arrest.attrs["warnings"] if text.startswith("valves stay shut")]


@pytest.mark.slow
def test_a_beat_in_which_the_pressure_falls_begins_at_its_systolic_pressure(arrest):
    """The beat of the arrest had a systolic pressure 19 mmHg below its diastolic one."""
    falls = arrest.sel(time_min=slice(5.0, 5.1))
    assert (falls["beat_by_beat"] == 1).any()
    assert (arrest["pulse_pressure"].to_numpy() >= 0.0).all()
    assert (arrest["SP"].to_numpy() >= arrest["MAP"].to_numpy()).all()


@pytest.mark.slow
def test_the_page_shows_the_beat_of_an_arrest_with_the_same_pressures(arrest):
    page = compute_course(PageState(read_mapping(ARREST).case), 60)
    minute = page.times[int(np.searchsorted(page.times, 12.0))]
    beat = page.beat(minute)
    shown = page.computed.result.sel(time_min=minute, method="nearest")
    assert beat.undetermined == ()
    assert beat.outputs["MAP"] == pytest.approx(float(shown["MAP"]), abs=0.02)
    assert beat.outputs["MAP"] == pytest.approx(float(arrest["MAP"].interp(time_min=minute)), abs=0.3)


@pytest.mark.slow
def test_undetermined_outputs_are_blank_and_the_others_are_there(arrested, tmp_path):
    """PCWP rose from 8 to 20 mmHg in twenty minutes, with the start of each search."""
    lost, minute = undetermined_moments(arrested), arrested["time_min"].to_numpy()
    assert (lost == (minute < 5.0)).all()
    assert arrested.attrs["converged"]
    for name in BLANK:
        assert (np.isnan(arrested[name].to_numpy()) == lost).all(), name
    for name in KEPT:
        assert np.isfinite(arrested[name].to_numpy()).all(), name
    written = course_object(arrested)
    assert written["one_of_many"] == lost.tolist()
    assert written["outputs"]["MAP"][0] is None
    assert written["outputs"]["PF"][0] > 4.0
    table = write_tables(arrested, tmp_path)[0].read_text().splitlines()
    places = [table[0].split(",").index(head) for head in ("MAP [mmHg]", "status")]
    assert [table[1].split(",")[k] for k in places] == ["", "one_of_many"]


@pytest.mark.slow
def test_no_alarm_is_made_from_them(arrested):
    """Nor are pressures said to be well: a warning names the times."""
    alarms = [alarm for alarm in json.loads(arrested.attrs["alarms"]) if alarm["kind"] != "caution"]
    assert {alarm["quantity"] for alarm in alarms if alarm["at_min"] < 5.0} == {"aortic_valve_flow"}
    (said,) = (text for text in arrested.attrs["approximations"] if text.startswith("valves stay shut"))
    assert said in arrested.attrs["warnings"]
    assert (
        "from 00:00 to 00:05: pressures and volumes that the case does not determine are left blank" in said
    )


@pytest.mark.slow
def test_the_figure_says_why_its_curves_have_gaps(arrested):
    (legend,) = (text.get_text() for text in plot_course(arrested).texts if "gaps in" in text.get_text())
    assert "valves stay shut, so that the case does not determine the number" in legend


@pytest.mark.slow
def test_blood_that_stands_still_is_not_drawn_as_mixed_venous(arrest):
    """The saturation of the pulmonary artery was drawn at 100 % during an arrest."""
    stood = np.abs(arrest["pulmonary_flow"].to_numpy()) < 1e-3
    assert stood.any()
    assert not stood.all()
    of_arteries = arrest["MAP"].copy(data=np.full(stood.size, 70.0))
    numbers = {"SvO2": of_arteries.to_numpy(), "pulmonary_flow": arrest["pulmonary_flow"].to_numpy()}
    of_pulmonary_artery = of_arteries.copy(data=of_moving_blood(numbers)["SvO2"])
    fig = plot_course(arrest.assign(SvO2=of_pulmonary_artery, SaO2=of_arteries))
    curves = {line.get_label(): line.get_ydata() for ax in fig.axes for line in ax.lines}
    assert (np.isnan(curves["pulmonary artery"]) == stood).all()
    assert np.isfinite(curves["arteries"]).all()
    assert any("its blood stands still" in text.get_text() for text in fig.texts)


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


@pytest.mark.slow
def test_the_table_of_a_cohort_says_for_whom_no_alarm_can_be_known(arrest, arrested):
    content = cohort_object([arrested, arrest])
    assert [one["undetermined_from_min"] for one in content["courses"]] == [0.0, None]
    row, other = _cohort_text(content).splitlines()[1:3]
    assert "valves stay shut from 00:00: alarms unknown there" in row
    assert "unknown" not in other
