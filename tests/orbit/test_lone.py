"""The compiled search for one patient against the one for many."""

import numpy as np
import pytest

from eclsim.orbit.equation import OrbitOptions, OrbitProblem
from eclsim.orbit.search import solve_orbits
from eclsim.orbit.single_search import solve_alone
from eclsim.orbit.status import Status
from eclsim.orbit.steady import Batch, anchor, beat_program, steady_beats
from eclsim.validation.reference_cases import reference_model

CASES = ("s4_crrt_g_3425", "va_ecmo_default", "cvs_failure_90bpm")


@pytest.mark.parametrize("options", [OrbitOptions(), OrbitOptions(1e-3, 1e-2)], ids=["usual", "loose"])
@pytest.mark.parametrize("name", CASES)
def test_both_searches_take_the_same_steps(name, options):
    model = reference_model(name)
    batch = Batch(model.circuit, model.values, 1)
    program = beat_program(model.circuit)
    problem = OrbitProblem(program, batch.packed(program), batch.volume(), wide=True)
    assert not problem.lone
    many, one = (solve(problem, anchor(batch, 1), options) for solve in (solve_orbits, solve_alone))
    assert one.status[0] == many.status[0] == Status.CONVERGED
    assert one.beats[0] == many.beats[0]
    np.testing.assert_allclose(one.states, many.states, rtol=1e-10, atol=1e-9)
    np.testing.assert_allclose(one.residual, many.residual, rtol=1e-4, atol=1e-11)
    np.testing.assert_allclose(one.drift, many.drift, rtol=1e-4, atol=1e-9)


def test_what_is_not_found_is_said_so():
    model = reference_model(CASES[0])
    batch = Batch(model.circuit, model.values, 1)
    program = beat_program(model.circuit)
    problem = OrbitProblem(program, batch.packed(program), batch.volume())
    found = solve_alone(problem, anchor(batch, 1), OrbitOptions(quasi_newton_beats=5))
    assert found.status[0] == Status.NOT_CONVERGED
    assert found.beats[0] == 5
    assert np.isfinite(found.states).all()


def test_what_is_not_found_is_handed_to_newtons_method():
    model = reference_model(CASES[0])
    batch = Batch(model.circuit, model.values, 1)
    found = steady_beats(batch, OrbitOptions(quasi_newton_beats=5), lone=True).orbits
    assert found.status[0] == Status.CONVERGED
    np.testing.assert_allclose(found.states, steady_beats(batch).orbits.states, rtol=1e-6, atol=1e-5)
