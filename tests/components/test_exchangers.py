"""The law of the lung over a step in time, against closed forms."""

import jax.numpy as jnp
import numpy as np
import pytest

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
    still = Points(jnp.zeros((2, 8)), jnp.full((2, 8), 40.0), jnp.full(8, 0.01), jnp.full(8, 7.4))

    def rates(sweep, gained=0.0):
        points = still._replace(gained=still.gained + jnp.array([[gained], [0.0]]))
        return law.rates(jnp.array(4.0), points, {**values, "sweep": sweep})

    np.testing.assert_array_equal(rates(0.0), 0.0)
    by_sweep = (rates(1e-6)[0] / 1e-3)[0]
    by_gained = (rates(0.0, 1e-3)[0] / 1e-3)[0]
    assert 0.5 < float(-by_sweep / by_gained) < 1.0
