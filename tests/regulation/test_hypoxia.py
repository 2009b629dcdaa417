"""Hypoxic pulmonary vasoconstriction: the published curve, measured men, rest and lag."""

import jax.numpy as jnp
import numpy as np
import pytest

from eclsim.regulation.oxygen import (
    LAG_S,
    WANTED_RESISTANCE,
    HypoxicVasoconstriction,
    alveolar_po2,
    lung_law,
    relative_resistance,
)

GAS = 1000.0 * 0.8262 * 5.0


def test_the_curve_is_the_published_one():
    """Largest at 10 mmHg, 3.15 times that without hypoxia; half of it at 39.4 mmHg."""
    assert relative_resistance(10.0, 10.0) == pytest.approx(3.15, abs=0.06)
    assert relative_resistance(700.0, 700.0) == pytest.approx(1.0, abs=1e-2)
    half = (1.0 / 6.683e-5) ** (1.0 / 2.616)
    assert relative_resistance(half, half) == pytest.approx(1.0 + 2.15 / 2.0)


def test_healthy_men_answer_so_within_half_an_hour():
    """Dorrington 1997: 1.23 +- 0.26 to 1.77 +- 0.21 mmHg min/L, end-tidal PO2 50 instead of 100 mmHg."""
    rise = relative_resistance(32.0, 50.0) / relative_resistance(40.0, 100.0)
    assert rise == pytest.approx(1.77 / 1.23, abs=0.1)


def wanted(po2, venous, shunt=0.0, ventilation=5.0):
    """Of a lung with that alveolar PO2, from the balance solved the other way round."""
    fio2 = (po2 / 713.0 * (GAS - 250.0 + 200.0) + 250.0) / GAS
    rest = relative_resistance(40.0, 100.0)
    numbers = [venous, 250.0, -200.0, ventilation, fio2, shunt, 37.0, 1.0, float(rest)]
    return float(lung_law(jnp.array(numbers))[0])


def test_rest_shunt_and_apnoea():
    assert float(alveolar_po2(40.0, 250.0, -200.0, (0.0, 0.21, 0.0, 37.0))) == 40.0
    assert wanted(100.0, 40.0) == pytest.approx(1.0, abs=1e-4)
    assert wanted(50.0, 32.0) == pytest.approx(1.77 / 1.23, abs=0.1)
    assert wanted(100.0, 40.0, shunt=0.5) > 1.05
    assert np.isfinite(wanted(100.0, 40.0, ventilation=0.0))


def test_in_courses_it_begins_in_effect_and_follows_with_its_lag():
    law = HypoxicVasoconstriction()
    state = law.start({}, {WANTED_RESISTANCE: np.array([1.0])})
    assert law.in_effect(state, {})["regulation.hypoxic_resistance"] == pytest.approx(1.0, rel=1e-12)
    rate = law.rates(state, {}, {WANTED_RESISTANCE: np.array([1.4])}, {})[law.factor]
    assert rate * LAG_S == pytest.approx(np.log(1.4))
    unknown = law.rates(state, {}, {WANTED_RESISTANCE: np.zeros(1)}, {})[law.factor]
    assert not unknown.any()
