"""Two steady beats at the same values, where veins collapse: both are named."""

import re

import numpy as np
import pytest

from collapsing_veins import TWO_BEATS, collapsible
from eclsim.circuit.assembly import assemble
from eclsim.orbit.model import Model, model_of
from eclsim.orbit.steady import Batch
from eclsim.outputs import second_beat as module
from eclsim.outputs.results import simulate
from eclsim.outputs.second_beat import second_beat
from eclsim.outputs.steady_beat import steady_beat
from eclsim.validation.reference_cases import PAPER_PATIENT, reference_model


@pytest.fixture(scope="module")
def two() -> Model:
    return model_of(collapsible(TWO_BEATS))


@pytest.mark.slow
def test_a_simulation_names_the_beat_that_it_does_not_show(two):
    """PF 3.4 L/min was reported, and not that 2.7 with an empty vena cava is as steady."""
    result = simulate(two)
    (caution,) = [line for line in result.attrs["warnings"] if "two steady beats" in line]
    assert float(result["PF"]) == pytest.approx(3.41, abs=0.02)
    assert "caution: this patient has two steady beats at the same settings" in caution
    assert "PF 3.41" in caution
    assert re.search(r"PF 2\.7\d, CO 0\.7\d", caution)
    assert re.search(r"drainage down to -7\d mmHg with the vena cava filled to [78] %", caution)
    assert result["PF"].attrs["finding"]


@pytest.mark.slow
def test_the_other_beat_lasts_and_from_it_the_first_is_found(two):
    beat = steady_beat(Batch.of(two))
    other = second_beat(beat)
    assert other is not None
    state, volumes = other.orbits.states, assemble(beat.batch.circuit).layout.volumes.where
    later = other.orbits.wait(np.array([0]), state, 400)
    assert np.abs(later - state)[volumes].max() < 0.01
    assert state[volumes].sum() == pytest.approx(beat.orbits.states[volumes].sum(), rel=1e-9)
    back = second_beat(other)
    assert back is not None
    assert float(back.output("PF")[0]) == pytest.approx(float(beat.output("PF")[0]), rel=1e-6)


@pytest.mark.slow
def test_a_patient_with_enough_blood_has_one_beat():
    assert not [
        line for line in simulate(model_of(collapsible({}))).attrs["warnings"] if "two steady beats" in line
    ]


@pytest.mark.slow
def test_a_search_that_is_no_longer_needed_ends_after_its_first_step(two, monkeypatch):
    beat = steady_beat(Batch.of(two))
    monkeypatch.setattr(module, "solve_orbits", lambda *_: pytest.fail("the search went on"))
    assert second_beat(beat, wanted=lambda: False) is None


def test_veins_that_do_not_collapse_cost_no_further_beat(monkeypatch):
    monkeypatch.setattr(module, "compiled_search", lambda *_: pytest.fail("a further beat was computed"))
    assert second_beat(steady_beat(Batch.of(reference_model(PAPER_PATIENT)))) is None
