"""Settings that reach goals: what users may write, the smallest that do, goals that exclude each other."""

import json
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import eclsim
from eclsim.cases.presets import PRESETS
from eclsim.cases.reading import case_text, read_case, read_mapping
from eclsim.cli import main
from eclsim.course.timeline import case_with_settings
from eclsim.course.weaning import plan_weaning
from eclsim.goals import search
from eclsim.goals.goal import (
    Goal,
    GoalError,
    Setting,
    implicit_goals,
    is_kept_by_settings,
    read_goals,
    read_settings,
)
from eclsim.goals.result import GoalResult, broken_alarms_text, broken_goals, gravest, message_of
from eclsim.goals.search import reach
from eclsim.orbit.model import model_of
from eclsim.outputs.registry import all_outputs
from eclsim.outputs.results import simulate, simulate_many
from eclsim.outputs.signals import output_names, parameters_read
from eclsim.simulation.target_flow import with_speed

CASE = PRESETS["paper"].case()
VENO_VENOUS = Path(__file__).parents[2] / "examples" / "veno_venous_gas.toml"
OUTPUTS = ("MAP", "PF", "PCWP", "drainage_pressure")


def run_command(*arguments) -> int:
    with pytest.raises(SystemExit) as stop:
        main([str(a) for a in arguments])
    return int(stop.value.code or 0)


def test_goals_are_read_in_the_usual_spellings():
    text = "MAP >= 65, PCWP<18, PF 3..4.5, drainage_pressure = -80 to -20"
    assert read_goals(text, OUTPUTS) == (
        Goal("MAP", low=65.0), Goal("PCWP", high=18.0), Goal("PF", 3.0, 4.5),
        Goal("drainage_pressure", -80.0, -20.0),
    )  # fmt: skip
    assert read_goals("MAP > 65 mmHg, PF 3..4.5 l/min", OUTPUTS) == (
        Goal("MAP", low=65.0),
        Goal("PF", 3.0, 4.5),
    )
    assert read_goals("LVOT_VTI > 10", output_names(eclsim.circulation())) == (Goal("LVOT_VTI", low=10.0),)
    assert str(Goal("MAP", low=65.0)) == "MAP > 65"
    assert str(Goal("PF", 3.0, 4.5)) == "PF 3..4.5"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("MAP ~ 65", "'MAP ~ 65' is not a goal"),
        ("MAP > 9 kPa", "MAP > 9 kPa: MAP is in mmHg; did you mean 67.51 mmHg?"),
        ("MAP > 65 bananas", "MAP > 65 bananas: MAP is in mmHg"),
        ("PF > 4000 mL/min", "PF is in L/min; did you mean 4 L/min?"),
        ("MAPP > 65", "no such output; did you mean MAP"),
        ("MAP 70..65", "the first must not be larger"),
        ("MAP > 65, MAP < 80", "two goals; write both bounds as MAP LOW..HIGH"),
        ("", "'' is not a goal"),
        ("MAP > 8.7", "15 to 250 mmHg is the measurable range; did you mean 8.7 kPa = 65.26 mmHg?"),
        ("MAP > 1e9", "15 to 250 mmHg is the measurable range"),
        ("PF > 4000", "did you mean 4000 mL/min = 4 L/min?"),
        ("MAP > 65,5", "'MAP > 65,5' is not a goal"),
        ("MAP > 65,5", "did you mean MAP > 65.5?"),
        ("MAP > 1e400", "MAP: a goal without a finite bound"),
    ],
)
def test_what_cannot_be_meant_is_refused(text, message):
    with pytest.raises(GoalError, match=message.replace(".", r"\.")):
        read_goals(text, OUTPUTS)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("SaO2 > 0.9", "SaO2 > 0.9: 5 to 100 % is the measurable range; did you mean 0.9 = 90 %?"),
        ("SaO2_lower > 0.9", "did you mean 0.9 = 90 %?"),
        ("PaCO2 < 5.3", "did you mean 5.3 kPa = 39.75 mmHg?"),
        ("recirculation_fraction < 20", "is in fractions of 1; did you mean 0.2?"),
        ("O2ER < 30", "is in fractions of 1; did you mean 0.3?"),
        ("ejection_fraction_lv > 0.4", "is in %; did you mean 40 %?"),
        ("DO2 > 0.5", "DO2 is in mL/min; did you mean 500 mL/min?"),
    ],
)
def test_goals_in_other_units_are_refused(text, message):
    """SaO2 > 0.9 was reached at a SaO2 of 40 %: the alarm kept unasked gives way to a goal."""
    with pytest.raises(GoalError, match=re.escape(message)):
        read_goals(text, list(all_outputs()))


def test_settings_have_the_ranges_of_their_knobs_or_their_own():
    values = parameters_read(model_of(CASE).circuit)
    (speed,) = read_settings(None, CASE, values)
    assert speed == Setting("ecmo.speed_rpm", 1000.0, 5000.0, "rpm")
    named = read_settings("ecmo.speed_rpm=2000..4000, Rmc", CASE, values)
    assert named[0] == Setting("ecmo.speed_rpm", 2000.0, 4000.0, "rpm")
    assert (named[1].low, named[1].high) == (0.02, 8.0)
    with pytest.raises(GoalError) as caught:
        read_settings("ecmo.sped_rpm, Rmc=3..1, Cao, Cao", CASE, values)
    assert "did you mean ecmo.speed_rpm" in caught.value.mistakes[0]
    assert "LOW..HIGH" in caught.value.mistakes[1]
    assert caught.value.mistakes[-1] == "Cao: given twice"


def test_a_setting_of_a_section_that_the_case_lacks_says_how_to_have_it():
    with pytest.raises(GoalError, match=r"no section \[drugs\].* --set drugs\.noradrenaline=VALUE"):
        read_settings("drugs.noradrenaline", CASE, parameters_read(model_of(CASE).circuit))


FLOW = "PF > 4, drainage_pressure > -80, MAP > 20"


@pytest.fixture(scope="module")
def flow():
    return reach(CASE, FLOW)


@pytest.mark.slow
def test_the_lowest_speed_for_a_flow_is_that_of_the_search_for_a_flow(flow):
    """Two independent ways: sequential linear programs on derivatives, and false position on values."""
    assert flow.reached
    assert CASE.ecmo is not None
    searched = CASE.model_copy(
        update={"ecmo": CASE.ecmo.model_copy(update={"flow_l_min": 4.0, "speed_rpm": None})}
    )
    _, speed = with_speed(searched)
    assert speed is not None
    assert flow.values[0] == pytest.approx(speed.speed_rpm, abs=0.01)
    at_bound, *others = flow.goals
    assert (at_bound.met, at_bound.binding) == (True, True)
    assert [(other.met, other.binding) for other in others] == [(True, False)] * 2
    assert "smaller settings would break PF > 4" in flow.message


@pytest.mark.slow
def test_slopes_are_those_of_neighbouring_beats(flow):
    speeds = flow.values[0] + np.array([-1.0, 1.0])
    beside = simulate_many(CASE, {"ecmo.speed_rpm": speeds}, ("PF", "drainage_pressure", "MAP"))
    for goal in flow.goals:
        difference = np.diff(beside[goal.goal.output].to_numpy())[0] / 2.0
        assert goal.slopes["ecmo.speed_rpm"] == pytest.approx(difference, rel=1e-3)


@pytest.mark.slow
def test_the_result_is_the_beat_at_these_settings(flow):
    model = model_of(CASE).with_values({"ecmo.speed_rpm": flow.values[0]})
    beat = simulate(model)
    for goal in flow.goals:
        assert goal.value == pytest.approx(float(beat[goal.goal.output]), rel=1e-6)
    assert flow.outputs["MAP"] == pytest.approx(float(beat["MAP"]), rel=1e-6)


@pytest.mark.slow
def test_goals_that_exclude_each_other_are_named():
    result = reach(CASE, "PF > 5.5, drainage_pressure > -60, MAP > 20")
    assert not result.reached
    missed, stops, met = result.goals
    assert (missed.met, met.met, met.binding) == (False, True, False)
    assert stops.binding
    assert list(result.without) == ["drainage_pressure > -60"] or len(result.without) == 2
    assert any(str(goal) in result.message for goal in result.without)


@pytest.mark.slow
def test_a_goal_out_of_reach_alone_ends_at_the_end_of_the_range():
    result = reach(CASE, "PF > 9")
    assert not result.reached
    assert result.values == pytest.approx((5000.0,))
    assert "ecmo.speed_rpm at its highest" in result.message
    assert not result.without


def test_bounds_beyond_which_no_patient_can_be_hold_unasked():
    outputs = ("MAP", "ejection_fraction_lv", "venous_pressure")
    kept = implicit_goals(outputs, read_goals("MAP > 65", outputs), {}, {})
    assert {str(goal) for goal in kept} == {"ejection_fraction_lv 0..100", "venous_pressure > 0"}
    assert all(goal.because and goal.inside().because for goal in kept)
    assert [g.output for g in implicit_goals(outputs, [Goal("venous_pressure", low=-2.0)], {}, {})] == [
        "ejection_fraction_lv"
    ]
    assert not [
        g for g in implicit_goals((*outputs, "caval_filling"), [], {}, {}) if g.output == "venous_pressure"
    ]


@pytest.mark.slow
def test_a_pump_is_not_turned_up_beyond_what_veins_and_chambers_can_be():
    """A speed that reaches the goal exists, but with a ventricle emptier than empty."""
    bled = case_with_settings(CASE, {"fluid.extra_volume_ml": -180.0}, CASE)
    beyond = simulate(model_of(bled).with_values({"ecmo.speed_rpm": 4500.0}))
    assert beyond.attrs["impossible"]
    assert float(beyond["PF"]) > 5.3
    result = reach(bled, "PF > 5.3")
    assert not result.reached
    assert result.values[0] < 4500.0
    (stop,) = result.stops
    assert f"it is limited by {stop.goal} ({stop.goal.because})" in result.message
    there = simulate(model_of(bled).with_values({"ecmo.speed_rpm": result.values[0]}))
    assert not there.attrs["impossible"]
    assert float(there["right_atrial_pressure"]) >= 0.0


@pytest.mark.slow
def test_a_search_that_runs_out_of_steps_presents_no_smallest_setting(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(search, "MOST_STEPS", 1)
    result = reach(CASE, FLOW)
    assert (result.reached, result.status) == (False, "not_converged")
    assert result.message.startswith("not converged (the search was stopped after 1 steps)")
    assert not result.without
    file, out = tmp_path / "case.toml", tmp_path / "settings.json"
    file.write_text(case_text(CASE))
    assert run_command("settings", file, "--goal", "PF > 4", "--json", out) == 1
    content = json.loads(out.read_text())
    assert (content["reached"], content["status"]) == (False, "not_converged")


@pytest.mark.slow
def test_a_search_that_ends_where_no_beat_is_steady_is_no_answer(flow, monkeypatch):
    point = search._PatientModel.point
    step = 5000.0 / (search.SCAN_VALUES[1] - 1)
    edge = step * np.ceil(flow.values[0] / step) - 10.0

    def none_below(bedside, place, outputs):
        (speed,) = bedside.values_at(place[:, None])["ecmo.speed_rpm"]
        return None if speed < edge else point(bedside, place, outputs)

    monkeypatch.setattr(search._PatientModel, "point", none_below)
    result = reach(CASE, FLOW)
    assert result.status == "not_converged"
    assert all(goal.met for goal in result.goals)
    assert result.message.startswith("not converged (next to these settings, no steady beat was found)")


@pytest.mark.slow
def test_two_settings_meet_two_goals_and_the_first_is_the_dearest():
    result = reach(
        CASE, "MAP 65..75, PF > 3.0, drainage_pressure > -150", vary="ecmo.speed_rpm=1500..5000, Rmc=0.5..1.5"
    )
    assert result.reached
    speed, resistance = result.values
    beside = simulate(model_of(CASE).with_values({"ecmo.speed_rpm": speed, "Rmc": resistance}))
    assert 65.0 <= float(beside["MAP"]) <= 75.0
    slower = simulate_many(
        CASE, {"ecmo.speed_rpm": np.full(5, speed - 5.0), "Rmc": np.linspace(0.5, 1.5, 5)}, ("MAP", "PF")
    )
    both = (slower["PF"] >= 3.0) & (slower["MAP"] >= 65.0) & (slower["MAP"] <= 75.0)
    assert not bool(both.any())


@pytest.mark.slow
def test_settings_are_tried_with_set_where_reflexes_act_around_the_case_as_written(tmp_path, capsys):
    """Nothing said that the speed found gives another pressure if it is written into the file."""
    file, out = tmp_path / "case.toml", tmp_path / "settings.json"
    file.write_text(f"{case_text(CASE)}\n[regulation]\nbaroreflex = 1.0\n")
    goal = float(simulate(read_case(file))["MAP"]) + 2.0
    assert run_command("settings", file, "--goal", f"MAP > {goal}", "--json", out) == 0
    assert (
        "reflexes act around the case as it is written: try the settings with --set"
        in capsys.readouterr().err
    )
    (found,) = json.loads(out.read_text())["settings"]
    tried = read_case(file, [f"{found['name']}={found['value']!r}"])
    assert float(simulate(tried)["MAP"]) == pytest.approx(goal, abs=1e-3)
    given = re.search("speed_rpm = .*", file.read_text())
    assert given is not None
    file.write_text(file.read_text().replace(given[0], f"speed_rpm = {found['value']}"))
    assert abs(float(simulate(read_case(file))["MAP"]) - goal) > 0.5


@pytest.mark.slow
def test_all_mistakes_are_said_at_once_and_the_command_ends_with_two(tmp_path, capsys):
    file = tmp_path / "case.toml"
    file.write_text(
        Path(eclsim.__file__).with_name("validation").joinpath("data/cases/s4_crrt_g_3425.toml").read_text()
    )
    with pytest.raises(GoalError) as caught:
        reach(file, "MAPP > 65", vary="Rmcc")
    assert len(caught.value.mistakes) == 2
    assert run_command("settings", file, "--goal", "MAPP > 65") == 2
    assert "did you mean" in capsys.readouterr().err
    out = tmp_path / "settings.json"
    assert run_command("settings", file, "--goal", "PF > 9", "--json", out) == 1
    content = json.loads(out.read_text())
    assert content["reached"] is False
    assert content["goals"][0]["high"] is None


@pytest.mark.slow
def test_with_gas_the_sweep_is_turned_too():
    """The lowest speed for a saturation: at less, no sweep within the bounds of PaCO2 reaches it."""
    file = VENO_VENOUS
    result = reach(file, "SaO2 > 90, PaCO2 30..45")
    assert result.reached
    assert [setting.name for setting in result.settings] == ["ecmo.speed_rpm", "ecmo.sweep_l_min"]
    speed, sweep = result.values
    sweeps = np.append(np.linspace(1.5, 6.0, 10), sweep)
    beside = simulate_many(
        read_case(file),
        {"ecmo.speed_rpm": np.append(np.full(10, speed - 5.0), speed), "ecmo.sweep_l_min": sweeps},
        ("SaO2", "PaCO2"),
    )
    allowed = (beside["PaCO2"] >= 30.0) & (beside["PaCO2"] <= 45.0)
    reached = allowed & (beside["SaO2"] >= 90.0)
    assert int(allowed.sum()) > 3
    assert list(np.flatnonzero(reached)) == [10]


def test_gases_that_are_nowhere_in_the_ranges_are_named():
    case = read_case(VENO_VENOUS).case
    gas = case.gas.model_copy(update={"shunt_fraction": 1.0})
    result = reach(case.model_copy(update={"gas": gas}), "SaO2 > 90", vary="ecmo.sweep_l_min=0..0.000001")
    assert result.status is search.ReachStatus.NO_STEADY_GASES
    assert "less than a tenth of the oxygen" in result.message
    assert np.isnan(result.values).all()


@pytest.mark.slow
def test_the_slowest_pump_that_keeps_a_pressure_does_not_carry_blood_backwards():
    result = reach(CASE, "MAP > 20")
    assert result.outputs["PF"] == pytest.approx(0.5, abs=1e-3)
    assert any(stop.goal.output == "PF" for stop in result.stops)
    assert "clots in the oxygenator" in result.message
    open_label = implicit_goals(("PF",), [], {}, {})
    assert [(g.output, g.low) for g in open_label] == [("PF", 0.0)]


@pytest.mark.slow
def test_a_goal_of_flow_leaves_the_sweep_alone_and_alarms_are_in_the_first_words():
    """The smallest sweep for a flow is none: an answer at a saturation of 23 %, called reached."""
    found = reach(VENO_VENOUS, "PF > 4")
    assert [one.name for one in found.settings] == ["ecmo.speed_rpm"]
    assert found.outputs["SaO2"] > 85.0
    slow = reach(VENO_VENOUS, "PF < 3")
    assert slow.goals[0].value > -1e-4
    assert "SaO2" in slow.message.partition("beyond alarm limits")[0]


def test_bounds_of_settings_lie_in_the_allowed_range():
    with pytest.raises(GoalError, match=r"gas.shunt_fraction = -1..0.5: outside the allowed range"):
        reach(VENO_VENOUS, "PF > 4", vary="gas.shunt_fraction=-1..0.5")


@pytest.mark.slow
def test_no_alarm_of_gases_is_raised_that_the_case_does_not_raise():
    """The smallest speed for PaCO2 alone left a saturation of 40 %."""
    found = reach(VENO_VENOUS, "PaCO2 < 45")
    assert found.outputs["SaO2"] >= 80.0
    assert [stop.goal.output for stop in found.stops] == ["SaO2"]
    asked = reach(VENO_VENOUS, "PaCO2 < 45, SaO2 > 30")
    assert asked.outputs["SaO2"] < 80.0


@pytest.mark.slow
def test_a_patient_is_not_hyperventilated_to_spare_pump_speed(tmp_path, capsys):
    """For SaO2 alone the sweep rose until PaCO2 was 29.7 mmHg, which the answer did not even list."""
    found = reach(VENO_VENOUS, "SaO2 > 92")
    assert found.reached
    assert found.outputs["PaCO2"] == pytest.approx(30.0, abs=1e-3)
    (stop,) = found.stops
    assert str(stop.goal) == "PaCO2 > 30"
    assert "PaCO2 > 30 (the brain's vessels constrict" in found.message
    assert [str(kept.goal) for kept in found.kept] == ["PaCO2 30..60", "pHa 7.2..7.55"]
    there = [found.outputs["PaCO2"], found.outputs["pHa"]]
    assert [kept.value for kept in found.kept] == pytest.approx(there, rel=1e-9)
    asked = reach(VENO_VENOUS, "SaO2 > 92, PaCO2 20..45")
    assert asked.outputs["PaCO2"] < 30.0
    assert asked.values[0] < found.values[0]
    assert [kept.goal.output for kept in asked.kept] == ["pHa"]
    out = tmp_path / "settings.json"
    assert run_command("settings", VENO_VENOUS, "--goal", "SaO2 > 92", "--json", out) == 0
    assert re.search(r"PaCO2 30\.\.60 \(by default\) +30 +mmHg +yes +yes", capsys.readouterr().out)
    first = json.loads(out.read_text())["kept"][0]
    assert (first["output"], first["low"], first["high"]) == ("PaCO2", 30.0, 60.0)


def test_warning_limits_of_carbon_dioxide_hold_only_where_it_may_be_changed_and_the_patient_keeps_them():
    outputs, present = ("PaCO2", "pHa", "SaO2"), {"PaCO2": 38.0, "pHa": 7.4, "SaO2": 90.0}
    sweep, speed = Setting("ecmo.sweep_l_min", 0.0, 12.0), Setting("ecmo.speed_rpm", 1000.0, 5000.0)
    ventilation = Setting("gas.alveolar_ventilation_l_min", 0.5, 8.0)

    def kept(settings, asked="SaO2 > 88", **changed):
        goals = read_goals(asked, outputs)
        return {str(one) for one in implicit_goals(outputs, goals, present | changed, {}, settings)}

    alarms = {"PaCO2 < 80", "pHa > 7", "pHa < 7.65"}
    warnings = {"PaCO2 > 30", "PaCO2 < 60", "pHa > 7.2", "pHa < 7.55"}
    assert kept([speed]) == alarms
    assert kept([speed, sweep]) == kept([ventilation]) == alarms | warnings
    assert kept([sweep], PaCO2=65.0) == (alarms | warnings) - {"PaCO2 < 60"}
    assert kept([sweep], asked="PaCO2 25..70") >= warnings - {"PaCO2 > 30", "PaCO2 < 60"}
    assert not kept([sweep], asked="PaCO2 25..70") & {"PaCO2 > 30", "PaCO2 < 60", "PaCO2 < 80"}


def test_of_a_warning_and_an_alarm_that_are_both_broken_only_the_alarm_is_named():
    goals = [Goal("PaCO2", high=80.0), Goal("PaCO2", high=60.0), Goal("PaCO2", low=30.0)]
    for value, named in ((90.0, "PaCO2 < 80"), (70.0, "PaCO2 < 60"), (20.0, "PaCO2 > 30")):
        assert [str(one.goal) for one in gravest(broken_goals({"PaCO2": value}, goals))] == [named]
    both = [GoalResult(goal, 90.0, goal.low > 0.0, binding=True, slopes={}) for goal in goals]
    said = message_of([Setting("s", 0.0, 1.0)], {"s": 0.5}, both, {}, "")
    assert said.startswith("PaCO2 < 80 is not reached: the best is 90 mmHg")


@pytest.mark.slow
def test_a_goal_that_nothing_moves_is_refused():
    case = read_case(VENO_VENOUS).case
    ecmo = case.as_mapping()["ecmo"] | {"pump": {"roller_l_min": 4.0}}
    ecmo.pop("speed_rpm")
    rolled = read_mapping(case.as_mapping() | {"ecmo": ecmo}).case
    with pytest.raises(GoalError, match=r"MAP: not affected by ecmo.sweep_l_min"):
        reach(rolled, "MAP > 65")


@pytest.mark.slow
def test_a_goal_is_looked_for_where_only_other_settings_move_it():
    # At its own speed the LVAD keeps the aortic valve shut: LVO is 0 with a slope of 0.
    patient = {"id": "P", "sex": "female", "age_years": 70, "heart_rate_bpm": 90}
    parts = {"patient": patient, "parameters": {"Emaxlv": 0.5, "Emaxrv": 0.3}}
    pump = {"pump": "HM3", "speed_rpm": 5000, "inlet_site": "lv", "outlet_site": "ao"}
    case = read_mapping({"format": 1, "lvad": pump} | parts).case
    assert float(simulate(model_of(case))["LVO"]) == pytest.approx(0.0, abs=1e-3)
    found = reach(case, "LVO 0.2..0.3")
    assert found.reached
    speeds = np.linspace(3000.0, 5000.0, 21)
    ejected = simulate_many(model_of(case), {"lvad.speed_rpm": list(speeds)}, outputs=["LVO"])["LVO"].values
    below, above = speeds[ejected > 0.3].max(), speeds[ejected < 0.2].min()
    assert below < found.values[0] < above
    assert found.outputs["LVO"] == pytest.approx(0.3, abs=1e-4)


@pytest.mark.slow
def test_a_search_that_ends_where_valves_stay_shut_says_so():
    # "no steady beat was found" stood there, while there is one: it is one of many.
    patient = {"id": "P", "sex": "female", "age_years": 70, "heart_rate_bpm": 90}
    ecmo = {"pump": "Rotaflow", "speed_rpm": 3200, "oxygenator": "Quadrox-i Adult", "mode": "VA"}
    weak = {"Emaxlv": 0.5, "Emaxrv": 0.3, "Rmc": 0.8}
    raw = {"format": 1, "blood_volume_policy": "patient_held", "patient": patient, "parameters": weak}
    case = read_mapping(raw | {"ecmo": ecmo}).case
    found = reach(case, "MAP > 200")
    assert found.status is search.ReachStatus.NOT_CONVERGED
    assert "valves stay shut throughout the beat, so that it is one of many" in found.message
    beyond = model_of(case).with_values({"ecmo.speed_rpm": found.values[0] + 20.0})
    assert simulate(beyond).attrs["status"] == "one_of_many"


def test_beats_that_are_undetermined_everywhere_are_not_called_not_found():
    """It said "no steady beat was found anywhere in the ranges: steady beat found, but it is one of many"."""
    patient = {"id": "P", "sex": "male", "age_years": 60, "heart_rate_bpm": 80}
    ecmo = {"pump": "Rotaflow", "speed_rpm": 3000, "oxygenator": "Quadrox-i Adult", "mode": "VA"}
    raw = {"format": 1, "patient": patient, "ecmo": ecmo, "parameters": {"Emaxlv": 0.1}}
    found = reach(read_mapping(raw).case, "MAP > 65", vary="ecmo.speed_rpm=3500..4500")
    assert found.status is search.ReachStatus.NO_STEADY_BEAT
    assert found.message.startswith(
        "the steady beat is not determined anywhere in the ranges: steady beat found"
    )


@pytest.mark.slow
def test_a_limit_that_what_is_turned_cannot_keep_is_an_alarm_and_no_goal():
    """No dose kept `PF > 0.5`, which nobody had asked for: the dose for a pressure was "not reached"."""
    slow = CASE.with_section("ecmo", speed_rpm=1000.0)
    found = reach(slow, "MAP > 60", vary="Rmc=0.3..3")
    assert found.reached
    assert found.outputs["MAP"] == pytest.approx(60.0, abs=0.01)
    (alarm,) = found.not_kept
    assert (alarm.goal.output, alarm.goal.low, alarm.value) == ("PF", 0.5, found.outputs["PF"])
    assert found.outputs["PF"] < 0.5
    assert "PF > 0.5 (blood clots in the oxygenator at lower flows" in found.message
    assert "PF is beyond alarm limits" not in found.message
    assert found.as_object()["not_kept"][0]["output"] == "PF"
    (step,) = plan_weaning(CASE, [1000.0], keep="MAP > 60", vary="Rmc=0.3..3")
    assert step.reached
    assert "PF > 0.5" in step.message
    asked = reach(slow, "MAP > 60, PF > 0.5", vary="Rmc=0.3..3")
    assert not asked.reached
    assert not asked.not_kept


def test_a_flow_is_kept_by_its_own_pump_alone():
    flow, gases = Goal("PF", low=0.5, gives_way=True), Goal("PaCO2", high=60.0, gives_way=True)
    speed, dose = Setting("ecmo.speed_rpm", 0.0, 5000.0), Setting("drugs.noradrenaline", 0.0, 1.0)
    assert is_kept_by_settings(flow, [dose, speed])
    assert not is_kept_by_settings(flow, [dose])
    assert is_kept_by_settings(gases, [dose])
    assert is_kept_by_settings(Goal("PF", low=0.5), [dose])


@pytest.mark.slow
def test_what_is_not_reached_says_how_much_of_the_ranges_was_not_seen(monkeypatch):
    scan = search._PatientModel.scan

    def without_two(bedside, outputs):
        places, values, beat = scan(bedside, outputs)
        values[:, :2] = np.nan
        return places, values, SimpleNamespace(status=beat.status, determined=np.arange(9) > 1)

    monkeypatch.setattr(search._PatientModel, "scan", without_two)
    found = reach(CASE, "PF > 9", vary="ecmo.speed_rpm")
    assert (found.reached, found.tried, found.without_beat) == (False, 9, 2)
    assert "2 of the 9 points tried first over the ranges had no steady beat" in found.message


def test_a_start_without_derivatives_is_an_answer_and_no_error(monkeypatch, tmp_path):
    """The command ended without the JSON that was asked for."""
    monkeypatch.setattr(search._PatientModel, "point", lambda *_: None)
    file, out = tmp_path / "case.toml", tmp_path / "settings.json"
    file.write_text(case_text(CASE))
    assert run_command("settings", file, "--goal", "MAP > 65", "--json", out) == 1
    content = json.loads(out.read_text())
    assert content["status"] == "not_converged"
    assert "lack the derivatives" in content["message"]


@pytest.mark.slow
def test_the_search_follows_curved_bounds_to_an_optimum_with_fewer_goals_than_settings(monkeypatch):
    """Sweep, speed and FdO2 for one goal of gases: creeping along its bound took more than the most steps."""
    ends, search_from = [], search._search

    def kept(patient, goals, now):
        end = search_from(patient, goals, now)
        ends.append((end.unfinished, search._merit(goals, end.at.place, end.at.values)))
        return end

    monkeypatch.setattr(search, "_search", kept)
    result = reach(
        read_case(VENO_VENOUS), "PaCO2 33..41, PF > 3", vary="ecmo.sweep_l_min, ecmo.speed_rpm, ecmo.fdo2"
    )
    assert result.reached
    unfinished, merits = zip(*ends, strict=True)
    assert len(ends) == 3
    assert not any(unfinished)
    assert max(merits) - min(merits) < 1e-9


def test_a_share_out_of_reach_has_no_unit():
    dialysed = {"dialysate_ml_h": 1000.0, "replacement_post_ml_h": 1000.0}
    case = CASE.model_copy(update={"crrt": CASE.crrt.model_copy(update=dialysed)})
    result = reach(case, "filtration_fraction < 0.05", vary="crrt.flow_ml_min=100..300")
    assert "the best is 0.07937, with crrt.flow_ml_min = 300 mL/min" in result.message


def test_no_goal_is_advised_for_an_output_that_has_one():
    """A goal for PCWP was missed, and the same sentence advised to add a goal for PCWP."""
    where = "with the settings found"
    said = broken_alarms_text(["PCWP", "SaO2", "MAP", "MAP"], where, {"PCWP": False, "MAP": True})
    assert said == (
        "; with the settings found SaO2 is beyond alarm limits: add a goal for it"
        "; with the settings found MAP is beyond alarm limits, which its goal allows"
    )
    assert broken_alarms_text(["PCWP"], where, {"PCWP": False}) == ""
    assert broken_alarms_text(["PF", "MAP"], where, {}).endswith(
        "PF, MAP are beyond alarm limits: add a goal for them"
    )


def test_of_several_goals_that_are_missed_none_is_said_to_be_at_its_best():
    """SaO2 was 73 % in the file, and an answer with SaO2 > 95 and MAP < 90 said "the best is 68.03 %"."""
    speed = Setting("ecmo.speed_rpm", 1000.0, 5000.0, "rpm")
    missed = [
        GoalResult(Goal("SaO2", low=95.0), 68.03, met=False, binding=True, slopes={}),
        GoalResult(Goal("MAP", high=90.0), 111.1, met=False, binding=True, slopes={}),
    ]
    said = message_of([speed], {speed.name: 2986.0}, missed, {}, "")
    assert said.startswith("SaO2 > 95 and MAP < 90 are not reached: the sum of their misses")
    assert "is smallest at 68.03 % and 111.1 mmHg (either alone may come closer)" in said
    one = message_of([speed], {speed.name: 2986.0}, missed[:1], {}, "")
    assert one.startswith("SaO2 > 95 is not reached: the best is 68.03 %, with ecmo.speed_rpm = 2986 rpm")
