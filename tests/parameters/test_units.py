import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eclsim.units import ML_S_PER_L_MIN, ML_S_PER_ML_MIN, convert, known_unit, quantity_of, units_of

QUANTITIES = (
    "flow",
    "pressure",
    "length",
    "resistance",
    "compliance",
    "rate",
    "mass",
    "viscosity",
    "density",
)


@pytest.mark.parametrize(
    ("value", "unit", "expected", "other"),
    [
        (1, "L/min", 16.6666667, "mL/s"),
        (200, "mL/min", 3.33333333, "mL/s"),
        (15, "cmH2O", 11.0333, "mmHg"),
        (1, "kPa", 7.50062, "mmHg"),
        (1, "psi", 51.7149, "mmHg"),
        (21, "Fr", 7, "mm"),
        (0.375, "in", 0.9525, "cm"),
        (1.2, "Hz", 72, "bpm"),
        (1, "Wood unit", 79.9934, "dyn.s/cm5"),
        (8, "WU", 0.48, "mmHg s/mL"),
        (3, "cP", 0.003, "Pa s"),
        (1060, "kg/m^3", 0.00106, "kg/mL"),
    ],
)
def test_known_conversions(value, unit, expected, other):
    assert convert(value, unit, other) == pytest.approx(expected, rel=1e-5)


def test_constants_agree_with_convert():
    assert convert(1, "L/min", "mL/s") == ML_S_PER_L_MIN
    assert convert(1, "mL/min", "mL/s") == ML_S_PER_ML_MIN


@given(st.sampled_from(QUANTITIES), st.floats(1e-6, 1e6), st.data())
def test_there_and_back(quantity, value, data):
    one, other = (data.draw(st.sampled_from(units_of(quantity))) for _ in range(2))
    assert math.isclose(convert(convert(value, one, other), other, one), value, rel_tol=1e-12)


def test_units_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="unknown unit 'furlong'"):
        convert(1, "furlong", "cm")
    with pytest.raises(ValueError, match="L/min is a flow and mmHg a pressure"):
        convert(1, "L/min", "mmHg")


def test_spellings():
    assert known_unit(" FRENCH ") == "Fr"
    assert known_unit("dyn.s/cm5") == "dyn s/cm^5"
    assert known_unit("parsec") is None
    assert quantity_of("mmhg") == "pressure"
