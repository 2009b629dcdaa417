import jax
import jax.numpy as jnp
import numpy as np
import pytest

from component_catalogue import STORAGES
from eclsim.components import AtrialBump, Balloon, VentricularSystole, all_storages

ACTIVATIONS = (0.0, 0.35, 1.0)
VOLUMES = (-5.0, 0.0, 12.0, 80.0, 180.0)


def test_the_catalogue_holds_every_storage():
    assert {type(law) for law, _ in STORAGES.values()} == set(all_storages)


@pytest.mark.parametrize("name", STORAGES)
@pytest.mark.parametrize("activation", ACTIVATIONS)
@pytest.mark.parametrize("volume", VOLUMES)
def test_stiffness_is_the_derivative_of_pressure(name, activation, volume):
    law, values = STORAGES[name]
    own = law.constants(values)
    _, stiffness = law.pressure(volume, activation, own)
    exact = jax.grad(lambda v: law.pressure(v, activation, own)[0])(volume)
    assert float(stiffness) == pytest.approx(float(exact), rel=1e-12)
    step = 1e-5
    high, low = (float(law.pressure(volume + s, activation, own)[0]) for s in (step, -step))
    assert float(stiffness) == pytest.approx((high - low) / (2 * step), rel=1e-5)
    assert float(stiffness) > 0.0


@pytest.mark.parametrize("name", STORAGES)
def test_derivatives_with_respect_to_parameters_match_finite_differences(name):
    law, values = STORAGES[name]

    def pressure(key, value):
        return law.pressure(50.0, 0.4, law.constants({**values, key: value}))[0]

    for key in law.parameter_names():
        step = 1e-6 * values[key]
        numeric = float(pressure(key, values[key] + step) - pressure(key, values[key] - step)) / (2 * step)
        assert float(jax.grad(pressure, argnums=1)(key, values[key])) == pytest.approx(numeric, rel=1e-5)


@pytest.mark.parametrize("name", STORAGES)
def test_a_batch_equals_a_loop_compiled_or_not(name):
    law, values = STORAGES[name]
    rng = np.random.default_rng(11)
    many = {key: value * rng.uniform(0.7, 1.3, 20) for key, value in values.items()}
    volumes = rng.uniform(1.0, 150.0, 20)
    batch = jax.jit(lambda v, p: law.pressure(v, 0.3, law.constants(p)))(volumes, many)
    for k in range(20):
        single = law.pressure(volumes[k], 0.3, law.constants({key: value[k] for key, value in many.items()}))
        np.testing.assert_allclose([float(x[k]) for x in batch], [float(x) for x in single], rtol=1e-12)


@pytest.mark.parametrize("name", STORAGES)
def test_constant_stiffness_is_said_where_it_is_so(name):
    law, values = STORAGES[name]
    own = law.constants(values)
    result = {float(law.pressure(v, a, own)[1]) for v in VOLUMES for a in ACTIVATIONS}
    assert law.constant_stiffness == (len(result) == 1)
    passive = law.activation is None or isinstance(law, Balloon)
    assert law.constant_stiffness == (passive and not law.narrows)


@pytest.mark.parametrize("name", STORAGES)
def test_a_storage_reads_the_parameters_it_names_and_no_others(name):
    law, values = STORAGES[name]
    assert set(law.parameter_names()) == set(values)


def test_the_ventricle_at_rest_and_at_peak():
    law, values = STORAGES["ventricle"]
    own = law.constants(values)
    assert float(law.pressure(100.0, 0.0, own)[0]) == pytest.approx(0.064 * np.exp(3.3) + 2.5)
    assert float(law.pressure(100.0, 1.0, own)[0]) == pytest.approx(180.0)


def test_a_wild_ventricle_stays_finite():
    law, values = STORAGES["ventricle"]
    pressure, stiffness = law.pressure(1e5, 0.0, law.constants(values))
    assert np.isfinite([float(pressure), float(stiffness)]).all()


@pytest.mark.parametrize("curve", [AtrialBump(), AtrialBump(0.92, 0.09), VentricularSystole()])
class TestActivation:
    def test_runs_from_0_to_1_and_back(self, curve):
        phases = np.linspace(0.0, 1.0, 10001)
        result = curve.at(phases, np)
        assert result.min() == 0.0
        assert result.max() == pytest.approx(1.0, abs=1e-6)

    def test_is_periodic_and_has_no_jump(self, curve):
        result = curve.at(np.linspace(0.0, 1.0, 100001), np)
        assert result[0] == pytest.approx(result[-1], abs=1e-9)
        assert np.abs(np.diff(result)).max() < 2e-3

    def test_is_smooth_away_from_its_break_points(self, curve):
        phases = np.linspace(0.0, 1.0, 20001)
        bend = np.abs(np.diff(curve.at(phases, np), 3))
        kinks = phases[1:-2][bend > 100 * np.median(bend[bend > 0])]
        near = np.array([0.0, 1.0, *curve.break_points])
        assert all(np.abs(near - kink).min() < 3e-4 for kink in kinks)

    def test_is_the_same_in_numpy_and_jax(self, curve):
        phases = np.linspace(0.0, 1.0, 501)
        np.testing.assert_allclose(curve.at(phases, np), curve.at(jnp.asarray(phases), jnp), atol=1e-12)
