"""Fluid against measurements: what is compared, and that nothing is both fitted and tested."""

import math

import pytest

from eclsim.validation.fluid import fluid_check


@pytest.mark.slow
def test_rows_are_numbers_and_say_what_was_fitted():
    check = fluid_check()
    assert not check.required
    assert all(math.isfinite(row.got) for row in check.rows)
    assert [row.name for row in check.rows if "(test)" not in row.name] == [
        "filtration coefficient (fit of the source)"
    ]
    assert all(row.source for row in check.rows)
    for row in check.missed:
        assert row.explanation is not None, row.name
