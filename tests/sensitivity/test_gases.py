import numpy as np
import pytest

from eclsim.cases.reading import read_mapping
from eclsim.orbit.model import AS_PUBLISHED, model_of
from eclsim.sensitivity.runs import WITHOUT_GASES, SteadyBeatEvaluator, status_word

CASE = read_mapping({
    "format": 1,
    "patient": {"id": "P", "sex": "male", "age_years": 50, "heart_rate_bpm": 95},
    "gas": {"haemoglobin_g_dl": 10.0, "shunt_fraction": 0.5},
    "ecmo": {
        "pump": "Rotaflow", "speed_rpm": 2600, "oxygenator": "Quadrox-i Adult", "mode": "VV",
        "drainage_fr": 25, "return_fr": 21, "sweep_l_min": 3.0,
    },
}).case  # fmt: skip


@pytest.mark.slow
def test_a_run_without_a_steady_gas_state_is_a_failed_run_and_says_why():
    model = model_of(CASE)
    evaluator = SteadyBeatEvaluator(model.circuit, model.values, ("SaO2", "MAP"), AS_PUBLISHED, resolution=1)
    settings = {"gas.shunt_fraction": np.array([0.5, 1.0]), "ecmo.sweep_l_min": np.array([3.0, 0.0])}
    runs = evaluator(settings, 2)
    assert runs.status[0] == 0
    assert runs.status[1] > WITHOUT_GASES
    assert status_word(int(runs.status[1])) == "no_oxygen"
    assert np.isfinite(runs.values[0]).all()
    assert np.isnan(runs.values[1, 0])
