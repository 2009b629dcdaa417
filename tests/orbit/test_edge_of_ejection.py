"""Hearts that eject next to nothing: what is said of them does not hang on the last bit of the processor."""

import numpy as np
import pytest

from eclsim.orbit.execution import Execution
from eclsim.orbit.status import Status
from eclsim.orbit.steady import Batch, start_state
from eclsim.outputs.steady_beat import steady_beat
from model_catalogue import model

SPEED = "ecmo.speed_rpm"
COPIES = 4
"""Of each patient, apart by 1e-12: far more than processors differ by, far less than anyone could measure."""
FOUND = {
    "V-A, CRRT g": (
        {"Emaxrv": 0.05, SPEED: 6000.0}, {"Emaxrv": 0.05, SPEED: 7000.0}, {"Emaxrv": 0.03, SPEED: 6000.0},
        {"Emaxrv": 0.02, SPEED: 6000.0}, {"Emaxrv": 0.02, SPEED: 7000.0},
    ),
    "V-A": ({"Emaxrv": 0.15, SPEED: 7000.0}, {"Emaxlv": 1.0, SPEED: 5000.0}),
    "V-V": ({"Emaxrv": 0.02, SPEED: 6000.0}, {"Emaxlv": 0.1, SPEED: 6000.0}),
    "LVAD": ({"Emaxlv": 0.1, "lvad.speed_rpm": 5000.0}, {"Emaxrv": 0.02, "lvad.speed_rpm": 5000.0}),
}  # fmt: skip
SHUT = {
    "V-A, CRRT g": ({"Emaxlv": 1.0, SPEED: 7000.0}, {"Emaxlv": 0.5, SPEED: 6000.0}),
    "V-A": (
        {"Emaxrv": 0.08, SPEED: 7000.0}, {"Emaxlv": 0.3, SPEED: 4000.0}, {"Emaxlv": 0.3, SPEED: 5000.0},
        {"Emaxlv": 0.6, "Emaxrv": 0.075, SPEED: 7000.0},
    ),
}  # fmt: skip
CASES = [
    (name, changes, status)
    for cases, status in ((FOUND, Status.CONVERGED), (SHUT, Status.ONE_OF_MANY))
    for name, several in cases.items()
    for changes in several
]


def copies(name, changes):
    """The same patient over and over, every parameter but for 1e-12 of it."""
    patient, rng = model(name, **changes), np.random.default_rng(1)
    values = {n: v * (1.0 + 1e-12 * rng.uniform(-1.0, 1.0, COPIES)) for n, v in patient.values.items()}
    return Batch(patient.circuit, values, COPIES)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "changes", "status"), CASES, ids=[f"{n} {c}" for n, c, _ in CASES])
def test_a_status_does_not_depend_on_rounding(name, changes, status):
    beat = steady_beat(copies(name, changes), ("CO", "MAP"), execution=Execution(width=1))
    assert [Status(k).word for k in beat.status] == [status.word] * COPIES
    if status == Status.CONVERGED:
        assert (np.ptp(beat.values, axis=1) < 1e-6 * np.abs(beat.values).max(axis=1) + 1e-8).all()


@pytest.mark.slow
@pytest.mark.parametrize("changes", FOUND["V-A, CRRT g"], ids=str)
def test_plain_beats_from_the_published_start_lead_to_the_beat_that_was_found(changes):
    """Thousands of them: while the right heart's valves hold, blood moves by 0.1 mL a beat."""
    patient = model("V-A, CRRT g", **changes)
    beat = steady_beat(Batch.of(patient))
    waited = beat.orbits.wait(np.array([0]), start_state(patient)[:, None], 4800)
    np.testing.assert_allclose(waited, beat.orbits.states, rtol=1e-6, atol=1e-5)
