"""Whether a followed patient's estimate meets what was measured, and what moved with it."""

import numpy as np
import pytest

from eclsim.identification.after_update import Course, Miss, unmet
from eclsim.identification.filtering import GaussianMixture, InnovationTest
from eclsim.identification.points import Interval

ESTIMATE = Interval(3.94, 3.99, 4.04)
BEFORE = {"SP": 90.0, "MAP": 70.0, "CVP": 12.0, "PF": 3.9}
AFTER = {"SP": 66.0, "MAP": 58.0, "CVP": 19.0, "PF": 3.1}
DEVIATIONS = {"SP": -2.9, "MAP": -2.4, "CVP": 1.6, "PF": -4.4}


def test_a_used_measurement_that_the_estimate_does_not_meet_is_found():
    """A flow of 3.0 was "used", and the flow afterwards was 3.987 (3.938 to 4.036)."""
    after = GaussianMixture(np.ones(1), np.array([[3.99, 60.0, 15.0]]), np.diag([0.03, 3.0, 2.0])[None] ** 2)
    values, errors = np.array([3.0, 62.0, np.nan]), np.array([0.15, 3.0, np.inf])
    # The flow follows the arterial pressure, which is measured, too.
    slope = np.array([[-0.4, 0.0], [60.0, 0.0], [0.0, 30.0]])
    found = unmet(("PF", "MAP", "CVP"), values, errors, after, np.full(3, True), slope)
    assert found == {"PF": Miss("PF", 3.0, used=True, reachable=False)}
    said = found["PF"].sentence(ESTIMATE)
    assert said.startswith("PF: 3 L/min was used but cannot be met by the free parameters: the estimate")
    assert "3.99 (3.94 to 4.04), and its interval is not to be trusted" in said
    assert "tamponade" in said
    slope[0, 1] = -0.9  # and the venous pressure, which is not
    assert unmet(("PF", "MAP", "CVP"), values, errors, after, np.full(3, True), slope)["PF"].reachable


@pytest.mark.parametrize(
    ("miss", "words"),
    [
        (Miss("MAP", 40.0, used=True, reachable=True), "MAP: 40 mmHg was used but is not met: the estimate"),
        (Miss("MAP", 40.0, used=True, reachable=True), "changed faster than the drift"),
        (
            Miss("CO", 9.0, used=False, reachable=True),
            "CO: 9 L/min was not used; if it is right, the estimate",
        ),
    ],
)
def test_what_may_be_met_later_or_was_not_used_is_told_apart(miss, words):
    said = miss.sentence(ESTIMATE)
    assert words in said
    assert "model holds fixed" not in said


@pytest.mark.parametrize("reachable", [True, False])
def test_before_the_first_estimate_nothing_can_have_changed(reachable):
    said = Miss("PF", 3.0, used=True, reachable=reachable, is_first=True).sentence(ESTIMATE)
    assert "changed" not in said
    assert said.endswith("or the value is wrong")


def test_the_doubt_stays_until_the_output_is_measured_again():
    said = Miss("PF", 3.0, used=True, reachable=False).sentence_later("9:00")
    assert said.startswith("PF: 3 L/min at 9:00, the last measured, was not met by the estimate")


def moved_with(change=AFTER, deviations=DEVIATIONS):
    course = Course({})
    course.learn(BEFORE)
    return course.sudden_change("PF", change, deviations)


def test_a_flow_that_falls_together_with_others_is_a_sudden_change():
    """As in tamponade: the flow alone was called wrong."""
    said = moved_with()
    assert said == (
        "PF fell from 3.9 to 3.1 L/min, SP fell from 90 to 66 mmHg, MAP fell from 70 to 58 mmHg, CVP rose "
        "from 12 to 19 mmHg at the same time"
    )
    outputs = GaussianMixture(np.ones(1), np.zeros((1, 4)), 0.5 * np.eye(4)[None])
    errors = np.full(4, np.sqrt(0.5))
    test = InnovationTest.of(np.array([0.0, 0.0, 0.0, 8.0]), errors, outputs, np.full(4, True))
    message = test.message(tuple(AFTER), said)
    assert "a sudden change of the patient is likelier than a wrong value" in message
    assert "check it" not in message
    assert "check it" in test.message(tuple(AFTER))


@pytest.mark.parametrize(
    ("change", "deviations"),
    [
        (AFTER | {"CVP": 13.0}, DEVIATIONS),  # the arterial pressures are one kind
        (AFTER | {"PF": 3.8}, DEVIATIONS),
        (AFTER, DEVIATIONS | {"CVP": 0.2}),  # as forecast, as where the pump was slowed
        (AFTER, DEVIATIONS | {"MAP": 2.4, "SP": 2.9}),
    ],
)
def test_one_value_that_moves_alone_or_as_expected_is_none(change, deviations):
    assert moved_with(change, deviations) == ""
