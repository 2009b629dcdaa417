"""The gas exchange of whole circuits: conservation, closed forms, status, derivatives, batches."""

from dataclasses import replace

import jax
import numpy as np
import pytest

import eclsim
from eclsim import gas
from eclsim.cases import CaseError
from eclsim.cases.reading import read_mapping
from eclsim.components.exchangers import Tissue
from eclsim.devices.ecmo_parts import OXYGENATORS
from eclsim.gas.network import gas_exchanges, gas_of
from eclsim.orbit.model import model_of
from eclsim.orbit.status import NoDerivativesError
from eclsim.outputs.steady_beat import steady_beat
from eclsim.sensitivity.inputs import varied_inputs
from eclsim.validation.gas_bench import single_pass

VV = {
    "format": 1,
    "patient": {
        "id": "vv", "sex": "male", "age_years": 45, "height_cm": 178, "weight_kg": 80, "heart_rate_bpm": 95,
    },
    "gas": {
        "haemoglobin_g_dl": 9.0, "base_excess_mmol_l": 0.0, "temperature_c": 37.0, "vo2_ml_min": 250.0,
        "respiratory_quotient": 0.8, "fio2": 0.5, "alveolar_ventilation_l_min": 2.0, "shunt_fraction": 0.8,
    },
    "ecmo": {
        "pump": "Rotaflow", "speed_rpm": 3400, "oxygenator": "Quadrox-i Adult", "drainage_site": "ra",
        "drainage_cannula": "venous", "drainage_fr": 25, "return_site": "ra", "return_cannula": "venous",
        "return_fr": 21, "sweep_l_min": 4.0, "fdo2": 1.0, "drainage_mixing": 0.3,
    },
}  # fmt: skip


def model(**changes):
    """The model of the case above, with keys such as `gas_fio2` or `ecmo_sweep_l_min` changed."""
    raw = {section: dict(keys) if isinstance(keys, dict) else keys for section, keys in VV.items()}
    for key, value in changes.items():
        section, _, name = key.partition("_")
        raw[section][name] = value
    return model_of(read_mapping(raw).case)


@pytest.fixture(scope="module")
def steady():
    return eclsim.simulate(model())


def test_what_the_lungs_exchange_is_what_the_tissues_do(steady):
    taken_up = float(steady.VO2_lung + steady.VO2_oxygenator)
    given_off = float(steady.VCO2_lung + steady.VCO2_oxygenator)
    assert taken_up == pytest.approx(250.0, rel=1e-8)
    assert given_off == pytest.approx(0.8 * 250.0, rel=1e-8)
    assert float(steady.VO2) == pytest.approx(250.0, rel=1e-8)


def test_fick_holds_between_artery_and_pulmonary_artery(steady):
    """Shunted and oxygenated blood mix: VO2_lung = CO (CaO2 - CvO2)."""
    contents = [
        eclsim.blood.gases_with_saturation(saturation=s / 100.0, pco2=p, haemoglobin=9.0).oxygen
        for s, p in ((float(steady.SaO2), float(steady.PaCO2)),)
    ]
    assert 10.0 * float(steady.systemic_flow) * float(contents[0]) == pytest.approx(
        float(steady.DO2), rel=1e-3
    )


def test_recirculation_is_the_closed_form(steady):
    flow, output, mixing = float(steady.PF), float(steady.CO), 0.3
    assert float(steady.recirculation_fraction) == pytest.approx(
        mixing * flow / (output + mixing * flow), rel=1e-4
    )


@pytest.mark.slow
def test_other_sites_recirculate_what_the_atrium_throws_back():
    """Drained from the veins and returned to the atrium, only blood that flows back is drawn again."""
    apart = eclsim.simulate(model(ecmo_drainage_site="svn"))
    mixed = float(apart.PF / (apart.CO + apart.PF))
    assert 0.0 < float(apart.recirculation_fraction) < 0.5 * mixed


@pytest.mark.parametrize(
    ("changes", "status"),
    [
        ({"ecmo_sweep_l_min": 0.0, "gas_alveolar_ventilation_l_min": 0.0}, "no_oxygen"),
        ({"ecmo_sweep_l_min": 0.0, "gas_shunt_fraction": 1.0}, "no_oxygen"),
        ({"ecmo_sweep_l_min": 0.0, "gas_alveolar_ventilation_l_min": 0.15, "gas_fio2": 1.0}, "no_removal"),
    ],
)
def test_without_a_steady_state_there_are_no_numbers_but_a_finding(changes, status):
    result = eclsim.simulate(model(**changes))
    assert result.attrs["gas_status"] == status
    assert result.attrs["status"] == "converged"
    assert np.isnan([float(result.SaO2), float(result.VO2_oxygenator)]).all()
    assert np.isfinite(result.MAP)
    assert any("no steady gas state" in sentence for sentence in result.attrs["warnings"])


@pytest.mark.slow
def test_gases_that_are_not_there_have_their_own_status_wherever_they_are_asked_for():
    patient = model(gas_shunt_fraction=1.0, ecmo_sweep_l_min=0.0)
    many = eclsim.simulate_many(patient, {"gas.shunt_fraction": [0.5, 1.0]}, outputs=["SaO2"])
    assert many["gas_status"].values.tolist() == ["steady", "no_oxygen"]
    assert np.isfinite(many["SaO2"].values).tolist() == [True, False]
    assert "less than a tenth of the oxygen" in str(many["message"].values[1])
    with pytest.raises(NoDerivativesError, match=r"no derivatives \(no_oxygen\)"):
        eclsim.derivatives(patient, ["SaO2"], ["ecmo.speed_rpm"])
    slopes = eclsim.derivatives(patient, ["SaO2"], ["ecmo.speed_rpm"], throw=False)
    assert slopes.attrs["status"] == "no_oxygen"
    assert np.isnan(slopes).all()
    assert np.isfinite(eclsim.derivatives(patient, ["MAP"], ["ecmo.speed_rpm"])).all()


def test_consumption_below_demand_is_said():
    result = eclsim.simulate(model(ecmo_sweep_l_min=0.0, gas_shunt_fraction=0.7, gas_fio2=0.21))
    assert result.attrs["gas_status"] == "steady"
    assert 200.0 < float(result.VO2) < 230.0
    assert any("below the 250 mL/min" in sentence for sentence in result.attrs["warnings"])
    assert any("no acid is made where oxygen is lacking" in sentence for sentence in result.attrs["warnings"])
    assert result.pHa.attrs["read_with_care"] == result.PaCO2.attrs["read_with_care"] == 1
    assert "read_with_care" not in eclsim.simulate(model()).pHa.attrs


DERIVED = (
    "SaO2", "PaO2", "PaCO2", "pHa", "SvO2", "VO2", "VO2_lung", "VCO2_lung", "DO2", "O2ER", "SpreO2", "PpreO2",
    "PpreCO2", "SpostO2", "PpostO2", "PpostCO2", "SreturnO2", "PreturnCO2", "VO2_oxygenator",
    "VCO2_oxygenator", "recirculation_fraction", "MAP",
)  # fmt: skip
BY = {
    "ecmo.speed_rpm": 2.0, "ecmo.sweep_l_min": 1e-3, "gas.haemoglobin_g_dl": 1e-3, "Rmc": 1e-4,
    "ecmo.drainage_mixing": 1e-3, "gas.shunt_fraction": 1e-4,
}  # fmt: skip


@pytest.mark.slow
def test_derivatives_are_those_of_differences():
    base = model()
    exact = eclsim.derivatives(base, DERIVED, list(BY))
    for name, step in BY.items():
        changes = {name: base.values[name] + step * np.array([-1.0, 1.0])}
        both = eclsim.simulate_many(base, changes, DERIVED)
        for output in DERIVED:
            difference = float(np.diff(both[output].values)[0]) / (2.0 * step)
            result = float(exact.sel(output=output, parameter=name))
            scale = abs(float(exact.sel(output=output).value)) / abs(base.values[name])
            assert result == pytest.approx(difference, rel=2e-3, abs=2e-4 * scale), (output, name)


def test_batches_give_what_single_patients_do():
    base = model()
    many = eclsim.simulate_many(
        base,
        {"ecmo.sweep_l_min": np.array([1.0, 4.0, 8.0]), "gas.haemoglobin_g_dl": np.array([8.0, 9.0, 11.0])},
    )
    single = eclsim.simulate(base)
    for name in ("SaO2", "PaCO2", "VO2_oxygenator", "O2ER"):
        assert float(many[name][1]) == pytest.approx(float(single[name]), rel=1e-9)
    assert (np.diff(many.PaCO2.values) < 0.0).all()
    assert list(many.gas_status.values) == ["steady"] * 3


def test_without_the_section_nothing_is_added():
    raw = {key: value for key, value in VV.items() if key != "gas"}
    raw["ecmo"] = {**VV["ecmo"], "drainage_site": "svn"}
    reading = read_mapping(raw)
    result = eclsim.simulate(reading.case)
    assert "SaO2" not in result
    assert "gas_status" not in result.attrs
    assert any("without effect" in warning.message for warning in reading.warnings)


@pytest.mark.slow
def test_shares_of_tissues_add_to_the_demand():
    circuit = model().circuit
    (tissue,) = (e for e in circuit.exchanges if isinstance(e.component, Tissue))
    halves = tuple(
        replace(tissue, name=f"tissue_{at}", component=Tissue(share=0.5), at=at) for at in ("sart", "ao")
    )
    others = tuple(e for e in circuit.exchanges if e is not tissue)
    base = model()
    split = eclsim.simulate(replace(base, circuit=replace(circuit, exchanges=(*halves, *others))))
    assert float(split.VO2) == pytest.approx(250.0, rel=1e-6)


def test_the_network_lists_what_it_reads():
    circuit = model().circuit
    assert {e.name for e in gas_exchanges(circuit)} == {"tissue", "lung", "ecmooxy"}
    assert set(gas_of(circuit).parameters) <= set(circuit.content_names())


def test_circuits_that_carry_the_same_blood_share_their_programs():
    """Each program takes seconds to compile; reflexes and laws of vessels are no part of any."""
    raw = VV | {"regulation": {"baroreflex": 1.0}, "physiology": {"pericardium": True}}
    circuits = [model().circuit, model_of(read_mapping(raw).case).circuit]
    assert circuits[0] != circuits[1]
    assert len({id(gas_of(circuit)) for circuit in circuits}) == 1
    assert gas_of(model(ecmo_drainage_site="svn").circuit) is not gas_of(circuits[0])


@pytest.mark.slow
def test_derivatives_start_from_what_the_search_has_found(monkeypatch):
    """The search is most of a program and was compiled once more for them."""
    function = gas_of(model().circuit)
    numbers = np.ones(2 * len(function.connections) + len(function.parameters))
    found = jax.eval_shape(function.compute, numbers)
    assert found.shape == (len(function.quantities),)
    monkeypatch.setattr(gas.steady, "_searched", None)
    assert function.without_search is not None
    assert jax.eval_shape(function.without_search, numbers, found) == found
    with pytest.raises(TypeError):
        jax.eval_shape(lambda x: function.compute(x), numbers)  # another function than the one traced above


@pytest.mark.slow
def test_consumption_follows_the_temperature_only_if_the_case_says_so():
    cold = {"gas_temperature_c": 34.0}
    assert float(eclsim.simulate(model(**cold)).VO2) == pytest.approx(250.0, rel=1e-8)
    follows = model(**cold, gas_vo2_percent_per_c=8.5)
    beat = steady_beat(eclsim.Batch.of(follows))
    assert beat.outputs()["VO2"] == pytest.approx(250.0 / 1.085**3, rel=1e-8)
    assert "VO2" not in {finding.quantity for finding in beat.findings()}  # the tissues want no more
    names = ("gas.temperature_c", "gas.vo2_percent_per_c")
    found = eclsim.derivatives(follows, ("VO2", "SvO2", "PaCO2"), names)
    for name, step in zip(names, (1e-3, 1e-3), strict=True):
        ends = eclsim.simulate_many(
            follows, {name: follows.values[name] + np.array([-step, step])}, ("VO2", "SvO2", "PaCO2")
        )
        for output in ("VO2", "SvO2", "PaCO2"):
            slope = float(ends[output][1] - ends[output][0]) / (2.0 * step)
            assert float(found.sel(output=output, parameter=name)) == pytest.approx(slope, rel=1e-5)


INPUTS = (
    "gas.haemoglobin_g_dl", "gas.base_excess_mmol_l", "gas.temperature_c", "gas.vo2_ml_min",
    "gas.respiratory_quotient", "gas.fio2", "gas.alveolar_ventilation_l_min", "gas.shunt_fraction",
    "ecmo.sweep_l_min", "ecmo.fdo2", "ecmo.drainage_mixing", "ecmo.oxygenator.oxygen_transfer",
)  # fmt: skip


def test_gas_inputs_vary_within_what_is_allowed():
    case = read_mapping(VV).case
    chosen = varied_inputs(case, model().values, parameters=("Rmc",), include=INPUTS)
    ranges = {one.name: (one.low, one.high) for one in chosen.inputs}
    assert len(ranges) == 13
    assert ranges["ecmo.fdo2"] == (0.75, 1.0)
    assert ranges["gas.base_excess_mmol_l"] == (-5.0, 5.0)
    assert ranges["gas.haemoglobin_g_dl"] == pytest.approx((6.75, 11.25))


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("gas_fio2", 40, "40 % = 0.4"),
        ("gas_shunt_fraction", 40, "40 % = 0.4"),
        ("gas_haemoglobin_g_dl", 100, "100 g/L = 10 g/dL"),
        ("ecmo_sweep_l_min", -1, "0 to 20 L/min"),
        ("ecmo_fdo2", 0.1, "0.21 to 1"),
        ("ecmo_fdo2", 95, "95 % = 0.95"),
    ],
)
def test_a_value_in_another_unit_is_one_line_that_names_it(key, value, says):
    with pytest.raises(CaseError) as caught:
        model(**{key: value})
    assert len(caught.value.mistakes) == 1
    assert says in str(caught.value)


def test_haemoglobin_that_may_be_in_mmol_is_named_and_not_converted():
    raw = {**VV, "gas": {**VV["gas"], "haemoglobin_g_dl": 6.2}}
    reading = read_mapping(raw)
    assert reading.case.gas.haemoglobin_g_dl == 6.2
    assert any("6.2 mmol/L = 10.0 g/dL" in str(warning) for warning in reading.warnings)


def test_consumption_follows_from_the_body_where_it_is_left_out():
    raw = {**VV, "gas": {key: value for key, value in VV["gas"].items() if key != "vo2_ml_min"}}
    assert model_of(read_mapping(raw).case).values["gas.vo2_ml_min"] == pytest.approx(
        126.0 * (178 * 80 / 3600) ** 0.5
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", OXYGENATORS)
def test_an_oxygenator_saturates_blood_at_the_highest_flow_that_it_is_made_for(name):
    membrane = OXYGENATORS[name].membrane
    flow = membrane.highest_flow_l_min
    passed = single_pass(flow, flow, 0.65, oxygen_transfer=membrane.oxygen_transfer)
    assert passed.saturation == pytest.approx(99.65, abs=0.02)
    assert passed.oxygen == pytest.approx(60.5 * flow, rel=0.005)


def test_gases_of_a_patient_depend_on_no_other_member_to_the_last_bit():
    base, speeds = model(), np.linspace(2800.0, 3600.0, 11)
    whole = eclsim.simulate_many(base, {"ecmo.speed_rpm": speeds}, DERIVED)
    for members in ([10], [9, 2, 10], [*range(10, 0, -1)]):
        part = eclsim.simulate_many(base, {"ecmo.speed_rpm": speeds[members]}, DERIVED)
        for name in DERIVED:
            np.testing.assert_array_equal(part[name].values, whole[name].values[members], name)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "outputs"),
    [
        ("gas.alveolar_ventilation_l_min", ("PaCO2", "pHa", "VCO2_lung", "VO2_lung")),
        ("ecmo.sweep_l_min", ("PaCO2", "PaO2", "VCO2_oxygenator", "VO2_oxygenator")),
    ],
)
def test_slopes_at_no_ventilation_or_sweep_are_those_towards_more(name, outputs):
    """Less there is not: the gas that is left, nothing but for rounding, may have either sign."""
    base, step = model(**{name.replace(".", "_"): 0.0}), 1e-6
    some = eclsim.simulate_many(base, {name: [0.0, step]}, outputs)
    exact = eclsim.derivatives(base, outputs, [name])
    for output in outputs:
        difference = float(np.diff(some[output].values)[0]) / step
        assert float(exact.sel(output=output, parameter=name)) == pytest.approx(difference, rel=1e-3), output
