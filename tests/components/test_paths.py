import jax
import jax.numpy as jnp
import numpy as np
import pytest

from component_catalogue import FLOWS, GIVEN_FLOW, ONE_WAY, PATHS, ROTARY_PUMPS
from eclsim.components import Cannula, HeartValve, LeakingValve, Orifice, RollerPump, all_paths
from eclsim.devices import ecmo, lvad
from eclsim.devices.cannulae import CANNULAE

PUMPS = {**ecmo.PUMPS, **lvad.PUMPS}

with_a_drop = [name for name in PATHS if name not in GIVEN_FLOW]
LOADS = (0.0, 1e-3, 0.05, 2.0)


def constants_of(name, values=None):
    law, own = PATHS[name]
    return law, law.constants({**own, **(values or {})})


def some_flows(name, count=300):
    low, high = (0.0, FLOWS[1]) if name in ONE_WAY else FLOWS
    return np.random.default_rng(7).uniform(low, high, count)


def test_the_catalogue_holds_every_path():
    assert {type(law) for law, _ in PATHS.values()} == set(all_paths)


@pytest.mark.parametrize("name", with_a_drop)
@pytest.mark.parametrize("load", LOADS)
def test_flow_is_the_inverse_of_the_loaded_drop(name, load):
    law, own = constants_of(name)
    flows = some_flows(name)
    driving = load * flows + law.pressure_drop(flows, own)
    result = law.flow(driving, load, own)
    if name in ONE_WAY and load == 0.0:
        # Without a load the valve is rounded off over a thousandth of a mmHg.
        np.testing.assert_allclose(law.pressure_drop(result, own), driving, atol=1e-3)
    else:
        np.testing.assert_allclose(result, flows, rtol=1e-8, atol=1e-7)


@pytest.mark.parametrize("name", with_a_drop)
def test_the_drop_rises_with_the_flow(name):
    law, own = constants_of(name)
    flows = np.linspace(*FLOWS, 1000)
    rise = np.diff(law.pressure_drop(flows, own))
    assert (rise >= 0.0).all() if name in ONE_WAY else (rise > 0.0).all()


@pytest.mark.parametrize("name", ROTARY_PUMPS)
@pytest.mark.parametrize("share_of_speed", [0.3, 1.0, 1.5])
def test_the_head_of_a_rotary_pump_falls_with_the_flow(name, share_of_speed):
    law, values = PATHS[name]
    own = law.constants({**values, "w": values["w"] * share_of_speed})
    flows = jnp.linspace(-100.0, 300.0, 1000)
    slope = jax.vmap(jax.grad(lambda q: law.head(q, own)))(flows)
    assert float(slope.max()) < 0.0


@pytest.mark.parametrize("name", ROTARY_PUMPS)
def test_the_head_agrees_with_the_data_sheet_in_its_own_units(name):
    law, values = PATHS[name]
    own = law.constants(values)
    for litres in (-1.0, 0.0, 0.5, 3.0, 7.0):
        expected = PUMPS[name].head_mmhg(values["w"], litres)
        assert float(law.head(litres * 1000 / 60, own)) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("name", PATHS)
def test_derivatives_of_the_flow_match_finite_differences(name):
    law, own = constants_of(name)
    # Away from the kinks: zero flow, closed valve.
    for driving, load in ((7.3, 0.02), (45.0, 0.3), (-12.0, 0.1)):
        if name in ONE_WAY and driving < 0:
            continue
        exact = jax.grad(lambda dp, load=load: law.flow(dp, load, own))(driving)
        step = 1e-5
        forward, back = (float(law.flow(driving + s, load, own)) for s in (step, -step))
        assert float(exact) == pytest.approx((forward - back) / (2 * step), rel=1e-5, abs=1e-7)


PRESSURES = (-450.0, -200.0, -12.0, 30.0)
"""Pumps against little and against more than they can, other paths forwards and backwards [mmHg]."""


def quantities(law, values):
    """Flows at some pressures, and the inertance of a path that has one."""
    own = law.constants(values)
    result = [law.flow(pressure, 0.05, own) for pressure in PRESSURES]
    return jnp.stack([*result, law.inertance(own)] if law.inertial else result)


@pytest.mark.parametrize(
    ("name", "key"), [(name, key) for name, (law, _) in PATHS.items() for key in law.parameter_names()]
)
def test_derivatives_with_respect_to_parameters_match_finite_differences(name, key):
    """As elasticities: the relative change for a relative change of the parameter, which must act."""
    law, values = PATHS[name]
    here, step = np.asarray(quantities(law, values)), 1e-6
    exact = jax.jacfwd(lambda factor: quantities(law, {**values, key: values[key] * factor}))(1.0)
    high, low = (quantities(law, {**values, key: values[key] * (1.0 + s)}) for s in (step, -step))
    size = np.maximum(np.abs(here), 1e-9)
    elasticity, numeric = np.asarray(exact) / size, np.asarray(high - low) / (2 * step) / size
    assert np.abs(elasticity).max() > 1e-4, "the parameter does nothing at any of these points"
    np.testing.assert_allclose(elasticity, numeric, rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize("unit", ["mL/min", "ml/min", "L/min", "l/min", "mL/s", "L/h"])
def test_a_roller_pump_honours_its_unit(unit):
    per_ml_s = {"ml/min": 60.0, "l/min": 0.06, "ml/s": 1.0, "l/h": 3.6}[unit.lower()]
    law = RollerPump("rate", unit)
    assert float(law.flow(0.0, 0.0, law.constants({"rate": 7.0}))) == pytest.approx(7.0 / per_ml_s)


@pytest.mark.parametrize("unit", ["rpm", "mL", "furlongs", ""])
def test_a_roller_pump_refuses_what_is_no_unit_of_a_flow(unit):
    with pytest.raises(
        ValueError, match=f"unit '{unit}' is not a unit of flow; allowed: mL/s, L/min, mL/min"
    ):
        RollerPump("rate", unit)


@pytest.mark.parametrize("name", PATHS)
def test_a_batch_equals_a_loop(name):
    law, values = PATHS[name]
    rng = np.random.default_rng(3)
    many = {key: value * rng.uniform(0.8, 1.2, 20) for key, value in values.items()}
    driving, load = rng.uniform(-20, 80, 20), rng.uniform(0.001, 1.0, 20)
    together = np.asarray(law.flow(driving, load, law.constants(many)))
    for k in range(20):
        single = law.constants({key: value[k] for key, value in many.items()})
        assert float(law.flow(driving[k], load[k], single)) == pytest.approx(together[k], rel=1e-12)


@pytest.mark.parametrize("name", PATHS)
def test_compiling_changes_nothing(name):
    law, own = constants_of(name)
    driving = np.random.default_rng(5).uniform(-20.0, 80.0, 50)
    compiled = jax.jit(lambda dp: law.flow(dp, 0.02, own))(driving)
    np.testing.assert_allclose(compiled, law.flow(jnp.asarray(driving), 0.02, own), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("name", PATHS)
def test_a_path_reads_the_parameters_it_names_and_no_others(name):
    law, values = PATHS[name]
    assert set(law.parameter_names()) == set(values)


@pytest.mark.parametrize("load", LOADS)
def test_a_closed_valve_lets_nothing_back(load):
    law, own = constants_of("valve")
    flow = np.asarray(law.flow(np.array([-120.0, -10.0, -0.1]), load, own))
    assert (flow >= 0.0).all()
    assert flow.max() < 1.0 if load == 0.0 else flow.max() == 0.0


def test_an_open_valve_follows_its_square_root_law():
    law, own = constants_of("valve")
    assert float(law.flow(4.0, 0.0, own)) == pytest.approx(350.0 * 2.0, rel=1e-6)


@pytest.mark.parametrize("kind", CANNULAE)
def test_a_cannula_follows_its_data_sheet(kind):
    values = {"fr": float(CANNULAE[kind].sizes_fr[1])}
    law = Cannula("fr", CANNULAE[kind].coefficients)
    own = law.constants(values)
    for litres in (-2.0, 0.7, 4.0):
        drop = CANNULAE[kind].pressure_drop_mmhg(values["fr"], litres)
        assert float(law.flow(drop, 0.0, own)) == pytest.approx(litres * 1000 / 60, rel=1e-9)


@pytest.mark.parametrize("name", GIVEN_FLOW)
def test_a_roller_pump_ignores_pressure(name):
    law, own = constants_of(name)
    flow = np.asarray(law.flow(np.array([-300.0, 0.0, 400.0]), 1.0, own))
    np.testing.assert_allclose(flow, PATHS[name][1]["rate"] / 60.0 * (1000.0 if "ecmo" in name else 1.0))


def test_a_tube_follows_hagen_poiseuille_in_si_units():
    law, values = PATHS["tube"]
    resistance, inertance = law.constants(values)
    radius, length = 0.009625 / 2, 2.0
    pascal_s_per_m3 = 8 * 0.003 * length / (np.pi * radius**4)
    assert resistance == pytest.approx(pascal_s_per_m3 * 1e-6 / 133.322, rel=1e-5)
    kilogram_per_m4 = 1060.0 * length / (np.pi * radius**2)
    assert inertance == pytest.approx(kilogram_per_m4 * 1e-6 / 133.322, rel=1e-5)


def test_flags_say_what_a_path_is():
    assert ONE_WAY == ("valve", "stenosed valve", "leaking valve")
    assert [name for name, (law, _) in PATHS.items() if law.leaks] == ["leaking valve"]
    assert GIVEN_FLOW == ("crrt roller pump", "ecmo roller pump")
    assert {name for name, (law, _) in PATHS.items() if law.linear} == {"resistance", "artery", "tube"}


def test_an_orifice_of_a_square_centimetre_lets_50_ml_a_second_pass_for_a_root_of_a_mmhg():
    values = {"area": 1.0, "rhoB": 0.00106}
    coefficient = Orifice("area").value(values)
    assert coefficient == pytest.approx(50.155, abs=0.001)
    # Bernoulli: 4 m/s make 63.6 mmHg in blood of this density (the bedside's 4 v^2 says 64).
    assert (400.0 / coefficient) ** 2 == pytest.approx(63.6, abs=0.05)


@pytest.mark.parametrize("load", [1e-9, 0.05])
@pytest.mark.parametrize("area", [0.1, 0.4])
def test_a_leaking_valve_passes_an_orifice_of_its_area_backwards(area, load):
    values = {"CQ": 350.0, "area": area, "rhoB": 0.00106}
    law = LeakingValve("CQ", Orifice("area"))
    own = law.constants(values)
    flow = float(law.flow(-81.0, load, own))
    leak = 50.155 * area
    assert flow == pytest.approx(0.5 * (load * leak - (load**2 * leak**2 + 4 * 81.0) ** 0.5) * leak, rel=1e-5)
    whole = HeartValve("CQ")
    assert float(law.flow(12.0, load, own)) == pytest.approx(
        float(whole.flow(12.0, load, whole.constants(values))), rel=1e-12
    )


def test_a_leak_of_nothing_is_a_tight_valve_with_the_slope_of_its_first_leak():
    """A regurgitation of 0 was refused in variants of a case, while a case file with it has no leak."""
    law = LeakingValve("CQ", Orifice("area"))

    def backwards(area: float):
        return law.flow(-81.0, 0.05, law.constants({"CQ": 350.0, "area": area, "rhoB": 0.00106}))

    assert abs(float(backwards(0.0))) < 1e-15
    assert float(jax.grad(backwards)(0.0)) == pytest.approx(-9.0 * 50.155, rel=1e-5)
    assert law.is_leaking({})
    assert law.is_leaking({"area": 0.1, "rhoB": 0.00106})
    assert not law.is_leaking({"area": 0.0, "rhoB": 0.00106})
