"""Presets show what they say they show."""

import pytest

from eclsim.haemodynamics.dataset import simulate
from eclsim.patients.presets import PRESETS
from eclsim.solver.model import model_of

# What each preset's `aim` claims: output, lowest, highest; per square metre of body surface with "index".
AIMS = {
    "healthy": [
        ("SP", 90, 140),
        ("MAP", 70, 100),
        ("PCWP", 4, 12),
        ("right_atrial_pressure", 1, 6),
        ("index", 2.4, 4),
    ],
    "cardiogenic-shock": [("SP", 60, 90), ("index", 1.2, 2.2), ("PCWP", 15, 30)],
    "right-heart-failure": [("index", 1.2, 2.2), ("right_atrial_pressure", 10, 20)],
    "paper": [("MAP", 69, 72), ("PF", 3.5, 3.9)],
    "vv-ecmo": [("MPAP", 25, 40), ("PCWP", 4, 12), ("PF", 4, 5)],
    "lvad": [("MAP", 70, 90), ("lvad_flow", 4, 5), ("aortic_valve_flow", 0.1, 2)],
}


@pytest.mark.parametrize("key", PRESETS)
def test_preset_shows_its_aim(key):
    case = PRESETS[key].case()
    beat = simulate(model_of(case))
    surface = (case.patient.height_cm * case.patient.weight_kg / 3600.0) ** 0.5
    assert beat.attrs["status"] == "converged"
    for name, low, high in AIMS[key]:
        value = float(beat["CO"]) / surface if name == "index" else float(beat[name])
        assert low <= value <= high, (name, value)


def test_right_heart_failure_is_of_the_right_heart():
    beat = simulate(model_of(PRESETS["right-heart-failure"].case()))
    assert float(beat["right_atrial_pressure"]) > 0.63 * float(beat["PCWP"])


def test_presets_have_different_keys_names_and_ids():
    cases = [preset.case() for preset in PRESETS.values()]
    assert len({case.patient.id for case in cases}) == len({p.name for p in PRESETS.values()}) == len(PRESETS)
