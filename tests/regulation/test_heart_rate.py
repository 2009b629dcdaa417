"""Hearts whose rate follows reflexes and drugs in part or not at all."""

import numpy as np
import pytest

from eclsim.cases.reading import read_mapping
from eclsim.circuit.network import HEART_RATE
from eclsim.course.course import course
from eclsim.orbit.model import model_of
from eclsim.outputs.results import derivatives, simulate
from eclsim.parameters.regulation import HEART_RATE_RESPONSE

CASE = {
    "format": 1,
    "patient": {"id": "P", "sex": "male", "age_years": 70, "heart_rate_bpm": 75},
    "regulation": {"baroreflex": 1.0, "set_point_mmHg": 90},
    "drugs": {"adrenaline": 0.1},
}


def beat(response, **patient):
    given = {} if response is None else {"heart_rate_response": response}
    sections = {"patient": CASE["patient"] | patient, "regulation": CASE["regulation"] | given}
    return simulate(read_mapping(CASE | sections).case)


@pytest.mark.slow
def test_a_paced_heart_keeps_its_rate_while_contractility_and_resistance_respond():
    usual, paced = beat(None), beat(0.0)
    assert float(usual["heart_rate"]) > 90.0
    assert float(paced["heart_rate"]) == 75.0
    assert float(paced["contractility_lv_factor"]) > float(usual["contractility_lv_factor"]) > 1.5
    assert float(beat(0.0, heart_rate_bpm=35)["heart_rate"]) == 35.0


def test_a_response_of_one_is_the_heart_without_the_key_and_a_half_is_between():
    usual, whole, half = beat(None), beat(1.0), beat(0.5)
    for name in ("heart_rate", "MAP", "CO"):
        assert float(whole[name]) == pytest.approx(float(usual[name]), rel=1e-9)
    assert 75.0 < float(half["heart_rate"]) < float(usual["heart_rate"])


@pytest.mark.slow
@pytest.mark.parametrize("parameter", [HEART_RATE_RESPONSE, HEART_RATE])
def test_derivatives_with_respect_to_the_response_and_the_own_rate_are_exact(parameter):
    """The own rate was packed twice, and its derivatives were those of the entry that no beat reads: 0."""
    sections = {"regulation": CASE["regulation"] | {"heart_rate_response": 0.5}}
    model = model_of(read_mapping(CASE | sections).case)
    step, names = 1e-3, ("heart_rate", "MAP", "CO")
    ends = [simulate(model.with_values({parameter: model.values[parameter] + d})) for d in (-step, step)]
    exact = derivatives(model, names, (parameter,)).values.ravel()
    numeric = [(float(ends[1][name]) - float(ends[0][name])) / (2.0 * step) for name in names]
    assert exact == pytest.approx(numeric, rel=1e-3)


def test_a_heart_rate_that_nothing_changes_is_said():
    case = {key: CASE[key] for key in ("format", "patient")} | {"regulation": {"heart_rate_response": 0.0}}
    (said,) = [m for m in read_mapping(case).warnings if "heart_rate_response" in m.key]
    assert "without effect: neither reflexes nor drugs change the heart rate" in str(said)


@pytest.mark.slow
def test_an_event_sets_the_rate_of_a_paced_heart():
    sections = {
        "regulation": CASE["regulation"] | {"heart_rate_response": 0.0},
        "events": [{"at_min": 2, "set": {"patient.heart_rate_bpm": 150}}],
    }
    result = course(read_mapping(CASE | sections).case, minutes=6.0, every_min=1.0, outputs=("heart_rate",))
    rates = result["heart_rate"].to_numpy()
    assert set(np.round(rates, 6)) == {75.0, 150.0}
