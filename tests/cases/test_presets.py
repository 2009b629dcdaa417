"""Presets show what they say they show."""

import pytest

from eclsim.cases.presets import CARDIAC_INDEX, PRESETS
from eclsim.orbit.model import model_of
from eclsim.outputs.results import simulate, simulate_many


@pytest.mark.parametrize("key", PRESETS)
def test_preset_shows_its_aim(key):
    case = PRESETS[key].case()
    beat = simulate(model_of(case))
    surface = (case.patient.height_cm * case.patient.weight_kg / 3600.0) ** 0.5
    assert beat.attrs["status"] == "converged"
    values = {CARDIAC_INDEX: float(beat["CO"]) / surface}
    for output, (lowest, highest) in PRESETS[key].aims.items():
        value = values.get(output, float(beat.get(output, float("nan"))))
        assert lowest <= value <= highest, (output, value)


@pytest.mark.parametrize("policy", ["as_published", "patient_held"])
def test_the_wedge_pressure_in_cardiogenic_shock_rises_with_the_flow_of_v_a_ecmo(policy):
    case = PRESETS["cardiogenic-shock"].case()
    ecmo = PRESETS["paper"].case().ecmo.model_copy(update={"drainage_fr": 25.0, "return_fr": 19.0})
    model = model_of(case.model_copy(update={"ecmo": ecmo}))
    ramp = simulate_many(model, {"ecmo.speed_rpm": [2000.0, 3000.0, 4000.0]}, volume_policy=policy)
    single = simulate(model_of(case))
    for name in ("PCWP", "EDVLV", "end_diastolic_pressure_lv", "MAP"):
        rising = [float(single[name]), *ramp[name].values]
        assert rising == sorted(rising), name


def test_right_heart_failure_is_of_the_right_heart():
    beat = simulate(model_of(PRESETS["right-heart-failure"].case()))
    assert float(beat["right_atrial_pressure"]) > 0.63 * float(beat["PCWP"])


def test_presets_have_different_keys_names_and_ids():
    cases = [preset.case() for preset in PRESETS.values()]
    assert len({case.patient.id for case in cases}) == len({p.name for p in PRESETS.values()}) == len(PRESETS)
