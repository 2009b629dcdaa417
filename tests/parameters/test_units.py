import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eclsim.units import (
    _FACTORS,
    ML_S_PER_L_MIN,
    ML_S_PER_ML_MIN,
    convert,
    known_unit,
    quantity_of,
    unit_after_number,
    units_of,
)

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
        (98.6, "°F", 37, "C"),
        (310.15, "K", 98.6, "degF"),
    ],
)
def test_known_conversions(value, unit, expected, other):
    assert convert(value, unit, other) == pytest.approx(expected, rel=1e-5)


INTERNAL = {
    "flow": "mL/s", "pressure": "mmHg", "length": "cm", "volume": "mL", "mass": "kg", "age": "years",
    "rate": "bpm", "speed": "rpm", "resistance": "mmHg s/mL", "compliance": "mL/mmHg", "elastance": "mmHg/mL",
    "inertance": "mmHg s^2/mL", "viscosity": "Pa s", "density": "kg/mL", "mass concentration": "g/dL",
    "fraction": "1", "time": "s", "concentration": "mmol/L", "rate of formation": "mmol/h",
    "small concentration": "umol/L", "small rate of formation": "umol/h", "area": "cm2", "temperature": "C",
    "content of a gas": "mL/dL", "mass per time": "ug/min", "mass per body weight per time": "ug/kg/min",
    "activity per time": "U/min", "activity per body weight per time": "U/kg/min",
}  # fmt: skip
ONE_IS = {
    "L/min": 16.66666667, "mL/min": 0.01666666667, "L/s": 1000, "L/h": 0.2777777778, "mL/h": 2.777777778e-4,
    "kPa": 7.50061683, "Pa": 7.50061683e-3, "hPa": 0.750061683, "bar": 750.061683, "mbar": 0.750061683,
    "cmH2O": 0.73555924, "psi": 51.7149326, "mm": 0.1, "m": 100, "in": 2.54, "Fr": 0.0333333333, "L": 1000,
    "g": 1e-3, "lb": 0.45359237, "months": 0.0833333333, "Hz": 60, "krpm": 1000, "Wood units": 0.06,
    "dyn s/cm^5": 7.50061683e-4, "mL/kPa": 0.133322387, "kPa/mL": 7.50061683, "mPa s": 1e-3, "g/mL": 1e-3,
    "kg/m^3": 1e-6, "g/L": 0.1, "%": 0.01, "min": 60, "h": 3600, "d": 86400, "mg": 1e-6, "ug": 1e-9,
    "mg/dL": 0.001, "mm2": 0.01, "K": -272.15, "°F": -17.22222222, "mL/L": 0.1,
    "ng/min": 0.001, "mg/min": 1000,
    "ug/h": 0.01666666667, "ng/h": 1.666666667e-5, "mg/h": 16.66666667, "ng/kg/min": 0.001,
    "mg/kg/min": 1000, "ug/kg/h": 0.01666666667, "ng/kg/h": 1.666666667e-5, "mg/kg/h": 16.66666667,
    "mU/min": 0.001, "U/h": 0.01666666667, "mU/h": 1.666666667e-5, "mU/kg/min": 0.001,
    "U/kg/h": 0.01666666667, "mU/kg/h": 1.666666667e-5,
}  # fmt: skip
"""By hand, from 101325 Pa = 760 Torr, the pound of 0.45359237 kg and the inch of 2.54 cm."""


@pytest.mark.parametrize(("quantity", "unit"), INTERNAL.items())
def test_one_of_each_unit_is_so_many_of_the_internal_one(quantity, unit):
    assert units_of(quantity)[0] == unit
    for other in units_of(quantity)[1:]:
        assert convert(1.0, other, unit) == pytest.approx(ONE_IS[other], rel=1e-6)


def test_every_unit_is_checked():
    assert {unit for quantity in INTERNAL for unit in units_of(quantity)[1:]} == set(ONE_IS)
    assert set(_FACTORS) == set(ONE_IS) | set(INTERNAL.values())


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
    assert known_unit("I.U./hour") == "U/h"
    assert known_unit("mcg / kg / min") == known_unit("µg/kg/min") == "ug/kg/min"
    assert quantity_of("mmhg") == "pressure"


def test_a_fraction_has_no_unit_after_its_number():
    assert [unit_after_number(unit) for unit in ("1", "mmHg", "%", "")] == ["", "mmHg", "%", ""]
