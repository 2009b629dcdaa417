"""Maps that straighten curved posteriors."""

import jax.numpy as jnp
import numpy as np
import pytest

from eclsim.identification.transport import Transport


@pytest.fixture
def banana():
    random = np.random.default_rng(0)
    first = random.standard_normal(4000)
    second = 0.6 * first**2 + np.exp(0.5 * first) * random.standard_normal(4000) * 0.3
    return np.stack([first, second], axis=1)


@pytest.fixture
def fitted(banana):
    return Transport.fit(banana, np.ones(len(banana)))


def test_there_and_back(fitted):
    u = np.random.default_rng(1).standard_normal((100, 2)) * 2.0
    back, log_slope = fitted.u_of(fitted.z_of(u)[0])
    assert back == pytest.approx(u, abs=1e-8)
    assert log_slope == pytest.approx(fitted.z_of(u)[1], abs=1e-8)


def test_the_logarithm_of_the_slope_is_that_of_the_determinant(fitted):
    for u in np.random.default_rng(2).standard_normal((5, 2)):
        _, log_slope = fitted.z_of(u)
        assert log_slope == pytest.approx(np.linalg.slogdet(fitted.jacobian(u))[1], abs=1e-6)


def test_numpy_and_jax_agree(fitted):
    u = np.array([0.3, -1.2])
    z, log_slope = fitted.z_of(u, jnp)
    assert np.asarray(z) == pytest.approx(fitted.z_of(u)[0], rel=1e-12)
    assert float(log_slope) == pytest.approx(float(fitted.z_of(u)[1]), rel=1e-12)


def test_a_curved_distribution_becomes_nearly_standard_normal(banana, fitted):
    straight = Transport.linear(banana.mean(axis=0), np.cov(banana.T))

    def lack(transport):
        """Kullback-Leibler divergence up to a constant that all maps share."""
        u, log_slope = transport.u_of(banana)
        return np.mean(0.5 * np.sum(u**2, axis=1) + log_slope)

    assert lack(fitted) < lack(straight) - 0.4
    u, _ = fitted.u_of(banana)
    assert u.mean(axis=0) == pytest.approx(0.0, abs=0.1)
    assert np.cov(u.T) == pytest.approx(np.eye(2), abs=0.15)
    assert np.corrcoef(u[:, 0] ** 2, u[:, 1])[0, 1] == pytest.approx(0.0, abs=0.1)


def test_straight_gives_a_normal_distribution_its_coordinates():
    covariance = np.array([[4.0, 1.2], [1.2, 1.0]])
    transport = Transport.linear(np.array([1.0, -2.0]), covariance)
    z, log_slope = transport.z_of(np.random.default_rng(3).standard_normal((40000, 2)))
    assert np.cov(z.T) == pytest.approx(covariance, rel=0.05)
    assert log_slope == pytest.approx(0.5 * np.linalg.slogdet(covariance)[1])


def test_with_few_effective_draws_the_map_stays_straight(banana):
    weights = np.zeros(len(banana))
    weights[:50] = 1.0
    assert not Transport.fit(banana, weights + 1e-12).shapes.any()
