"""What an answer of several settings says of the goals at their bounds."""

import re

import pytest

from eclsim.cases.presets import PRESETS
from eclsim.cases.settings import apply_settings
from eclsim.devices.device import Naming
from eclsim.devices.ecmo import ECMO
from eclsim.goals.goal import Goal, Setting
from eclsim.goals.result import GoalResult, Reached, ReachStatus, led_by_narrow_lines, message_of
from eclsim.goals.search import reach
from eclsim.simulation.target_flow import FlowNotReachedError, with_speed

SPEED = Setting("ecmo.speed_rpm", 1000.0, 5000.0, "rpm")
SWEEP = Setting("ecmo.sweep_l_min", 0.0, 12.0, "L/min")
AT = {SPEED.name: 3531.0, SWEEP.name: 2.816}


def at_bound(goal, value, by_speed, by_sweep):
    return GoalResult(goal, value, True, True, {SPEED.name: by_speed, SWEEP.name: by_sweep})


SATURATION = at_bound(Goal("SaO2", 88.0), 88.0, 0.0044, 0.69)
PRESSURE = at_bound(Goal("MAP", 70.0), 70.0, -0.0021, -7.17)


def test_a_pressure_that_rises_with_smaller_settings_is_not_broken_by_them():
    message = message_of((SPEED, SWEEP), AT, (PRESSURE, SATURATION), {}, "")
    assert message.endswith("smaller settings would break SaO2 > 88; MAP > 70 is at the bound too")


def test_an_upper_bound_is_broken_where_the_output_rises_with_smaller_settings():
    carbon_dioxide = at_bound(Goal("PaCO2", 35.0, 45.0), 45.0, -0.003, -6.0)
    message = message_of((SPEED, SWEEP), AT, (carbon_dioxide, SATURATION), {}, "")
    assert message.endswith("smaller settings would break PaCO2 35..45 and SaO2 > 88")


def test_a_setting_at_its_lowest_cannot_be_smaller():
    pressure = at_bound(Goal("MAP", 70.0), 70.0, 0.02, -7.17)
    saturation = at_bound(Goal("SaO2", 88.0), 88.0, -0.001, 0.69)
    message = message_of((SPEED, SWEEP), AT | {SWEEP.name: 0.0}, (pressure, saturation), {}, "")
    assert message.endswith("smaller settings would break MAP > 70; SaO2 > 88 is at the bound too")


@pytest.mark.parametrize(
    ("clamps", "status", "message"),
    [
        ({}, ReachStatus.NOT_REACHED, "PF > 3 is not reached"),
        (
            {"return_clamp": 0.97}, ReachStatus.NOT_REACHED,
            "the return line of the ECMO is 97 % closed (ecmo.return_clamp = 0.97): open it first; as it is, "
            "PF > 3 is not reached",
        ),
        (
            {"drainage_clamp": 1.0, "return_clamp": 0.2}, ReachStatus.REACHED,
            "the drainage line of the ECMO is closed (ecmo.drainage_clamp = 1): open it first; as it is, "
            "PF > 3 is not reached",
        ),
        (
            {"return_clamp": 0.1}, ReachStatus.NOT_REACHED,
            "PF > 3 is not reached; the return line of the ECMO is 10 % closed (ecmo.return_clamp = 0.1)",
        ),
        ({"return_clamp": 0.1}, ReachStatus.REACHED, "PF > 3 is not reached"),
    ],
)  # fmt: skip
def test_a_nearly_closed_line_is_named_before_settings(clamps, status, message):
    """5000 rpm were the best against a return line that was kinked."""
    values = {f"ecmo.{clamp}": closed for clamp, closed in clamps.items()}
    found = Reached("P", (SPEED,), (5000.0,), (), status, "PF > 3 is not reached")
    assert led_by_narrow_lines(found, [ECMO.narrowed(Naming(ECMO), values)]).message == message


@pytest.mark.slow
def test_the_answer_for_a_kinked_line_begins_with_it():
    case = apply_settings(PRESETS["paper"].case(), ["ecmo.return_clamp=0.9"])
    kink = "the return line of the ECMO is 90 % closed (ecmo.return_clamp = 0.9)"
    found = reach(case, "PF > 4")
    assert not found.reached
    assert found.message.startswith(f"{kink}: open it first; as it is, PF > 4 is not reached: the best is ")
    with pytest.raises(FlowNotReachedError, match=re.escape(f" rpm); {kink}")):
        with_speed(case.with_section("ecmo", speed_rpm=None, flow_l_min=4.0))
