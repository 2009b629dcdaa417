"""What an answer of several settings says of the goals at their bounds."""

from eclsim.goals.goal import Goal, Setting
from eclsim.goals.result import GoalResult, message_of

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
