"""Sentences of courses that go on where a patient would not."""

import json

import numpy as np
import pytest

from eclsim.course.alarms import alarms, alarms_text, finding_after_arrest, not_survived
from eclsim.course.result import impossible_among
from eclsim.devices.description import Finding


def pressures(*values):
    return {"MAP": np.array(values, dtype=float)}


def test_a_course_says_from_when_on_it_describes_no_patient():
    """After too much ultrafiltration a course went on for hours at 2 mmHg."""
    minute = np.array([0.0, 60.0, 66.0, 80.0, 120.0, 130.0])
    (alarm,) = not_survived(minute, pressures(80, 70, 28, 5, 12, 60))
    assert (alarm.at_min, alarm.until_min, alarm.kind, alarm.worst) == (66.0, None, "collapse", 5.0)
    said = alarm.sentence
    assert said.startswith("mean arterial pressure below 30 mmHg from 01:06 for more than 10 min")
    assert "nothing after it describes a patient, even if pressure returns" in said


def test_a_short_fall_is_survived():
    minute = np.array([0.0, 4.0, 8.0, 20.0, 25.0, 29.0])
    assert not_survived(minute, pressures(80, 20, 25, 60, 20, 25)) == []
    assert not_survived(minute, {"CO": np.zeros(6)}) == []


def test_alarms_without_a_limit_are_finite_json():
    """Files with NaN in the attribute `alarms` could not be read by strict readers of JSON."""
    paced = Finding.without_limit("warning", "heart_rate", 90.0, "paced", "heart_rate", "CO")
    nothing = Finding.without_limit("alarm", "VO2", float("nan"), "no steady gases", "VO2")
    minute = np.array([0.0, 60.0, 66.0, 80.0])
    outputs = pressures(80, 70, 28, 5) | {"heart_rate": np.full(4, 90.0), "VO2": np.full(4, np.nan)}
    broken = [*not_survived(minute, outputs), *alarms([[paced, nothing], [paced], [], []], outputs, minute)]
    written = json.loads(alarms_text(broken), parse_constant=pytest.fail)
    assert [(one["kind"], one["limit"], one["worst"]) for one in written] == [
        ("collapse", None, 5.0), ("alarm", None, None), ("warning", None, 90.0),
    ]  # fmt: skip
    assert (written[2]["at_min"], written[2]["until_min"]) == (0.0, 66.0)
    assert paced.concerns == ("heart_rate", "CO")


def test_an_alarm_ends_where_its_quantity_is_not_determined():
    """Pressures that are blank are not said to be well."""
    low = Finding("alarm", "MAP", 40.0, 55.0, "mean arterial pressure 40 mmHg, below 55 mmHg: organs")
    minute = np.array([0.0, 5.0, 6.0, 7.0])
    (alarm,) = alarms([[], [low], [], []], pressures(80, 40, np.nan, np.nan), minute)
    assert alarm.until_min == 6.0
    assert ", not determined from 00:06 on (40 mmHg at worst)" in alarm.sentence


def test_moments_after_an_arrest_that_is_not_survived_are_no_patients():
    """The page said "no limit is broken" of a patient given blood after two hours without circulation."""
    minute = np.array([0.0, 60.0, 66.0, 80.0, 120.0, 130.0])
    broken = not_survived(minute, pressures(80, 70, 28, 5, 12, 60))
    low = Finding("alarm", "MAP", 40.0, None, "a pressure without a limit")
    marked = impossible_among([[low] for _ in minute], broken, minute)
    assert marked.values.tolist() == [0, 0, 0, 1, 1, 1]
    assert not impossible_among([[]] * 6, [], minute).values.any()
    text = alarms_text([*broken, *alarms([[low]] * 6, pressures(80, 70, 28, 5, 12, 60), minute)])
    assert finding_after_arrest(text, 70.0, 28.0) == []
    (finding,) = finding_after_arrest(text, 130.0, 60.0)
    assert (finding.kind, finding.quantity, finding.value) == ("collapse", "MAP", 60.0)
    assert "does not survive" in finding.sentence
