"""Exact derivatives along a path of a patient on ECMO."""

from dataclasses import replace

import numpy as np
import pytest
from simulated_patients import simulated_patient

from eclsim.identification.density import (
    GradientEvaluator,
    NoSteadyBeatError,
    PosteriorDensity,
    Prior,
    gaussian_approximation,
)
from eclsim.orbit.model import model_of
from eclsim.outputs.results import simulate
from eclsim.outputs.uncertainty import measurement_errors
from eclsim.parameters.thiel2025 import BOUNDS

NAMES = ("Csart", "Emaxlv", "Rmc")
OUTPUTS = ("SP", "DP", "MPAP", "CO", "PF")


def posterior_of(names, policy="as_published"):
    point = simulated_patient(1)
    table = np.log([BOUNDS.get(n, (80.0, 8.0, 800.0)) for n in names])
    prior = Prior(names, *table.T)
    measured = {n: getattr(point.case.measurements, n) for n in OUTPUTS}
    model = model_of(point.case).with_values(dict(point.truth))
    return PosteriorDensity(model, measured, measurement_errors(measured), prior, policy)


@pytest.fixture(scope="module")
def posterior():
    return posterior_of(NAMES)


@pytest.fixture(scope="module")
def centre(posterior):
    return posterior.prior.z_of(np.log([posterior.model.values[n] for n in NAMES]))


@pytest.mark.slow
def test_outputs_are_those_of_a_simulation(posterior, centre):
    follower = GradientEvaluator(posterior, centre)
    follower.potential(centre)
    z = centre + np.array([0.1, -0.05, 0.08])
    outputs, _ = follower.linear(z)
    model = posterior.model.with_values(dict(zip(NAMES, np.exp(posterior.prior.x_of(z)), strict=True)))
    whole = simulate(model)
    for name, value, error in zip(OUTPUTS, outputs, posterior.scale, strict=True):
        assert value == pytest.approx(float(whole[name]), abs=2e-3 * error)


@pytest.mark.slow
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


@pytest.mark.slow
def test_many_members_side_by_side_agree(posterior, centre):
    z = centre + 0.2 * np.random.default_rng(0).standard_normal((16, len(NAMES)))
    follower = GradientEvaluator(posterior, centre)
    one_by_one = np.stack([follower.linear(each)[0] for each in z])
    assert posterior.simulate(z, centre) == pytest.approx(one_by_one, rel=2e-4)


def test_the_blood_volume_of_a_product_is_followed_exactly():
    """Stressed volume P0 Csart is no linear function of the two; outputs and gradient follow it."""
    posterior = posterior_of(("Csart", "P0sart"))
    centre = posterior.prior.z_of(np.log([1.0, 80.0]))
    evaluator = GradientEvaluator(posterior, centre)
    z = centre + np.array([0.3, -0.2])
    outputs, slopes = evaluator.linear(z)
    assert outputs == pytest.approx(posterior.simulate(z[None])[0], rel=1e-4)
    for k in range(2):
        shift = 1e-3 * np.eye(2)[k]
        ends = [evaluator.linear(z + s)[0] for s in (shift, -shift)]
        assert slopes[:, k] == pytest.approx((ends[0] - ends[1]) / 2e-3, rel=2e-2, abs=2e-2)


@pytest.mark.slow
def test_a_highest_point_behind_shut_valves_is_refused():
    """No derivatives there: the patient's beat is one of many."""
    posterior = posterior_of(NAMES)
    shut = replace(posterior, model=posterior.model.with_values({"Emaxrv": 0.02, "Rmc": 0.3}))
    fixed = replace(shut, prior=Prior(("Csart",), np.log([1.5]), np.log([1.0]), np.log([2.0])))
    fixed = replace(fixed, model=fixed.model.with_values({"Emaxlv": 0.1, "ecmo.speed_rpm": 4500.0}))
    assert GradientEvaluator(fixed, np.zeros(1)).linear(np.zeros(1)) is None
    with pytest.raises(NoSteadyBeatError):
        gaussian_approximation(fixed, np.log([[1.5]]))
