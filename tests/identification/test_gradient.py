"""Exact derivatives along a path of a patient on ECMO."""

import numpy as np
import pytest

from eclsim.identification.beat_derivatives import BloodVolume, GradientEvaluator
from eclsim.identification.density import PosteriorDensity, Prior
from eclsim.identification.observation import measurement_errors
from eclsim.orbit.model import model_of
from eclsim.outputs.results import simulate
from eclsim.parameters.thiel2025 import BOUNDS
from eclsim.validation.simulated_patients import simulated_patient

NAMES = ("Csart", "Emaxlv", "Rmc")
OUTPUTS = ("SP", "DP", "MPAP", "CO", "PF")


def posterior_of(names, policy="as_published"):
    point = simulated_patient(1)
    table = np.log([BOUNDS.get(n, (80.0, 8.0, 800.0)) for n in names])
    prior = Prior(names, table[:, 1], table[:, 2], table[:, 0])
    measured = {n: getattr(point.case.measurements, n) for n in OUTPUTS}
    model = model_of(point.case).with_values(dict(point.truth))
    return PosteriorDensity(model, measured, measurement_errors(measured), prior, policy)


@pytest.fixture(scope="module")
def posterior():
    return posterior_of(NAMES)


@pytest.fixture(scope="module")
def centre(posterior):
    return posterior.prior.z_of(np.log([posterior.model.values[n] for n in NAMES]))


def test_outputs_are_those_of_a_simulation(posterior, centre):
    follower = GradientEvaluator(posterior, centre)
    follower.potential(centre)
    z = centre + np.array([0.1, -0.05, 0.08])
    outputs, _ = follower.linear(z)
    model = posterior.model.with_values(dict(zip(NAMES, np.exp(posterior.prior.x_of(z)), strict=True)))
    whole = simulate(model)
    for name, value, error in zip(OUTPUTS, outputs, posterior.scale, strict=True):
        assert value == pytest.approx(float(whole[name]), abs=2e-3 * error)


def test_gradient_is_the_derivative_of_the_potential(posterior, centre):
    follower = GradientEvaluator(posterior, centre)
    z = centre + np.array([0.15, 0.1, -0.1])
    _, gradient = follower.potential(z)
    for k in range(len(NAMES)):
        shift = 3e-4 * np.eye(len(NAMES))[k]
        difference = (follower.potential(z + shift)[0] - follower.potential(z - shift)[0]) / 6e-4
        assert gradient[k] == pytest.approx(difference, rel=5e-3, abs=5e-3)


def test_by_point_the_path_changes_no_bit(posterior, centre):
    z = centre + np.array([0.1, 0.1, 0.1])
    direct, round_about = (GradientEvaluator(posterior, centre, by_point=True) for _ in range(2))
    for step in (0.3, -0.3, 2.5, 0.2):
        round_about.potential(centre + step)
    value, gradient = direct.potential(z)
    other_value, other_gradient = round_about.potential(z)
    assert other_value == value
    assert other_gradient.tolist() == gradient.tolist()


def test_along_a_path_the_potential_is_nearly_the_same(posterior, centre):
    z = centre + np.array([0.1, 0.1, 0.1])
    direct, followed = (
        GradientEvaluator(posterior, centre, by_point=True),
        GradientEvaluator(posterior, centre),
    )
    for step in (0.3, -0.3, 0.2):
        followed.potential(centre + step)
    assert direct.potential(z)[0] == pytest.approx(followed.potential(z)[0], abs=2e-3)


def test_many_members_side_by_side_agree(posterior, centre):
    z = centre + 0.2 * np.random.default_rng(0).standard_normal((16, len(NAMES)))
    follower = GradientEvaluator(posterior, centre)
    one_by_one = np.stack([follower.linear(each)[0] for each in z])
    assert posterior.simulate(z, centre) == pytest.approx(one_by_one, rel=2e-4)


def test_blood_volume_is_straight_in_a_compliance_but_not_in_a_product():
    straight = BloodVolume(posterior_of(NAMES), np.zeros(3))
    assert straight.straight
    assert straight.slopes[0] > 0.0
    assert straight.slopes[1:] == pytest.approx(0.0, abs=1e-6)
    product = BloodVolume(posterior_of(("Csart", "P0sart")), np.log([1.0, 80.0]))
    assert not product.straight
    volume, slopes = product.at(np.array([2.0, 70.0]))
    assert slopes == pytest.approx([70.0, 2.0], rel=1e-4)
    assert volume.target[0] == pytest.approx(product.target - 80.0 + 140.0)
