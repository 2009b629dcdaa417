"""Two independent ways to the steady beat: fixed grid and solved orbit, tight tolerance and waiting."""

import numpy as np
import pytest

from eclsim.orbit.independent import AdaptiveBeats, AdaptiveOptions
from eclsim.orbit.model import PATIENT_HELD
from eclsim.orbit.steady import start_state
from eclsim.outputs.registry import leading_outputs
from eclsim.outputs.results import simulate, simulate_adaptive
from model_catalogue import model

CONFIGURATIONS = ("none", "LVAD", "V-A", "V-A, CRRT g", "V-V", "veins, pericardium, V-A")
slow_ones = ("V-A, CRRT g", "V-V", "veins, pericardium, V-A")


@pytest.fixture(scope="module")
def waited():
    """Results of the independent path, each computed once."""
    kept = {}
    return lambda name: kept.setdefault(name, simulate_adaptive(model(name)))


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow) if n in slow_ones else n for n in CONFIGURATIONS]
)
def test_both_paths_give_the_same_outputs(name, waited):
    result, check = simulate(model(name), resolution=2), waited(name)
    assert check.attrs["converged"] == 1
    assert check.attrs["solver"] == "adaptive"
    assert set(result.data_vars) == set(check.data_vars)
    for entry in leading_outputs():
        if entry.name in check:
            assert float(result[entry.name]) == pytest.approx(float(check[entry.name]), rel=1e-3)


@pytest.mark.slow
def test_waveforms_agree_too(waited):
    result, check = simulate(model("V-A")), waited("V-A")
    for name in ("Pao", "Plv", "Vlv", "Vra", "Ppas", "Pecmooxy", "Qecmopump", "Qao"):
        expected = np.interp(result["phase"], check["phase"], check[name])
        spread = max(float(np.ptp(check[name].to_numpy())), 0.3)
        apart = np.abs(result[name].to_numpy() - expected)
        assert apart.max() < 0.02 * spread
        assert apart.mean() < 0.005 * spread


@pytest.mark.slow
def test_a_held_patient_by_both_paths():
    patient = model("V-A")
    check, result = simulate_adaptive(patient, PATIENT_HELD), simulate(patient, PATIENT_HELD, resolution=2)
    for name in ("SP", "MAP", "CO", "PF", "EDVLV"):
        assert float(result[name]) == pytest.approx(float(check[name]), rel=1e-3)


@pytest.mark.slow
def test_the_beat_repeats_to_the_tolerance(waited):
    patient = model("V-A")
    beats = AdaptiveBeats(patient)
    end = beats.wait()
    assert end.steady
    later = end.state
    for _ in range(10):
        later = beats.beat(later)
    assert np.max(np.abs(later - end.state) / np.maximum(np.abs(end.state), 1.0)) < 1e-5
    assert waited("V-A").attrs["residual"] <= AdaptiveOptions().change


def test_a_looser_tolerance_changes_little():
    patient = model("none")
    tight, loose = (AdaptiveBeats(patient, AdaptiveOptions(tolerance=t)) for t in (1e-8, 1e-6))
    state = start_state(patient)
    np.testing.assert_allclose(loose.beat(state), tight.beat(state), rtol=1e-3, atol=1e-3)


def test_patience_has_an_end():
    result = simulate_adaptive(model("none"), options=AdaptiveOptions(seconds=1.0))
    assert result.attrs["converged"] == 0
    assert result.attrs["beats"] == 2
    assert "no steady beat found" in result.attrs["message"]


def test_numbers_out_of_range_give_a_reason():
    result = simulate_adaptive(model("none", Rmc=-1.0), options=AdaptiveOptions(seconds=20.0))
    assert result.attrs["status"] == "invalid_input"
    assert "Rmc = -1: allowed: zero or above" in result.attrs["message"]
    assert result.attrs["converged"] == 0
    stone = simulate_adaptive(model("none", LV_Pd_kappa=50.0), options=AdaptiveOptions(seconds=5.0))
    assert stone.attrs["converged"] == 0
    assert stone.attrs["status"] in ("not_finite", "not_converged")


def test_an_unknown_policy_is_refused():
    with pytest.raises(ValueError, match="allowed: as_published, patient_held"):
        simulate_adaptive(model("none"), "frozen")
