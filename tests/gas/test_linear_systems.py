"""Small linear systems: the solution, its derivatives, and that programs of gas need no threads of LAPACK."""

from pathlib import Path

import jax
import numpy as np
import pytest

from eclsim.cases import read_case
from eclsim.gas.linear_systems import solution
from eclsim.gas.network import gas_of
from eclsim.orbit.model import model_of

EXAMPLE = Path(__file__).parents[2] / "examples" / "veno_venous_gas.toml"


@pytest.fixture
def system():
    random = np.random.default_rng(3)
    matrix = random.normal(size=(14, 14))
    matrix[0, 0] = 0.0  # elimination needs another row first
    return matrix, random.normal(size=(14, 3))


def test_the_solution_is_that_of_lapack_alone_and_side_by_side(system):
    matrix, offsets = system
    expected = np.linalg.solve(matrix, offsets)
    np.testing.assert_allclose(solution(matrix, offsets), expected, rtol=1e-10, atol=1e-12)
    many = np.stack([matrix, matrix.T])
    np.testing.assert_allclose(
        jax.vmap(solution, (0, None))(many, offsets)[1],
        np.linalg.solve(matrix.T, offsets),
        rtol=1e-10,
        atol=1e-12,
    )


def test_derivatives_follow_finite_differences(system):
    matrix, offsets = system
    by_matrix = np.random.default_rng(4).normal(size=matrix.shape)
    _, slope = jax.jvp(solution, (matrix, offsets), (by_matrix, offsets))
    up, down = (np.linalg.solve(matrix + h * by_matrix, (1 + h) * offsets) for h in (1e-6, -1e-6))
    np.testing.assert_allclose(slope, (up - down) / 2e-6, rtol=1e-6, atol=1e-6)


def test_a_singular_matrix_has_no_finite_solution():
    assert not np.isfinite(solution(np.zeros((3, 3)), np.ones((3, 1)))).any()


@pytest.mark.slow
def test_programs_of_gas_hold_no_decomposition_that_waits_for_threads():
    model = model_of(read_case(EXAMPLE).case)
    function = gas_of(model.circuit)
    numbers = np.ones((2 * len(function.connections) + len(function.parameters), 4))
    program = jax.jit(jax.vmap(function.compute, in_axes=1)).lower(numbers).as_text()
    assert "lapack" not in program
