import numpy as np
import pytest

from eclsim.orbit.model import PATIENT_HELD, UnknownValueError
from eclsim.outputs.registry import leading_outputs
from eclsim.outputs.results import derivatives, simulate, simulate_course, simulate_many
from model_catalogue import model


@pytest.fixture(scope="module")
def beat():
    return simulate(model("V-A, CRRT g"))


def mean(result, name):
    return float(np.trapezoid(result[name], result["phase"]))


def test_everything_has_a_unit_and_a_name(beat):
    for variable in (*beat.data_vars.values(), *beat.coords.values()):
        assert variable.attrs["units"]
        assert variable.attrs["long_name"]
    assert beat.attrs["converged"] == 1
    assert beat.attrs["blood_volume_policy"] == "as_published"
    assert all(entry.name in beat for entry in leading_outputs())


@pytest.mark.slow
def test_derivatives_and_batches_carry_units_and_refuse_what_is_misspelt():
    patient = model("V-A")
    slopes = derivatives(patient, ["MAP", "PF"], ["Rmc", "ecmo.speed_rpm", "heart_rate_bpm"])
    assert list(slopes["output_units"].values) == ["mmHg", "L/min"]
    assert list(slopes["parameter_units"].values) == ["mmHg s/mL", "rpm", "bpm"]
    many = simulate_many(patient, {"Rmc": [0.5], "ecmo.speed_rpm": [3000.0]}, ["MAP"])
    assert [many[name].attrs["units"] for name in ("Rmc", "ecmo.speed_rpm")] == ["mmHg s/mL", "rpm"]
    assert many["residual"].attrs["units"] == "1"
    with pytest.raises(UnknownValueError, match="no parameter 'Rmx'; did you mean Rmc"):
        derivatives(patient, ["MAP"], ["Rmx"])


def test_the_beat_closes(beat):
    waves = [v for v in beat.data_vars.values() if v.ndim == 1]
    assert len(waves) > 60
    for wave in waves:
        assert float(wave[0]) == pytest.approx(float(wave[-1]), abs=1e-6)
    assert float(beat["time"][-1]) == pytest.approx(0.5)


def test_volumes_add_up_to_the_blood_volume(beat):
    total = sum(v.values for name, v in beat.data_vars.items() if name[0] == "V" and v.ndim == 1)
    blood = model("V-A, CRRT g").values["total_blood_volume_ml"]
    in_capillaries = 0.07 * blood
    np.testing.assert_allclose(total + in_capillaries, blood, rtol=1e-9)


def test_mean_flow_is_the_same_all_the_way_round(beat):
    for near, far in (("ao", "sart"), ("pas", "part"), ("part", "pvn"), ("ecmooxy", "ecmotuor")):
        missing = mean(beat, "Qcrrtpump") * ((near, far) == ("ecmooxy", "ecmotuor"))
        assert mean(beat, "Q" + near) - missing == pytest.approx(mean(beat, "Q" + far), rel=2e-3)


def test_the_pump_raises_the_pressure_by_its_head(beat):
    np.testing.assert_allclose(beat["Pecmopump"], beat["Pecmotupo"] - beat["Pecmotudp"], atol=1e-9)


def test_a_held_patient_has_more_blood_and_pressure(beat):
    held = simulate(model("V-A, CRRT g"), PATIENT_HELD)
    assert held.attrs["blood_volume_policy"] == "patient_held"
    assert float(held["MAP"]) > float(beat["MAP"]) + 2.0


def test_a_course_is_labelled_over_time():
    course = simulate_course(model("V-A"), 1.3, names=("Pao", "Qecmopump", "Vlv", "Pecmopump"))
    assert dict(course.sizes) == {"time": len(course["time"])}
    assert set(course.data_vars) == {"Pao", "Qecmopump", "Vlv", "Pecmopump"}
    units = {name: course[name].attrs["units"] for name in course.data_vars}
    assert units == {"Pao": "mmHg", "Qecmopump": "mL/s", "Vlv": "mL", "Pecmopump": "mmHg"}
    head = course["Pecmopump"].attrs["long_name"]
    assert head == "head of ecmopump: pressure gained from ecmotudp to ecmotupo"
    assert course.attrs["solver"] == "semi-implicit"


def test_the_long_course_shows_the_steady_beat():
    patient = model("none")
    course, beat = simulate_course(patient, 60.0, names=("Pao", "Vlv", "Vsvn")), simulate(patient)
    last = course.isel(time=slice(-len(beat["phase"]), None))
    for name in ("Pao", "Vlv", "Vsvn"):
        np.testing.assert_allclose(last[name], beat[name], rtol=1e-5)


@pytest.mark.parametrize("name", ["none", "V-A, CRRT g"])
def test_every_valve_moves_in_a_beat_what_the_circulation_needs(name):
    """In a steady beat what a valve lets through is what its neighbours pass on: no blood is lost."""
    beat = simulate(model(name))
    flows = [float(beat[f"{valve}_valve_flow"]) for valve in ("tricuspid", "pulmonary", "mitral", "aortic")]
    assert flows == pytest.approx([flows[0]] * 4, rel=1e-8)
    assert flows[0] == pytest.approx(float(beat["CO"]), rel=1e-4)
