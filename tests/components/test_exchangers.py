"""The law of the lung over a step in time, against closed forms."""

import math

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_bvp

from eclsim.blood.standard import severinghaus, severinghaus_pressure
from eclsim.components.exchangers import (
    AIR_CARBON_DIOXIDE,
    AIR_OXYGEN,
    MembraneLung,
    NativeLung,
    Points,
    dry_gas_pressure,
    stpd_of_btps,
)

DRY, STPD = float(dry_gas_pressure(37.0)), 1000.0 * float(stpd_of_btps(37.0))
HELD = 2.0 / 0.05
BEFORE = (100.0, 40.0)
LUNG = NativeLung().over_a_step("held", ("oxygen", "carbon_dioxide"))


def rates(pressure, gained, ventilation, fio2=0.5, law=LUNG):
    """Gas that blood gets at partial pressures [mL/min STPD], of 2 L of gas over a step of 0.05 min."""
    values = {
        "held": HELD, "oxygen": BEFORE[0], "carbon_dioxide": BEFORE[1], "gas.fio2": fio2,
        "gas.alveolar_ventilation_l_min": ventilation, "gas.shunt_fraction": 0.0, "gas.temperature_c": 37.0,
    }  # fmt: skip
    columns = [jnp.array(pair)[:, None] for pair in (gained, pressure)]
    inside = Points(*columns, jnp.zeros(1), jnp.full(1, 7.4))
    return np.asarray(law.rates(jnp.array(5.0), inside, values))[:, 0]


@pytest.mark.parametrize("ventilation", [0.5, 4.0, 40.0])
def test_lungs_without_blood_are_washed_out_as_the_closed_form_says(ventilation):
    inspired, share = DRY * np.array([0.5, AIR_CARBON_DIOXIDE]), ventilation / HELD
    after = (np.array(BEFORE) + share * inspired) / (1.0 + share)
    np.testing.assert_allclose(rates(after, (0.0, 0.0), ventilation), 0.0, atol=1e-9)


def test_without_ventilation_air_follows_what_blood_takes_up():
    """Blood takes up 250 and gives off 30 mL/min: 220 of air come in, of which oxygen is a fifth."""
    gained = np.array([250.0, -30.0])
    drawn = 220.0 * np.array([AIR_OXYGEN, AIR_CARBON_DIOXIDE])
    after = np.array(BEFORE) + DRY * (drawn - gained) / (STPD * HELD)
    np.testing.assert_allclose(rates(after, gained, 0.0, fio2=1.0), gained, rtol=1e-12)


def test_without_ventilation_gas_that_blood_gives_off_leaves_as_it_is_in_the_alveoli():
    gained, after = np.array([10.0, -60.0]), np.array([90.0, 45.0])
    kept = STPD * HELD * (after - BEFORE) / DRY
    np.testing.assert_allclose(rates(after, gained, 0.0), -50.0 * after / DRY - kept, rtol=1e-12)


def test_where_nothing_changes_any_more_the_law_is_the_steady_one():
    gained = np.array([220.0, -180.0])
    over_time = rates(BEFORE, gained, 3.0)
    np.testing.assert_allclose(over_time, rates(BEFORE, gained, 3.0, law=NativeLung()), rtol=1e-12)


@pytest.mark.parametrize(("temperature", "vapour"), [(25.0, 23.8), (30.0, 31.8), (37.0, 47.0), (42.0, 61.5)])
def test_dry_gas_is_what_water_vapour_leaves(temperature, vapour):
    """Saturation pressures of water from tables; at 37 C the 47 mmHg of the clinic."""
    assert float(dry_gas_pressure(temperature)) == pytest.approx(760.0 - vapour, abs=0.15)
    assert float(dry_gas_pressure(37.0)) == 713.0


def test_a_stopped_sweep_gives_nothing_and_the_first_of_it_is_taken_up():
    """Per mL of gas blood takes up its oxygen, less what it gives back: a slope of order 1, not of 1000."""
    law = MembraneLung("o2", "exponent", "co2", "clot", "sweep", "fdo2")
    values = {"o2": 10.0, "exponent": 0.3, "co2": 5.0, "clot": 0.0, "fdo2": 1.0, "gas.temperature_c": 37.0,
              "gas.oxygen_capacity_ml_g": 1.34, "gas.haemoglobin_g_dl": 10.0}  # fmt: skip
    still = Points(jnp.zeros((2, 8)), jnp.full((2, 8), 40.0), jnp.full(8, 40.0), jnp.full(8, 7.4))

    def rates(sweep, gained=0.0):
        points = still._replace(gained=still.gained + jnp.array([[gained], [0.0]]))
        return law.rates(jnp.array(4.0), points, {**values, "sweep": sweep})

    np.testing.assert_array_equal(rates(0.0), 0.0)
    by_sweep = (rates(1e-6)[0] / 1e-3)[0]
    by_gained = (rates(0.0, 1e-3)[0] / 1e-3)[0]
    assert 0.5 < float(-by_sweep / by_gained) < 1.0


def boundary_layer(blood: float, gas: float, haemoglobin: float) -> float:
    """Oxygen that crosses a fibre's boundary layer, over that without haemoglobin.

    Leveque's layer with a linear velocity and chemical equilibrium: with y the distance over its thickness,
    P'' + 3 y^2 (1 + 1.34 Hb S'(P) / 0.0031) P' = 0 from the PO2 of the gas to that of the blood.
    """

    def slopes(y: np.ndarray, state: np.ndarray) -> np.ndarray:
        po2, change = state
        cubic = po2**3 + 150.0 * po2
        binding = 1.34 * haemoglobin / 0.0031 * 23400.0 * (3.0 * po2**2 + 150.0) / (cubic + 23400.0) ** 2
        return np.stack([change, -3.0 * y**2 * (1.0 + binding) * change])

    y = np.linspace(0.0, 3.0**0.5, 600) ** 2
    guess = np.stack([blood + (gas - blood) * np.exp(-2.0 * y), -2.0 * (gas - blood) * np.exp(-2.0 * y)])
    solution = solve_bvp(
        slopes, lambda wall, far: np.array([wall[0] - gas, far[0] - blood]), y, guess, tol=1e-5,
        max_nodes=100_000,
    )  # fmt: skip
    assert solution.success
    return -solution.y[1, 0] / (gas - blood) * math.gamma(4.0 / 3.0)


@pytest.mark.parametrize(("gas", "tolerance"), [(690.0, 0.003), (330.0, 0.03), (130.0, 0.13)])
@pytest.mark.parametrize("saturation", [0.4, 0.7, 0.9, 0.95])
def test_haemoglobin_speeds_the_transfer_of_oxygen_as_in_the_boundary_layer_of_a_fibre(
    saturation, gas, tolerance
):
    law = MembraneLung("o2", "exponent", "co2", "clot", "sweep", "fdo2")
    values = {"o2": 1.0, "exponent": 1.0, "co2": 1.0, "clot": 0.0, "fdo2": gas / DRY,
              "gas.temperature_c": 37.0,
              "gas.oxygen_capacity_ml_g": 1.34, "gas.haemoglobin_g_dl": 12.0}  # fmt: skip
    po2 = float(severinghaus_pressure(saturation))
    assert float(severinghaus(po2)) == pytest.approx(saturation)
    inside = Points(jnp.zeros((2, 1)), jnp.array([[po2], [40.0]]), jnp.array([po2]), jnp.array([7.4]))
    permeance = law.transfer(jnp.array(1.0), inside, values)[0, 0]
    assert float(permeance) == pytest.approx(boundary_layer(po2, gas, 12.0), rel=tolerance)
