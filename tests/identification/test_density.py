"""Hidden variables, parameters and back."""

import numpy as np
import pytest
from scipy.stats import kstest, norm, truncnorm

from eclsim.identification.density import DEVIATIONS_TO_BOUNDS, Prior

LOWER, UPPER, START = np.log([0.1, 0.02]), np.log([10.0, 8.0]), np.log([1.0, 0.5])


@pytest.fixture(params=["log-uniform", "log-normal"])
def prior(request):
    return Prior(("a", "b"), START, LOWER, UPPER, request.param)


def test_there_and_back(prior):
    z = np.random.default_rng(0).uniform(-3.0, 3.0, (50, 2))
    assert prior.z_of(prior.x_of(z)) == pytest.approx(z, abs=1e-8)


def test_slopes_are_derivatives(prior):
    z = np.random.default_rng(1).uniform(-2.5, 2.5, (20, 2))
    difference = (prior.x_of(z + 1e-5) - prior.x_of(z - 1e-5)) / 2e-5
    assert prior.slopes(z) == pytest.approx(difference, rel=1e-6)


def test_never_outside_the_bounds(prior):
    x = prior.x_of(np.array([[-40.0, -9.0], [9.0, 40.0]]))
    assert (x >= LOWER - 1e-12).all()
    assert (x <= UPPER + 1e-12).all()


def test_parameters_at_a_bound_have_finite_variables(prior):
    assert np.isfinite(prior.z_of(np.stack([LOWER, UPPER]))).all()


def test_log_uniform_is_uniform_in_the_logarithm():
    x = Prior(("a", "b"), START, LOWER, UPPER).x_of(norm.ppf((np.arange(2000) + 0.5) / 2000)[:, None])
    shares = (x - LOWER) / (UPPER - LOWER)
    assert kstest(shares[:, 0], "uniform").statistic < 1e-3


def test_log_normal_is_a_normal_distribution_cut_at_the_bounds():
    prior = Prior(("a", "b"), START, LOWER, UPPER, "log-normal")
    x = prior.x_of(norm.ppf((np.arange(2000) + 0.5) / 2000)[:, None])[:, 1]
    spread = max(UPPER[1] - START[1], START[1] - LOWER[1]) / DEVIATIONS_TO_BOUNDS
    ends = (LOWER[1] - START[1]) / spread, (UPPER[1] - START[1]) / spread
    assert kstest(x, truncnorm(*ends, START[1], spread).cdf).statistic < 1e-3
