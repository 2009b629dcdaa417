"""Derivatives of a beat that was not found, or that has none."""

import numpy as np
import pytest

from eclsim.beat.heartbeat import beat_program
from eclsim.identification.objective import Objective, Target
from eclsim.orbit.derivatives import orbit_derivatives
from eclsim.orbit.equation import OrbitProblem
from eclsim.orbit.status import NoDerivativesError, Status
from eclsim.orbit.steady import Batch, solve, start_state
from eclsim.outputs.results import derivatives
from eclsim.outputs.steady_beat import steady_beat
from eclsim.validation.reference_cases import reference_model
from model_catalogue import model

OUTPUTS, PARAMETERS = ("MAP", "CO"), ("Rmc", "Emaxlv")
WEAK_RIGHT = {"Csart": 1.97, "Edla": 1.14, "Emaxlv": 1.57, "Emaxrv": 0.0228, "Rmc": 6.7, "Rpmc": 0.428}
STILL = {"Emaxlv": 0.02, "Emaxrv": 0.02, "ecmo.speed_rpm": 4500.0}
OFF_ORBIT = {
    "an explosive ventricle": ({"LV_Pd_kappa": 50.0}, Status.NOT_CONVERGED, "check the parameters"),
    "a value that is not allowed": ({"Rmc": -1.0}, Status.INVALID_INPUT, "Rmc = -1: allowed: zero or above"),
}


@pytest.mark.slow
@pytest.mark.parametrize(("changes", "status", "reason"), OFF_ORBIT.values(), ids=OFF_ORBIT)
def test_without_a_steady_beat_there_are_no_derivatives(changes, status, reason):
    patient = model("V-A", **changes)
    with pytest.raises(NoDerivativesError, match=r"V-A: no derivatives \(") as caught:
        derivatives(patient, OUTPUTS, PARAMETERS)
    assert caught.value.status is status
    assert reason in str(caught.value)
    result = derivatives(patient, OUTPUTS, PARAMETERS, throw=False)
    assert result.shape == (2, 2)
    assert np.isnan(result.values).all()
    assert np.isnan(result["value"].values).all()
    assert result.attrs["id"] == "V-A"
    assert result.attrs["status"] == status.name.lower()
    assert reason in result.attrs["message"]


@pytest.mark.slow
@pytest.mark.parametrize("changes", [STILL, WEAK_RIGHT], ids=["standing still", "weak right heart"])
def test_a_singular_beat_has_no_derivatives(changes):
    patient = reference_model("va_ecmo_default").with_values(changes)
    with pytest.raises(NoDerivativesError, match=r"va_ecmo_default: no derivatives \(singular\)") as caught:
        derivatives(patient, OUTPUTS, PARAMETERS)
    assert caught.value.status is Status.CONVERGED
    result = derivatives(patient, OUTPUTS, PARAMETERS, throw=False)
    assert result.attrs["status"] == "singular"
    assert np.isnan(result.values).all()


@pytest.mark.slow
def test_a_beat_that_was_found_says_so():
    result = derivatives(model("V-A"), OUTPUTS, PARAMETERS)
    assert result.attrs["status"] == "converged"
    assert np.isfinite(result.values).all()


@pytest.mark.slow
def test_one_member_without_a_beat_leaves_the_others_their_derivatives():
    patient = model("V-A")
    values = {**patient.values, **{k: np.array([patient.values[k], v]) for k, v in WEAK_RIGHT.items()}}
    beat = steady_beat(Batch(patient.circuit, values, 2))
    assert np.isfinite(beat.linearise(OUTPUTS, PARAMETERS, 0).slopes).all()
    with pytest.raises(NoDerivativesError):
        beat.linearise(OUTPUTS, PARAMETERS, 1)


@pytest.mark.slow
def test_an_objective_has_no_slopes_where_there_is_no_beat():
    patient = model("V-A", **WEAK_RIGHT)
    objective = Objective([Target(patient, {"MAP": 60.0}, {"MAP": 3.0})], ("Rmc",))
    which, x = np.zeros(2, dtype=int), np.log([[6.7], [0.5]])
    result = objective.evaluate(which, x)
    slopes, near = objective.linearise(result, [0], x[:1])
    assert np.isnan(slopes).all()
    assert near == [None]


@pytest.mark.slow
def test_tangents_of_the_state_alone_need_no_sums():
    patient = model("V-A")
    batch = Batch.of(patient)
    program = beat_program(patient.circuit)
    problem = OrbitProblem(program, batch.packed(program), batch.volume())
    state, slopes = solve(batch).states[:, 0], batch.volume_slopes(("Rmc",))
    result = orbit_derivatives(problem, state, ("Rmc",), slopes)
    assert result.sums.shape == (0, 1)
    assert result.distance < 1e-7
    step = 1e-4 * patient.values["Rmc"]
    changed = {**patient.values, "Rmc": patient.values["Rmc"] + np.array([step, -step])}
    high, low = solve(Batch(patient.circuit, changed, 2)).states.T
    np.testing.assert_allclose(result.states[:, 0], (high - low) / (2 * step), rtol=2e-3, atol=2e-3)


def test_a_heart_that_does_not_eject_is_said_to_have_one_of_many_beats():
    """From the published start it is settled within 300 beats, not where the search hands it back."""
    patient = model("V-A", **WEAK_RIGHT)
    beat = steady_beat(Batch.of(patient))
    only = np.array([0])
    waited = beat.orbits.wait(only, start_state(patient)[:, None], 300)
    assert np.abs(beat.orbits.wait(only, waited) - waited).max() < 1e-8
    assert np.abs(waited - beat.orbits.states).max() > 10.0
    assert "one of many: no blood passes the tricuspid" in beat.message()
