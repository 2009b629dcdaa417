import math

import pytest

from eclsim.reporting.numbers import interval, number


@pytest.mark.parametrize(
    ("value", "decimals", "written"),
    [
        (70.26, 1, "70.3"), (-70.26, 0, "\N{MINUS SIGN}70"), (-0.04, 1, "0.0"), (0.0, 2, "0.00"),
        (1234.5678, None, "1235"), (-1e-7, None, "\N{MINUS SIGN}1e\N{MINUS SIGN}07"),
        (None, 1, "–"), (math.nan, None, "–"), (math.inf, 1, "–"),
    ],
)  # fmt: skip
def test_numbers_have_a_true_minus_no_negative_zero_and_a_dash_for_none(value, decimals, written):
    assert number(value, decimals) == written


def test_a_unit_stands_behind_a_number_and_not_behind_none():
    assert number(70.26, 1, unit="mmHg") == "70.3 mmHg"
    assert number(None, 1, unit="mmHg", missing="not measured") == "not measured"


def test_an_interval_has_both_ends_or_is_empty():
    assert interval(0.70012, -1.0) == "0.7 to \N{MINUS SIGN}1"
    assert interval(None, 1.0) == interval(1.0, None) == ""


def test_thousands_are_written_out():
    assert number(1064.4, digits=2) == "1100"
    assert number(9999.6) == "10000"
    assert number(-123456.0) == "\N{MINUS SIGN}123500"
    assert number(2.5e7, digits=2) == "2.5e+07"
