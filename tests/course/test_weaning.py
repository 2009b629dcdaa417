"""Weaning step by step: what is read at each speed, and which goals it keeps."""

import math

import pytest

from eclsim.cases import read_case
from eclsim.cases.reading import read_mapping
from eclsim.cases.settings import apply_settings
from eclsim.course.weaning import plan_weaning
from eclsim.goals.goal import GoalError
from eclsim.simulation.single import simulate
from small_patient import ON_ECMO


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    file = tmp_path_factory.mktemp("plan") / "case.toml"
    file.write_text(ON_ECMO)
    return read_case(file).case


@pytest.mark.parametrize(
    ("speeds", "vary", "message"),
    [
        ([], None, "numbers"), ("3000,2000", None, "numbers"), (["a"], None, "numbers"),
        ([3000], "drugs.noradrenaline=0..1, drugs.dobutamine=0..10", "one setting is sought"),
    ],
)  # fmt: skip
def test_weaning_that_cannot_be_meant_is_refused(own, speeds, vary, message):
    """Of two settings the dose of the second was not said."""
    with pytest.raises(GoalError, match=message):
        plan_weaning(own, speeds, keep=vary and "MAP > 65", vary=vary)


def test_weaning_reads_what_the_bedside_reads(own):
    steps = plan_weaning(own, [3000.0, 2500.0])
    assert [step.speed_rpm for step in steps] == [3000.0, 2500.0]
    assert steps[0].outputs["PF"] > steps[1].outputs["PF"]
    vti = steps[0].outputs["LVOT_VTI"]
    stroke = 1000.0 * steps[0].outputs["LVO"] / 80.0
    assert vti == pytest.approx(stroke / math.pi)


@pytest.mark.slow
def test_what_doppler_sees_in_the_outflow_tract_includes_what_leaks_back(own):
    """With a leaking aortic valve the integral was half of an echo's, and plans refused speeds for it."""
    leaking = read_mapping(own.as_mapping() | {"physiology": {"aortic_regurgitation_cm2": 0.2}}).case
    read = plan_weaning(leaking, [2500.0])[0].outputs
    ejected = simulate(apply_settings(leaking, ["ecmo.speed_rpm=2500"]))
    assert read["LVOT_VTI"] == pytest.approx(float(ejected["stroke_volume_lv"]) / math.pi, rel=0.01)
    assert read["LVOT_VTI"] > 1.3 * 1000.0 * read["LVO"] / 80.0 / math.pi


def test_a_speed_that_does_not_keep_a_goal_is_named_where_nothing_is_given_for_it(own):
    """Goals were refused without something to vary: nobody could ask down to which speed they hold."""
    plain = plan_weaning(own, [3000.0, 2500.0])
    bound = 0.5 * sum(step.outputs["PF"] for step in plain)
    fast, slow = plan_weaning(own, [3000.0, 2500.0], keep=f"PF > {bound:.3f}, MAP > 20")
    assert (fast.reached, fast.message, fast.setting) == (True, "", None)
    assert not slow.reached
    assert slow.message == f"PF > {bound:.4g} is not kept there: {slow.outputs['PF']:.4g} L/min"
    with pytest.raises(GoalError, match="no such output"):
        plan_weaning(own, [3000.0], keep="MAPP > 20")
    with pytest.raises(GoalError, match="needs goals to keep"):
        plan_weaning(own, [3000.0], vary="Rmc")


def test_a_flow_in_which_the_oxygenator_clots_is_said_where_the_goals_are_kept(own):
    """A pressure was kept "at every speed" with a pump that carried nothing."""
    (low,) = plan_weaning(own, [1000.0], keep="MAP > 20")
    assert low.reached
    assert low.outputs["PF"] < 0.5
    assert low.message.startswith("PF > 0.5 (blood clots in the oxygenator at lower flows")
    (stated,) = plan_weaning(own, [1000.0], keep="PF > 0.1, MAP > 20")
    assert stated.message.startswith("PF > 0.1 is not kept there")


@pytest.mark.slow
def test_a_beat_that_is_one_of_many_keeps_no_goal(own):
    """Its pressures are where the search began: they met a goal that `vary` refused to judge."""
    stunned = own.model_copy(update={"parameters": {"Emaxlv": 0.06, "Emaxrv": 0.05}})
    (asked,), (read,) = plan_weaning(stunned, [4200.0], keep="MAP > 20"), plan_weaning(stunned, [4200.0])
    assert not asked.reached
    assert "one of many" in asked.message
    assert read.outputs == asked.outputs


@pytest.mark.slow
def test_the_dose_that_keeps_a_pressure_rises_as_flow_falls(own):
    steps = plan_weaning(own, [3000.0, 2000.0], keep="MAP > 75", vary="drugs.noradrenaline=0..1")
    assert all(step.reached for step in steps)
    assert all(step.outputs["MAP"] >= 75.0 - 1e-2 for step in steps)
    assert steps[1].setting > steps[0].setting


def with_circuits(own, *names):
    """The case with several ECMO circuits of these names and no CRRT."""
    raw = {key: section for key, section in own.as_mapping().items() if key != "crrt"}
    plain = {key: raw["ecmo"][key] for key in ("pump", "speed_rpm", "oxygenator")}
    kinds = {name: plain | {"mode": mode} for name, mode in zip(names, ("VA", "VV"), strict=False)}
    return read_mapping(raw | {"ecmo": kinds}).case


def test_a_single_circuit_may_have_a_name(own):
    """It was refused with advice to write [ecmo]."""
    named = with_circuits(own, "a")
    (step,) = plan_weaning(named, [2500.0])
    (plain,) = plan_weaning(own, [2500.0])
    assert next(iter(step.outputs)) == "ecmo.a.PF"
    assert step.outputs["ecmo.a.PF"] == pytest.approx(plain.outputs["PF"], rel=0.02)
    assert plan_weaning(named, [2500.0], circuit="ecmo.a")[0].outputs == step.outputs


@pytest.mark.slow
def test_of_two_circuits_the_one_that_is_named_is_weaned(own):
    """The advice was to write [ecmo] for the circuit to wean, which excludes named ones."""
    both = with_circuits(own, "va", "vv")
    fast, slow = plan_weaning(both, [3000.0, 2000.0], circuit="ecmo.va")
    assert list(fast.outputs)[:2] == ["ecmo.va.PF", "ecmo.vv.PF"]
    assert slow.outputs["ecmo.va.PF"] < 0.7 * fast.outputs["ecmo.va.PF"]
    assert slow.outputs["ecmo.vv.PF"] == pytest.approx(fast.outputs["ecmo.vv.PF"], rel=0.1)


def test_weaning_says_which_circuits_may_be_named(own):
    both = with_circuits(own, "va", "vv")
    with pytest.raises(
        GoalError, match=r"which one to wean, such as --wean ecmo.va=.*allowed: ecmo.va, ecmo"
    ):
        plan_weaning(both, [3000.0])
    with pytest.raises(GoalError, match=r"'ecmo.xx': not in this case; allowed: ecmo.va, ecmo.vv"):
        plan_weaning(both, [3000.0], circuit="ecmo.xx")
