"""The linearly implicit step: its order with any matrix, what it conserves, stiff decay."""

import numpy as np
import pytest

from eclsim.course.rosenbrock import ALPHA, COUPLING, EMBEDDED, GAMMA, WEIGHTS, between, step


def rates(time, states):
    """A damped oscillator, driven in time, and a ledger: the last state balances the first."""
    x, v, _ = states
    force = np.sin(time) - x**3 - 0.3 * v
    return np.stack([v, force, -v]), np.ones(states.shape[1], dtype=bool)


def marched(count, matrix, end=2.0):
    states, length = np.array([[1.0], [0.0], [-1.0]]), np.array([end / count])
    for k in range(count):
        time = np.array([k * end / count])
        states = step(rates, rates(time, states)[0], time, states, length, matrix[None]).states
    return states[:, 0]


@pytest.mark.parametrize(
    "matrix",
    [np.zeros((3, 3)), np.array([[0.0, 1.0, 0.0], [-3.0, -0.3, 0.0], [0.0, -1.0, 0.0]])],
    ids=["none", "of the start"],
)
def test_the_order_is_three_whatever_the_matrix(matrix):
    exact = marched(2000, np.zeros((3, 3)))
    errors = [np.abs(marched(count, matrix) - exact).max() for count in (20, 40, 80)]
    assert errors[2] < 2e-5
    assert errors[0] / errors[1] == pytest.approx(8.0, rel=0.35)
    assert errors[1] / errors[2] == pytest.approx(8.0, rel=0.35)


def test_what_is_conserved_stays_to_rounding():
    matrix = np.array([[0.0, 1.0, 0.0], [-3.0, -0.3, 0.0], [0.0, -1.0, 0.0]])
    end = marched(50, matrix)
    assert abs(end[0] + end[2]) < 1e-13


def test_the_step_is_stiffly_accurate_and_the_embedded_weights_add_to_one():
    np.testing.assert_allclose(np.array(ALPHA[3]) + np.array(COUPLING[3]), WEIGHTS[:3])
    assert WEIGHTS[3] == GAMMA
    assert sum(WEIGHTS) == pytest.approx(1.0, abs=1e-14)
    assert sum(EMBEDDED) == pytest.approx(1.0, abs=1e-14)


def test_a_fast_decay_is_damped_in_a_long_step():
    def decay(time, states):
        return -1e3 * states, np.ones(1, dtype=bool)

    one, length = np.ones((1, 1)), np.array([60.0])
    result = step(decay, decay(0.0, one)[0], np.zeros(1), one, length, np.array([[[-1e3]]]))
    assert abs(result.states[0, 0]) < 1e-3


def test_between_two_moments_a_cubic_is_exact():
    time = np.linspace(1.0, 3.0, 5)
    ends = [np.array([t**3 - t]) for t in (1.0, 3.0)]
    slopes = [np.array([3 * t**2 - 1.0]) for t in (1.0, 3.0)]
    np.testing.assert_allclose(between(time, (1.0, 3.0), tuple(ends), tuple(slopes))[0], time**3 - time)
