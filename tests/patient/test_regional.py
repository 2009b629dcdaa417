"""A patient in regions: totals are those of the published one, and so are the numbers of a beat."""

import numpy as np
import pytest

import eclsim
from eclsim.cases.reading import read_mapping
from eclsim.cases.resolve import circuit_of, nominal_values
from eclsim.circuit.assembly import assemble
from eclsim.circuit.volumes import unstressed_volume
from eclsim.orbit.execution import Execution
from eclsim.orbit.model import model_of
from eclsim.orbit.status import Status
from eclsim.orbit.steady import Batch
from eclsim.outputs.registry import leading_outputs
from eclsim.outputs.results import simulate
from eclsim.outputs.steady_beat import steady_beat
from eclsim.patient.circulation import Anatomy, circulation

PATIENT = {
    "id": "P", "sex": "female", "age_years": 70, "height_cm": 165, "weight_kg": 60, "heart_rate_bpm": 90,
}  # fmt: skip
VA = {"pump": "Rotaflow", "speed_rpm": 3000, "oxygenator": "Quadrox-i Adult", "mode": "VA"}
FAILING = {"Emaxlv": 0.6, "Emaxrv": 0.2, "Rmc": 0.8}
ARTERIES = ("arch", "descending", "upper", "lower")


def case(regional=True, upper_share=0.35, **sections):
    physiology = {"regional": regional, "upper_share": upper_share} | sections.pop("physiology", {})
    return read_mapping({"format": 1, "patient": PATIENT, "physiology": physiology} | sections).case


def laws(regional, upper_share=0.35):
    """Compartments and connections by name, each with the constants of its law."""
    circuit = circulation(Anatomy(regional=regional))
    values = {**nominal_values(circuit), "physiology.upper_share": upper_share}
    constants = assemble(circuit).constants(values)
    stores = dict(zip((c.name for c in circuit.compartments), constants.storages, strict=True))
    paths = dict(zip((c.name for c in circuit.connections), constants.paths, strict=True))
    return circuit, values, stores, paths


def test_without_a_section_or_with_its_defaults_the_circuit_is_the_published_one():
    plain = read_mapping({"format": 1, "patient": PATIENT}).case
    assert circuit_of(plain) == circuit_of(case(regional=False)) == circulation()
    assert str(circulation()).count("\n") == 21  # ten compartments, ten connections


@pytest.mark.parametrize("upper_share", [0.2, 0.35, 0.5])
def test_regions_add_to_the_published_totals(upper_share):
    _, _, stores, paths = laws(False)
    circuit, _, divided, parts = laws(True, upper_share)
    compliance = lambda table, names: sum(1.0 / table[name].stiffness for name in names)  # noqa: E731
    assert compliance(divided, ARTERIES) == pytest.approx(compliance(stores, ["sart"]), rel=1e-14)
    assert compliance(divided, ["svc", "ivc"]) == pytest.approx(compliance(stores, ["svn"]), rel=1e-14)
    assert 1 / (1 / parts["svc"] + 1 / parts["ivc"]) == pytest.approx(paths["svn"], rel=1e-14)
    for what in ("resistance", "inertance"):
        part = {name: getattr(path, what) for name, path in parts.items() if hasattr(path, what)}
        whole = {name: getattr(path, what) for name, path in paths.items() if hasattr(path, what)}
        side_by_side = 1 / (1 / part["upper"] + 1 / part["lower"])
        assert side_by_side == pytest.approx(whole["sart"], rel=1e-14)
        # From the root to either body the drop of the published aorta, at the body's share of flow.
        upper = part["ao"] + upper_share * part["archupper"]
        lower = part["ao"] + (1 - upper_share) * (part["arch"] + part["descending"])
        assert upper == pytest.approx(whole["ao"], rel=1e-14)
        assert lower == pytest.approx(whole["ao"], rel=1e-14)
    assert len(circuit.compartments) == 14


def test_blood_at_the_start_is_that_of_the_published_patient():
    held = {}
    for regional in (False, True):
        circuit, values, _, _ = laws(regional)
        stressed = assemble(circuit).start_volumes(values)
        rest = [unstressed_volume(circuit, c.name, values) for c in circuit.compartments]
        held[regional] = sum(stressed), sum(rest)
    np.testing.assert_allclose(held[True], held[False], rtol=1e-13)


@pytest.mark.slow
@pytest.mark.parametrize("devices", [{}, {"ecmo": VA}], ids=["no device", "central V-A ECMO"])
def test_numbers_of_a_beat_are_those_of_the_published_patient(devices):
    divided, whole = (
        eclsim.simulate(case(regional, parameters=FAILING, **devices)) for regional in (True, False)
    )
    assert divided.attrs["converged"] == whole.attrs["converged"] == 1
    for name in (entry.name for entry in leading_outputs() if entry.name in whole):
        assert float(divided[name]) == pytest.approx(float(whole[name]), rel=0.01), name
    share = float(divided["upper_body_flow"] / (divided["upper_body_flow"] + divided["lower_body_flow"]))
    assert share == pytest.approx(0.35, abs=0.002)


def beat_mean(result, name):
    """Mean over the beat, whose grid is denser where valves move."""
    values, time = result[name].values, result["time"].values
    return float(np.trapezoid(values, time) / (time[-1] - time[0]))


@pytest.mark.slow
def test_a_femoral_return_feeds_the_lower_body_first_and_a_cava_is_drained_first():
    femoral = {name: value for name, value in VA.items() if name != "mode"} | {
        "drainage_site": "svc", "drainage_cannula": "venous", "drainage_fr": 25, "speed_rpm": 4000,
        "return_site": "lower", "return_cannula": "arterial", "return_fr": 19,
    }  # fmt: skip
    failing = FAILING | {"Emaxlv": 0.4}
    result = eclsim.simulate(case(parameters=failing, ecmo=femoral, blood_volume_policy="patient_held"))
    assert result.attrs["converged"]
    number = {name: float(result[name]) for name in result.data_vars if result[name].ndim == 0}
    assert number["lower_body_pressure"] > number["MAP"] > number["upper_body_pressure"]
    assert number["superior_caval_pressure"] < number["right_atrial_pressure"]
    assert beat_mean(result, "Qdescending") < 0.0
    assert beat_mean(result, "Qsvc") < 0.0 < beat_mean(result, "Qivc")
    # What the lower body does not take of the pump's flow, the upper body takes beside the heart's.
    surplus = number["PF"] - number["lower_body_flow"]
    assert surplus == pytest.approx(number["upper_body_flow"] - number["LVO"], abs=1e-3)


@pytest.mark.slow
def test_bronchial_return_is_a_share_of_the_systemic_conductance_and_passes_the_right_heart():
    model = model_of(case(regional=False, physiology={"bronchial_fraction": 0.05}))
    result = simulate(model)
    bronchial, systemic = float(result["bronchial_flow"]), float(result["systemic_flow"])
    conductance = 0.06 / (model.values["Rsart"] + model.values["Rmc"])  # L/min/mmHg
    artery, lungs, veins = (beat_mean(result, "P" + name) for name in ("sart", "pvn", "svn"))
    assert bronchial == pytest.approx(0.05 * conductance * (artery - lungs), rel=1e-4)
    assert systemic == pytest.approx(0.95 * conductance * (artery - veins), rel=1e-4)
    assert float(result["LVO"]) - float(result["CO"]) == pytest.approx(bronchial, abs=1e-4)


@pytest.mark.slow
def test_on_central_va_ecmo_bronchial_return_distends_the_left_ventricle():
    """The experiment of docs/regional-patient.md: EF near 15 %, the patient's volume held."""

    def beat(rpm, fraction):
        weak = case(
            False, parameters={"Emaxlv": 0.3}, blood_volume_policy="patient_held",
            physiology={"bronchial_fraction": fraction}, ecmo=VA | {"speed_rpm": rpm},
        )  # fmt: skip
        result = eclsim.simulate(weak)
        assert result.attrs["converged"]
        return float(result["EDVLV"]), float(result["PCWP"])

    without, more = [beat(rpm, 0.0) for rpm in (1500, 4000)], [beat(rpm, 0.02) for rpm in (1500, 4000)]
    for volumes in (without, more):
        assert volumes[1][0] > volumes[0][0] + 1.0
        assert volumes[1][1] > volumes[0][1]
    assert more[1][0] > without[1][0] + 0.2
    assert more[1][1] > without[1][1] + 0.08


@pytest.mark.slow
def test_valves_of_a_given_area_obey_the_orifice_equation_in_the_beat():
    areas = {"aortic_stenosis_cm2": 0.8, "mitral_regurgitation_cm2": 0.4}
    result = eclsim.simulate(case(False, physiology=areas))
    assert result.attrs["converged"]
    per_cm2 = 100.0 * (2.0 * 133.322387415 / 1060.0) ** 0.5
    forward, gradient = result["Qlv"].values, (result["Plv"] - result["Pao"]).values
    open_valve = forward > 20.0
    expected = 0.8 * per_cm2 * np.sqrt(gradient[open_valve])
    np.testing.assert_allclose(forward[open_valve], expected, rtol=1e-4)
    assert 30.0 < gradient.max() < 150.0
    back, drive = result["Qla"].values, (result["Plv"] - result["Pla"]).values
    leak = back < -20.0
    np.testing.assert_allclose(-back[leak], 0.4 * per_cm2 * np.sqrt(drive[leak]), rtol=1e-4)
    assert float(result["mitral_valve_flow"]) == pytest.approx(float(result["LVO"]), abs=1e-4)


FEMORAL = {
    "pump": "Rotaflow", "speed_rpm": 3300, "oxygenator": "Quadrox-i Adult", "drainage_site": "ivc",
    "drainage_cannula": "venous", "drainage_fr": 25, "return_site": "lower", "return_cannula": "arterial",
    "return_fr": 19,
}  # fmt: skip


def test_without_a_device_all_arterial_blood_is_native():
    beat = steady_beat(Batch(circulation(Anatomy(regional=True)), model_of(case()).values, 1))
    for place in ARTERIES:
        assert beat.output(f"native_share_{place}")[0] == pytest.approx(100.0, abs=1e-6)


@pytest.mark.slow
def test_native_blood_is_conserved_and_reaches_the_heart_before_the_brain():
    model = model_of(case(ecmo=FEMORAL, parameters=FAILING | {"P0svn": 10}))
    weak = {"Emaxlv": np.array([0.6, 0.9, 1.4])}
    beat = steady_beat(Batch(model.circuit, {**model.values, **weak}, 3, "patient_held"))
    assert beat.determined.all()
    number = {name: beat.output(name) for name in beat.names}
    native = {name: number[f"native_share_{name}"] for name in ("ao", *ARTERIES)}
    # All that passes the aortic valve leaves the arteries again, through one body or the other.
    left = native["upper"] * number["upper_body_flow"] + native["lower"] * number["lower_body_flow"]
    np.testing.assert_allclose(left, 100.0 * number["LVO"], rtol=2e-3)
    order = np.array([native[name] for name in ("ao", "upper", "descending", "lower")])
    assert (np.diff(order, axis=0) < 0.0).all(), "less along the aorta"
    assert (np.diff(order, axis=1) > 0.0).all(), "more from a stronger heart"
    assert native["ao"][0] > 95.0 > 80.0 > native["upper"][0]
    np.testing.assert_allclose(native["upper"], native["arch"], rtol=1e-6)


@pytest.mark.slow
def test_failing_lungs_on_femoral_va_ecmo_give_the_upper_body_less_oxygen_and_caval_drainage_helps():
    gas = {"haemoglobin_g_dl": 9, "vo2_ml_min": 220, "fio2": 0.6, "shunt_fraction": 0.7}
    sweep = {"sweep_l_min": 3, "fdo2": 1.0}
    numbers = {}
    for site in ("ivc", "svc"):
        own = case(
            gas=gas, ecmo=FEMORAL | sweep | {"drainage_site": site}, parameters=FAILING | {"Emaxlv": 0.9}
        )
        result = eclsim.simulate(own)
        assert result.attrs["converged"]
        numbers[site] = {name: float(result[name]) for name in ("SaO2", "SaO2_lower", "SvO2", "SpreO2")}
    for found in numbers.values():
        assert found["SaO2"] < found["SaO2_lower"] - 5.0
    assert numbers["ivc"]["SpreO2"] > numbers["ivc"]["SvO2"], "Hou 2015: 83.6 % in the inferior cava"
    assert numbers["svc"]["SpreO2"] < numbers["svc"]["SvO2"], "Hou 2015: 70.4 % against 73.4 % behind"
    assert numbers["svc"]["SaO2"] > numbers["ivc"]["SaO2"] + 2.0, "Falk 2023: 54 to 86 %"


@pytest.mark.slow
@pytest.mark.parametrize("width", [1, 32])
def test_the_beat_of_a_heart_that_bronchial_return_fills_is_found_at_once(width):
    """Blood moves to the lungs for a thousand beats until the left heart ejects what returns through them."""
    changes = {
        "Emaxlv": [0.241, 0.219], "Emaxrv": [1.03, 0.966], "Rmc": [0.855, 0.869], "Csvn": [22.405, 11.042],
        "Rpmc": [0.1, 0.031], "Cpvn": [16.304, 38.269], "Rsvn": [0.006, 0.02], "P0svn": [1.715, 2.42],
    }  # fmt: skip
    model = model_of(case(False, physiology={"bronchial_fraction": 0.015}, ecmo=VA))
    batch = Batch(model.circuit, {**model.values, **{k: np.array(v) for k, v in changes.items()}}, 2)
    beat = steady_beat(batch, ("LVO", "bronchial_flow"), execution=Execution(width=width))
    assert [Status(k).word for k in beat.status] == ["one_of_many"] * 2  # the right heart is shut all beat
    assert beat.orbits.beats.max() < 400
    np.testing.assert_allclose(*beat.values, rtol=1e-4)
    later = beat.orbits.wait(np.arange(2), beat.orbits.states, 500)
    np.testing.assert_allclose(later, beat.orbits.states, atol=1e-5)
