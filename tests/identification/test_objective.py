"""The objective on the simulated patient: residuals, exact derivatives, agreement with SciPy."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from eclsim.devices.ecmo import ecmo
from eclsim.identification.least_squares import EXACT, polish, refine
from eclsim.identification.objective import Box, Objective, Target
from eclsim.identification.profiles import slices
from eclsim.orbit.model import Model, model_of, nominal_values
from eclsim.patient.circulation import circulation

HERE = np.zeros(1, dtype=int)
TRUE_X = np.log([[0.85, 1.3]])


def test_residuals_vanish_at_the_truth_and_are_relative_elsewhere(objective: Objective):
    at_truth = objective.evaluate(HERE, TRUE_X)
    np.testing.assert_allclose(at_truth.residuals, 0.0, atol=1e-6)
    away = objective.evaluate(HERE, TRUE_X + 0.2)
    expected = away.outputs[0] / objective.measured[0] - 1.0
    np.testing.assert_allclose(away.residuals[0], expected)
    assert away.costs[0] == pytest.approx(np.sum(expected**2))


def test_an_unmeasured_output_has_no_residual(objective: Objective):
    model = objective.targets[0].model
    partial = Objective([Target(model, {"MAP": 80.0}, {"MAP": 4.0})], objective.names)
    result = partial.evaluate(HERE, TRUE_X)
    column = partial.outputs.index("MAP")
    assert result.residuals[0, column] == pytest.approx((result.outputs[0, column] - 80.0) / 4.0)
    assert np.count_nonzero(result.residuals) == 1


def test_derivatives_are_those_of_central_differences(objective: Objective):
    x = TRUE_X + np.array([[0.15, -0.1]])
    exact = objective.linearise(objective.evaluate(HERE, x), [0], x)[0][0]
    for k in range(2):
        step = 1e-4 * (np.arange(2) == k)
        ends = objective.evaluate(np.zeros(2, dtype=int), np.concatenate([x + step, x - step])).outputs
        difference = (ends[0] - ends[1]) / 2e-4
        np.testing.assert_allclose(exact[:, k], difference, atol=2e-3 * np.abs(exact).max(axis=1).max())


@pytest.mark.slow
def test_the_optimum_is_scipys_from_the_same_start(objective: Objective, box: Box):
    """With noise, so that the cost at the optimum is not zero."""
    target = objective.targets[0]
    noisy = {n: v * (1.0 + 0.04 * (-1) ** k) for k, (n, v) in enumerate(target.measured.items())}
    noisy_objective = Objective([Target(target.model, noisy, noisy)], box.names)
    start = box.start[None]

    def residuals(x: np.ndarray) -> np.ndarray:
        return noisy_objective.evaluate(HERE, x[None]).residuals[0]

    def jacobian(x: np.ndarray) -> np.ndarray:
        result = noisy_objective.evaluate(HERE, x[None])
        return noisy_objective.linearise(result, [0], x[None])[0][0] * noisy_objective.weights[0][:, None]

    scipys = least_squares(
        residuals, start[0], jacobian, bounds=(box.lower, box.upper), xtol=1e-12, ftol=1e-12, gtol=1e-12
    )
    ours = polish(noisy_objective, 0, refine(noisy_objective, HERE, start, box, EXACT), box, EXACT)
    assert ours.costs[0] <= 2.0 * scipys.cost * (1.0 + 1e-6)
    np.testing.assert_allclose(ours.x[0], scipys.x, atol=2e-3)


def test_slices_are_lowest_at_the_truth(objective: Objective, box: Box):
    """In a narrow valley the curves were lowest beside and above the point that they go through."""
    result = slices(objective, box, TRUE_X[0], steps=9)
    assert result.costs.shape == (2, 10)
    assert result.cost < 1e-10
    lowest = np.nanargmin(result.costs, axis=1)
    np.testing.assert_allclose(np.log(result.values)[[0, 1], lowest], TRUE_X[0])
    np.testing.assert_allclose(result.costs.min(axis=1), result.cost, rtol=0.0, atol=1e-10)


def test_slices_have_the_further_values(objective: Objective, box: Box):
    further = np.add(TRUE_X.T, [[-0.01, 0.01]])
    result = slices(objective, box, TRUE_X[0], steps=3, further=further)
    assert result.values.shape == (2, 6)
    assert np.all(np.diff(result.values, axis=1) > 0.0)
    assert np.all(np.isin(np.exp(further).round(9), result.values.round(9)))


def test_points_of_an_objective_share_a_circuit(twin):
    model = model_of(twin)
    with_ecmo = circulation() + ecmo("ra", "ao")
    values = nominal_values(with_ecmo)
    assert values is not None
    targets = [Target(m, {}, {}) for m in (model, Model(with_ecmo, values))]
    with pytest.raises(ValueError, match="2 different circuits"):
        Objective(targets, ("Rmc",))


def test_an_output_that_the_circuit_lacks_is_named(twin):
    with pytest.raises(ValueError, match="PF"):
        Objective([Target(model_of(twin), {"PF": 3.0}, {"PF": 3.0})], ("Rmc",))
