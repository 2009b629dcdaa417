"""Plasma on noradrenaline against patients, and what arterioles alone would do."""

import pytest

from eclsim.validation.vasopressors import vasopressors_check


@pytest.mark.slow
def test_plasma_leaves_on_noradrenaline_as_in_patients_in_shock():
    """By default arterioles alone answer, and plasma hardly moves; the experiment is venules that follow."""
    check = vasopressors_check()
    assert not check.required
    assert all("(test)" in row.name and row.source for row in check.rows)
    lower, higher, dialysed = check.rows
    for row in (lower, higher):
        assert not row.holds
        assert row.got > 0.3 * row.expected
        assert row.explained
    assert not dialysed.holds
    assert dialysed.evidence[0].got < -5.0
