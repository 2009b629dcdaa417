"""Reading of one number of a case file, with suggestions for values that are not numbers."""

from __future__ import annotations

import math
import re
import sys
import unicodedata
from typing import TypeGuard

from eclsim.files import NUMBER
from eclsim.inputs.fields import Field
from eclsim.inputs.mistakes import Mistake, NumberAsWritten
from eclsim.units import convert, equation, known_unit, quantity_of, unit_in_words, units_of

_MISSING = frozenset(
    {"", "na", "n/a", "#n/a", "#nv", "#n/d", "nan", "-", "--", ".", "?", "none", "null", "missing"}
)
_TWO_PRESSURES = re.compile(r"\s*(\d+(?:\.\d+)?)\s*/\s*(\d+(?:\.\d+)?)\s*")
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+")
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
_GROUPED_NUMBER = re.compile(r"[+-]?\d{1,3}([.,' ]\d{3})+[.,]\d+")
_DIGIT_GROUPS = re.compile("\\d{1,3}(?:[ '\u00a0\u2009\u202f]\\d{3})+")
_LETTERS_LIKE_DIGITS = re.compile(r"[0-9OoIl|]+(?:\.[0-9OoIl|]+)?(?<!l)")
_LETTERS_TO_DIGITS = str.maketrans("OoIl|", "00111")
_UNIT_LIKE = re.compile(r"[^\W\d_%°µ/][^\W\d_]*|[%°]")
_MONTH = re.compile(r"(jan|feb|m[aä]r|apr|ma[iy]|jun|jul|aug|sep|o[ck]t|nov|de[cz])", re.IGNORECASE)
_WITH_UNIT = re.compile(rf"\s*({NUMBER.pattern})\s*(\D.*?)\s*")


class RefusedValueError(Exception):
    """A value that is refused; `mistake` gives the reason, without key and place."""

    def __init__(self, message: str, allowed: str = "", suggestion: str = ""):
        self.mistake = Mistake("", message, allowed=allowed, suggestion=suggestion)
        super().__init__(message)


def is_missing(value: object) -> bool:
    """Whether a value stands for "not measured": nan, "NA", "n/a", "-", "." and the like."""
    if isinstance(value, float):
        return math.isnan(value)
    return isinstance(value, str) and value.strip().lower() in _MISSING


def is_number(value: object) -> TypeGuard[int | float]:
    """Whether a value is a number within the range of a float; Booleans and NaN are not."""
    if not isinstance(value, (int, float)) or isinstance(value, bool):
        return False
    return abs(value) <= sys.float_info.max


def read_number(value: object, field: Field) -> float:
    """Read the value of a number field, in the field's unit.

    Raises:
        RefusedValueError: The value is not a number or is outside the allowed range.
    """
    number = _finite(value, field)
    too_little = 0.0 < number < field.least
    if field.minimum <= number <= field.maximum and not too_little:
        return number
    message = "must be above 0" if number <= 0 < field.minimum else "outside the allowed range"
    smallest = field.least or field.minimum
    suggestion = suspected_unit(number, field.unit, field.typical, (smallest, field.maximum))
    raise RefusedValueError(message, field.allowed, suggestion)


def suspected_unit(number: float, unit: str, typical: float, allowed: tuple[float, float]) -> str:
    """Guess the unit of an impossible number, as "800 dyn s/cm^5 = 0.6 mmHg s/mL"; empty if none fits."""
    quantity = quantity_of(unit)
    best, best_distance = "", math.log(30.0)
    for other in units_of(quantity) if quantity else ():
        converted = convert(number, other, unit)
        if other == unit or converted / typical <= 0 or not allowed[0] <= converted <= allowed[1]:
            continue
        distance = abs(math.log(converted / typical))
        if distance < best_distance:
            best, best_distance = equation(number, other, unit), distance
    return best


def _finite(value: object, field: Field) -> float:
    if isinstance(value, bool):
        raise RefusedValueError("true and false are not numbers", field.allowed)
    if isinstance(value, str):
        return _number_in_text(value, field)
    if not isinstance(value, (int, float)):
        raise RefusedValueError(f"a {_kind(value)} where a number belongs", field.allowed)
    try:
        number = float(value)
    except OverflowError:
        raise RefusedValueError("too large", field.allowed) from None
    if math.isnan(number):
        raise RefusedValueError(f"not a number{_if_unknown(field)}", field.allowed)
    if math.isinf(number):
        raise RefusedValueError("infinite" if not _digits(value) else "too large", field.allowed)
    if number == 0 and _digits(value):
        raise RefusedValueError("too small to be distinguished from 0", field.allowed)
    return number


def _if_unknown(field: Field) -> str:
    return ", and this value is needed" if field.required else "; a number is needed where the key is written"


def _digits(value: object) -> bool:
    """Whether a number was written with a digit other than 0 before its exponent."""
    written = value.text if isinstance(value, NumberAsWritten) else ""
    return any(digit in "123456789" for digit in re.split("[eE]", written)[0])


def _number_in_text(text: str, field: Field) -> float:
    if is_missing(text) and text.strip().lower() != "nan":
        raise RefusedValueError(f"not given{_if_unknown(field)}", field.allowed)
    if NUMBER.fullmatch(text.strip()):
        meant = text.strip() if field.minimum <= float(text) <= field.maximum else ""
        raise RefusedValueError("text in quotes where a number belongs", field.allowed, meant)
    if result := _WITH_UNIT.fullmatch(text):
        return _number_with_unit(text, float(result[1]), result[5], field)
    raise RefusedValueError(*_why_no_number(text, field))


def _number_with_unit(text: str, number: float, unit: str, field: Field) -> float:
    if result := _TWO_PRESSURES.fullmatch(text):
        raise RefusedValueError(*_two_pressures(result, field))
    if _DECIMAL_COMMA.fullmatch(text.strip()) or _GROUPED_NUMBER.fullmatch(text.strip()):
        raise RefusedValueError(*_why_no_number(text, field))
    known = known_unit(unit)
    if known == field.unit == "Fr":
        return read_number(number, field)
    if known == field.unit:
        raise RefusedValueError(
            f"text with a unit; write only the number [{known}]", field.allowed, f"{number:g}"
        )
    if known is not None:
        raise _in_another_unit(number, known, field)
    if _DIGIT_GROUPS.fullmatch(text.strip()):
        message = "digits in groups; write them without spaces"
        raise RefusedValueError(message, field.allowed, number_meant(text))
    raise RefusedValueError(f'not a number: "{unit.strip()}" follows it', field.allowed, number_meant(text))


def _in_another_unit(number: float, unit: str, field: Field) -> RefusedValueError:
    message = f"in {unit}, but {field.name} is in {unit_in_words(field.unit)}"
    if quantity_of(unit) != quantity_of(field.unit):
        return RefusedValueError(message, field.allowed)
    meant = equation(number, unit, field.unit)
    if field.minimum <= convert(number, unit, field.unit) <= field.maximum:
        return RefusedValueError(message, field.allowed, meant)
    return RefusedValueError(f"{message}: {meant}", field.allowed)


def number_meant(text: str) -> str:
    """Return the number probably meant by a text with characters after its digits; empty if that is a guess.

    A word or sign is dropped, groups of digits are joined, and letters that look like digits are read as
    digits. A date or any other text gives an empty result.
    """
    written = text.strip()
    if _DIGIT_GROUPS.fullmatch(written):
        return re.sub(r"\D", "", written)
    if re.search("[0-9]", written) and _LETTERS_LIKE_DIGITS.fullmatch(written):
        return written.translate(_LETTERS_TO_DIGITS)
    result = _WITH_UNIT.fullmatch(written)
    if result is None or result[5] == "l" or not _UNIT_LIKE.fullmatch(result[5]) or _MONTH.match(result[5]):
        return ""
    return f"{float(result[1]):g}"


def _two_pressures(result: re.Match[str], field: Field) -> tuple[str, str, str]:
    if field.unit == "mmHg":
        message = "two pressures in one value; give systolic and diastolic pressure on their own"
        return message, field.allowed, f"SP = {result[1]} and DP = {result[2]}"
    return "two numbers in one value", field.allowed, ""


def _why_no_number(text: str, field: Field) -> tuple[str, str, str]:
    stripped = text.strip()
    if any(letter.isdecimal() and not letter.isascii() for letter in stripped):
        return "digits other than 0 to 9", field.allowed, _in_ascii_digits(stripped)
    if result := _TWO_PRESSURES.fullmatch(text):
        return _two_pressures(result, field)
    if _GROUPED_NUMBER.fullmatch(stripped):
        return (
            "a thousands separator and a decimal sign; write digits and a decimal point only",
            field.allowed,
            "",
        )
    if _THOUSANDS.fullmatch(stripped) and _is_in_thousands(stripped, field):
        return "a thousands separator; write digits only", field.allowed, stripped.replace(",", "")
    if _DECIMAL_COMMA.fullmatch(stripped):
        return "a decimal comma; write a decimal point", field.allowed, stripped.replace(",", ".")
    return "not a number", field.allowed, ""


def _in_ascii_digits(text: str) -> str:
    """Return a number with its digits written as 0 to 9; empty if it is none."""
    written = "".join(str(unicodedata.decimal(one)) if one.isdecimal() else one for one in text)
    return written if NUMBER.fullmatch(written) else ""


def _is_in_thousands(text: str, field: Field) -> bool:
    """Whether a number with a comma is nearer to a typical value if the comma separates thousands."""
    typical = field.typical or 1.0
    decimal, whole = (float(text.replace(",", sign)) for sign in (".", ""))
    if not field.minimum <= whole <= field.maximum or whole / typical <= 0.0:
        return False
    return abs(math.log(whole / typical)) < abs(math.log(decimal / typical))


def _kind(value: object) -> str:
    if isinstance(value, dict):
        return "table"
    return "list" if isinstance(value, (list, tuple)) else f"{type(value).__name__} value"
