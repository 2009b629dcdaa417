"""Weighted draws against quadrature."""

from dataclasses import replace

import numpy as np
import pytest

from eclsim.identification import density
from eclsim.identification.density import Gaussian, gaussian_approximation
from eclsim.identification.importance import (
    FEWEST_EFFECTIVE,
    WeightedDraws,
    importance_sample,
    pareto_fit,
    smoothed,
    weighted_quantile,
)
from eclsim.identification.objective import Explored
from eclsim.identification.proposals import Mixture
from eclsim.identification.transport import Transport
from known_posteriors import AnalyticGradient, CurvedPosterior, TwoSolutions


def gaussian_of(posterior, z=(0.4, 0.5)):
    z = np.array(z)
    jacobian = posterior.jacobian(z)
    scaled = jacobian / posterior.scale[:, None]
    covariance = np.linalg.inv(scaled.T @ scaled + np.eye(2))
    outputs = posterior.simulate(z)
    return Gaussian(z, covariance, outputs, jacobian, float(posterior.potential(z, outputs)))


@pytest.mark.slow
def test_moments_of_a_curved_posterior(curved):
    result = importance_sample(curved, gaussian_of(curved), count=1500, seed=1)
    mean, covariance = curved.moments()
    weighted = result.weights @ result.z
    away = result.z - weighted
    assert weighted == pytest.approx(mean, abs=0.03)
    assert (away.T * result.weights) @ away == pytest.approx(covariance, abs=0.03)
    assert result.shape < 0.5
    assert not result.doubts
    chosen = result.z[result.resample(4000, 0)]
    assert chosen.mean(axis=0) == pytest.approx(mean, abs=0.03)


@pytest.mark.slow
def test_both_of_two_narrow_solutions_are_sampled():
    """From the better one alone a tenth of the posterior was missing, and Pareto k raised no doubt."""
    posterior = TwoSolutions()
    maxima = [gaussian_of(posterior, z) for z in ((2.28, -2.1), (-1.68, 1.55), (2.3, -2.1))]
    both = Gaussian.at_maxima(maxima)
    assert [g.centre[0] for g in both.solutions] == [-1.68, 2.3]
    mean, covariance = posterior.moments()
    alone, result = (importance_sample(posterior, g, count=500) for g in (maxima[1], both))
    assert not alone.doubts
    assert alone.weights @ alone.z == pytest.approx([-1.68, 1.55], abs=0.05)
    weighted = result.weights @ result.z
    away = result.z - weighted
    assert weighted == pytest.approx(mean, abs=0.02)
    assert (away.T * result.weights) @ away == pytest.approx(covariance, abs=0.05)
    assert not result.doubts
    assert result.transport.centre == pytest.approx(weighted)


def explored_sets(posterior, count=64):
    """Random sets of parameters between the bounds, as those of a search."""
    z = np.random.default_rng(2).uniform(-2.4, 2.4, (count, 2))
    return Explored(posterior.prior.x_of(z), posterior.simulate(z))


@pytest.mark.slow
def test_a_solution_that_was_only_explored_is_sampled(monkeypatch):
    """The search ended in one of two solutions alone: an eleventh of the posterior was missing, unnoticed."""
    monkeypatch.setattr(density, "GradientEvaluator", AnalyticGradient)
    posterior = TwoSolutions()
    ends = posterior.prior.x_of(np.array([[-1.7, 1.6], [-1.6, 1.5]]))
    missed = gaussian_approximation(posterior, ends)
    assert missed.others == ()
    assert importance_sample(posterior, missed, count=500).doubts == ()
    both = gaussian_approximation(posterior, ends, explored_sets(posterior))
    assert [g.centre[0] for g in both.solutions] == pytest.approx([-1.69, 2.29], abs=0.02)
    assert both.potential == missed.potential
    result = importance_sample(posterior, both, count=500)
    mean, _ = posterior.moments()
    assert result.weights @ result.z == pytest.approx(mean, abs=0.02)


@pytest.mark.parametrize("bend", [0.0, 0.8], ids=["straight", "curved"])
def test_one_solution_stays_the_same_to_the_last_bit_whatever_was_explored(monkeypatch, bend):
    monkeypatch.setattr(density, "GradientEvaluator", AnalyticGradient)
    posterior = CurvedPosterior(bend=bend)
    ends = posterior.prior.x_of(np.array([[0.4, 0.5]]))
    alone, result = (
        gaussian_approximation(posterior, ends, explored) for explored in (None, explored_sets(posterior))
    )
    assert result.others == ()
    assert result.potential == alone.potential
    assert np.array_equal(result.centre, alone.centre)
    assert np.array_equal(result.covariance, alone.covariance)


def test_climbs_from_explored_sets_are_few_and_stop_where_nothing_is_unexplained(monkeypatch):
    climbs = []

    class Counted(AnalyticGradient):
        def __init__(self, posterior, centre, by_point=False):
            climbs.append(centre)
            super().__init__(posterior, centre)

    monkeypatch.setattr(density, "GradientEvaluator", Counted)
    posterior = TwoSolutions()
    gaussian_approximation(posterior, posterior.prior.x_of(np.array([[-1.7, 1.6]])), explored_sets(posterior))
    assert 1 < len(climbs) <= 1 + density.FURTHER_CLIMBS
    assert climbs[1][0] > 0.3


def test_maxima_without_probability_are_no_solutions():
    posterior = TwoSolutions(target=np.array([4.0, 2.0]), scale=np.array([0.15, 0.3]))
    near, far = (gaussian_of(posterior, z) for z in ((2.28, -0.3), (-1.68, 3.4)))
    assert far.potential - near.potential > 3.0
    assert Gaussian.at_maxima([far, near]).others == (far,)
    assert Gaussian.at_maxima([replace(far, potential=far.potential + 9.0), near]).others == ()


def test_a_bad_proposal_is_found_out():
    """Weights with a tail that has no mean."""
    random = np.random.default_rng(0)
    _, shape = smoothed(1.5 * random.exponential(size=4000))
    assert shape > 0.7


def test_shape_of_a_pareto_distribution():
    random = np.random.default_rng(5)
    for shape in (0.2, 0.8):
        above = 2.0 * np.expm1(-shape * np.log(random.uniform(size=3000))) / shape
        result, scale = pareto_fit(np.sort(above))
        assert result == pytest.approx(shape, abs=0.08)
        assert scale == pytest.approx(2.0, rel=0.1)


def test_members_without_a_steady_beat_have_no_weight():
    weights, _ = smoothed(np.r_[np.random.default_rng(0).standard_normal(400), -np.inf])
    assert weights[-1] == 0.0
    assert weights.sum() == pytest.approx(1.0)


def test_weighted_quantiles():
    values = np.array([3.0, 1.0, 2.0])
    assert weighted_quantile(values, np.ones(3), np.array([0.5])) == pytest.approx(2.0)
    assert weighted_quantile(values, np.array([1.0, 0.0, 1.0]), np.array([0.5])) == pytest.approx(2.5)


def doubtful(exponent, count=2000, shape=0.4):
    """Draws of a standard normal distribution, weighted by its density to a power."""
    z = np.random.default_rng(3).standard_normal((count, 2))
    weights = np.exp(-0.5 * exponent * np.sum(z**2, axis=1))
    proposal = Mixture((Transport.linear(np.zeros(2), np.eye(2)),))
    return WeightedDraws(z, z, weights / weights.sum(), shape, proposal)


def test_weights_that_are_trusted_are_not_widened():
    result = doubtful(0.5)
    weights, power = result.tempered()
    assert power == 1.0
    assert weights is result.weights


@pytest.mark.parametrize("result", [doubtful(40.0), doubtful(0.5, shape=1.2)], ids=["few", "heavy tail"])
def test_weights_in_doubt_are_widened_until_they_can_be_trusted(result):
    assert result.reasons
    weights, power = result.tempered()
    assert 0.0 < power < 1.0
    assert weights.sum() == pytest.approx(1.0)
    assert 1.0 / np.sum(weights**2) >= FEWEST_EFFECTIVE
    assert power * result.shape <= 0.7 + 1e-9
    assert weights @ result.z[:, 0] ** 2 > 1.1 * (result.weights @ result.z[:, 0] ** 2)


def test_draws_without_a_steady_beat_are_counted():
    result = doubtful(0.5)
    outputs = result.z.copy()
    outputs[:7] = np.nan
    assert WeightedDraws(result.z, outputs, result.weights, 0.4, result.proposals).without_beat == 7
