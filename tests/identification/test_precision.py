"""The Gaussian approximation against what it must give for linear models."""

import numpy as np
import pytest

from eclsim.identification.objective import Box, correlation


def box_of(*deviations):
    """Bounds whose prior has these standard deviations."""
    half = np.sqrt(3.0) * np.array(deviations)
    return Box(("a", "b", "c")[: len(half)], np.zeros(len(half)), -half, half)


def test_of_a_linear_model_with_wide_bounds_it_is_that_of_least_squares():
    generator = np.random.default_rng(1)
    design = generator.normal(size=(8, 3))
    result = box_of(1e6, 1e6, 1e6).covariance(design)
    np.testing.assert_allclose(result, np.linalg.inv(design.T @ design), rtol=1e-6)
    draws = np.linalg.lstsq(design, generator.normal(size=(8, 20_000)), rcond=None)[0]
    np.testing.assert_allclose(np.sqrt(np.diag(result)), draws.std(axis=1), rtol=0.03)


def test_of_a_fit_with_other_weights_it_is_that_of_its_own_errors():
    """Intervals were those of the best weights whatever the fit had: too narrow by a third here."""
    generator = np.random.default_rng(2)
    design, weights = generator.normal(size=(6, 3)), np.array([3.0, 0.5, 1.0, 2.0, 0.3, 1.0])
    wide = box_of(1e6, 1e6, 1e6)
    result, best = wide.covariance(design, 5.0 * weights), wide.covariance(design)
    noise = generator.normal(size=(6, 20_000))
    draws = np.linalg.lstsq(weights[:, None] * design, weights[:, None] * noise, rcond=None)[0]
    np.testing.assert_allclose(np.sqrt(np.diag(result)), draws.std(axis=1), rtol=0.03)
    assert np.all(np.diag(result) > 1.2 * np.diag(best))
    assert np.array_equal(wide.covariance(design, np.full(6, 0.7)), best)


def test_other_weights_never_make_a_fit_surer_than_the_best_ones_or_less_sure_than_its_bounds():
    generator, box = np.random.default_rng(3), box_of(1.0, 0.3, 2.0)
    for _ in range(20):
        design = generator.normal(size=(5, 3)) * 10.0 ** generator.uniform(-2, 2, (5, 1))
        design[:, 2] = 0.0
        result = box.covariance(design, 10.0 ** generator.uniform(-1, 1, 5))
        assert np.linalg.eigvalsh(result - box.covariance(design)).min() > -1e-9
        assert result[2, 2] == pytest.approx(4.0)


def test_what_nothing_is_known_of_keeps_what_its_bounds_leave():
    box = Box.of(dict.fromkeys("ab", (1.0, 0.1, 10.0)))
    prior = box.prior_deviations
    assert prior[0] == pytest.approx(np.log(100.0) / np.sqrt(12.0))
    result = np.sqrt(np.diag(box.covariance(np.array([[50.0, 0.0]]))))
    assert result[0] == pytest.approx(1.0 / 50.0, rel=1e-3)
    assert result[1] == pytest.approx(prior[1])


def test_parameters_that_make_up_for_each_other_are_correlated():
    result = correlation(box_of(1.0, 1.0).covariance(np.array([[10.0, 10.0]])))
    assert result[0, 1] < -0.98
    np.testing.assert_allclose(np.diag(result), 1.0)


def test_intervals_end_at_the_bounds():
    low, high = Box.of({"Rmc": (2.0, 1.9, 20.0)}).interval(0, np.log(2.0), 0.1)
    assert low == 1.9
    assert high == pytest.approx(2.0 * np.exp(0.16448536))
    assert Box.of({"a": (1.0, 0.1, 10.0)}).scale.value(0, np.log(4.5)) == 4.5
