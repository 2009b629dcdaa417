"""Beats that are not those of the patient who was measured."""

import numpy as np

import eclsim
from eclsim.cases import read_case
from eclsim.course.course import course
from eclsim.course.result import remarks_on_measurements
from eclsim.course.timeline import Timeline
from eclsim.outputs.uncertainty import misses_of, sentence_on_misses
from small_patient import PATIENT


def measured(folder, *settings, **values):
    file = folder / "case.toml"
    lines = "".join(f"{name} = {value}\n" for name, value in values.items())
    file.write_text(f"{PATIENT}\n[measurements]\n{lines}")
    return read_case(file, settings).case


def test_only_what_lies_beyond_the_error_of_measurement_is_a_miss():
    """A case with a measured mean pressure of 58 mmHg was simulated at 139 without a word."""
    beat = {"SP": 120.0, "CO": 4.0, "PCWP": float("nan")}
    assert sentence_on_misses({"SP": 118.0, "CO": 4.1, "PCWP": 30.0, "PF": 3.0}, beat) == ""
    said = sentence_on_misses({"SP": 70.0, "CO": 4.1}, beat)
    assert "this beat is not that of the patient who was measured (SP 70 measured, 120 here)" in said


def test_measurements_belong_to_the_settings_of_the_file(tmp_path):
    beat = {"SP": 120.0}
    assert misses_of(measured(tmp_path, SP=70), beat)
    assert misses_of(measured(tmp_path, SP=119), beat) == []
    assert misses_of(measured(tmp_path, "Rmc=0.9", SP=70), beat) == []


def test_results_in_python_and_courses_say_so_too(tmp_path):
    """Two patients of a table had one course, of neither, and only `eclsim simulate` said so."""
    case = measured(tmp_path, SP=40, CO=9)
    beat = eclsim.simulate(case)
    (said,) = [text for text in beat.attrs["warnings"] if "who was measured" in text]
    assert said.startswith("caution: this beat is not that of the patient")
    followed = course(case, minutes=2.0, every_min=2.0)
    (remark,) = [text for text in followed.attrs["cautions"] if "who was measured" in text]
    assert remark.startswith("the beat at 00:00 is not that of the patient")
    assert f"SP 40 measured, {float(beat.SP):.4g} here" in remark


def test_draws_are_not_compared(tmp_path):
    case, outputs = measured(tmp_path, SP=40), {"SP": np.array([120.0])}
    assert remarks_on_measurements(Timeline(case, 60.0), outputs)
    assert remarks_on_measurements(Timeline(case, 60.0, {"Rmc": 0.9}), outputs) == []
