"""Mixtures, and jumps as a chain of their own, against quadrature."""

import numpy as np
import pytest

from eclsim.identification.proposals import Jumps, Mixture
from eclsim.identification.transport import Transport
from known_posteriors import TwoArms


@pytest.fixture
def mixture(curved):
    mean, covariance = curved.moments()
    return Mixture((Transport.linear(mean, covariance), Transport.linear(mean + 0.3, 3.0 * covariance)))


def test_the_density_of_a_mixture_is_that_of_its_draws(mixture):
    """Over a box, the share of the draws is the integral of the density."""
    draws = mixture.draws(np.random.default_rng(0), 40_000)
    axis = np.linspace(-1.0, 1.5, 251)
    z = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1)
    density = np.exp(mixture.log_density(z))
    integral = np.trapezoid(np.trapezoid(density, axis), axis)
    inside = ((draws > -1.0) & (draws < 1.5)).all(axis=1).mean()
    assert inside == pytest.approx(integral, abs=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("posterior", [None, TwoArms()], ids=["curved", "two arms"])
def test_a_chain_of_jumps_keeps_the_distribution(posterior, curved, mixture):
    posterior = posterior or curved
    proposed = Jumps.draw(mixture, 1, 40_000, seed=0)
    potentials = posterior.potential(proposed.z[0], posterior.simulate(proposed.z[0]))
    z, ratio, chain = proposed.z[0, 0], -np.inf, []
    for k in range(40_000):
        potential = float(potentials[k])
        if not proposed.refused(0, k, ratio, potential):
            z = proposed.z[0, k]
            ratio = proposed.log_ratio(z, potential)
        chain.append(z)
    mean, covariance = posterior.moments()
    assert np.mean(chain, axis=0) == pytest.approx(mean, abs=0.05)
    assert np.cov(np.array(chain).T) == pytest.approx(covariance, abs=0.05)


@pytest.mark.slow
def test_a_place_without_a_steady_beat_is_refused(mixture):
    proposed = Jumps.draw(mixture, 1, 3, seed=1)
    assert proposed.refused(0, 1, 0.0, np.inf)
    assert proposed.refused(0, 1, 0.0, np.nan)
