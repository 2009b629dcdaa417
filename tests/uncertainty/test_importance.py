"""Weighted draws against quadrature."""

import numpy as np
import pytest

from eclsim.uncertainty.gaussian import Gaussian
from eclsim.uncertainty.importance import pareto_fit, smoothed, weigh, weighted_quantile


def gaussian_of(posterior):
    z = np.array([0.4, 0.5])
    jacobian = posterior.jacobian(z)
    scaled = jacobian / posterior.scale[:, None]
    covariance = np.linalg.inv(scaled.T @ scaled + np.eye(2))
    return Gaussian(z, covariance, posterior.simulate(z), jacobian, 0.0)


def test_moments_of_a_curved_posterior(curved):
    found = weigh(curved, gaussian_of(curved), count=1500, seed=1)
    mean, covariance = curved.moments()
    weighted = found.weights @ found.z
    away = found.z - weighted
    assert weighted == pytest.approx(mean, abs=0.03)
    assert (away.T * found.weights) @ away == pytest.approx(covariance, abs=0.03)
    assert found.shape < 0.5
    assert not found.doubts
    chosen = found.z[found.resample(4000, 0)]
    assert chosen.mean(axis=0) == pytest.approx(mean, abs=0.03)


def test_a_bad_proposal_is_found_out():
    """Weights with a tail that has no mean."""
    random = np.random.default_rng(0)
    _, shape = smoothed(1.5 * random.exponential(size=4000))
    assert shape > 0.7


def test_shape_of_a_pareto_distribution():
    random = np.random.default_rng(5)
    for shape in (0.2, 0.8):
        above = 2.0 * np.expm1(-shape * np.log(random.uniform(size=3000))) / shape
        found, scale = pareto_fit(np.sort(above))
        assert found == pytest.approx(shape, abs=0.08)
        assert scale == pytest.approx(2.0, rel=0.1)


def test_members_without_a_steady_beat_have_no_weight():
    weights, _ = smoothed(np.r_[np.random.default_rng(0).standard_normal(400), -np.inf])
    assert weights[-1] == 0.0
    assert weights.sum() == pytest.approx(1.0)


def test_weighted_quantiles():
    values = np.array([3.0, 1.0, 2.0])
    assert weighted_quantile(values, np.ones(3), np.array([0.5])) == pytest.approx(2.0)
    assert weighted_quantile(values, np.array([1.0, 0.0, 1.0]), np.array([0.5])) == pytest.approx(2.5)
