"""Removal of fluid: the fastest rate that keeps goals, and what comes after it."""

import math

import numpy as np
import pytest
import xarray as xr

from eclsim.cases import read_case
from eclsim.cases.settings import apply_settings
from eclsim.course.course import course, follow
from eclsim.course.handover import EarlyStop
from eclsim.course.removal import (
    ULTRAFILTRATION,
    BrokenGoal,
    Removal,
    bracketing_rates,
    fastest_rate,
    first_broken_goals,
    first_rates,
    plan_removal,
    removal_courses,
    removal_result,
    with_afterwards,
)
from eclsim.course.timeline import Timeline, case_with_settings
from eclsim.devices.renox import Renox
from eclsim.goals.goal import Goal, GoalError, read_goals
from eclsim.inputs.mistakes import CaseError
from small_patient import ON_ECMO


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    file = tmp_path_factory.mktemp("plan") / "case.toml"
    file.write_text(ON_ECMO)
    return read_case(file).case


@pytest.fixture(scope="module")
def removal(own):
    return plan_removal(own, 300.0, "MAP > 62, filtration_fraction < 1", hours=10.0)


@pytest.mark.slow
def test_the_rate_found_keeps_the_goal_and_a_faster_one_does_not(own, removal):
    assert removal.possible
    (limit,) = removal.limits
    assert limit.goal == "MAP > 62"
    for factor, kept in ((1.0, True), (1.1, False)):
        rate = factor * removal.fastest_ml_h
        case = apply_settings(own, [f"crrt.net_ultrafiltration_ml_h={rate!r}"])
        result = course(case, minutes=60.0 * 300.0 / rate, outputs=("MAP",))
        assert (float(result["MAP"].min()) > 62.0) is kept


@pytest.mark.slow
def test_the_result_says_it_in_words_and_data(removal):
    assert removal.message.startswith(f"300 mL can be removed at {removal.rate_ml_h:.0f} mL/h")
    assert removal.hours == pytest.approx(300.0 / removal.rate_ml_h)
    assert removal.as_object()["limits"][0]["goal"] == "MAP > 62"


@pytest.mark.slow
def test_a_filter_that_clots_removes_nothing_so_its_limit_holds_unasked(own):
    """A goal of one's own for it takes its place; what the rate means for the patient is said beside it."""
    found = plan_removal(own, 300.0, "MAP > 20", hours=10.0)
    assert found.limits[0].goal.startswith("filtration_fraction < 0.25 (blood thickens")
    case = apply_settings(own, [f"crrt.net_ultrafiltration_ml_h={found.fastest_ml_h!r}"])
    minutes = 60.0 * 300.0 / found.fastest_ml_h
    fraction = float(course(case, minutes=minutes)["filtration_fraction"].max())
    assert fraction == pytest.approx(0.25, rel=0.02)
    assert fraction <= 0.25
    assert found.rate_ml_h == 1.75 * 80.0
    assert not any("fewer critically ill patients" in line for line in found.warnings)
    assert any("refill is too quick" in line for line in found.warnings)
    assert "fluid is removed without a reflex" in found.warnings[-1]
    freer = plan_removal(own, 300.0, "MAP > 20, filtration_fraction < 0.4", hours=10.0)
    assert freer.fastest_ml_h > 1.3 * found.fastest_ml_h


@pytest.mark.slow
def test_a_goal_whose_output_has_no_value_is_not_kept():
    goals, status = read_goals("DO2 > 400", ["DO2"]), ("time_min", ["converged"] * 3)
    result = xr.Dataset(
        {"DO2": ("time_min", [450.0, np.nan, 440.0]), "status": status}, {"time_min": [0.0, 1.0, 2.0]},
        {"converged": True, "message": ""},
    )  # fmt: skip
    (only,) = first_broken_goals(goals, result)
    assert (only.goal, only.at_min) == ("no value of DO2", 1.0)
    sealed = result.assign(status=("time_min", ["one_of_many", "converged", "converged"]))
    (only,) = first_broken_goals(goals, sealed)
    assert only.goal.startswith("the beat is one of many")
    assert only.at_min == 0.0


@pytest.mark.slow
def test_a_goal_that_is_broken_from_the_start_cannot_be_kept(own):
    result = plan_removal(own, 300.0, "MAP > 120", hours=10.0)
    assert not result.possible
    assert math.isnan(result.rate_ml_h)
    assert "cannot be removed" in result.message
    assert "MAP > 120 is broken from the start (" in result.message
    assert result.message.endswith("mmHg)")


@pytest.mark.slow
def test_a_march_ends_where_it_breaks_a_goal(own):
    """10 L from a patient of 68 kg were marched to their end, mostly in a patient without plasma: 105 s."""
    early_stop = EarlyStop(("MAP",), lambda beat: beat["MAP"] < 65.0, [60.0])
    seen = [(0.0, 70.0), (50.0, 64.0), (59.0, 63.0), (61.0, 66.0), (110.0, 64.0), (121.0, 63.0)]
    assert [early_stop.is_over(0, time, {"MAP": value}) for time, value in seen] == [False] * 5 + [True]
    goals = read_goals("MAP > 78", ["MAP"])
    key, rate = f"crrt.{ULTRAFILTRATION}", 2000.0
    (whole,) = follow([Timeline(case_with_settings(own, {key: rate}, own), 3600.0)], [1.5], ["MAP"])
    (stopped,) = removal_courses(own, key, [rate], rate, goals, None)
    assert whole.sizes["time_min"] == 41
    assert stopped.sizes["time_min"] < 20
    assert stopped.attrs["solves"] < 0.5 * whole.attrs["solves"]
    assert first_broken_goals(goals, stopped)[0] == pytest.approx(first_broken_goals(goals, whole)[0])


def test_a_goal_that_breaks_on_the_way_has_the_value_that_it_started_from():
    """ "MAP > 65 breaks after 18.0 h (64.2 mmHg)" left out that it started at 74.7."""
    goals = read_goals("MAP > 65", ["MAP"])
    result = xr.Dataset(
        {"MAP": ("time_min", [74.7, 70.0, 64.2]), "status": ("time_min", ["converged"] * 3)},
        {"time_min": [0.0, 540.0, 1080.0]}, {"converged": True, "message": ""},
    )  # fmt: skip
    (broken,) = first_broken_goals(goals, result)
    assert broken.at_start == 74.7
    found = removal_result("P", 3000.0, goals, {42.0: [broken]})
    assert "MAP > 65 breaks after 18.0 h (64.2 mmHg, from 74.7 at the start); 756 mL are" in found.message
    assert found.as_object()["limits"][0]["at_start"] == 74.7


def test_a_faster_rate_that_keeps_all_goals_is_found_where_the_slowest_does_not():
    """It was "cannot be removed": rates were looked at below the first that breaks a goal alone."""
    tried = {10.0: False, 20.0: True, 40.0: True, 80.0: False, 160.0: True}
    assert bracketing_rates(tried) == (40.0, 80.0)
    assert bracketing_rates({10.0: False, 20.0: False}) == (None, 10.0)
    assert bracketing_rates({10.0: True, 20.0: True}) == (20.0, None)
    slow, fast = BrokenGoal("PCWP < 18", 19.0, 300.0, "mmHg"), BrokenGoal("MAP > 65", 60.0, 30.0, "mmHg")
    broken = {10.0: [slow], 20.0: [], 40.0: [], 80.0: [fast], 160.0: []}
    found = removal_result("P", 100.0, [Goal("MAP", low=65.0)], broken)
    assert found.possible
    assert found.rate_ml_h == 40.0
    assert found.message == (
        "100 mL can be removed at 40 mL/h, in 2.5 h; at 80 mL/h MAP > 65 breaks after 0.5 h (60 mmHg); "
        "of the slower rates, 10 mL/h does not keep the goals: PCWP < 18 breaks after 5.0 h (19 mmHg)"
    )


@pytest.mark.parametrize(
    ("harmful", "rate", "begin"),
    [
        (1e9, 400.0, "2500 mL can be removed at 400 mL/h, in 6.2 h; at 1000 mL/h MAP > 65 breaks"),
        (140.0, 140.0, "2500 mL can be removed at 140 mL/h (1.75 mL/kg/h), in 17.9 h; above 1.75 mL/kg/h "),
        (15.0, 30.0, "2500 mL in 83.3 h need 30 mL/h (3.5 mL/kg/h); above 1.75 mL/kg/h fewer "),
    ],
)
def test_the_rate_first_named_is_one_that_did_not_harm_patients(harmful, rate, begin):
    """13 mL/kg/h were the answer, with the rate at which patients survive after it, and a warning."""
    broken = {30.0: [], 60.0: [], 140.0: [], 400.0: [], 1000.0: [BrokenGoal("MAP > 65", 60.0, 30.0, "mmHg")]}
    found = removal_result("P", 2500.0, [Goal("MAP", low=65.0)], broken, harmful)
    assert found.message.startswith(begin)
    assert (found.rate_ml_h, found.fastest_ml_h) == (rate, 400.0)
    assert found.as_object()["fastest_ml_h"] == 400.0
    assert found.hours == pytest.approx(2500.0 / rate)
    assert ("the goals alone would allow 400 mL/h, 6.2 h; at 1000" in found.message) is (harmful < 400.0)
    assert ("allow 166.7 h or more (15 mL/h)" in found.message) is (harmful < 30.0)


def test_the_harmful_rate_is_tried_where_the_time_allows_it():
    rates = first_rates(34.7, 2000.0, 140.0)
    assert 140.0 in rates
    assert (rates[0], rates[-1], len(rates)) == (pytest.approx(34.7), pytest.approx(2000.0), 8)
    assert (np.diff(rates) > 0.0).all()
    assert 140.0 not in first_rates(312.0, 2000.0, 140.0)


def test_a_pump_that_stands_still_removes_nothing(own):
    stopped = apply_settings(own, ["crrt.flow_ml_min=0"])
    with pytest.raises(GoalError, match=r"crrt\.flow_ml_min = 0: the pump stands still"):
        plan_removal(stopped, 300.0, "MAP > 20")


@pytest.mark.slow
def test_a_rate_that_harmed_patients_is_named_in_the_first_words(own):
    found = plan_removal(own, 300.0, "MAP > 20, filtration_fraction < 0.9", hours=1.0)
    assert found.message.startswith("300 mL in 1.0 h need 300 mL/h (3.75 mL/kg/h); above 1.75 mL/kg/h fewer")
    assert "allow 2.1 h or more (140 mL/h)" in found.message
    assert "fewer critically ill patients survived" in found.warnings[0]


@pytest.mark.slow
def test_alarms_on_the_way_stand_in_the_first_words(own):
    """ "can be removed" stood there alone, with a pressure of 4 mmHg on the way among the warnings."""
    dilated = apply_settings(own, ["Rmc=0.35", "fluid.extra_volume_ml=-100"])
    found = plan_removal(dilated, 300.0, "MAP > 20, filtration_fraction < 0.9", hours=1.0)
    alarms = [line for line in found.warnings if "mean arterial pressure below 55 mmHg" in line]
    assert bool(alarms) == ("on the way MAP" in found.message)
    assert alarms


@pytest.mark.parametrize("volume", [50_000.0, -1.0, math.nan])
def test_a_volume_that_nobody_has_is_refused(own, volume):
    """50 L from a patient of 68 kg were searched for without an end in sight."""
    with pytest.raises(GoalError, match="allowed"):
        plan_removal(own, volume, "MAP > 62")


def test_a_rate_that_the_device_cannot_have_is_said_in_what_was_asked(own):
    """1 mL was refused for a rate of 0.0139 mL/h with the advice to take 50."""
    with pytest.raises(GoalError, match=r"remove 10000 mL in 0.5 h, 20000 mL/h: .*, or more hours"):
        plan_removal(own, 10_000.0, "MAP > 62", hours=0.5)
    found = plan_removal(own, 1.0, "MAP > 120")
    assert min(found.tried) == 1.0


def test_without_a_device_that_removes_fluid_it_is_refused(own):
    bare = own.model_copy(update={"crrt": None})
    with pytest.raises(GoalError, match=r"no device that removes fluid: add a section \[crrt\]"):
        plan_removal(bare, 300.0, "MAP > 62")


def test_fluid_that_another_filter_removes_beside_the_plan_is_refused(own):
    """It was not counted: 1000 mL "cannot be removed at 14 mL/h" where a second filter removed 100 mL/h."""
    both = own.model_copy(update={"renox": Renox(dialysate_ml_h=2000.0, net_ultrafiltration_ml_h=100.0)})
    message = r"renox.net_ultrafiltration_ml_h: removed beside \[crrt\], whose rate is planned; allowed: 0"
    with pytest.raises(GoalError, match=message):
        plan_removal(both, 300.0, "MAP > 62")


def test_the_fastest_rate_is_that_of_the_device(own):
    key = f"crrt.{ULTRAFILTRATION}"
    fastest = fastest_rate(own, key, 100.0)
    apply_settings(own, [f"{key}={fastest!r}"])
    with pytest.raises(CaseError, match="the water removed"):
        apply_settings(own, [f"{key}={1.02 * fastest!r}"])


@pytest.mark.slow
def test_a_removal_is_followed_by_what_comes_after_it(own):
    """3 L at 5 L/h kept the pressure to the last minute, and nothing was said of the day after it.

    The slowest rate broke the same goal after 70 h, so that it was called less safe than the fastest.
    """
    case = own.with_section("ecmo", speed_rpm=3300.0)
    case = apply_settings(case, ["Emaxlv=0.7", "Rmc=0.7", "fluid.extra_volume_ml=700"])
    removal = Removal("P01", 3000.0, ("MAP > 65",), 5000.0, 0.6, True, (), "3000 mL can be removed")
    key, goals = f"crrt.{ULTRAFILTRATION}", [Goal("MAP", low=65.0)]
    found = with_afterwards(case, key, removal, goals, 72.0 * 60.0, "patient_held")
    (later,) = found.afterwards
    assert later.goal == "MAP > 65"
    assert 12.0 * 60.0 < later.at_min < 72.0 * 60.0
    assert found.message.startswith(
        "3000 mL can be removed; after the removal, though nothing more is removed, MAP > 65 breaks after"
    )
    assert found.as_object()["afterwards"] == [later._asdict()]
    kept = with_afterwards(case, key, removal, [Goal("MAP", low=20.0)], 0.0, "patient_held")
    assert kept == removal
