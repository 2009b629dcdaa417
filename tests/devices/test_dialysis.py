"""Dialysis of the CRRT from the case file on: off by default, its outputs, derivatives, and mistakes."""

import numpy as np
import pytest

import eclsim
from eclsim.cases import CaseError, read_case
from eclsim.cases.reading import read_mapping
from eclsim.devices.crrt import SITES_WITHOUT_ECMO, crrt
from eclsim.devices.dialysed_blood import CARBON_DIOXIDE_FROM_GASES, HAEMATOCRIT_OF_PATIENT, SETTINGS, SOLUTES
from eclsim.orbit.model import values_of
from eclsim.outputs.limits import broken_limits
from eclsim.sensitivity.inputs import InputError, varied_inputs
from eclsim.validation.reference_cases import DATA

FLUIDS = {"dialysate_ml_h": 1000, "replacement_post_ml_h": 1000, "net_ultrafiltration_ml_h": 100}
ON_ECMO = {"flow_ml_min": 200, "access_site": "post_oxy", "return_site": "pre_oxy"}
VV = {
    "format": 1,
    "patient": {
        "id": "vv", "sex": "male", "age_years": 45, "height_cm": 178, "weight_kg": 80, "heart_rate_bpm": 95,
    },
    "gas": {"haemoglobin_g_dl": 9.0, "shunt_fraction": 0.8},
    "ecmo": {
        "pump": "Rotaflow", "speed_rpm": 3400, "oxygenator": "Quadrox-i Adult", "drainage_site": "ra",
        "drainage_cannula": "venous", "drainage_fr": 25, "return_site": "ra", "return_cannula": "venous",
        "return_fr": 21, "sweep_l_min": 4.0,
    },
}  # fmt: skip
OUTPUTS_OF_FLUIDS = (
    *(f"{what}_{name}" for what in ("clearance", "effective_clearance") for name in SOLUTES), "citrate_load",
)  # fmt: skip
CASE = DATA / "cases" / "s4_crrt_g_3425.toml"


def written(folder, **keys):
    """The reference case with scheme g and some more keys of [crrt]."""
    lines = "".join(f"{key} = {value}\n" for key, value in keys.items())
    file = folder / "case.toml"
    file.write_text(CASE.read_text().replace("[crrt]\n", "[crrt]\n" + lines))
    return file


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    return read_case(written(tmp_path_factory.mktemp("dialysis"), **FLUIDS)).case


def test_without_fluids_nothing_of_it_is_there():
    plain = crrt("svn", "ra")
    assert not plain.exchanges
    assert not set(SETTINGS) & {*plain.parameter_names(), *plain.content_names()}
    with_fluids = crrt("svn", "ra", dialysis=True)
    assert with_fluids.without_exchanges() == plain
    assert set(SETTINGS) <= set(with_fluids.content_names())


def test_a_beat_has_clearances_and_the_same_pressures(case):
    result, plain = eclsim.simulate(case), eclsim.simulate(CASE)
    for name in plain.data_vars:
        np.testing.assert_array_equal(result[name].values, plain[name].values)
    assert set(result.data_vars) - set(plain.data_vars) >= {f"clearance_{solute}" for solute in SOLUTES}
    assert result["effluent_ml_h"] == pytest.approx(2100.0)
    assert result["filtration_fraction"] == pytest.approx(1100.0 / (200.0 * 60.0 * 0.7), rel=1e-9)
    mean = 0.5 * float(result["Pcrrtfil"].attrs["mean"] + result["Pcrrttuout"].attrs["mean"])
    assert result["effluent_pressure"] == pytest.approx(mean - float(result["transmembrane_pressure"]))
    assert 34.5 < float(result["clearance_urea"]) < 35.0
    again, water = float(result["crrt_recirculated_fraction"]), 200.0 * (0.93 * 0.7 + 0.8 * 0.3)
    cleared = float(result["clearance_urea"])
    expected = cleared * (1.0 - again) / (1.0 - again * (1.0 - cleared / water))
    assert float(result["effective_clearance_urea"]) == pytest.approx(expected, rel=1e-6)


def test_constants_without_a_source_are_said_until_a_case_sets_them(case):
    message = [line for line in eclsim.simulate(case).attrs["warnings"] if "assumed" in line]
    assert len(message) == 2
    assert "37 mL/h/mmHg" in message[0]
    assert "KoAurea 300 mL/min" in message[1]
    own = case.model_copy(update={"parameters": case.parameters | {"Kufcrrtfil": 45.0, "KoAurea": 280.0}})
    assert not [line for line in eclsim.simulate(own).attrs["warnings"] if "assumed" in line]


def test_fluid_taken_faster_than_patients_bear_is_warned_of():
    def said(rate):
        reading = read_mapping(VV | {"crrt": ON_ECMO | {"net_ultrafiltration_ml_h": rate}})
        return [str(remark) for remark in reading.warnings if "mL/kg/h" in str(remark)]

    assert said(140) == []
    (warning,) = said(3000)
    assert "37.5 mL/kg/h: above 1.75 mL/kg/h fewer critically ill patients survived" in warning


def test_fluid_taken_by_two_filters_counts_together():
    dialysed = {"flow_ml_min": 200, "access_site": "svn", "return_site": "ra"}
    raw = {key: value for key, value in VV.items() if key != "crrt"}
    two = {name: dialysed | {"net_ultrafiltration_ml_h": 100} for name in "ab"}
    said = [str(one) for one in read_mapping(raw | {"crrt": two}).warnings if "mL/kg/h" in str(one)]
    assert len(said) == 1
    assert "2.5 mL/kg/h together with [crrt.b]: above 1.75 mL/kg/h" in said[0]


def test_renox_has_the_checks_of_fluid_and_red_cells_of_a_crrt():
    raw = {key: value for key, value in VV.items() if key != "crrt"} | {"gas": {"haemoglobin_g_dl": 5}}
    renox = {"dialysate_ml_h": 2000, "net_ultrafiltration_ml_h": 500, "haematocrit_in": 0.3}
    said = " ".join(map(str, read_mapping(raw | {"renox": renox}).warnings))
    assert "6.2 mL/kg/h: above 1.75 mL/kg/h fewer critically ill patients survived" in said
    assert "red cells would hold 17 g/dL" in said


def test_no_filter_takes_all_water_of_the_plasma(case):
    plain = {key: value for key, value in VV.items() if key not in ("gas", "ecmo")}
    few, many = (
        {"crrt": {"flow_ml_min": 100, "replacement_post_ml_h": rate} | SITES_WITHOUT_ECMO}
        for rate in (3800, 4000)
    )
    assert read_mapping(plain | few)
    with pytest.raises(CaseError, match="together below 3906 mL/h"):
        read_mapping(plain | many)
    with pytest.raises(CaseError, match="together below 2511 mL/h"):
        read_mapping(plain | few | {"fluid": {"haematocrit": 0.55}})
    too_much = case.model_copy(
        update={"crrt": case.crrt.model_copy(update={"flow_ml_min": 100.0, "replacement_post_ml_h": 3950.0})}
    )
    beat = eclsim.simulate(too_much)
    assert np.isnan([float(beat[f"clearance_{solute}"]) for solute in SOLUTES]).all()
    (line,) = [line for line in beat.attrs["warnings"] if "96 % of the plasma would be filtered" in line]
    assert "of which 93 % is water: clearances" in line


@pytest.mark.slow
def test_clearances_beside_another_filter_are_said_to_know_nothing_of_it(case):
    raw = case.as_mapping()
    dialysed = {"flow_ml_min": 200, "access_site": "svn", "return_site": "ra"} | FLUIDS
    raw = {key: value for key, value in raw.items() if key not in ("crrt", "ecmo")}
    two = eclsim.simulate(read_mapping(raw | {"crrt": {"a": dialysed, "b": dialysed}}).case)
    said = [line for line in two.attrs["warnings"] if "cleared nothing" in line]
    assert len(said) == 2
    assert said[0].startswith(
        "caution: effective clearances of the CRRT a are computed as if [crrt.b] cleared nothing: too high"
    )
    assert not [line for line in eclsim.simulate(case).attrs["warnings"] if "cleared nothing" in line]


def test_without_gas_a_dialyzer_needs_no_blood_gases(case):
    single = case.model_copy(
        update={"ecmo": None, "crrt": case.crrt.model_copy(update=dict(SITES_WITHOUT_ECMO))}
    )
    result = eclsim.simulate(single)
    assert result.attrs["converged"]
    assert not [name for name in result.data_vars if "SaO2" in name]


GASEOUS = [
    ({"crrt": FLUIDS}, "crrt_carbon_dioxide_removal"),
    ({"crrt": FLUIDS | {"fluid_bicarbonate_mmol_l": 0}}, "crrt_carbon_dioxide_removal"),
    ({"renox": {"dialysate_ml_h": 5000}}, "renox_carbon_dioxide_removal"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("sections", "removal"), GASEOUS, ids=["fluid above blood", "no base", "renox"])
def test_carbon_dioxide_that_fluids_take_or_bring_is_in_the_balance_of_the_lungs(sections, removal):
    raw = VV | {key: (ON_ECMO if key == "crrt" else {}) | keys for key, keys in sections.items()}
    result, plain = eclsim.simulate(read_mapping(raw).case), eclsim.simulate(read_mapping(VV).case)
    taken = float(result[removal])
    lungs = float(result["VCO2_lung"] + result["VCO2_oxygenator"])
    assert abs(taken) > 3.0
    assert lungs + taken == pytest.approx(0.8 * float(result["VO2"]), rel=1e-9)
    assert float(result["VO2_lung"] + result["VO2_oxygenator"]) == pytest.approx(
        float(result["VO2"]), rel=1e-9
    )
    assert (float(result["PaCO2"]) - float(plain["PaCO2"])) * taken < 0.0


@pytest.mark.slow
def test_water_taken_off_with_what_it_holds_changes_no_gas():
    plain = eclsim.simulate(read_mapping(VV | {"crrt": ON_ECMO}).case)
    dry = eclsim.simulate(read_mapping(VV | {"crrt": ON_ECMO | {"net_ultrafiltration_ml_h": 1000}}).case)
    for name in ("PaCO2", "SaO2", "VCO2_lung"):
        assert float(dry[name]) == pytest.approx(float(plain[name]), rel=1e-9)
    assert float(dry["base_gain"]) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.slow
def test_arterial_carbon_dioxide_follows_the_fluid_as_its_derivative_says():
    case = read_mapping(VV | {"crrt": ON_ECMO | FLUIDS}).case
    exact = eclsim.derivatives(case, ["PaCO2"], ["crrt.fluid_bicarbonate_mmol_l", "crrt.dialysate_ml_h"])
    for name in exact["parameter"].values:
        value = float(exact["parameter_value"].sel(parameter=name))
        many = eclsim.simulate_many(case, {name: [0.999 * value, 1.001 * value]}, ["PaCO2"])
        slope = float(np.diff(many["PaCO2"].values)[0]) / (0.002 * value)
        assert float(exact.sel(output="PaCO2", parameter=name)) == pytest.approx(slope, rel=1e-4)


REMOVED = ["crrt_carbon_dioxide_removal", "base_gain", "PaCO2"]


@pytest.mark.slow
def test_a_filter_meets_the_bicarbonate_of_the_blood_that_reaches_it():
    gas = VV["gas"] | {"base_excess_mmol_l": -6.0}
    result = eclsim.simulate(read_mapping(VV | {"gas": gas, "crrt": ON_ECMO | FLUIDS}).case)
    into = eclsim.blood.gases(
        po2=float(result["PpostO2"]), pco2=float(result["PpostCO2"]), haemoglobin=9.0, base_excess=-6.0
    )
    total = float(into.bicarbonate) + 0.0307 * float(result["PpostCO2"])
    given = ON_ECMO | FLUIDS | {"plasma_bicarbonate_mmol_l": total}
    again = eclsim.simulate(read_mapping(VV | {"gas": gas, "crrt": given}).case)
    for name in ("crrt_carbon_dioxide_removal", "PaCO2"):
        # 1e-7 of the blood before the filter comes back from behind it with the beat.
        assert float(result[name]) == pytest.approx(float(again[name]), rel=1e-6), name
    usual = eclsim.simulate(
        read_mapping(VV | {"gas": gas, "crrt": given | {"plasma_bicarbonate_mmol_l": 24.0}}).case
    )
    assert float(usual["crrt_carbon_dioxide_removal"]) > float(result["crrt_carbon_dioxide_removal"]) + 3.0


@pytest.mark.slow
def test_the_bloods_own_bicarbonate_has_exact_derivatives_and_the_same_numbers_in_batches():
    case = read_mapping(VV | {"crrt": ON_ECMO | FLUIDS}).case
    names = ["gas.base_excess_mmol_l", "gas.haemoglobin_g_dl", "ecmo.sweep_l_min", "crrt.flow_ml_min"]
    exact = eclsim.derivatives(case, REMOVED, names)
    for name in names:
        value = float(exact["parameter_value"].sel(parameter=name))
        step = 1e-3 * max(abs(value), 1.0)
        many = eclsim.simulate_many(case, {name: [value - step, value + step, value]}, REMOVED)
        single = eclsim.simulate_many(case, {name: [value]}, REMOVED)
        for output in REMOVED:
            low, high, middle = many[output].values
            slope = (high - low) / (2.0 * step)
            assert float(exact.sel(output=output, parameter=name)) == pytest.approx(slope, rel=3e-4, abs=1e-6)
            # Programs for one and for many order products in their own ways.
            assert middle == pytest.approx(float(single[output].values[0]), rel=1e-13)


def test_renox_meets_the_haematocrit_and_the_bicarbonate_of_the_patient():
    values = values_of(read_mapping(VV | {"renox": {"dialysate_ml_h": 2000}}).case)
    assert values["renox.haematocrit_in"] == HAEMATOCRIT_OF_PATIENT
    assert values["renox.plasma_bicarbonate_mmol_l"] == CARBON_DIOXIDE_FROM_GASES
    without = {key: value for key, value in VV.items() if key != "gas"}
    without["ecmo"] = VV["ecmo"] | {"drainage_site": "svn"}
    values = values_of(read_mapping(without | {"renox": {"dialysate_ml_h": 2000}}).case)
    assert values["renox.haematocrit_in"] == 0.3
    assert values["renox.plasma_bicarbonate_mmol_l"] == 24.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("device", "outputs"),
    [
        (
            {"crrt": ON_ECMO | FLUIDS},
            ["filtration_fraction", "effective_clearance_creatinine", "fresh_plasma_ml_h", "PaCO2"],
        ),
        (
            {"renox": {"dialysate_ml_h": 2000, "net_ultrafiltration_ml_h": 300}},
            ["renox_filtration_fraction", "renox_clearance_urea", "PaCO2"],
        ),
    ],
)
def test_the_dialyzer_meets_the_varied_haemoglobin(device, outputs):
    """Variants and derivatives are those of cases with that haemoglobin."""
    cases = {x: read_mapping(VV | device | {"gas": {"haemoglobin_g_dl": x}}).case for x in (8.99, 9.0, 9.01)}
    single = {x: eclsim.simulate(case) for x, case in cases.items()}
    key = "gas.haemoglobin_g_dl"
    many = eclsim.simulate_many(cases[9.0], {key: list(cases)}, outputs)
    exact = eclsim.derivatives(cases[9.0], outputs, [key])
    for name in outputs:
        assert many[name].values == pytest.approx([float(one[name]) for one in single.values()], rel=1e-12)
        slope = (float(single[9.01][name]) - float(single[8.99][name])) / 0.02
        assert float(exact.sel(output=name, parameter=key)) == pytest.approx(slope, rel=1e-3, abs=1e-7)


@pytest.mark.slow
def test_without_gases_the_dialyzer_meets_the_haematocrit_of_the_fluid():
    without = {key: value for key, value in VV.items() if key != "gas"} | {"crrt": ON_ECMO | FLUIDS}
    without["ecmo"] = VV["ecmo"] | {"drainage_site": "svn"}
    fluid = {"haematocrit": 0.3, "reference_haematocrit": 0.3}
    thick = eclsim.simulate(read_mapping(without | {"fluid": fluid | {"haematocrit": 0.45}}).case)
    case, names = read_mapping(without | {"fluid": fluid}).case, ["filtration_fraction", "clearance_urea"]
    varied = {"fluid.haematocrit": [0.45, 0.3], "crrt.haematocrit_in": [0.0, 0.45]}
    many = eclsim.simulate_many(case, varied, names)
    for name in names:
        assert many[name].values == pytest.approx([float(thick[name])] * 2, rel=1e-9)
    unset = read_mapping(without | {"fluid": {}}).case
    assert values_of(unset)["crrt.haematocrit_in"] == HAEMATOCRIT_OF_PATIENT
    with pytest.raises(InputError, match=r"give crrt\.haematocrit_in in the case, or vary gas"):
        varied_inputs(case, values_of(case), ["crrt.haematocrit_in"])


@pytest.mark.slow
def test_derivatives_and_batches_are_those_of_single_beats(case):
    outputs = ["clearance_urea", "filtration_fraction", "effluent_pressure", "effective_clearance_urea"]
    parameters = ["crrt.dialysate_ml_h", "crrt.flow_ml_min", "ecmo.speed_rpm", "KoAurea"]
    exact = eclsim.derivatives(case, outputs, parameters)
    for name in parameters:
        value = float(exact["parameter_value"].sel(parameter=name))
        step = 1e-3 * value
        many = eclsim.simulate_many(case, {name: [value - step, value + step]}, outputs)
        for output in outputs:
            slope = float(np.diff(many[output].values)[0]) / (2.0 * step)
            assert float(exact.sel(output=output, parameter=name)) == pytest.approx(slope, rel=3e-4, abs=1e-7)


@pytest.mark.slow
def test_the_first_fluid_clears_as_much_as_it_is():
    # Without any the slopes by every fluid were 0; a mL/h of each clears a mL/h of all that passes freely.
    names = ("clearance_urea", "clearance_potassium", "base_gain", "PaCO2")
    dry = VV | {"crrt": ON_ECMO | dict.fromkeys(FLUIDS, 0.0) | {"replacement_pre_ml_h": 0.0}}
    fluids = [f"crrt.{key}" for key in (*FLUIDS, "replacement_pre_ml_h")]
    model = eclsim.model_of(read_mapping(dry).case)
    slopes = eclsim.derivatives(model, names, fluids)
    np.testing.assert_allclose(slopes.sel(output=list(names[:2])).values, 1.0 / 60.0, rtol=1e-9)
    ahead = eclsim.simulate_many(model, {"crrt.dialysate_ml_h": [0.0, 0.01]}, outputs=names)
    for name in names:
        difference = float(np.diff(ahead[name].values)[0]) / 0.01
        assert float(slopes.sel(output=name, parameter=fluids[0])) == pytest.approx(difference, rel=1e-4)


def test_more_filtered_than_there_is_plasma_is_no_number_and_no_failure(case):
    many = eclsim.simulate_many(
        case, {"crrt.replacement_post_ml_h": [1000.0, 13000.0]}, ["clearance_urea", "MAP"]
    )
    assert list(many["status"].values) == ["converged", "converged"]
    assert np.isfinite(many["clearance_urea"].values).tolist() == [True, False]


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"haematocrit_in": 30, **FLUIDS}, r"haematocrit_in = 30: .*percentage.*0\.3"),
        ({"dialysate_ml_h": -5}, r"dialysate_ml_h = -5: .*outside the allowed range.*0 to 20000 mL/h"),
        (
            {"dialysate_ml_h": 1000, "replacement_post_ml_h": 9000},
            r"post_ml_h = 9000: .*water removed.*8400 mL/h",
        ),
        ({"dialysate_ml_hr": 5}, r"dialysate_ml_hr = 5: unknown key.*dialysate_ml_h"),
    ],
)
def test_mistakes_are_one_line_each(tmp_path, keys, message):
    with pytest.raises(CaseError, match=message) as refused:
        read_case(written(tmp_path, **keys))
    assert len(str(refused.value).splitlines()) == 1


def test_dialysate_takes_no_plasma_and_thin_blood_has_more_of_it(tmp_path):
    """200 mL/min of blood: 8400 mL/h of plasma at 30 % of cells, 9838 at 6 g/dL of haemoglobin."""
    assert read_case(written(tmp_path, dialysate_ml_h=9000, replacement_pre_ml_h=4000)).case.crrt.dialyses
    read_mapping(VV | {"gas": {"haemoglobin_g_dl": 6}, "crrt": ON_ECMO | {"replacement_post_ml_h": 9000}})
    with pytest.raises(CaseError, match="flow of 9838 mL/h; allowed: together below 9149 mL/h"):
        read_mapping(VV | {"gas": {"haemoglobin_g_dl": 6}, "crrt": ON_ECMO | {"replacement_post_ml_h": 9900}})


def test_keys_without_a_flow_are_pointed_out(tmp_path):
    reading = read_case(written(tmp_path, fluid_bicarbonate_mmol_l=32))
    assert any("has no effect" in str(remark) for remark in reading.warnings)
    assert not reading.case.crrt.dialyses


@pytest.mark.slow
def test_a_pump_that_stands_still_clears_nothing_and_its_fluids_stand_still_too():
    still = read_mapping(VV | {"crrt": ON_ECMO | FLUIDS | {"flow_ml_min": 0, "citrate_mmol_l": 3}}).case
    result = eclsim.simulate(still)
    zero = (*OUTPUTS_OF_FLUIDS, "effluent_ml_h", "filtration_fraction", "crrt_flow", "base_gain")
    assert [float(result[name]) for name in zero] == pytest.approx([0.0] * len(zero), abs=1e-5)
    for line, site in (("access", "post_oxygenator"), ("return", "pre_oxygenator")):
        assert float(result[f"crrt_{line}_pressure"] - result[f"{site}_pressure"]) == pytest.approx(0, abs=1)
    running = read_mapping(VV | {"crrt": ON_ECMO | FLUIDS | {"citrate_mmol_l": 3}}).case
    in_batch = eclsim.simulate_many(running, {"crrt.flow_ml_min": [0.0, 200.0]}, zero)
    assert [float(in_batch[name][0]) for name in zero] == pytest.approx([0.0] * len(zero), abs=1e-5)
    assert all(float(in_batch[name][1]) > 0.0 for name in zero)
    (said,) = [line for line in result.attrs["warnings"] if "pump and fluids stand still" in line]
    assert "is lost if it cannot be given back: bleed_ml" in said
    assert "its lines raise no alarms of pressure" in said
    with pytest.raises(CaseError, match=r"allowed: 0, or 10 to 600 mL/min; did you mean 0\.2 L/min"):
        read_mapping(VV | {"crrt": ON_ECMO | {"flow_ml_min": 0.2}})


def test_citrate_with_fluids_that_are_not_made_for_it_is_warned_of():
    flows = ON_ECMO | FLUIDS | {"citrate_mmol_l": 3.0}
    (said,) = [w for w in read_mapping(VV | {"crrt": flows}).warnings if w.key == "crrt.citrate_mmol_l"]
    assert "36 mmol/h of citrate become up to 108 mmol/h of bicarbonate" in said.message
    assert "fluids made for citrate hold 20 to 25 mmol/L" in said.message
    made = read_mapping(VV | {"crrt": flows | {"fluid_bicarbonate_mmol_l": 22}}).warnings
    assert not [w for w in made if w.key == "crrt.citrate_mmol_l"]


def test_limits_of_filtration_and_of_the_membrane():
    broken = broken_limits({"filtration_fraction": 0.3, "transmembrane_pressure": 460.0})
    assert [(b.quantity, b.kind) for b in broken] == [
        ("transmembrane_pressure", "alarm"), ("filtration_fraction", "warning"),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("section", "key", "value", "message"),
    [
        ("crrt", "dialysate_ml_h", 1.5, r"0, or 20 to 20000 mL/h; did you mean 1\.5 L/h = 1500 mL/h"),
        ("crrt", "replacement_pre_ml_h", 0.8, r"did you mean 0\.8 L/h = 800 mL/h"),
        ("crrt", "net_ultrafiltration_ml_h", 0.1, r"0, or 1 to 20000 mL/h; did you mean 0\.1 L/h = 100 mL/h"),
        ("renox", "dialysate_ml_h", 2, r"did you mean 2 L/h = 2000 mL/h"),
        ("renox", "net_ultrafiltration_ml_h", 0.1, r"did you mean 0\.1 L/h = 100 mL/h"),
    ],
)
def test_a_flow_of_fluid_in_litres_is_named(section, key, value, message):
    own = (ON_ECMO if section == "crrt" else {"dialysate_ml_h": 2000}) | {key: value}
    with pytest.raises(CaseError, match=message):
        read_mapping(VV | {section: own})


def test_no_flow_of_fluid_is_allowed():
    read_mapping(VV | {"crrt": ON_ECMO | {"dialysate_ml_h": 0, "net_ultrafiltration_ml_h": 1}})


@pytest.mark.slow
def test_a_circuit_that_is_clamped_brings_the_patient_neither_base_nor_citrate_and_gives_no_plasma():
    """Blood goes in a circle: what it is given and loses there, the patient is not given and cannot lose."""
    names = ("effective_clearance_urea", "base_gain", "citrate_load", "fresh_plasma_ml_h")
    crrt_section = ON_ECMO | FLUIDS | {"citrate_mmol_l": 3.0}
    found = {}
    for clamp in (0.0, 1.0):
        raw = VV | {"crrt": crrt_section, "ecmo": VV["ecmo"] | {"return_clamp": clamp}}
        result = eclsim.simulate(read_mapping(raw).case)
        found[clamp] = [float(result[name]) for name in names]
        said = [line for line in result.attrs["warnings"] if "net ultrafiltration 100 mL/h is more" in line]
        assert len(said) == clamp
    shares = [closed / open_ for open_, closed in zip(found[0.0], found[1.0], strict=True)]
    assert max(shares) < 0.03
    # What one pass takes wholly reaches the filter less than what it hardly takes, which comes again.
    assert shares[3] < shares[0]


@pytest.mark.slow
@pytest.mark.slow
@pytest.mark.parametrize(
    ("more", "drained"),
    [
        ({"renox": {"dialysate_ml_h": 2000, "net_ultrafiltration_ml_h": 100}}, 0.0),
        ({"crrt": {**ON_ECMO, "return_site": "pre_rc", "dialysate_ml_h": 2000}}, 0.0),
        ({"crrt": {"flow_ml_min": 400, "access_site": "pre_pump", "return_site": "pre_rc"}}, 0.4),
    ],
    ids=["RenOx", "behind the oxygenator", "beside pump and oxygenator"],
)
def test_dialysis_hides_no_recirculation_of_the_ecmo_circuit(more, drained):
    """With RenOx it was 0, as only blood that had passed the oxygenator last was counted."""
    mixing = 0.3
    circuit = {**VV["ecmo"], "drainage_mixing": mixing}
    beat = eclsim.simulate(read_mapping(VV | {"ecmo": circuit} | more).case)
    taken = mixing * (float(beat["PF"]) + drained)
    expected = taken / (float(beat["CO"]) + taken)
    assert float(beat["recirculation_fraction"]) == pytest.approx(expected, rel=1e-3)


def test_recirculation_takes_from_base_and_citrate_what_it_takes_from_clearances():
    lines = {
        "post": ON_ECMO,
        "pre": {"flow_ml_min": 200, "access_site": "pre_oxy", "return_site": "post_oxy"},
    }
    base = {}
    for name, sites in lines.items():
        raw = VV | {"crrt": sites | {"dialysate_ml_h": 2000, "citrate_mmol_l": 3.0}}
        result = eclsim.simulate(read_mapping(raw).case)
        again, water = float(result["crrt_recirculated_fraction"]), 200.0 * 0.93 * (1.0 - 9.0 / 33.3)
        dose = 60.0 * 3.0 * 0.2
        kept = 1.0 - (dose - float(result["citrate_load"])) / dose
        base[name] = (again, kept, water)
    # A dose D of which p passes and R comes again reaches the patient as D p (1 - R) / (1 - R p).
    again, kept, _ = base["post"]
    _, passed, _ = base["pre"]
    assert base["pre"][0] < 1e-9 < again
    assert kept < passed
    assert kept == pytest.approx(passed * (1.0 - again) / (1.0 - again * passed), rel=5e-3)


def lines_of(access, back, circuits=None):
    """Case with CRRT lines at some positions, beside the plain circuit or named ones."""
    section = ON_ECMO | {"access_site": access, "return_site": back}
    return read_mapping(VV | {"crrt": section, "ecmo": circuits or VV["ecmo"]}).case


def test_a_position_may_have_the_name_of_the_plain_circuit():
    """`ecmo.post_oxy` was accepted, and ended in an error about unknown compartments of the circuit."""
    named = lines_of("ecmo.post_oxy", "ecmo.pre_oxy")
    assert (named.crrt.access_site, named.crrt.return_site) == ("post_oxy", "pre_oxy")
    assert values_of(named) == values_of(lines_of("post_oxy", "pre_oxy"))


def test_positions_that_are_allowed_are_those_of_the_circuits_of_the_case():
    """A plain circuit was offered as `ecmo.post_oxy`, and a further circuit that excludes it."""
    with pytest.raises(CaseError, match=r"no \[ecmo\.va\] section") as plain:
        lines_of("ecmo.va.post_oxy", "pre_oxy")
    assert ", post_dc, pre_pump, post_pump, pre_oxy, post_oxy, pre_rc" in str(plain.value)
    assert "or add" not in str(plain.value)
    assert "ecmo.post_oxy" not in str(plain.value)
    with pytest.raises(CaseError, match=r"no \[ecmo\] section") as named:
        lines_of("ecmo.post_oxy", "ecmo.a.pre_oxy", {"a": VV["ecmo"]})
    assert "ecmo.a.post_oxy" in str(named.value)
    assert "or add" not in str(named.value)
    with pytest.raises(CaseError, match=r"or add \[ecmo\.b\]"):
        lines_of("ecmo.b.post_oxy", "ecmo.a.pre_oxy", {"a": VV["ecmo"]})
