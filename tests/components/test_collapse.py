"""The vein of Lu et al. 2001 and the pericardium of Smith et al. 2004, from their printed equations."""

import numpy as np
import pytest

from eclsim.components import Atrium, CollapsibleChamber, CollapsibleVein, Pericardium

LU = CollapsibleVein(1.0 / 0.15, 130.0, -5.0, 0.001 * (350.0 / (130.0 + (4.0 - 0.3855) / 0.15)) ** 2, 4.0)
OWN = LU.constants({})


def printed(volume):
    """Pressure by the equations as printed, with their kink at 130 mL."""
    emptying = 2.0 / np.expm1(volume / 8.0)
    filled = 0.3855 + 0.15 * (volume - 130.0)
    return np.where(volume >= 130.0, filled, -5.0 + 0.4 * np.exp(volume / 50.0)) - emptying


def test_the_vein_is_the_printed_one_but_for_the_rounded_kink():
    volume = np.linspace(0.2, 400.0, 2000)
    apart = np.abs(np.asarray(LU.pressure(volume, 0.0, OWN)[0]) - printed(volume))
    assert apart.max() < 0.08
    assert apart[np.abs(volume - 130.0) > 60.0].max() < 5e-3


def test_its_resistance_is_the_printed_one():
    volume = np.array([5.0, 50.0, 130.0, 300.0])
    np.testing.assert_allclose(LU.outlet(volume, OWN), 0.001 * (350.0 / volume) ** 2, rtol=1e-12)


def test_an_empty_vein_resists_without_bound_and_stays_finite():
    volume = np.array([-50.0, -1.0, 0.0, 0.05, 1.0])
    pressure, stiffness = LU.pressure(volume, 0.0, OWN)
    assert np.all(np.diff(pressure) > 0.0)
    assert np.all(np.asarray(stiffness) > 0.0)
    assert pressure[2] < -300.0
    assert np.isfinite(LU.outlet(volume, OWN)).all()


def test_a_drained_atrium_keeps_blood_and_a_full_one_is_the_published_one():
    law = CollapsibleChamber(Atrium(0.1575, 0.225), 2.0)
    own = law.constants({})
    assert float(law.pressure(0.1, 0.0, own)[0]) < -30.0
    assert float(law.pressure(25.0, 0.0, own)[0]) == pytest.approx(0.1575 * 25.0, abs=1e-4)


def test_the_pericardium_is_the_printed_one_and_goes_on_where_the_exponential_ends():
    law = Pericardium(0.5003, 200.0, 1.0 / 0.03)
    own = law.constants({})
    volume = np.array([0.0, 200.0, 260.0, 400.0])
    np.testing.assert_allclose(
        law.pressure(volume, own)[0], 0.5003 * np.expm1(0.03 * (volume - 200.0)), atol=1e-12
    )
    pressure, stiffness = law.pressure(np.array([1190.0, 1199.99, 1200.01, 5e4]), own)
    assert np.all(np.diff(pressure) > 0.0)
    assert np.isfinite(pressure).all()
    assert np.all(np.asarray(stiffness) > 0.0)
