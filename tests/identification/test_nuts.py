"""The sampler against quadrature."""

import numpy as np
import pytest

from eclsim.identification import nuts
from eclsim.identification.nuts import diagnose
from eclsim.identification.proposals import Mixture
from eclsim.identification.transport import Transport
from known_posteriors import AnalyticGradient, HalfBlind, TwoArms

pytest.importorskip("numpyro")


@pytest.fixture
def analytic(monkeypatch):
    monkeypatch.setattr(nuts, "GradientEvaluator", AnalyticGradient)


def straight(mean, covariance):
    return Mixture((Transport.linear(mean, covariance),))


SHORT = nuts.Sampling(chains=4, warmup=200, draws=500, seed=3)


@pytest.mark.slow
def test_moments_of_a_curved_posterior(curved, analytic):
    mean, covariance = curved.moments()
    message = []
    result = nuts.sample(
        curved, straight(mean, covariance), SHORT, lambda done, of: message.append((done, of))
    )
    flat = result.z.reshape(-1, 2)
    assert result.z.shape == (4, 500, 2)
    assert flat.mean(axis=0) == pytest.approx(mean, abs=0.05)
    assert np.cov(flat.T) == pytest.approx(covariance, abs=0.06)
    statistics = result.statistics
    report = diagnose(("a", "b"), result.z, statistics)
    assert report.r_hat.max() < 1.02
    assert report.energy_fraction.min() > 0.5
    assert (statistics["saturated"] == (statistics["num_steps"] >= 7)).all()
    assert 0.2 < statistics["jumped"].mean() < 0.9
    assert message[-1] == (2800, 2800)


@pytest.mark.slow
def test_the_same_seed_gives_the_same_draws(curved, analytic):
    start = straight(*curved.moments())
    short = nuts.Sampling(chains=2, warmup=60, draws=20, seed=5)
    first, again = (nuts.sample(curved, start, short).z for _ in range(2))
    assert first.tolist() == again.tolist()
    assert first[0].tolist() != first[1].tolist()


@pytest.mark.slow
def test_chains_jump_between_arms_and_what_can_be_left_can_be_entered(analytic):
    """The potential of the place that is left and of the one that is entered are the same function."""
    mean, covariance = TwoArms().moments()
    result = nuts.sample(HalfBlind(), straight(mean, covariance), SHORT)
    right = (result.z[..., 0] > 0.0).mean(axis=1)
    assert right == pytest.approx(0.5, abs=0.4)  # without jumps 0 or 1
    assert right.mean() == pytest.approx(0.5, abs=0.2)


@pytest.mark.slow
def test_points_without_a_steady_beat_are_counted_and_the_potential_depends_on_the_point_alone(
    curved, monkeypatch
):
    requests = []

    class Walled(AnalyticGradient):
        def __init__(self, posterior, centre, by_point=False):
            super().__init__(posterior, centre)
            requests.append(by_point)

        def potential(self, z):
            return super().potential(z) if z[0] < 0.6 else (np.inf, np.zeros(2))

    monkeypatch.setattr(nuts, "GradientEvaluator", Walled)
    result = nuts.sample(
        curved, straight(*curved.moments()), nuts.Sampling(chains=2, warmup=30, draws=30, seed=1)
    )
    assert requests == [True, True]
    assert 0 < result.without_beat < result.evaluations
    assert (result.z[..., 0] < 0.6).all()


def test_without_numpyro_it_says_what_to_install(curved, analytic, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "numpyro.infer.hmc", None)
    with pytest.raises(nuts.MissingPackageError, match=r"eclsim\[bayes\]"):
        nuts.sample(curved, straight(*curved.moments()), SHORT)
