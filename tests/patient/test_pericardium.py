"""The pericardium: what the chambers share, and what each does to the other through it."""

import numpy as np
import pytest

from eclsim.cases.reading import read_mapping
from eclsim.cases.resolve import circuit_of
from eclsim.circuit import Circuit, CircuitError, Surrounding, validate
from eclsim.components import Pericardium
from eclsim.orbit.model import model_of
from eclsim.outputs.results import simulate
from eclsim.patient.circulation import Anatomy, circulation

PATIENT = {
    "id": "P", "sex": "male", "age_years": 60, "height_cm": 175, "weight_kg": 75, "heart_rate_bpm": 90,
}  # fmt: skip
OVERLOAD = {"pulmonary_regurgitation_cm2": 1.0}
CHAMBERS = ("ra", "rv", "la", "lv")


def patient(pericardium, volume=0.0, **physiology):
    own = {"pericardium": pericardium} | physiology
    fluid = {"extra_volume_ml": volume}
    return model_of(read_mapping({"format": 1, "patient": PATIENT, "physiology": own, "fluid": fluid}).case)


@pytest.fixture(scope="module")
def beats():
    """A filled patient without and with a pericardium, each without and with an overloaded right heart."""
    return {
        (one, two): simulate(patient(one, 400.0, **(OVERLOAD if two else {})))
        for one in (False, True)
        for two in (False, True)
    }


def test_without_the_key_there_is_none():
    plain = read_mapping({"format": 1, "patient": PATIENT, "physiology": {}}).case
    assert circuit_of(plain) == circulation()
    assert not circulation().surroundings
    (around,) = circulation(Anatomy(pericardium=True)).surroundings
    assert around.members == CHAMBERS


@pytest.mark.slow
def test_its_pressure_is_that_of_the_volume_in_it_and_part_of_every_chamber(beats):
    beat = beats[True, False]
    held = sum(beat["V" + name].values for name in CHAMBERS)
    expected = 0.5003 * np.expm1((held - 250.0) / (100.0 / 3.0))
    np.testing.assert_allclose(beat["Ppericardium"].values, expected, rtol=1e-9, atol=1e-9)
    phase = beat["phase"].values
    resting = (phase > 0.5) & (phase < 0.85)
    wall = 0.1575 * beat["Vra"].values[resting]
    np.testing.assert_allclose(beat["Pra"].values[resting], wall + expected[resting], rtol=1e-9, atol=1e-9)
    assert float(beat["pericardial_pressure"]) == pytest.approx(4.7, abs=0.3)


@pytest.mark.slow
def test_a_large_right_heart_takes_room_from_the_left(beats):
    """Ventricular interdependence: less volume at a higher pressure than where nothing is shared."""
    fall = [
        1.0 - float(beats[one, True]["EDVLV"]) / float(beats[one, False]["EDVLV"]) for one in (False, True)
    ]
    assert fall[1] > 1.3 * fall[0] > 0.0
    single, shared = beats[False, True], beats[True, True]
    assert float(shared["EDVRV"]) > float(beats[True, False]["EDVRV"]) + 10.0
    assert float(shared["EDVLV"]) < float(single["EDVLV"]) - 20.0
    assert float(shared["end_diastolic_pressure_lv"]) > float(single["end_diastolic_pressure_lv"]) + 1.0


def test_surroundings_that_do_not_hang_together_are_refused():
    law = Pericardium(0.5, 250.0, 33.0)
    around = (Surrounding("bag", law, ("ra", "lvv")), Surrounding("lv", law, ()))
    with pytest.raises(CircuitError) as caught:
        validate(circulation() + Circuit(surroundings=around))
    first, second, third = caught.value.mistakes
    assert first == "surrounding 'bag': 'lvv' is not a compartment of the circuit; did you mean lv?"
    assert second == "surrounding 'lv' has no members: name compartments"
    assert "'lv'" in third


def test_it_is_renamed_with_its_circuit():
    other = circulation(Anatomy(pericardium=True)).prefixed("twin")
    (around,) = other.surroundings
    assert around.name == "twin.pericardium"
    assert around.members == tuple(f"twin.{name}" for name in CHAMBERS)
    assert "twin.pericardium_ml" in other.parameter_names()
    validate(other)


@pytest.mark.slow
def test_a_tamponade_is_named_since_its_filling_pressures_are_the_pericardiums():
    """Pericardial 5.7, right atrial 8.9 and wedge pressure 9.7 mmHg: nothing was said."""
    man = PATIENT | {"age_years": 66, "height_cm": 178, "weight_kg": 82, "heart_rate_bpm": 118}
    fluid_around_the_heart = {"pericardium_ml": 60.0, "Rmc": 0.9}
    case = {"format": 1, "patient": man, "physiology": {"pericardium": True}}
    tight = simulate(model_of(read_mapping(case | {"parameters": fluid_around_the_heart}).case))
    (said,) = (text for text in tight.attrs["warnings"] if "pericardium" in text)
    assert said.startswith(
        "caution: pericardial pressure 5.7 mmHg (usually about 0): the pericardium constrains"
    )
    assert "right atrial 8.9 and wedge pressure 9.7 mmHg are nearly equal" in said
    assert "only 3.2 and 4.1 mmHg of them distend the heart" in said
    resting = simulate(model_of(read_mapping(case).case))
    assert not any("pericardium" in text for text in resting.attrs["warnings"])
