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


CHAMBER = CollapsibleChamber(Atrium("Ed", "Emax"), "Ve")


@pytest.mark.parametrize(
    ("law", "values"),
    [
        (LU, {}),
        (CollapsibleVein(4.0, 70.0, -3.0, 0.02, 5.0), {}),
        (CHAMBER, {"Ed": 0.1575, "Emax": 0.225, "Ve": 2.0}),
    ],
)
def test_stiffness_is_the_slope_of_the_pressure(law, values):
    volume, own = np.linspace(0.5, 300.0, 400), law.constants(values)
    pressure, stiffness = law.pressure(volume + 1e-30j, 0.3, own)
    np.testing.assert_allclose(np.asarray(stiffness).real, np.asarray(pressure).imag / 1e-30, rtol=1e-10)


def test_a_vein_of_half_the_rest_volume_is_the_same_at_half_the_volume():
    volume = np.array([-3.0, 0.01, 0.2, 5.0, 60.0, 129.0, 131.0, 250.0])
    half = CollapsibleVein(0.5 / 0.15, 65.0, -5.0, LU.resistance, 4.0)
    np.testing.assert_allclose(
        half.pressure(0.5 * volume, 0.0, half.constants({}))[0], LU.pressure(volume, 0.0, OWN)[0], rtol=1e-12
    )
    np.testing.assert_allclose(
        half.outlet(0.5 * volume, half.constants({})), LU.outlet(volume, OWN), rtol=1e-12
    )


def test_a_chamber_that_empties_reads_the_parameters_of_its_law_and_its_own():
    assert set(CHAMBER.parameter_names()) == {"Ed", "Emax", "Ve"}


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
