"""Plasma on noradrenaline against patients, and what arterioles alone would do."""

import pytest

from eclsim.validation.vasopressors import plasma_change, vasopressors_check


@pytest.mark.slow
def test_plasma_leaves_on_noradrenaline_as_in_patients_in_shock():
    """Without venules that follow, vasopressors hardly moved plasma, and with a reflex drew it in."""
    check = vasopressors_check()
    assert not check.required
    assert all("(test)" in row.name and row.source for row in check.rows)
    lower, higher, dialysed = check.rows
    assert lower.holds
    assert higher.holds
    assert dialysed.got < -5.0
    assert plasma_change(90.0, venular_tone=0.0) > 0.3 * higher.expected
