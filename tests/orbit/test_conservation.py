"""Blood is neither made nor lost: 1000 beats in every configuration."""

import numpy as np
import pytest

from eclsim.beat.heartbeat import beat_program
from eclsim.beat.recording import all_signals
from eclsim.circuit.assembly import assemble
from eclsim.orbit.independent import AdaptiveBeats
from eclsim.orbit.iteration import compiled_search
from eclsim.orbit.steady import start_state
from eclsim.orbit.transient import follow
from model_catalogue import CIRCUITS, SCHEMES, model, scheme_sites

BEATS = 1000


def blood_after(patient, beats=BEATS):
    """Stressed volume of all compartments at the start and after each beat [mL]."""
    program = beat_program(patient.circuit)
    search = compiled_search(program, 1)
    packed = np.array([patient.values[name] for name in program.names])
    state, volumes = start_state(patient), program.assembly.layout.volumes.where
    blood = [state[volumes].sum()]
    for _ in range(beats):
        state = search.beat(state, packed)[0]
        blood.append(state[volumes].sum())
    return np.array(blood)


@pytest.mark.slow
@pytest.mark.parametrize("name", CIRCUITS)
def test_blood_stays_the_same_over_1000_beats(name):
    blood = blood_after(model(name))
    assert np.abs(blood / blood[0] - 1.0).max() < 1e-10


@pytest.mark.slow
@pytest.mark.parametrize("scheme", SCHEMES)
def test_blood_stays_the_same_in_every_crrt_scheme(scheme):
    blood = blood_after(model("V-A, CRRT anywhere").with_values(scheme_sites(scheme)))
    assert np.abs(blood / blood[0] - 1.0).max() < 1e-10


@pytest.mark.slow
@pytest.mark.parametrize("name", ["none", "V-A, CRRT g"])
def test_the_independent_path_keeps_its_blood_too(name):
    patient = model(name)
    beats, state = AdaptiveBeats(patient), start_state(patient)
    volumes = assemble(patient.circuit).layout.volumes.where
    blood = state[volumes].sum()
    for _ in range(50):
        state = beats.beat(state)
    assert state[volumes].sum() == pytest.approx(blood, rel=1e-10)


@pytest.mark.slow
def test_recorded_volumes_hold_all_blood_at_every_step():
    patient = model("V-A, CRRT g")
    names = tuple(s for s in all_signals(assemble(patient.circuit)) if s[0] == "V")
    course = follow(patient, 5.0, names)
    assert np.ptp(course.signals.sum(axis=1)) < 1e-9 * course.signals[0].sum()
