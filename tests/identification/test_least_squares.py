"""Bounded least squares on problems whose optimum is known, without a simulation."""

import numpy as np
import pytest
from scipy.optimize import least_squares, lsq_linear

from eclsim.identification.least_squares import EXACT, Termination, bounded_step, refine
from eclsim.identification.multi_start import MultiStart, agreeing, identify, mixing_weight, sobol
from eclsim.identification.objective import Box
from function_objective import FunctionObjective


def rosenbrock(x: np.ndarray) -> np.ndarray:
    return np.stack([10.0 * (x[:, 1] - x[:, 0] ** 2), 1.0 - x[:, 0]], axis=1)


def box(lower: float, upper: float, size: int = 2) -> Box:
    names = tuple(f"p{k}" for k in range(size))
    return Box(names, np.zeros(size), np.full(size, lower), np.full(size, upper))


def test_a_curved_valley_is_followed_to_its_end():
    starts = np.array([[-1.2, 1.0], [2.0, -1.0], [0.0, 2.0]])
    result = refine(FunctionObjective(rosenbrock), np.zeros(3, dtype=int), starts, box(-3, 3), EXACT)
    np.testing.assert_allclose(result.x, 1.0, atol=1e-8)
    assert set(result.terminations) == {Termination.SETTLED}


@pytest.mark.parametrize("upper", [0.5, 0.2, -0.4])
def test_the_optimum_at_a_bound_is_that_of_scipys_trust_region(upper: float):
    result = refine(
        FunctionObjective(rosenbrock), np.zeros(1, dtype=int), np.array([[-1.0, -1.0]]), box(-2, upper), EXACT
    )
    scipys = least_squares(
        lambda x: rosenbrock(x[None])[0], [-1.0, -1.0], bounds=(-2, upper), xtol=1e-14, ftol=1e-14, gtol=1e-14
    )
    assert result.costs[0] <= 2.0 * scipys.cost * (1 + 1e-6)
    np.testing.assert_allclose(result.x[0], scipys.x, atol=1e-4)


def test_starts_without_a_steady_beat_are_named_and_do_not_stop_the_others():
    def undefined_on_the_left(x: np.ndarray) -> np.ndarray:
        return np.where(x[:, :1] < -1.5, np.nan, rosenbrock(x))

    starts = np.array([[-2.0, 0.0], [0.5, 0.5]])
    result = refine(
        FunctionObjective(undefined_on_the_left), np.zeros(2, dtype=int), starts, box(-3, 3), EXACT
    )
    assert result.terminations[0] == Termination.NO_STEADY_BEAT
    assert np.isinf(result.costs[0])
    np.testing.assert_allclose(result.x[1], 1.0, atol=1e-8)


def test_a_start_all_of_whose_steps_have_no_steady_beat_stays_and_ends():
    """As of a heart in arrest: there is a beat with derivatives at the start, and none where they lead."""

    class OnlyHere(FunctionObjective):
        def evaluate(self, points, x, options=None, resolution=None, tangents=None):
            assert len(x) > 0
            return super().evaluate(points, x, options, resolution, tangents)

    start = np.array([[0.2, -0.4]])

    def nowhere_else(x: np.ndarray) -> np.ndarray:
        far = np.abs(x - start).max(axis=1, keepdims=True) > 1e-5
        return np.where(far, np.nan, rosenbrock(x))

    result = refine(OnlyHere(nowhere_else), np.zeros(1, dtype=int), start, box(-3, 3))
    np.testing.assert_allclose(result.x, start, atol=2e-5)
    assert result.terminations[0] == Termination.SETTLED


def test_a_start_does_not_depend_on_the_others():
    objective, starts = FunctionObjective(rosenbrock), np.array([[-1.2, 1.0], [2.0, -1.0]])
    together = refine(objective, np.zeros(2, dtype=int), starts, box(-3, 3))
    single = refine(objective, np.zeros(1, dtype=int), starts[1:], box(-3, 3))
    np.testing.assert_array_equal(together.x[1], single.x[0])


def random_steps(count: int):
    """Steps of random linear problems beside the best there are inside the bounds (SciPy's lsq_linear)."""
    generator = np.random.default_rng(3)
    for _ in range(count):
        jacobian, residuals = generator.normal(size=(5, 3)), 0.7 * generator.normal(size=5)
        # No way across this box is longer than a step may be.
        x, space = generator.uniform(-0.05, 0.05, 3), box(-0.8, 0.8, 3)
        step = bounded_step(jacobian, residuals, x, space, 1e-12)
        assert np.all(np.abs(x + step) <= 0.8 + 1e-12)
        after = residuals + jacobian @ step
        best = lsq_linear(jacobian, -residuals, (-0.8 - x, 0.8 - x), tol=1e-12)
        fall, most = (residuals @ residuals - cost for cost in (after @ after, 2.0 * best.cost))
        yield step, fall, best, most


def test_a_step_inside_the_bounds_is_the_best_there_is():
    inside = [(step, best.x) for step, _, best, _ in random_steps(200) if not best.active_mask.any()]
    assert len(inside) > 80
    for step, best in inside:
        np.testing.assert_allclose(step, best, atol=1e-6)


def test_a_step_against_the_bounds_gains_as_much_as_the_best():
    gains = [promised / ideal for _, promised, best, ideal in random_steps(200) if best.active_mask.any()]
    assert len(gains) > 40
    np.testing.assert_allclose(gains, 1.0, rtol=1e-9)


def test_explored_points_fill_the_box_the_same_way_for_a_seed():
    space, settings = box(-1, 3), MultiStart(points_per_parameter=64, seed=7)
    points = sobol(space, settings)
    assert points.shape == (128, 2)
    np.testing.assert_array_equal(points[0], space.start)
    np.testing.assert_array_equal(points, sobol(space, settings))
    assert not np.array_equal(points, sobol(space, MultiStart(points_per_parameter=64, seed=8)))
    filled = np.histogram2d(*points[1:].T, bins=4, range=[(-1, 3), (-1, 3)])[0]
    assert filled.min() >= 7
    assert filled.max() <= 8


def test_weight_of_the_best_grows_with_the_starts():
    weights = [mixing_weight(k, 70) for k in range(70)]
    assert weights[0] == 0.1
    assert weights == sorted(weights)
    assert weights[-1] == pytest.approx(np.sqrt(69 / 70))


def many_valleys(x: np.ndarray) -> np.ndarray:
    """Local optima at x = -2, -1, ... 2; the deepest one at 0."""
    return np.concatenate([np.sin(np.pi * x), 0.1 * x], axis=1)


def test_multi_start_finds_the_deepest_valley_and_stops_when_it_is_found_again():
    settings = MultiStart(points_per_parameter=200, refined_share=0.2)
    (result,) = identify(FunctionObjective(many_valleys), box(-2.4, 2.4), settings)
    np.testing.assert_allclose(result.x, 0.0, atol=1e-8)
    assert result.agreeing > settings.rediscoveries
    assert len(result.starts.agreeing) < 80
    assert result.status == "fitted"


def test_the_same_seed_gives_the_same_fit():
    settings = MultiStart(points_per_parameter=50, refined_share=0.2, seed=3)
    one, other = (identify(FunctionObjective(many_valleys), box(-2.4, 2.4), settings)[0] for _ in range(2))
    np.testing.assert_array_equal(one.x, other.x)
    np.testing.assert_array_equal(one.starts.end, other.starts.end)


def test_points_are_fitted_as_if_alone():
    settings = MultiStart(points_per_parameter=50, refined_share=0.2)
    shifts = np.array([0.0, 0.7])
    both = identify(FunctionObjective(rosenbrock, shifts), box(-3, 3), settings)
    single = identify(FunctionObjective(rosenbrock, shifts[1:]), box(-3, 3), settings)
    np.testing.assert_allclose(both[0].x, 1.0, atol=1e-7)
    np.testing.assert_allclose(both[1].x, 1.7, atol=1e-7)
    np.testing.assert_array_equal(both[1].x, single[0].x)


def test_nothing_to_start_from_is_a_status():
    (result,) = identify(FunctionObjective(lambda x: np.full_like(x, np.nan)), box(-1, 1), MultiStart(20))
    assert result.status == "no_steady_beat"
    assert result.explored.without_beat == result.explored.points == 40
    assert "steady heartbeat" in result.status.message


def test_the_same_cost_with_other_outputs_is_another_optimum():
    def mirror(x: np.ndarray) -> np.ndarray:
        return np.stack([x[:, 0] ** 2 - 1.0, 0.001 * x[:, 0], 0.1 + 0.0 * x[:, 0]], axis=1)

    starts = np.array([[0.9, 0.0], [1.2, 0.0], [-0.8, 0.0]])
    ended = refine(FunctionObjective(mirror), np.zeros(3, dtype=int), starts, box(-2, 2), EXACT)
    np.testing.assert_allclose(ended.costs, ended.costs[0], rtol=1e-6)
    assert agreeing(ended).sum() in (1, 2)


def test_a_place_without_derivatives_is_left_aside():
    class Shut(FunctionObjective):
        """Has no derivatives beyond 0.5, where its outputs are lower."""

        def linearise(self, evaluation, members, x):
            result, near = super().linearise(evaluation, members, x)
            result[x[:, 0] > 0.5] = np.nan
            return result, near

    objective = Shut(lambda x: np.stack([x[:, 0] - 1.0, x[:, 1] + 0.2], axis=1))
    starts = np.array([[0.0, 0.0], [0.8, 0.0]])
    result = refine(objective, np.zeros(2, dtype=int), starts, box(-2, 2))
    assert result.terminations[1] == Termination.NO_STEADY_BEAT
    assert np.isinf(result.costs[1])
    assert 0.3 < result.x[0, 0] <= 0.5
    assert np.isfinite(result.jacobians[0]).all()
