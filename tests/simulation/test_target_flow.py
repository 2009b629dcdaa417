"""A pump flow in place of a speed: the speed that gives it, and what is said where none does."""

import json

import numpy as np
import pytest

import eclsim
from eclsim.cases import CaseError, read_mapping
from eclsim.cases.reading import case_text
from eclsim.cases.settings import apply_settings
from eclsim.devices.device import UnsolvedFlowError
from eclsim.orbit.model import UnknownValueError, model_of
from eclsim.simulation.files import case_object
from eclsim.simulation.single import NOT_REACHED, simulate, simulate_transient
from eclsim.simulation.target_flow import (
    TOLERANCE_L_MIN,
    FlowNotReachedError,
    solved_speed_of,
    speeds_for_flows,
    with_speed,
)

PATIENT = {
    "id": "P01", "sex": "female", "age_years": 70, "height_cm": 165, "weight_kg": 60, "heart_rate_bpm": 90,
}  # fmt: skip
ECMO = {"pump": "Rotaflow", "oxygenator": "Quadrox-i Adult", "mode": "VA"}
CRRT = {"flow_ml_min": 200, "access_site": "post_oxy", "return_site": "pre_oxy"}


def case(flow: float = 4.0, **more):
    raw = {"format": 1, "patient": PATIENT, "ecmo": ECMO | {"flow_l_min": flow}, **more}
    return read_mapping(raw).case


@pytest.mark.slow
@pytest.mark.parametrize(
    ("settings", "more", "policy"),
    [
        ((), {}, "as_published"),
        ((), {}, "patient_held"),
        ((), {"crrt": CRRT}, "as_published"),
        (("ecmo.mode=VV", "ecmo.drainage_site=svn", "ecmo.return_site=ra"), {}, "as_published"),
        (("Emaxlv=0.5",), {}, "as_published"),
    ],
)
def test_the_beat_has_the_flow_that_was_asked_for(settings, more, policy):
    result = simulate(apply_settings(case(**more), settings), volume_policy=policy)
    assert result.attrs["converged"]
    assert float(result["PF"]) == pytest.approx(4.0, abs=TOLERANCE_L_MIN)
    solved = case_object(result)["solved"]["ecmo.speed_rpm"]
    assert 2000 < solved < 5000
    assert case_object(result)["target"] == {"ecmo.flow_l_min": 4.0}


def test_the_public_function_solves_for_the_speed_of_a_file(tmp_path):
    """The same beat as of `eclsim simulate FILE`, whose speed is solved for."""
    file = tmp_path / "P01.toml"
    file.write_text(case_text(case()), encoding="utf-8")
    beat = eclsim.simulate(file)
    assert float(beat["PF"]) == pytest.approx(4.0, abs=TOLERANCE_L_MIN)
    assert solved_speed_of(beat) == solved_speed_of(simulate(case())) == with_speed(case())[1]
    assert eclsim.simulate(model_of(with_speed(case())[0]))["MAP"] == beat["MAP"]


def test_the_speed_found_gives_the_same_beat_when_it_is_set():
    solved, result = with_speed(case())
    assert result is not None
    assert solved.ecmo is not None
    assert (solved.ecmo.flow_l_min, solved.ecmo.speed_rpm) == (None, result.speed_rpm)
    assert str(result) == f"ecmo.flow_l_min = 4 needs {result.speed_rpm:.0f} rpm"
    assert float(simulate(solved)["MAP"]) == pytest.approx(float(simulate(case())["MAP"]), abs=1e-6)
    assert with_speed(solved) == (solved, None)


def test_a_flow_out_of_reach_names_the_highest_and_gives_no_numbers():
    with pytest.raises(FlowNotReachedError, match=r"highest flow reached is 6\.\d\d L/min, at 5000 rpm"):
        with_speed(case(8.0))
    result = simulate(case(8.0))
    assert (result.attrs["converged"], result.attrs["status"]) == (0, "flow_not_reached")
    written = case_object(result)
    assert (written["outputs"], written["waveforms"], written["residual"]) == ({}, {}, None)
    assert "solved" not in written
    assert json.dumps(written, allow_nan=False)


def test_a_course_in_time_runs_at_the_speed_that_was_found():
    solved, _ = with_speed(case(3.0))
    course, same = (simulate_transient(one, 1.0, names=["Pao"]) for one in (case(3.0), solved))
    np.testing.assert_array_equal(course["Pao"], same["Pao"])


@pytest.mark.parametrize(
    ("ecmo", "text"),
    [
        ({"flow_l_min": 4.0, "speed_rpm": 3000}, "one of the two"),
        (
            {"flow_l_min": 4.0, "pump": {"roller_l_min": 4.0}},
            "a roller pump takes its flow from roller_l_min",
        ),
        ({}, "or flow_l_min, to solve for the speed"),
        ({"flow_l_min": -1.0}, "0.1 to 10 L/min"),
    ],
)
def test_contradictions_are_refused(ecmo, text):
    with pytest.raises(CaseError, match=text):
        read_mapping({"format": 1, "patient": PATIENT, "ecmo": ECMO | ecmo})


def test_setting_one_takes_the_place_of_the_other():
    at_speed = apply_settings(case(), ["ecmo.speed_rpm=3000"])
    assert at_speed.ecmo is not None
    assert (at_speed.ecmo.speed_rpm, at_speed.ecmo.flow_l_min) == (3000, None)
    back = apply_settings(at_speed, ["ecmo.flow_l_min=4"])
    assert back.ecmo is not None
    assert (back.ecmo.speed_rpm, back.ecmo.flow_l_min) == (None, 4)
    with pytest.raises(CaseError, match="one of the two"):
        apply_settings(at_speed, ["ecmo.flow_l_min=4", "ecmo.speed_rpm=3000"])


def test_a_model_is_never_built_at_a_speed_that_was_not_solved():
    with pytest.raises(UnsolvedFlowError, match="target_flow"):
        model_of(case())


def test_a_fit_refuses_a_target_in_one_sentence():
    from eclsim.identification.settings import check_fit

    (mistake,) = check_fit(case(measurements={"MAP": 80}), {"Rmc": (1.0, 0.5, 2.0)}).mistakes
    assert "a fit needs the speed at which the pump ran" in str(mistake)


# --- the search itself, on functions whose answer is known ----------------------------------------


def with_messages(function):
    def flows(members, speeds):
        result = function(speeds)
        return result, ["settled" if np.isfinite(flow) else "no steady beat" for flow in result]

    return flows


@pytest.mark.parametrize("power", [1, 3, 9])
def test_the_search_meets_the_tolerance_on_curves_of_any_bend(power):
    curve = with_messages(lambda s: 6.0 * (s / 5000.0) ** power)
    expected = np.array([2.0, 6.0, 1.0, 7.0])
    speeds, reasons = speeds_for_flows(curve, expected, (1000.0, 5000.0))
    within = [not reason for reason in reasons]
    assert not within[3]
    np.testing.assert_allclose(
        6.0 * (speeds / 5000.0) ** power, np.where(within, expected, np.nan), atol=TOLERANCE_L_MIN
    )


@pytest.mark.parametrize(
    ("function", "expected", "text"),
    [
        (lambda s: np.where(s > 3900.0, np.nan, s / 1000.0), 4.5, "no steady beat was found at 4000, 4500"),
        (lambda s: s / 1000.0, 0.5, "lowest flow reached is 1.00 L/min, at 1000 rpm"),
        (lambda s: s * np.nan, 3.0, "at any speed: no steady beat"),
        (lambda s: np.where(s < 3100.0, 1.0, 5.0), 3.0, "jumps over it between"),
        (lambda s: np.where(s % 500.0 == 0.0, s / 1000.0, np.nan), 3.3, "but no steady beat was found at"),
    ],
)
def test_what_cannot_be_found_is_said(function, expected, text):
    (speed,), (reason,) = speeds_for_flows(with_messages(function), np.array([expected]), (1000.0, 5000.0))
    assert np.isnan(speed)
    assert text in reason


# --- variants and derivatives of a case that names a flow ------------------------------------------


def test_each_variant_has_a_speed_of_its_own_and_the_flow():
    """Each as `simulate` has it alone; a flow beyond reach takes nothing from its neighbours."""
    resistances = [0.8, 1.2, 1.2]
    result = eclsim.simulate_many(case(), {"Rmc": resistances, "ecmo.flow_l_min": [4.0, 3.0, 9.0]}, ("MAP",))
    assert list(result["status"].values) == ["converged", "converged", NOT_REACHED]
    assert "highest flow reached" in str(result["message"].values[2])
    for member, flow in ((0, 4.0), (1, 3.0)):
        single = simulate(apply_settings(case(flow), [f"Rmc={resistances[member]}"]))
        solved = solved_speed_of(single)
        assert solved is not None
        assert float(result["ecmo.speed_rpm"][member]) == pytest.approx(solved.speed_rpm, rel=1e-7)
        assert float(result["MAP"][member]) == pytest.approx(float(single["MAP"]), rel=1e-8)
    assert np.isnan([float(result[name][2]) for name in ("MAP", "ecmo.speed_rpm")]).all()


def test_a_flow_may_be_varied_in_a_case_with_a_speed():
    at_speed = apply_settings(case(), ["ecmo.speed_rpm=3000"])
    result = eclsim.simulate_many(at_speed, {"ecmo.flow_l_min": [3.0]}, ("PF",))
    assert float(result["PF"][0]) == pytest.approx(3.0, abs=TOLERANCE_L_MIN)
    with pytest.raises(UnknownValueError, match="is computed from the target flow"):
        eclsim.simulate_many(case(), {"ecmo.speed_rpm": [3000.0]})


@pytest.mark.slow
def test_derivatives_hold_the_flow():
    """Central differences of whole solutions, each with the speed that its flow needs."""
    names, parameters, steps = ("MAP", "PF", "pump_head"), ("Rmc", "ecmo.flow_l_min"), (1e-3, 1e-3)
    exact = eclsim.derivatives(case(), names, parameters)
    at = exact["parameter_value"].values
    for k, step in enumerate(steps):
        values = [float(at[k]) + sign * step for sign in (-1.0, 1.0)]
        low, high = (eclsim.simulate_many(case(), {parameters[k]: [value]}, names) for value in values)
        for name in names:
            slope = (float(high[name][0]) - float(low[name][0])) / (2.0 * step)
            assert float(exact.sel(output=name)[k]) == pytest.approx(slope, rel=2e-3, abs=2e-3)
    assert float(exact.sel(output="PF", parameter="Rmc")) == pytest.approx(0.0, abs=1e-12)
    assert solved_speed_of(exact) == with_speed(case())[1]
    with pytest.raises(UnknownValueError, match="is computed from the target flow"):
        eclsim.derivatives(case(), names, ("ecmo.speed_rpm",))
    with pytest.raises(FlowNotReachedError, match="highest flow"):
        eclsim.derivatives(case(9.0), names, parameters)
    nothing = eclsim.derivatives(case(9.0), names, parameters, throw=False)
    assert nothing.attrs["status"] == NOT_REACHED
    assert np.isnan(nothing).all()
    assert set(nothing.coords) == set(exact.coords)
    assert nothing.attrs["long_name"] == exact.attrs["long_name"]
    assert float(nothing["parameter_value"].sel(parameter="ecmo.flow_l_min")) == 9.0
    for units in ("output_units", "parameter_units"):
        assert list(nothing[units].values) == list(exact[units].values)
    with pytest.raises(UnknownValueError, match="Rmcc"):
        eclsim.derivatives(case(9.0), names, ["Rmcc"], throw=False)


@pytest.mark.slow
def test_two_flows_at_once_are_refused_and_one_of_a_named_circuit_is_solved_for():
    circuits = {"a": ECMO | {"flow_l_min": 2.0}, "b": ECMO | {"speed_rpm": 2000.0}}
    raw = {"format": 1, "patient": PATIENT, "ecmo": circuits}
    result = simulate(read_mapping(raw).case)
    assert float(result["ecmo.a.PF"]) == pytest.approx(2.0, abs=TOLERANCE_L_MIN)
    assert set(case_object(result)["solved"]) == {"ecmo.a.speed_rpm"}
    circuits["b"] = ECMO | {"flow_l_min": 2.0}
    refused = simulate(read_mapping(raw).case)
    assert refused.attrs["status"] == NOT_REACHED
    assert "only one can be solved for" in refused.attrs["message"]


def test_the_crrt_study_solves_for_the_speed_and_holds_it():
    study = eclsim.crrt_study(case(), schemes="g", speeds=[2000.0], volume_policy="as_published")
    solved = with_speed(case(), "as_published")[1]
    assert solved is not None
    assert study.case_speed == solved.speed_rpm
    assert not study.case.targets()
