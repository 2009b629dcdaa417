import numpy as np
import pytest

from eclsim.orbit.equation import OrbitOptions
from eclsim.orbit.model import AS_PUBLISHED, PATIENT_HELD
from eclsim.orbit.steady import Batch
from eclsim.outputs.steady_beat import steady_beat
from model_catalogue import model

TIGHT = OrbitOptions(tolerance=1e-12, error_tolerance=1e-12)
OUTPUTS = ("SP", "DP", "MAP", "MPAP", "PCWP", "CO", "EDVLV", "ESVRV", "stroke_work_lv")


def both(name, parameters, outputs, policy=AS_PUBLISHED):
    """Exact derivatives and own central differences of the solved beat, shape (outputs, parameters)."""
    patient = model(name)
    base = steady_beat(Batch.of(patient, policy), outputs, options=TIGHT)
    exact = base.linearise(outputs, parameters).slopes
    values, count = dict(patient.values), 4 * len(parameters)
    shifts = {}
    for k, key in enumerate(parameters):
        # Fourth order: differences at one and at two steps, too small to push a valve over a grid point.
        step = 2e-5 * abs(values[key])
        column = np.full(count, values[key])
        column[4 * k : 4 * k + 4] += step * np.array([1.0, -1.0, 2.0, -2.0])
        shifts[key] = (step, column)
    values |= {key: column for key, (_, column) in shifts.items()}
    batch = Batch(patient.circuit, values, count, policy)
    beat = steady_beat(batch, outputs, options=TIGHT, start=patient.values)
    result = beat.values.reshape(len(outputs), len(parameters), 4)
    one = (result[..., 0] - result[..., 1]) / 2.0
    two = (result[..., 2] - result[..., 3]) / 4.0
    steps = np.array([step for step, _ in shifts.values()])
    return exact, (4.0 * one - two) / 3.0 / steps, np.array([patient.values[key] for key in parameters])


def agree(exact, numeric, point):
    """Every entry within 1e-5 of the largest in its row, per relative change of the parameter."""
    exact, numeric = exact * point, numeric * point
    largest = np.abs(exact).max(axis=1, keepdims=True)
    assert (np.abs(exact - numeric) <= 1e-5 * largest).all(), np.abs(exact - numeric) / largest


@pytest.mark.slow
def test_derivatives_equal_own_central_differences_without_devices():
    parameters = ("Rmc", "Csart", "Csvn", "Emaxlv", "Emaxrv", "Edla", "Lao", "total_blood_volume_ml")
    agree(*both("none", (*parameters, "heart_rate_bpm"), OUTPUTS))


@pytest.mark.slow
@pytest.mark.parametrize("policy", [AS_PUBLISHED, PATIENT_HELD])
def test_derivatives_equal_own_central_differences_with_devices(policy):
    parameters = (
        "Rmc",
        "Csart",
        "Emaxlv",
        "ecmo.speed_rpm",
        "ecmo.return_fr",
        "crrt.flow_ml_min",
        "Ccrrtfil",
    )
    agree(*both("V-A, CRRT g", parameters, (*OUTPUTS, "PF", "crrt_access_pressure"), policy))


CIRCUITS = {
    "V-V": ("Rmc", "Emaxrv", "ecmo.speed_rpm"),
    "V-A, roller pump": ("Rmc", "Emaxlv", "ecmo.roller_l_min"),
    "LVAD": ("Rmc", "Emaxlv", "lvad.speed_rpm"),
    "veins, pericardium, V-A": (
        "Csvn", "ecmo.speed_rpm", "caval_rest_volume_ml", "caval_resistance_share", "pericardium_ml",
    ),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("name", "parameters"), CIRCUITS.items(), ids=CIRCUITS)
def test_derivatives_equal_own_central_differences_with_other_devices(name, parameters):
    agree(*both(name, parameters, ("SP", "MAP", "MPAP", "PCWP", "CO", "EDVLV")))


@pytest.mark.slow
def test_a_step_along_the_derivative_predicts_the_next_beat():
    patient = model("none")
    result = steady_beat(Batch.of(patient)).linearise(("MAP", "CO"), ("Rmc",))
    moved = patient.with_values(Rmc=patient.values["Rmc"] * 1.001)
    there = steady_beat(Batch.of(moved), ("MAP", "CO")).values[:, 0]
    predicted = result.values + result.slopes[:, 0] * 0.001 * patient.values["Rmc"]
    np.testing.assert_allclose(there, predicted, rtol=1e-5)
