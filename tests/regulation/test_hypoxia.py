"""Hypoxic pulmonary vasoconstriction: the published curve, measured men, rest and lag."""

import numpy as np
import pytest

from eclsim.cases.reading import read_mapping
from eclsim.parameters.regulation import HYPOXIA
from eclsim.regulation.hypoxia import LAG_S, HypoxicVasoconstriction, relative_resistance

SETTINGS = {"gas.alveolar_ventilation_l_min": 5.0, "gas.fio2": 0.21, "gas.shunt_fraction": 0.0, HYPOXIA: 1.0,
            "Rpmc": 0.05}  # fmt: skip


def beat(po2, venous=40.0, vo2=250.0, vco2=200.0):
    """What is read of a lung with that alveolar PO2, from the balance solved the other way round."""
    gas = 1000.0 * 0.8262 * 5.0
    return {"PvO2": np.array([venous]), "VO2_lung": np.array([vo2]), "VCO2_lung": np.array([vco2])}, (
        (po2 / 713.0 * (gas - vo2 + vco2) + vo2) / gas
    )


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


def test_it_starts_at_rest_and_follows_with_its_lag():
    law = HypoxicVasoconstriction()
    usual, fio2 = beat(100.0)
    own = SETTINGS | {"gas.fio2": fio2}
    state = law.start(own, usual)
    assert law.in_effect(state, own)["Rpmc"] == pytest.approx(0.05, rel=1e-12)
    assert not np.any(law.rates(state, own, usual, {})[law.factor])
    assert law.shown(state, own)[0].values == pytest.approx(1.0)
    less, fio2 = beat(50.0, 32.0)
    rate = law.rates(state, own | {"gas.fio2": fio2}, less, {})[law.factor]
    assert rate * LAG_S == pytest.approx(np.log(1.77 / 1.23), abs=0.07)
    shunted = law.rates(state, own | {"gas.shunt_fraction": 0.5}, usual, {})[law.factor]
    assert shunted > 0.0
    stopped = own | {"gas.alveolar_ventilation_l_min": 0.0}
    assert np.isfinite(law.rates(state, stopped, usual, {})[law.factor]).all()


def test_a_case_takes_it_and_says_where_it_acts():
    patient = {"id": "P", "sex": "male", "age_years": 60, "heart_rate_bpm": 75}
    reading = read_mapping({"format": 1, "patient": patient, "regulation": {"hypoxic_vasoconstriction": 1}})
    assert not reading.warnings
    assert any("acts in courses" in str(note) for note in reading.notes)
