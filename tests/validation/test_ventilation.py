"""The rows of apnoea."""

from functools import cache

import pytest

from eclsim.validation import ventilation
from eclsim.validation.ventilation import AIR, OXYGEN, time_to


@pytest.fixture(scope="module")
def breathless():
    """Beats of the patient, followed once."""
    return cache(ventilation.apnoea)


@pytest.mark.slow
def test_oxygen_lasts_and_carbon_dioxide_rises_as_was_measured(breathless, monkeypatch):
    monkeypatch.setattr(ventilation, "apnoea", breathless)
    check = ventilation.apnoea_check()
    assert not check.required
    assert [row.name for row in check.rows if not row.holds] == []


@pytest.mark.slow
@pytest.mark.parametrize(("fio2", "lasts"), [(AIR, 1.2), (OXYGEN, 3.0)])
def test_less_gas_in_the_lungs_lasts_less_long(breathless, fio2, lasts):
    assert time_to(breathless(fio2), 90.0) > lasts * time_to(breathless(fio2, lung_volume_ml=500.0), 90.0)
