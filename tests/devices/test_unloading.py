"""Vent, septostomy and RenOx: closed forms in the beat, blood conserved, mistakes."""

import numpy as np
import pytest

import eclsim
from eclsim.cases import CaseError
from eclsim.cases.reading import read_mapping
from eclsim.components import dialysis
from eclsim.devices.cannulae import CANNULAE
from eclsim.devices.renox import SETTINGS
from eclsim.orbit.model import model_of
from eclsim.outputs.limits import backward_flow_bounds

PATIENT = {"id": "P", "sex": "female", "age_years": 70, "heart_rate_bpm": 90}
ECMO = {"pump": "Rotaflow", "speed_rpm": 3200, "oxygenator": "Quadrox-i Adult", "mode": "VA"}
FAILING = {"Emaxlv": 0.5, "Emaxrv": 0.3, "Rmc": 0.8}


def case(**sections):
    raw = {"format": 1, "blood_volume_policy": "patient_held", "patient": PATIENT, "parameters": FAILING}
    return read_mapping(raw | {"ecmo": ECMO} | sections).case


@pytest.fixture(scope="module")
def alone():
    return eclsim.simulate(case())


@pytest.mark.slow
def test_a_vent_is_an_orifice_of_its_size_that_unloads_the_left_ventricle(alone):
    vented = eclsim.simulate(case(vent={"site": "lv", "fr": 12}))
    assert vented.attrs["converged"]
    drop = (vented["Plv"] - vented["Pecmodrain"]).values
    at_15 = 1000.0 / 60.0 / CANNULAE["arterial"].resistance(15.0) ** 0.5
    expected = np.sign(drop) * at_15 * (12.0 / 15.0) ** 2 * np.sqrt(np.abs(drop))
    np.testing.assert_allclose(vented["Qvent"].values, expected, atol=0.02)
    flow = {name: float(vented[name]) for name in ("vent_flow", "CO", "LVO", "PF")}
    assert flow["vent_flow"] == pytest.approx(flow["CO"] - flow["LVO"], abs=1e-4)
    assert float(vented["EDVLV"]) < float(alone["EDVLV"]) - 2.0
    assert float(vented["PCWP"]) < float(alone["PCWP"])


@pytest.mark.slow
def test_blood_that_the_right_ventricle_pumps_round_through_a_hole_is_said():
    """A hole of 10 mm let 6.5 L/min run back to the lungs at an ECMO flow of 4.2, without a word."""
    full = case(septostomy={"diameter_mm": 10}, fluid={"extra_volume_ml": 900})
    beat = eclsim.simulate(full)
    (said,) = [text for text in beat.attrs["warnings"] if "hole in the septum" in text]
    assert said.startswith(f"caution: {float(beat['septostomy_flow']):.1f} L/min run through the hole")
    assert "Baruteau 2018" in said
    small = eclsim.simulate(full.with_section("septostomy", diameter_mm=1.0))
    assert not any("hole in the septum" in text for text in small.attrs["warnings"])


@pytest.mark.slow
def test_a_vent_that_feeds_the_drainage_cannula_backwards_is_an_alarm_and_a_bound_of_settings(alone):
    slow = case(vent={"site": "lv", "fr": 17}).with_section("ecmo", speed_rpm=1500.0)
    vented = eclsim.simulate(slow)
    flow = {name: float(vented[name]) for name in ("vent_flow", "drainage_cannula_flow", "PF")}
    assert flow["drainage_cannula_flow"] < -0.1
    assert flow["drainage_cannula_flow"] + flow["vent_flow"] == pytest.approx(flow["PF"], abs=1e-4)
    assert any("runs through the drainage cannula into the patient" in w for w in vented.attrs["warnings"])
    assert "drainage_cannula_flow" not in alone
    names = [str(name) for name in vented.data_vars]
    assert "drainage_cannula_flow" in {limit.quantity for limit in backward_flow_bounds(names)}


@pytest.mark.slow
def test_a_hole_in_the_septum_parts_the_outputs_of_the_ventricles(alone):
    opened = eclsim.simulate(case(septostomy={"diameter_mm": 8}))
    assert opened.attrs["converged"]
    area = 0.61 * np.pi / 4.0 * 0.8**2
    drop = (opened["Pla"] - opened["Pra"]).values
    expected = np.sign(drop) * 50.155 * area * np.sqrt(np.abs(drop))
    np.testing.assert_allclose(opened["Qseptostomy"].values, expected, atol=0.02)
    shunt = float(opened["septostomy_flow"])
    assert shunt == pytest.approx(float(opened["CO"] - opened["LVO"]), abs=1e-4)
    assert shunt > 0.1
    assert float(opened["left_atrial_pressure"]) < float(alone["left_atrial_pressure"]) - 1.0


def test_renox_moves_no_blood_and_clears_as_its_fibres_do_at_the_flow_of_the_ecmo(alone):
    own = case(renox={"dialysate_ml_h": 2000, "net_ultrafiltration_ml_h": 100})
    result = eclsim.simulate(own)
    for name in alone.data_vars:
        np.testing.assert_array_equal(result[name].values, alone[name].values)
    values = model_of(own).values
    settings = dialysis.Settings(*(values[name] for name in SETTINGS))
    blood = float(result["PF"]) * 1000.0
    urea = settings.solute("urea")
    expected = dialysis.clearance(urea.water_flow(blood, settings.haematocrit), settings.fluids, urea)
    assert float(result["renox_clearance_urea"]) == pytest.approx(float(expected), rel=1e-6)
    assert float(result["renox_clearance_urea"]) == pytest.approx(
        2100.0 / 60.0, rel=0.005
    )  # effluent-limited
    mean = 0.5 * float(result["pre_oxygenator_pressure"] + result["post_oxygenator_pressure"])
    assert float(result["renox_effluent_pressure"]) == pytest.approx(mean - 100.0 / 37.0, rel=1e-6)
    assert float(result["renox_free_ultrafiltration_ml_h"]) == pytest.approx(37.0 * mean, rel=1e-6)


def test_renox_clears_blood_that_runs_backwards_and_says_how_it_was_computed():
    """Nothing was computed, so that a course with solutes ended at a stopped pump."""
    fluids = {"dialysate_ml_h": 2000, "net_ultrafiltration_ml_h": 100}
    slow = case(ecmo=ECMO | {"speed_rpm": 1000}, renox=fluids, parameters={})
    result = eclsim.simulate(slow)
    assert float(result["PF"]) < -0.1
    assert float(result["renox_clearance_urea"]) == pytest.approx(2100.0 / 60.0, rel=0.05)
    assert 0.0 < float(result["renox_filtration_fraction"]) < 0.1
    assert any("RenOx: blood runs backwards through the housing" in one for one in result.attrs["warnings"])


@pytest.mark.slow
def test_a_second_return_takes_its_share_of_the_flow_and_its_clamp_gives_it_back(alone):
    second = {"second_return_site": "ra", "second_return_fr": 15}
    drained = {"drainage_site": "svn", "drainage_cannula": "venous", "drainage_fr": 25}
    flows = {}
    for clamp in (0.0, 0.6, 1.0):
        result = eclsim.simulate(case(ecmo=ECMO | drained | second | {"second_return_clamp": clamp}))
        assert result.attrs["converged"]
        given = result["Qecmoreturn"].values + result["Qecmoreturn2"].values
        drop = (result["Pecmoreturn"] - result["Pra"]).values
        size = CANNULAE["arterial"].resistance(15.0) / max((1.0 - clamp) ** 2, 1e-9)
        expected = np.sqrt(drop / size) * 1000.0 / 60.0
        np.testing.assert_allclose(result["Qecmoreturn2"].values, expected, rtol=1e-3, atol=0.02)
        assert np.isfinite(given).all()
        flows[clamp] = float(result["second_return_flow"])
    one = eclsim.simulate(case(ecmo=ECMO | drained))
    assert flows[0.0] > flows[0.6] > 0.2
    assert flows[1.0] == pytest.approx(0.0, abs=1e-3)
    assert float(result["PF"]) == pytest.approx(float(one["PF"]), abs=2e-3)


@pytest.mark.slow
def test_left_atrial_drainage_unloads_the_left_side(alone):
    result = eclsim.simulate(case(ecmo=ECMO | {"second_drainage_site": "la", "second_drainage_fr": 21}))
    assert float(result["second_drainage_flow"]) == pytest.approx(
        float(result["CO"] - result["LVO"]), abs=1e-4
    )
    assert float(result["PCWP"]) < float(alone["PCWP"]) - 1.0


@pytest.mark.parametrize(
    ("sections", "line"),
    [
        ({"vent": {"site": "rv", "fr": 12}}, 'vent.site = "rv": unknown name; allowed: lv, la, pas'),
        ({"vent": {"site": "lv", "fr": 45}}, "vent.fr = 45: outside the allowed range"),
        ({"septostomy": {"diameter_mm": 0.8}}, "septostomy.diameter_mm = 0.8: outside the allowed range"),
        (
            {"ecmo": ECMO | {"second_return_site": "la"}},
            "ecmo.second_return_fr: missing, although second_return_",
        ),
        (
            {"ecmo": ECMO | {"second_return_site": "ra", "second_return_fr": 15}},
            'ecmo.second_return_site = "ra": a site of the first cannulae',
        ),
        (
            {"ecmo": ECMO | {"second_return_site": "la", "second_return_fr": 17, "second_return_clamp": 60}},
            "ecmo.second_return_clamp = 60: outside the allowed range; allowed: 0 to 1",
        ),
        ({"renox": {"net_ultrafiltration_ml_h": 100}}, "renox.dialysate_ml_h: missing"),
    ],
)
def test_mistakes_are_one_line_each(sections, line):
    with pytest.raises(CaseError) as caught:
        case(**sections)
    assert len(caught.value.mistakes) == 1
    assert str(caught.value).startswith(line)


@pytest.mark.parametrize("section", [{"vent": {"site": "lv", "fr": 12}}, {"renox": {"dialysate_ml_h": 2000}}])
def test_what_needs_an_ecmo_circuit_says_so(section):
    raw = {"format": 1, "patient": PATIENT}
    with pytest.raises(CaseError, match=r"the case has no \[ecmo\] section; allowed: one \[ecmo\] section"):
        read_mapping(raw | section)


@pytest.mark.slow
def test_a_course_goes_on_through_a_renox_in_which_blood_runs_backwards_and_ends_where_no_water_is_left():
    """It ended at the backward flow, and beat by beat with "the gases could not be followed"."""
    stop = {"at_min": 0.2, "set": {"ecmo.speed_rpm": 0}}
    clamp = {"at_min": 0.5, "set": {"ecmo.return_clamp": 1}}
    renox = {"dialysate_ml_h": 2000, "net_ultrafiltration_ml_h": 100}
    own = case(ecmo=ECMO, renox=renox, gas={}, solutes={}, parameters={}, events=[stop])
    result = eclsim.course_beats(own, minutes=0.6, outputs=("PF", "renox_clearance_urea"))
    assert not result.attrs["message"]
    assert float(result["PF"][-1]) < -0.1
    assert float(result["renox_clearance_urea"][-1]) > 30.0
    own = case(ecmo=ECMO, renox=renox, gas={}, solutes={}, parameters={}, events=[stop, clamp])
    result = eclsim.course_beats(own, minutes=0.7, outputs=("PF",))
    assert "a filter takes as much water from its blood as the plasma holds" in result.attrs["message"]


def test_a_vent_beside_named_circuits_is_told_that_it_needs_one_without_a_name():
    """It was said that the case had no [ecmo] section, although it had two."""
    raw = {"format": 1, "patient": PATIENT, "vent": {"site": "la", "fr": 14}}
    with pytest.raises(
        CaseError, match="a vent needs an ECMO circuit without a name; the case has only named"
    ):
        read_mapping(raw | {"ecmo": {"va": ECMO, "vv": ECMO | {"mode": "VV"}}})
    with pytest.raises(CaseError, match="but the case has no \\[ecmo\\] section"):
        read_mapping(raw)
