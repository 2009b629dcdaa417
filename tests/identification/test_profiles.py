"""Profiles and held fits on problems that are known, and polishing where slopes have a crease."""

import numpy as np
import pytest

from eclsim.identification.least_squares import EXACT, Termination, polish, refine
from eclsim.identification.objective import RISE_90, Box
from eclsim.identification.profiles import (
    doubts_of_a_lower_point,
    held_fits,
    interval_90,
    profiles,
    sides_without_beat,
    values_to_hold,
)
from eclsim.identification.quantities import Scale
from function_objective import FunctionObjective

LOG = Scale((0.0,))
BOX = Box(("a", "b"), np.zeros(2), np.full(2, -2.0), np.full(2, 2.0))


def only_their_sum(x: np.ndarray) -> np.ndarray:
    return np.stack([x[:, 0] + x[:, 1] - 0.5, 3.0 + 0.0 * x[:, 0]], axis=1)


def both(x: np.ndarray) -> np.ndarray:
    return np.stack([x[:, 0] + x[:, 1] - 0.5, x[:, 0] - x[:, 1] + 0.1], axis=1)


def test_a_profile_is_flat_where_another_parameter_makes_up():
    flat = profiles(FunctionObjective(only_their_sum), BOX, np.array([0.3, 0.2]), steps=7)
    inside = np.abs(np.log(flat.values)) <= 1.5
    np.testing.assert_allclose(flat.costs[inside], 9.0, rtol=1e-6)
    steep = profiles(FunctionObjective(both), BOX, np.array([0.2, 0.3]), steps=7)
    expected = 2.0 * (np.log(steep.values) - np.log(steep.optimum)[:, None]) ** 2
    near = np.abs(np.log(steep.values)) <= 1.4
    np.testing.assert_allclose(steep.costs[near], expected[near], atol=1e-3)


def two_valleys(x: np.ndarray) -> np.ndarray:
    """Best fits at (-0.5, -1) and (0.5, 1), alike; between them b has a ridge."""
    return np.stack([(x[:, 0] - 0.5 * x[:, 1]) / 0.2, 10.0 * (x[:, 1] ** 2 - 1.0)], axis=1)


def test_a_profile_from_one_valley_finds_the_other():
    """From (-0.5, -1) alone, a was 0.2 x 1.645 about -0.5."""
    curves = profiles(FunctionObjective(two_valleys), BOX, np.array([-0.5, -1.0]), steps=17)
    a = curves.names.index("a")
    expected = ((np.abs(np.log(curves.values[a])) - 0.5) / 0.2) ** 2
    inside = expected <= RISE_90
    np.testing.assert_allclose(curves.costs[a][inside], expected[inside], atol=0.05)
    lower, upper = interval_90(curves.values[a], curves.costs[a], LOG)
    assert np.log([lower, upper]) == pytest.approx([-0.83, 0.83], abs=0.02)
    assert {-1.0, 1.0} <= {*np.sign(curves.within[:, a])}


def a_deeper_valley(x: np.ndarray) -> np.ndarray:
    """As `two_valleys`, with 4 more at the one on the left."""
    left = 2.0 / (1.0 + np.exp(20.0 * x[:, 1]))
    return np.column_stack([two_valleys(x), left])


def test_profiles_name_the_lowest_point_they_find():
    curves = profiles(FunctionObjective(a_deeper_valley), BOX, np.array([-0.5, -1.0]), steps=17)
    assert curves.cost == pytest.approx(4.0, abs=1e-3)
    assert curves.lowest_cost == pytest.approx(0.0, abs=1e-3)
    np.testing.assert_allclose(curves.lowest, [0.5, 1.0], atol=0.01)


def test_a_lower_point_than_the_fit_is_a_doubt_if_the_fit_is_outside_its_region():
    (reason,) = doubts_of_a_lower_point(fitted=31.5, lowest=25.0)
    assert "25; a search from the fit ends at 31.5" in reason.sentence
    assert not doubts_of_a_lower_point(fitted=27.0, lowest=25.0)


def a_wall(x: np.ndarray) -> np.ndarray:
    return np.stack([np.exp(4.0 * (x[:, 0] - 1.0)), x[:, 1]], axis=1)


def test_a_steep_wall_behind_flat_ground_is_found_where_it_stands():
    """By the nine values of a profile alone it ended at 1.05 (logarithm); chi-square is 2.7 at 1.124."""
    curves = profiles(FunctionObjective(a_wall), BOX, np.array([-1.0, 0.0]), steps=9)
    lower, upper = interval_90(curves.values[0], curves.costs[0], LOG)
    assert np.log(upper) == pytest.approx(1.0 + np.log(RISE_90) / 8.0, abs=0.03)
    assert np.log(lower) == pytest.approx(-2.0)


def test_what_is_held_stays():
    mask = np.array([[True, False], [False, True]])
    starts = np.array([[1.0, 0.0], [0.0, -1.0]])
    result = refine(FunctionObjective(both), np.zeros(2, dtype=int), starts, BOX, EXACT, mask)
    assert result.x[0, 0] == 1.0
    assert result.x[1, 1] == -1.0
    np.testing.assert_allclose(result.x[0, 1], 0.3, atol=1e-4)


def test_a_follower_of_an_undetermined_parameter_is_seen():
    (result,) = held_fits(FunctionObjective(only_their_sum), BOX, [np.array([0.3, 0.2])], [[0]])
    moved, followed = result.compensation(np.array([0.3, 0.2]))
    assert moved[1] > 0.8
    assert followed[1] == 0
    (result,) = held_fits(FunctionObjective(both), BOX, [np.array([0.2, 0.3])], [[0]])
    assert result.compensation(np.array([0.2, 0.3]))[0][1] == 0.0


def test_the_values_that_were_held_bound_an_interval():
    """At the lower bound chi-square, exp(4 a), is flat; it has risen by 2.7 at a = 0.25."""
    at_bound, without_effect_there = np.array([-2.0, 0.0]), lambda x: np.exp(2.0 * x) * [1.0, 0.0]
    (result,) = held_fits(FunctionObjective(without_effect_there), BOX, [at_bound], [[0]])
    squares = np.sum(result.outputs**2, axis=1)
    ((name, (lower, upper)),) = result.intervals(BOX.names, at_bound, squares, 0.0).items()
    assert name == "a"
    assert np.log(lower) == pytest.approx(-2.0)
    assert np.log(upper) == pytest.approx(0.02, abs=0.01)  # on the chord from -0.4 to 0.6


def test_nothing_undetermined_needs_no_fit():
    (result,) = held_fits(FunctionObjective(both), BOX, [np.zeros(2)], [[]])
    assert len(result.held) == 0
    held, values = values_to_hold(np.zeros(2), BOX, [1])
    assert set(held) == {1}
    assert np.all(np.abs(values) > 0.5)


def along_a_crease(x: np.ndarray) -> np.ndarray:
    """Least, 1, at (-0.5, -0.5), down a crease that no slope on either side of it points along."""
    return np.stack([1.0 + 3.0 * np.abs(x[:, 0] - x[:, 1]), 0.5 * (x[:, 0] + x[:, 1] + 1.0)], axis=1)


def test_polishing_goes_on_where_a_crease_has_stopped_the_slopes():
    objective, start = FunctionObjective(along_a_crease), np.array([[-1.0, 0.5]])
    stopped = refine(objective, np.zeros(1, dtype=int), start, BOX, EXACT)
    assert stopped.terminations[0] == Termination.SETTLED
    assert stopped.costs[0] > 1.02
    polished = polish(objective, 0, stopped, BOX, EXACT)
    assert 1.0 <= polished.costs[0] < 1.0 + 0.5 * (stopped.costs[0] - 1.0)
    np.testing.assert_allclose(objective.evaluate(np.zeros(1, dtype=int), polished.x).costs, polished.costs)


def test_polishing_without_iterations_stays():
    objective, start = FunctionObjective(along_a_crease), np.array([[-1.0, 0.5]])
    stopped = refine(objective, np.zeros(1, dtype=int), start, BOX, EXACT)
    same = polish(objective, 0, stopped, BOX, EXACT, most_iterations=0)
    np.testing.assert_array_equal(same.x, stopped.x)


VALUES = np.exp(np.array([-2.0, -0.6, -0.33, -0.14, 0.0, 0.14, 0.33, 0.6, 2.0]))


def test_a_parabola_gives_the_interval_of_a_normal_distribution():
    lower, upper = interval_90(VALUES, 3.0 + (np.log(VALUES) / 0.2) ** 2, LOG)
    assert lower == pytest.approx(np.exp(-1.6448536 * 0.2), rel=1e-6)
    assert upper == pytest.approx(np.exp(1.6448536 * 0.2), rel=1e-6)


def test_a_flat_profile_reaches_its_ends():
    assert interval_90(VALUES, np.full(9, 5.0), LOG) == (VALUES[0], VALUES[-1])
    one_sided = np.where(VALUES < 1.0, 100.0, 5.0)
    lower, upper = interval_90(VALUES, one_sided, LOG)
    assert VALUES[3] < lower < 1.0
    assert upper == VALUES[-1]


def test_an_interval_reaches_over_a_ridge_to_another_minimum():
    costs = np.array([50.0, 3.5, 9.0, 4.0, 3.0, 4.0, 50.0, 50.0, 50.0])
    lower, upper = interval_90(VALUES, costs, LOG)
    assert VALUES[0] < lower < VALUES[1]
    assert VALUES[5] < upper < VALUES[6]


def test_an_interval_ends_where_there_is_no_steady_beat():
    costs = np.where(VALUES == 1.0, 4.9, 5.0)
    costs[7] = np.nan
    assert interval_90(VALUES, costs, LOG) == (VALUES[0], VALUES[7])
    assert sides_without_beat(costs) == ("upper",)
    costs[3] = np.nan
    assert interval_90(VALUES, costs, LOG) == (VALUES[3], VALUES[7])
    assert sides_without_beat(costs) == ("lower", "upper")
    assert sides_without_beat(np.full(9, 5.0)) == ()
