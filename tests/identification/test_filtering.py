"""The filter against Kalman's own formulas, and a mixture's quantiles."""

import numpy as np
import pytest
from scipy.stats import norm

from eclsim.identification.density import NoSteadyBeatError
from eclsim.identification.filtering import (
    GaussianMixture,
    outputs_after,
    regress,
    sigma_points,
    updated,
)
from eclsim.identification.transport import Transport

SLOPE = np.array([[2.0, 0.5, 0.0], [0.0, -1.0, 1.5]])
OFFSET = np.array([10.0, -3.0])
MEAN = np.array([0.2, -0.4, 1.0])
COVARIANCE = np.array([[1.0, 0.3, 0.0], [0.3, 0.5, 0.1], [0.0, 0.1, 0.8]])


def straight(z):
    return OFFSET + z @ SLOPE.T


@pytest.fixture
def belief():
    return GaussianMixture(np.ones(1), MEAN[None], COVARIANCE[None])


def test_sigma_points_have_the_moments(belief):
    points = sigma_points(belief.means, belief.covariances)[0, 1:]
    assert points.mean(axis=0) == pytest.approx(MEAN)
    assert (points - MEAN).T @ (points - MEAN) / len(points) == pytest.approx(COVARIANCE)


def test_outputs_of_a_straight_model(belief):
    outputs = regress(straight, belief.means, belief.covariances).outputs(belief)
    assert outputs.mean == pytest.approx(straight(MEAN))
    assert outputs.covariance == pytest.approx(SLOPE @ COVARIANCE @ SLOPE.T)


def test_update_of_a_straight_model_is_kalmans(belief):
    errors, measured = np.array([0.7, 0.4]), np.array([9.0, -1.0])
    first = regress(straight, belief.means, belief.covariances)
    found = updated(straight, belief, first, measured, errors, np.array([True, True]))
    total = SLOPE @ COVARIANCE @ SLOPE.T + np.diag(errors**2)
    gain = COVARIANCE @ SLOPE.T @ np.linalg.inv(total)
    assert found.mean == pytest.approx(MEAN + gain @ (measured - straight(MEAN)))
    assert found.covariance == pytest.approx(COVARIANCE - gain @ total @ gain.T)


def test_outputs_after_an_update_are_those_of_the_estimate():
    """Extrapolated from the forecast a heart that fails suddenly had a cardiac output of -5 L/min.

    With what is not linear over the forecast, a measured saturation of 83 % stood beside 53 to 96 %.
    """

    def falling(z):
        return np.exp(-z)

    def state(mean, spread, weights=(0.5, 0.5)):
        means, covariances = np.array([[mean], [mean]]), np.full((2, 1, 1), spread**2)
        return GaussianMixture(np.array(weights), means, covariances)

    far = outputs_after(falling, state(2.0, 0.02))
    assert far.mean == pytest.approx(np.exp(-2.0), rel=0.001)
    assert np.sqrt(far.covariance) == pytest.approx(0.02 * np.exp(-2.0), rel=0.001)
    unlikely = GaussianMixture(np.array([1e-6, 1.0]), np.array([[9.0], [0.05]]), state(0.0, 0.02).covariances)
    assert outputs_after(falling, unlikely).mean == pytest.approx(np.exp(-0.05), rel=0.001)
    with pytest.raises(NoSteadyBeatError):
        outputs_after(lambda z: np.where(z < 1.0, z, np.nan), state(2.0, 0.02))


def test_an_output_that_is_not_used_changes_nothing(belief):
    errors, used = np.array([0.7, 0.4]), np.array([True, False])
    first = regress(straight, belief.means, belief.covariances)
    some, other = (
        updated(straight, belief, first, np.array([9.0, value]), errors, used) for value in (np.nan, 50.0)
    )
    assert some.mean == pytest.approx(other.mean)


def test_the_filter_that_foresaw_the_measurement_gains_weight():
    means = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    both = GaussianMixture(np.array([0.5, 0.5]), means, np.stack([0.1 * COVARIANCE] * 2))
    first = regress(straight, both.means, both.covariances)
    measured = straight(means[1])
    found = updated(straight, both, first, measured, np.ones(2), np.array([True, True]))
    assert found.weights[1] > 0.9
    assert found.weights.sum() == pytest.approx(1.0)


def test_a_curved_model_is_linearised_around_the_estimate():
    """y = exp(z): one regression over a wide forecast is far off, iterating is not."""
    wide = GaussianMixture(np.ones(1), np.zeros((1, 1)), np.ones((1, 1, 1)))
    first = regress(np.exp, wide.means, wide.covariances)
    errors = np.array([0.05])
    found = updated(np.exp, wide, first, np.array([4.0]), errors, np.array([True]))
    assert found.mean[0] == pytest.approx(np.log(4.0), abs=0.02)
    assert np.sqrt(found.covariance[0, 0]) == pytest.approx(0.05 / 4.0, rel=0.2)


def test_a_sigma_point_without_a_steady_beat_is_drawn_in(belief):
    def partly(z):
        found = straight(z)
        found[z[:, 0] > 1.0] = np.nan
        return found

    found = regress(partly, belief.means, belief.covariances)
    assert found.slope[0] == pytest.approx(SLOPE)

    def second_alone(z):
        found = straight(z)
        found[z[:, 0] > 1.0, 1] = np.nan
        return found

    found = regress(second_alone, belief.means, belief.covariances)
    assert found.slope[0] == pytest.approx(SLOPE)


def test_without_a_steady_beat_at_the_mean_it_says_so(belief):
    with pytest.raises(NoSteadyBeatError, match="heart rate"):
        regress(lambda z: np.full((len(z), 2), np.nan), belief.means, belief.covariances)


def test_drift_widens_and_draws_back_to_the_prior():
    transport = Transport.linear(np.array([1.0, -1.0]), np.diag([0.25, 0.04]))
    narrow = GaussianMixture(np.ones(1), np.zeros((1, 2)), 0.01 * np.eye(2)[None])
    drifts = np.array([0.3])
    moved = narrow.forecast(drifts, transport)
    z_mean = transport.z_of(moved.means[0])[0]
    assert z_mean == pytest.approx(np.sqrt(1.0 - 0.09) * np.array([1.0, -1.0]))
    spread = transport.jacobian(np.zeros(2))
    of_z = spread @ moved.covariances[0] @ spread.T
    assert np.diag(of_z) == pytest.approx(0.91 * 0.01 * np.array([0.25, 0.04]) + 0.09)
    later = narrow
    for _ in range(200):
        later = later.forecast(drifts, transport)
    assert transport.z_of(later.means[0])[0] == pytest.approx(0.0, abs=1e-3)
    assert np.diag(spread @ later.covariances[0] @ spread.T) == pytest.approx(1.0, rel=1e-3)


def test_drift_depends_on_the_time_that_has_passed():
    """Its variance is proportional to time while that is short, and steps of any length add up."""
    transport = Transport.linear(np.zeros(2), np.eye(2))
    narrow = GaussianMixture(np.ones(1), np.array([[0.5, -0.5]]), 1e-6 * np.eye(2)[None])
    drifts = np.array([0.12])

    def after(*days):
        moved = narrow
        for each in days:
            moved = moved.forecast(drifts, transport, each)
        return moved.means[0, 0], moved.covariances[0, 0, 0]

    hour, three_hours = after(1 / 24)[1] - 1e-6, after(3 / 24)[1] - 1e-6
    assert hour == pytest.approx(0.12**2 / 24, rel=0.01)
    assert three_hours == pytest.approx(3.0 * hour, rel=0.01)
    assert after(1.0)[1] == pytest.approx((1.0 - 0.12**2) * 1e-6 + 0.12**2)
    assert after(0.25, 0.25, 0.5, 2.0) == pytest.approx(after(3.0), rel=1e-9)
    assert after(400.0) == pytest.approx((0.0, 1.0), abs=0.03)
    assert after(0.0) == pytest.approx((0.5, 1e-6))


def test_quantiles_of_a_mixture():
    both = GaussianMixture(np.array([0.3, 0.7]), np.array([[0.0], [4.0]]), np.array([[[1.0]], [[4.0]]]))
    (low,), (high,) = both.quantiles((0.05, 0.95))
    share = 0.3 * norm.cdf(low) + 0.7 * norm.cdf((low - 4.0) / 2.0)
    assert share == pytest.approx(0.05)
    assert 0.3 * norm.cdf(high) + 0.7 * norm.cdf((high - 4.0) / 2.0) == pytest.approx(0.95)
    draws = both.draws(20000, 0)
    assert draws.mean() == pytest.approx(2.8, abs=0.05)
