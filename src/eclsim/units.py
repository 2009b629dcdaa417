"""Unit conversion for the whole package.

Inside eclsim pressures are in mmHg, volumes in mL and times in s, so flows are in mL/s,
resistances in mmHg s/mL, compliances in mL/mmHg and inertances in mmHg s^2/mL. Users write
L/min, mL/min, rpm, French and cm; those are converted with the constants of this module or,
for any other pair, with `convert`.
"""

from __future__ import annotations

import re

ML_S_PER_L_MIN = 1000.0 / 60.0
ML_S_PER_ML_MIN = 1.0 / 60.0
CM_PER_FRENCH = 1.0 / 30.0
PA_PER_MMHG = 133.322387415
MMHG_PER_KPA = 1000.0 / PA_PER_MMHG
MMHG_PER_CMH2O = 98.0665 / PA_PER_MMHG
MMHG_PER_PSI = 6894.757293168 / PA_PER_MMHG
MMHG_S_PER_ML_PER_WOOD = 60.0 / 1000.0
MMHG_S_PER_ML_PER_DYN = 0.1 / PA_PER_MMHG
RED_CELL_HAEMOGLOBIN = 33.3
"""Usual haemoglobin of red cells [g/dL]: haemoglobin of the blood at a haematocrit of 1."""
SECONDS_PER_MINUTE = 60.0

_MICRO = re.compile(r"\bu(?=g|mol)")

# unit -> (quantity, value of one such unit in the internal unit of the quantity). Micromoles are not taken
# for millimoles: an impossible creatinine is rather one in mg/dL.
_FACTORS: dict[str, tuple[str, float]] = {
    "mL/s": ("flow", 1.0),
    "L/min": ("flow", ML_S_PER_L_MIN),
    "mL/min": ("flow", ML_S_PER_ML_MIN),
    "L/s": ("flow", 1000.0),
    "L/h": ("flow", 1000.0 / 3600.0),
    "mL/h": ("flow", 1.0 / 3600.0),
    "mmHg": ("pressure", 1.0),
    "kPa": ("pressure", MMHG_PER_KPA),
    "Pa": ("pressure", 1.0 / PA_PER_MMHG),
    "hPa": ("pressure", 0.1 * MMHG_PER_KPA),
    "bar": ("pressure", 100.0 * MMHG_PER_KPA),
    "mbar": ("pressure", 0.1 * MMHG_PER_KPA),
    "cmH2O": ("pressure", MMHG_PER_CMH2O),
    "psi": ("pressure", MMHG_PER_PSI),
    "cm": ("length", 1.0),
    "mm": ("length", 0.1),
    "m": ("length", 100.0),
    "in": ("length", 2.54),
    "cm2": ("area", 1.0),
    "mm2": ("area", 0.01),
    "C": ("temperature", 1.0),
    "K": ("temperature", 1.0),
    "°F": ("temperature", 5.0 / 9.0),
    "Fr": ("length", CM_PER_FRENCH),
    "mL": ("volume", 1.0),
    "L": ("volume", 1000.0),
    "kg": ("mass", 1.0),
    "g": ("mass", 0.001),
    "lb": ("mass", 0.45359237),
    "mg": ("mass", 1e-6),
    "ug": ("mass", 1e-9),
    "s": ("time", 1.0),
    "min": ("time", SECONDS_PER_MINUTE),
    "h": ("time", 60.0 * SECONDS_PER_MINUTE),
    "d": ("time", 1440.0 * SECONDS_PER_MINUTE),
    "years": ("age", 1.0),
    "months": ("age", 1.0 / 12.0),
    "bpm": ("rate", 1.0),
    "Hz": ("rate", SECONDS_PER_MINUTE),
    "rpm": ("speed", 1.0),
    "krpm": ("speed", 1000.0),
    "mmHg s/mL": ("resistance", 1.0),
    "Wood units": ("resistance", MMHG_S_PER_ML_PER_WOOD),
    "dyn s/cm^5": ("resistance", MMHG_S_PER_ML_PER_DYN),
    "mL/mmHg": ("compliance", 1.0),
    "mL/kPa": ("compliance", 1.0 / MMHG_PER_KPA),
    "mmHg/mL": ("elastance", 1.0),
    "kPa/mL": ("elastance", MMHG_PER_KPA),
    "mmHg s^2/mL": ("inertance", 1.0),
    "Pa s": ("viscosity", 1.0),
    "mPa s": ("viscosity", 0.001),
    "kg/mL": ("density", 1.0),
    "g/mL": ("density", 0.001),
    "kg/m^3": ("density", 1e-6),
    "g/dL": ("mass concentration", 1.0),
    "g/L": ("mass concentration", 0.1),
    "mg/dL": ("mass concentration", 0.001),
    "mmol/L": ("concentration", 1.0),
    "umol/L": ("small concentration", 1.0),
    "mmol/h": ("rate of formation", 1.0),
    "umol/h": ("small rate of formation", 1.0),
    "mL/dL": ("content of a gas", 1.0),
    "mL/L": ("content of a gas", 0.1),
    "1": ("fraction", 1.0),
    "%": ("fraction", 0.01),
}
_ZEROS = {"K": -273.15, "°F": -160.0 / 9.0}
"""Zero of a scale in the internal unit, where it is not 0."""
_OF_DRUGS = {"ug": ("mass", 1.0), "ng": ("mass", 0.001), "mg": ("mass", 1000.0)}
_OF_DRUGS |= {"U": ("activity", 1.0), "mU": ("activity", 0.001)}
_FACTORS |= {
    f"{amount}{per}/{time}": (f"{kind}{by_weight} per time", size / minutes)
    for per, by_weight in (("/kg", " per body weight"), ("", ""))
    for time, minutes in (("min", 1.0), ("h", 60.0))
    for amount, (kind, size) in _OF_DRUGS.items()
}

_SPELLINGS = {
    "ml/sec": "mL/s",
    "lpm": "L/min",
    "mmhg": "mmHg",
    "mm hg": "mmHg",
    "torr": "mmHg",
    "cmh20": "cmH2O",
    "cm h2o": "cmH2O",
    "centimetre": "cm",
    "inch": "in",
    '"': "in",
    "f": "Fr",
    "french": "Fr",
    "ch": "Fr",
    "sec": "s",
    "second": "s",
    "seconds": "s",
    "minute": "min",
    "minutes": "min",
    "hr": "h",
    "hour": "h",
    "hours": "h",
    "day": "d",
    "days": "d",
    "y": "years",
    "yr": "years",
    "yrs": "years",
    "year": "years",
    "a": "years",
    "month": "months",
    "mo": "months",
    "lbs": "lb",
    "beats/min": "bpm",
    "/min": "bpm",
    "1/min": "rpm",
    "wu": "Wood units",
    "wood": "Wood units",
    "wood unit": "Wood units",
    "dyn": "dyn s/cm^5",
    "dyn.s/cm5": "dyn s/cm^5",
    "dyn s/cm5": "dyn s/cm^5",
    "dyn*s/cm^5": "dyn s/cm^5",
    "dyn s cm-5": "dyn s/cm^5",
    "cp": "mPa s",
    "meq/l": "mmol/L",
    "vol%": "mL/dL",
    "gamma": "ug/kg/min",
    "°c": "C",
    "degf": "°F",
    "cm^2": "cm2",
    "mm^2": "mm2",
    "cm²": "cm2",
    "mm²": "mm2",
}
_BY_LOWER_CASE = {unit.lower(): unit for unit in _FACTORS} | _SPELLINGS
_PARTS = {"mcg": "ug", "iu": "u", "ie": "u", "units": "u", "miu": "mu"}
_PARTS |= {"minute": "min", "hr": "h", "hour": "h"}
"""Other spellings of what stands between the slashes of a unit, in lower case."""


def known_unit(text: str) -> str | None:
    """Return the unit meant by a spelling such as "mmhg", "French" or "dyn.s/cm5", or None if unknown."""
    text = " ".join(re.sub("[µμ]", "u", text).split())
    if text in _FACTORS:
        return text
    parts = (part.strip().replace(".", "") for part in text.lower().split("/"))
    plain = "/".join(_PARTS.get(part, part) for part in parts)
    return _BY_LOWER_CASE.get(text.lower()) or _BY_LOWER_CASE.get(plain)


def quantity_of(unit: str) -> str | None:
    """Return the quantity that a unit measures ("flow", "pressure", ...), or None for an unknown unit."""
    known = known_unit(unit)
    return None if known is None else _FACTORS[known][0]


def unit_in_words(unit: str) -> str:
    """Return a unit as it is named in a message: that of a fraction is "fractions of 1"."""
    return "fractions of 1" if unit == "1" else unit


def unit_after_number(unit: str) -> str:
    """Return a unit as it is written after a number: nothing for that of a fraction."""
    return "" if unit == "1" else unit


def with_micro_sign(unit: str) -> str:
    """Return a unit of case files with the sign for micro: "µg" for "ug"."""
    return _MICRO.sub("µ", unit)


def equation(value: float, unit: str, other_unit: str) -> str:
    """Return a value in two units of one quantity, as "800 dyn s/cm^5 = 0.6 mmHg s/mL"."""
    sides = (f"{value:g}", unit), (f"{convert(value, unit, other_unit):.4g}", other_unit)
    return " = ".join(number if of == "1" else f"{number} {of}" for number, of in sides)


def units_of(quantity: str) -> tuple[str, ...]:
    """Return all known units of a quantity, the internal one first."""
    return tuple(unit for unit, (measured, _) in _FACTORS.items() if measured == quantity)


def convert(value: float, from_unit: str, to_unit: str) -> float:
    """Convert a value between two units of the same quantity.

    Args:
        value: The number, in `from_unit`.
        from_unit: Unit in any spelling that `known_unit` understands, such as "L/min".
        to_unit: Unit in any such spelling, such as "mL/s".

    Raises:
        ValueError: If a unit is unknown or the two measure different quantities.
    """
    scales = []
    for unit in (from_unit, to_unit):
        known = known_unit(unit)
        if known is None:
            raise ValueError(f"unknown unit {unit!r}; known: {', '.join(_FACTORS)}")
        scales.append((*_FACTORS[known], _ZEROS.get(known, 0.0)))
    (from_quantity, from_factor, from_zero), (to_quantity, to_factor, to_zero) = scales
    if from_quantity != to_quantity:
        raise ValueError(f"{from_unit} is a {from_quantity} and {to_unit} a {to_quantity}: not convertible")
    if from_zero == to_zero:
        return value * from_factor / to_factor
    return (value * from_factor + from_zero - to_zero) / to_factor
