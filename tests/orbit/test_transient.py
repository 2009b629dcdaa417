import numpy as np
import pytest

from eclsim.circuit.assembly import assemble
from eclsim.orbit.model import PATIENT_HELD
from eclsim.orbit.steady import Batch, solve, start_state
from eclsim.orbit.transient import ADAPTIVE, follow, primed_start
from model_catalogue import model

SIGNALS = ("Pao", "Vlv", "Qao")


def test_a_course_starts_at_the_published_state():
    course = follow(model("V-A"), 1.0, ("Pao", "Psart", "Psvn", "Pecmooxy", "Qao"))
    np.testing.assert_allclose(course.signals[0], [80.0, 80.0, 4.0, 0.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("seconds", [0.2, 0.5, 1.7])
def test_time_runs_from_0_to_the_end_that_was_asked_for(seconds):
    course = follow(model("none"), seconds, SIGNALS)
    assert course.time[0] == 0.0
    assert (np.diff(course.time) > 0.0).all()
    assert seconds - 0.004 < course.time[-1] <= seconds * (1 + 1e-9)
    assert course.signals.shape == (len(course.time), len(SIGNALS))


def test_a_short_course_is_the_beginning_of_a_long_one():
    short, long = (follow(model("none"), seconds, SIGNALS) for seconds in (0.7, 3.0))
    np.testing.assert_array_equal(long.signals[: len(short.time)], short.signals)


def test_a_course_ends_at_the_steady_beat():
    patient = model("V-A")
    orbit = solve(Batch.of(patient)).states[:, 0]
    course = follow(patient, 150.0, ("Pao",))
    np.testing.assert_allclose(course.state, orbit, rtol=1e-4, atol=1e-3)


def test_primed_circuits_lead_to_the_steady_beat_of_a_held_patient():
    patient = model("V-A, CRRT g")
    layout = assemble(patient.circuit).layout
    own = layout.conserved(np.array([c.group == "patient" for c in patient.circuit.compartments])) > 0.0
    start, published = primed_start(patient, PATIENT_HELD), start_state(patient)
    np.testing.assert_array_equal(start[own], published[own])
    orbit = solve(Batch.of(patient, PATIENT_HELD)).states[:, 0]
    assert layout.conserved() @ start == pytest.approx(layout.conserved() @ orbit, rel=1e-8)
    course = follow(patient, 150.0, ("Pao",), policy=PATIENT_HELD)
    np.testing.assert_allclose(course.state, orbit, rtol=1e-4, atol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["none", "V-A, CRRT g"])
def test_both_solvers_take_the_same_course(name):
    fixed, adaptive = (
        follow(model(name), 3.0, ("Pao", "Vlv", "Ppvn"), solver=s) for s in ("semi-implicit", ADAPTIVE)
    )
    np.testing.assert_array_equal(fixed.time, adaptive.time)
    apart = np.abs(fixed.signals - adaptive.signals)
    assert (apart.max(axis=0) < 5e-3 * np.ptp(adaptive.signals, axis=0)).all()
    assert (apart.mean(axis=0) < 1e-3 * np.ptp(adaptive.signals, axis=0)).all()


@pytest.mark.parametrize("seconds", [0.0, -1.0, float("nan"), float("inf")])
def test_a_course_needs_a_positive_length(seconds):
    with pytest.raises(ValueError, match="seconds"):
        follow(model("none"), seconds, SIGNALS)


def test_an_unknown_solver_is_refused():
    with pytest.raises(ValueError, match="allowed: semi-implicit, adaptive"):
        follow(model("none"), 1.0, SIGNALS, solver="euler")
