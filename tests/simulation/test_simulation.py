import json

import numpy as np
import pytest

from eclsim.cases import Case, apply_settings
from eclsim.cases.reading import read_case
from eclsim.reporting.beat_values import beat_mean
from eclsim.simulation.files import case_object
from eclsim.simulation.single import simulate, simulate_many, simulate_transient
from eclsim.validation.reference_cases import waveform_statistics

CASE = """format = 1
[patient]
id = "P07"
sex = "male"
age_years = 50
height_cm = 180
weight_kg = 80
heart_rate_bpm = 80
"""


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    file = tmp_path_factory.mktemp("cases") / "case.toml"
    file.write_text(CASE)
    return read_case(str(file)).case


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["semi-implicit", "adaptive"])
def test_a_case_has_a_steady_beat_and_a_course_by_either_solver(case, solver):
    beat = simulate(case, solver=solver)
    course = simulate_transient(case, 24.0, solver=solver, names=["Pao"])
    assert beat.attrs["id"] == course.attrs["id"] == "P07"
    assert beat.attrs["solver"] == course.attrs["solver"] == solver
    assert list(course.data_vars) == ["Pao"]
    last = course["Pao"].where(course["time"] > 24.0 - 0.75, drop=True)
    assert float(last.max()) == pytest.approx(float(beat["SP"]), rel=1e-3)
    assert float(last.min()) == pytest.approx(float(beat["DP"]), rel=2e-3)


REGULATED = """format = 1
[patient]
id = "P08"
sex = "female"
age_years = 63
height_cm = 165
weight_kg = 70
heart_rate_bpm = 95
[ecmo]
pump = "Rotaflow"
drainage_site = "ra"
drainage_cannula = "venous"
drainage_fr = 25
return_site = "ao"
return_cannula = "arterial"
return_fr = 17
speed_rpm = 3000
oxygenator = "Quadrox-i Adult"
[gas]
haemoglobin_g_dl = 10
[regulation]
baroreflex = 1
chemoreflex = 1
[drugs]
noradrenaline = 0.1
"""


@pytest.mark.slow
def test_a_result_holds_the_case_that_repeats_it(tmp_path):
    """Set points that the file leaves open are those of the file, not of the case after --set."""
    file = tmp_path / "case.toml"
    file.write_text(REGULATED)
    changed = read_case(str(file), ["ecmo.speed_rpm=4200", "Emaxlv=0.5"]).case
    beat = simulate(changed, volume_policy="patient_held")
    held = Case.model_validate_json(beat.attrs["case"])
    assert held.regulation.open_set_points == ()
    assert "shunt_fraction" not in held.gas.model_fields_set
    again = simulate(held)
    assert again.attrs["blood_volume_policy"] == "patient_held"
    numbers = [n for n, v in beat.data_vars.items() if v.ndim == 0 and v.dtype.kind == "f"]
    assert {n: float(again[n]) for n in numbers} == {n: float(beat[n]) for n in numbers}
    without = simulate(changed.model_copy(update={"as_written": None}), volume_policy="patient_held")
    assert abs(float(without["MAP"]) - float(beat["MAP"])) > 1.0
    assert case_object(beat)["case"] == json.loads(beat.attrs["case"])


@pytest.mark.slow
@pytest.mark.parametrize(("flow", "status"), [("3.2", "converged"), ("9.5", "flow_not_reached")])
def test_a_result_of_a_flow_holds_the_case_with_its_speed(tmp_path, flow, status):
    """With settings over reflexes and a flow, the flow was that of a case whose speed was not known."""
    file = tmp_path / "case.toml"
    file.write_text(REGULATED.replace("speed_rpm = 3000", "flow_l_min = 3.0"))
    changed = read_case(str(file), [f"ecmo.flow_l_min={flow}", "Emaxlv=0.5"]).case
    beat = simulate(changed)
    assert beat.attrs["status"] == status
    held = Case.model_validate_json(beat.attrs["case"])
    assert bool(held.targets()) == (status != "converged")
    if status == "converged":
        assert held.ecmo.speed_rpm == beat.attrs["solved_ecmo_speed_rpm"]
        assert float(simulate(held)["MAP"]) == float(beat["MAP"])


def test_the_mean_of_a_waveform_is_one_number_everywhere(case):
    beat = simulate(case)
    written = case_object(beat)
    flows = {q: written["waveforms"][q]["mean"] for q in ("Qra", "Qrv", "Qla", "Qlv")}
    for valve, flow in zip(("tricuspid", "pulmonary", "mitral", "aortic"), flows.values(), strict=True):
        assert flow * 0.06 == pytest.approx(written["more_outputs"][f"{valve}_valve_flow"], rel=1e-12)
    assert max(flows.values()) == pytest.approx(min(flows.values()), rel=1e-6)  # what one gives the next gets
    assert flows["Qlv"] == beat_mean(beat, "Qlv") == waveform_statistics(beat, "Qlv")["mean"]
    for name, result in written["waveforms"].items():
        assert (result["min"], result["max"]) == (float(beat[name].min()), float(beat[name].max()))


def test_all_waveforms_are_kept_if_none_is_named(case):
    beat, course = simulate(case), simulate_transient(case, 0.3)
    waves = {name for name, variable in beat.data_vars.items() if variable.ndim == 1}
    assert set(course.data_vars) == waves
    assert all(np.isfinite(course[name]).all() for name in waves)


def test_a_variant_without_regurgitation_is_the_case_without_it(case):
    """It was a failed member: "a value is not allowed ..., allowed: above zero"."""
    key = "physiology.aortic_regurgitation_cm2"
    leaking, tight = (apply_settings(case, [f"{key}={area}"]) for area in (0.2, 0.0))
    variants = simulate_many(leaking, {key: [0.0, 0.2, -0.1]}, outputs=["MAP", "CO"])
    assert variants["status"].values.tolist() == ["converged", "converged", "invalid_input"]
    assert "allowed: zero or above" in str(variants["message"].values[2])
    for member, single in enumerate((tight, leaking)):
        beat = simulate(single)
        for name in ("MAP", "CO"):
            assert float(variants[name][member]) == pytest.approx(float(beat[name]), rel=1e-7)
