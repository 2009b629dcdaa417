"""Solutes under dialysis against closed forms, their balances, and stores of carbon dioxide."""

import numpy as np
import pytest
from scipy.linalg import expm

from eclsim.blood.acid_base import bicarbonate, ph_of
from eclsim.blood.gases import gases, gases_with_contents
from eclsim.blood.types import Blood
from eclsim.cases.reading import read_mapping
from eclsim.components.exchangers import HAEMOGLOBIN
from eclsim.course.laws import laws_of
from eclsim.fluid import solutes as module
from eclsim.fluid.solutes import (
    BASE_EXCESS,
    CarbonDioxideLaw,
    Filter,
    SolutesLaw,
    standard_base_excess,
    standard_bicarbonate,
)
from eclsim.orbit.model import model_of
from eclsim.orbit.steady import Batch
from eclsim.outputs.steady_beat import steady_beat
from eclsim.parameters.fluid import CARBON_DIOXIDE_STORES_HOLD, PARAMETERS
from eclsim.slow import INFLOWS

LAW = SolutesLaw((Filter("crrt"),), gas=True)
RENOX = ("renox_clearance", "renox_base_gain", "")
BEAT = {
    "effective_clearance_urea": 30.0, "effective_clearance_creatinine": 28.0,
    "effective_clearance_potassium": 29.0, "base_gain": 6.0, "citrate_load": 0.0,
}  # fmt: skip
SETTINGS = {
    "crrt.net_ultrafiltration_ml_h": 0.0, "crrt.plasma_bicarbonate_mmol_l": 22.0, BASE_EXCESS: -2.0,
    HAEMOGLOBIN: 10.0, "gas.respiratory_quotient": 0.8,
}  # fmt: skip


def settings(**changes):
    values = {key: one.value for key, one in PARAMETERS.items()} | SETTINGS | {"gas.temperature_c": 37.0}
    return {k: np.array([v]) for k, v in (values | {f"solutes.{n}": v for n, v in changes.items()}).items()}


def after(hours, values, law=LAW, step_s=60.0, **inflows):
    """States along the classical Runge-Kutta method at a steady beat."""
    beat = {key: np.array([value]) for key, value in BEAT.items()}
    given = {kind: np.array([inflows.get(kind, 0.0)]) for kind in INFLOWS}
    states = law.start(values, beat)
    for _ in range(round(3600 * hours / step_s)):
        slopes = [law.rates(states, values, beat, given)]
        for part in (0.5, 0.5, 1.0):
            moved = {k: states[k] + part * step_s * slopes[-1][k] for k in states}
            slopes.append(law.rates(moved, values, beat, given))
        a, b, c, d = slopes
        states = {k: x + step_s / 6.0 * (a[k] + 2.0 * b[k] + 2.0 * c[k] + d[k]) for k, x in states.items()}
    return states


@pytest.mark.parametrize(
    ("one", "urea", "gain"),
    [
        (Filter("crrt"), "effective_clearance_urea", "base_gain"),
        (Filter("crrt.left"), "crrt.left.effective_clearance_urea", "crrt.left.base_gain"),
        (Filter("renox", *RENOX), "renox_clearance_urea", "renox_base_gain"),
        (Filter("renox.left", *RENOX), "renox.left.clearance_urea", "renox.left.base_gain"),
    ],
)
def test_a_filter_reads_the_outputs_of_its_device_under_their_names(one, urea, gain):
    assert {urea, gain} <= set(one.reads)


def test_what_is_shown_at_the_start_is_what_the_case_says_in_its_units():
    said = {"urea": ("mmol/L", 31.0), "creatinine": ("umol/L", 410.0), "potassium": ("mmol/L", 5.1)}
    units = {"umol/L": "umol_l", "mmol/L": "mmol_l"}
    values = settings(**{f"{name}_{units[unit]}": value for name, (unit, value) in said.items()})
    shown = {one.name: one for one in LAW.derived_quantities(LAW.start(values, {}), values)}
    assert {name: (shown[name].unit, shown[name].values.item()) for name in said} == {
        name: (unit, pytest.approx(value)) for name, (unit, value) in said.items()
    }


@pytest.mark.slow
def test_one_pool_decays_as_its_exponential(monkeypatch):
    monkeypatch.setitem(module.POOL_TRANSFER_ML_MIN, "urea", 0.0)
    values = settings(urea_generation_mmol_h=12.0)
    volume, cleared, made = 35000.0 / 3.0, 30.0 * 60.0, 12.0
    end = 1e3 * made / cleared
    expected = end + (25.0 - end) * np.exp(-cleared * 24.0 / volume)
    assert LAW.concentrations(after(24.0, values), values)["urea"] == pytest.approx(expected, rel=1e-9)


def test_two_pools_follow_their_matrix_exponential():
    values = settings(urea_generation_mmol_h=12.0)
    outside, inside, transfer, cleared = 35000.0 / 3.0, 35000.0 * 2.0 / 3.0, 600.0 * 60.0, 30.0 * 60.0
    matrix = np.array(
        [[-(transfer + cleared) / outside, transfer / inside], [transfer / outside, -transfer / inside]]
    )
    rest = np.linalg.solve(matrix, [-12.0, 0.0])
    amounts = rest + expm(6.0 * matrix) @ (np.array([25e-3 * outside, 25e-3 * inside]) - rest)
    states = after(6.0, values)
    result = [states[f"solutes.urea_{where}_mmol"].item() for where in ("outside", "inside")]
    np.testing.assert_allclose(result, amounts, rtol=1e-8)


@pytest.mark.slow
def test_solutes_balance_to_rounding():
    values = settings(acid_generation_mmol_h=4.0, potassium_generation_mmol_h=3.0)
    start, end = after(0.0, values), after(24.0, values, bleed_ml=0.005, blood_ml=0.002, crystalloid_ml=0.01)

    def gain(solute, what):
        name = f"solutes.{solute}_{what}_mmol"
        return (end[name] - start[name]).item()

    for solute, held, sources in (
        ("urea", ("outside", "inside"), ("made",)), ("creatinine", ("outside", "inside"), ("made",)),
        ("potassium", ("outside",), ("made", "mobilised")), ("bicarbonate", ("outside",), ("made",)),
    ):  # fmt: skip
        stored = sum(gain(solute, what) for what in held)
        through = sum(gain(solute, what) for what in sources) - gain(solute, "removed")
        assert stored == pytest.approx(through, abs=1e-9 * start[f"solutes.{solute}_outside_mmol"].item())
        assert gain(solute, "removed") != 0.0


@pytest.mark.slow
@pytest.mark.parametrize(("made", "store"), [(0.0, 150.0), (5.0, 150.0), (0.0, 2000.0)])
def test_potassium_and_its_store_follow_their_matrix_exponential(made, store):
    """Outside V K' = 158 (6 - M / B - K) - 29 (K - 2) + made, given by cells M' = 158 (6 - M / B - K)."""
    values = settings(
        fluid_potassium_mmol_l=2.0,
        potassium_mmol_l=6.0,
        potassium_store_l=store,
        potassium_generation_mmol_h=made,
    )
    out, moves, clears = 35.0 / 3.0, 0.158 * 60.0, 0.029 * 60.0  # L, L/h
    matrix = np.array([[-(moves + clears) / out, -moves / store / out], [-moves, -moves / store]])
    rest = np.linalg.solve(matrix, [-(6.0 * moves + 2.0 * clears + made) / out, -6.0 * moves])
    expected, given = rest + expm(24.0 * matrix) @ (np.array([6.0, 0.0]) - rest)
    states = after(24.0, values)
    assert LAW.concentrations(states, values)["potassium"] == pytest.approx(expected, rel=1e-8)
    assert states["solutes.potassium_mobilised_mmol"].item() == pytest.approx(given, rel=1e-7)


def test_blood_that_is_bled_takes_what_its_plasma_holds():
    """100 mL of blood with 30 % of cells: 70 mL of plasma, and for urea four fifths of the cells too."""
    values = settings()
    law, beat = SolutesLaw(()), {}
    given = {kind: np.array([100.0 if kind == "bleed_ml" else 0.0]) for kind in INFLOWS}
    rates = law.rates(law.start(values, beat), values, beat, given)
    removed = {
        one: rates[f"solutes.{one}_removed_mmol"].item() for one in ("urea", "creatinine", "potassium")
    }
    assert removed == pytest.approx({"urea": 0.094 * 25.0, "creatinine": 0.07 * 0.3, "potassium": 0.07 * 4.5})


@pytest.mark.slow
def test_bicarbonate_gained_raises_base_excess_and_what_the_filter_meets():
    values = settings()
    start = LAW.in_effect(after(0.0, values), values)
    assert start["crrt.plasma_bicarbonate_mmol_l"] == 22.0
    assert start[BASE_EXCESS] == -2.0
    end = LAW.in_effect(after(24.0, values), values)
    assert end["crrt.plasma_bicarbonate_mmol_l"] == pytest.approx(22.0 + 24.0 * 6.0 / 35.0)
    assert end[BASE_EXCESS] > 2.0


@pytest.mark.slow
def test_where_the_filter_takes_the_bloods_own_bicarbonate_base_excess_alone_carries_what_is_gained():
    values = settings() | {"crrt.plasma_bicarbonate_mmol_l": np.array([0.0])}
    end = LAW.in_effect(after(24.0, values), values)
    assert end["crrt.plasma_bicarbonate_mmol_l"] == 0.0
    assert end[BASE_EXCESS] == LAW.in_effect(after(24.0, settings()), settings())[BASE_EXCESS]


@pytest.mark.parametrize("acid", [0.0, 6.0, 15.0])
def test_carbon_dioxide_that_stays_as_bicarbonate_is_not_in_the_tissues_too(acid):
    """Over tissues and bicarbonate together: what is made, less what the blood gets, and acid's share."""
    law = CarbonDioxideLaw((("tissue", 1.0),), LAW)
    values = settings(acid_generation_mmol_h=acid)
    store, beat = (
        float(values["solutes.carbon_dioxide_store_ml_mmHg"][0]),
        {**BEAT, "stored_CO2": 2.0, "tissue_PCO2": 45.0},
    )
    beat = {key: np.array([value]) for key, value in beat.items()}
    pressure, slow, blood = (
        float(r[0]) for r in law.rates(law.start(values, beat), values, beat, {}).values()
    )
    gases = store * (0.2 * pressure + 0.6 * slow + 0.2 * blood)
    none = {kind: np.zeros(1) for kind in INFLOWS}
    bicarbonate = LAW.rates(LAW.start(values, beat), values, beat, none)["solutes.bicarbonate_outside_mmol"]
    assert gases + 22.26 * float(bicarbonate[0]) == pytest.approx(2.0 / 60.0, rel=1e-12)


def test_citrate_brings_the_carbon_of_its_bicarbonate():
    """Six carbons each, of which three stay as bicarbonate; its oxygen would have burnt 3.6 of other fuel."""
    law = CarbonDioxideLaw((("tissue", 1.0),), LAW)
    values = settings()
    filled = float(values["solutes.carbon_dioxide_store_ml_mmHg"][0]) * 0.2
    beat = BEAT | {"stored_CO2": 0.0, "tissue_PCO2": 45.0, "base_gain": 3.0 * 13.0, "citrate_load": 13.0}
    beat = {key: np.array([value]) for key, value in beat.items()}
    rates = law.rates(law.start(values, beat), values, beat, {})
    gas = 3600.0 / 22.26 * filled * float(rates["solutes.tissue_pco2_mmHg"][0])
    assert gas == pytest.approx(13.0 * (6.0 - 3.6 - 3.0), rel=1e-9)
    assert "citrate_load" in law.reads


@pytest.mark.parametrize("expected", [12.0, 24.0, 34.0])
def test_base_excess_of_a_bicarbonate_is_that_of_the_blood_laws(expected):
    excess = standard_base_excess(np.array(expected), np.array(11.0))
    ph = ph_of(40.0, Blood(11.0, excess), lambda _: 1.0)
    assert bicarbonate(40.0, ph) == pytest.approx(expected, rel=1e-9)
    assert standard_bicarbonate(float(excess), 11.0) == pytest.approx(expected, rel=1e-9)


def model(regional=False, solutes=True):
    ecmo = {
        "mode": "VV", "pump": "Rotaflow", "speed_rpm": 2500, "oxygenator": "Quadrox-i Adult",
        "drainage_fr": 23, "return_fr": 19, "sweep_l_min": 4.0, "drainage_mixing": 0.3,
    }  # fmt: skip
    patient = {"id": "P", "sex": "male", "age_years": 60, "heart_rate_bpm": 90}
    body = {"physiology": {"regional": True}} if regional else {}
    more = {"solutes": {}} if solutes else {}
    gas = {"shunt_fraction": 0.8}
    raw = {"format": 1, "patient": patient, "ecmo": ecmo, "gas": gas} | body | more
    return model_of(read_mapping(raw).case)


def law_of(patient):
    (result,) = (one for one in laws_of(patient.circuit, patient.values) if isinstance(one, CarbonDioxideLaw))
    return result


@pytest.mark.parametrize("regional", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_stores_at_the_steady_pco2_leave_the_steady_state(regional):
    patient = model(regional)
    law, values = law_of(patient), {k: np.array([v]) for k, v in patient.values.items()}
    names = (*law.reads, "PaCO2", "SaO2", "VCO2_oxygenator")
    steady = steady_beat(Batch.of(patient), names).outputs()
    start = law.start(values, {k: np.array([steady[k]]) for k in law.reads})
    held = {key: float(value[0]) for key, value in law.in_effect(start, values).items()}
    assert held[CARBON_DIOXIDE_STORES_HOLD] == 1.0
    again = steady_beat(Batch.of(patient.with_values(held)), names).outputs()
    for name in names:
        assert again[name] == pytest.approx(steady[name], abs=1e-6), name
    assert all(abs(steady[name]) < 1e-6 for name in law.reads if name.startswith("stored"))


@pytest.mark.slow
def test_stores_fill_with_what_the_blood_does_not_carry_away():
    patient = model()
    law, values = law_of(patient), {k: np.array([v]) for k, v in patient.values.items()}
    names = (*law.reads, "PaCO2", "VCO2_oxygenator", "VCO2_lung", "VO2")
    steady = steady_beat(Batch.of(patient), names).outputs()
    high = {CARBON_DIOXIDE_STORES_HOLD: 1.0, "solutes.tissue_pco2_mmHg": steady["tissue_PCO2"] + 10.0}
    result = steady_beat(Batch.of(patient.with_values(high)), names).outputs()
    assert result["tissue_PCO2"] == pytest.approx(steady["tissue_PCO2"] + 10.0, abs=1e-7)
    removed = result["VCO2_oxygenator"] + result["VCO2_lung"]
    assert removed > steady["VCO2_oxygenator"] + steady["VCO2_lung"] + 10.0
    assert result["stored_CO2"] == pytest.approx(0.8 * result["VO2"] - removed, abs=1e-6)
    store, pressures = patient.values["solutes.carbon_dioxide_store_ml_mmHg"], np.array([50.0, 48.2, 47.0])
    states, read = (
        dict(zip([s.name for s in law.states], pressures[:, None], strict=True)),
        {k: result[k] for k in law.reads},
    )
    tissue, slow, blood = (60.0 * float(rate[0]) for rate in law.rates(states, values, read, {}).values())
    # Blood follows by 3 mmHg/min, tissues with little flow by 0.2; what these gain the tissue loses.
    assert (slow, blood) == pytest.approx((0.2, 3.0))
    assert store * (0.2 * tissue + 0.6 * slow + 0.2 * blood) == pytest.approx(result["stored_CO2"])
    # Beat by beat blood holds its own, and tissues alone fill.
    single = law.beat_by_beat().rates(states, values, read, {})
    tissue, slow, _ = (60.0 * float(rate[0]) for rate in single.values())
    assert store * (0.2 * tissue + 0.6 * slow) == pytest.approx(result["stored_CO2"])


def test_what_cold_stores_hold_has_the_pressure_of_blood_that_is_closed_off():
    patient = model()
    law, values = law_of(patient), {k: np.array([v]) for k, v in patient.values.items()}
    start = law.start(values, {"tissue_PCO2": np.array([48.0])})
    closed = gases(po2=30.0, pco2=48.0, haemoglobin=10.0)
    contents = {"oxygen": closed.oxygen, "carbon_dioxide": closed.carbon_dioxide}
    for temperature in (31.0, 34.0, 39.0):
        cold = values | {"gas.temperature_c": np.array([temperature])}
        held = float(law.in_effect(start, cold)["solutes.tissue_pco2_mmHg"][0])
        blood = gases_with_contents(**contents, haemoglobin=10.0, temperature=temperature)
        assert held == pytest.approx(float(blood.pco2), rel=0.01)
        again = law.start(cold, {"tissue_PCO2": np.array([held])})
        assert again == pytest.approx(start)


@pytest.mark.slow
def test_stores_change_no_steady_state():
    plain, stored = model(solutes=False), model()
    a, b = (steady_beat(Batch.of(one), ("PaCO2", "SaO2", "SvO2")).values for one in (plain, stored))
    np.testing.assert_allclose(a, b, rtol=1e-9)
    assert not laws_of(plain.circuit, plain.values)


@pytest.mark.parametrize(("weight", "space"), [(80.0, 40_000.0), (130.0, 59_238.0), (170.0, 72_686.0)])
def test_fat_holds_no_bicarbonate(weight, space):
    """Half of an obese patient's weight is more than all the water of the body (Watson 1980)."""
    patient = {"id": "x", "sex": "male", "age_years": 60, "height_cm": 175, "weight_kg": weight}
    patient["heart_rate_bpm"] = 80
    values = model_of(read_mapping({"format": 1, "patient": patient, "solutes": {}}).case).values
    assert values["solutes.bicarbonate_space_ml"] == pytest.approx(space, rel=1e-4)
    assert values["solutes.bicarbonate_space_ml"] <= values["solutes.body_water_ml"]
