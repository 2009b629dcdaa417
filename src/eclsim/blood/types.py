"""Properties of blood other than its gases, and checks of arguments."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, TypeAlias, TypedDict

import jax
import numpy as np
from jax.core import Tracer

from eclsim.arguments import written

Array: TypeAlias = float | np.ndarray | jax.Array

NEUTRAL_PH_SLOPE = 0.0147
"""Rise of pH per degree of cooling of blood in a closed system [1/C] (Rosenthal 1948)."""


class Given(TypedDict, total=False):
    """Optional properties of blood other than its gases; `Blood` describes them and has the defaults."""

    haemoglobin: Array
    base_excess: Array
    temperature: Array
    oxygen_capacity: Array
    dpg: Array


class Blood(NamedTuple):
    """Properties of blood other than its gases; numbers or arrays of a common shape.

    Attributes:
        haemoglobin: haemoglobin concentration [g/dL].
        base_excess: base excess of fully oxygenated blood [mmol/L]; gas exchange does not change it.
        temperature: temperature [C].
        oxygen_capacity: oxygen that haemoglobin binds [mL/g]; values of 1.34 to 1.39 are in use.
        dpg: 2,3-diphosphoglycerate in the red cells [mmol/L]; only the law of Dash 2016 uses it.
    """

    haemoglobin: Array = 15.0
    base_excess: Array = 0.0
    temperature: Array = 37.0
    oxygen_capacity: Array = 1.34
    dpg: Array = 4.65


class HeldGases(NamedTuple):
    """What blood holds at given partial pressures and pH.

    Attributes:
        standard_pressure: PO2 with the same saturation under standard conditions [mmHg].
        saturation: oxygen saturation of haemoglobin [-].
        oxygen: content of oxygen, bound and dissolved [mL/dL STPD].
        carbon_dioxide: content of carbon dioxide [mL/dL STPD].
    """

    standard_pressure: Array
    saturation: Array
    oxygen: Array
    carbon_dioxide: Array


class Allowed(NamedTuple):
    """Allowed values of an argument.

    Attributes:
        low: smallest value.
        high: largest value.
        unit: its unit.
        hint: conversion from the other usual unit.
    """

    low: float
    high: float
    unit: str
    hint: str = ""


ALLOWED = {
    "po2": Allowed(0.0, 3000.0, "mmHg", "13.3 kPa are 100 mmHg"),
    "pco2": Allowed(0.0, 1000.0, "mmHg", "5.33 kPa are 40 mmHg"),
    "saturation": Allowed(0.0, 1.0, "a fraction", "95 % is 0.95"),
    "haemoglobin": Allowed(0.0, 40.0, "g/dL", "150 g/L are 15 g/dL, 9.3 mmol/L are 15 g/dL"),
    "base_excess": Allowed(-100.0, 100.0, "mmol/L"),
    "temperature": Allowed(0.0, 50.0, "C", "310.15 K are 37 C"),
    "oxygen_capacity": Allowed(1.0, 1.6, "mL/g", "1.34 to 1.39 are in use"),
    "dpg": Allowed(0.0, 30.0, "mmol/L", "in red cells, 4.65 is usual"),
}
"""Bounds that any blood satisfies, wide enough for any computation; contents have none."""
UNUSED_ARGUMENTS = {
    "severinghaus1979": {"dpg": "its curve is of usual 2,3-diphosphoglycerate; law='dash2016' reads it"},
    "dash2016": {"oxygen_capacity": "four molecules for each haemoglobin are 1.398 mL/g in this law"},
}
"""By law, the arguments that it does not use, and the reason."""


def refuse_arguments(given: Mapping[str, object], law: str) -> None:
    """Raise `ValueError` with all arguments that a law cannot use.

    These are values that are impossible in the expected unit, and arguments that would have no effect.

    A text raises `TypeError`.

    Args:
        given: arguments by name; traced JAX values and NaN are not checked.
        law: name of the set of equations.
    """
    wrong = [f"{name}: {why}" for name, why in UNUSED_ARGUMENTS.get(law, {}).items() if name in given]
    for name, value in given.items():
        if isinstance(value, Tracer):
            continue
        if np.asarray(value).dtype.kind in "US":
            raise TypeError(f"{name} = {written(value)}: a text; allowed: a number, or an array of numbers")
        if name not in ALLOWED:
            continue
        low, high, unit, hint = ALLOWED[name]
        values = np.atleast_1d(np.asarray(value, dtype=float))
        outside = values[(values < low) | (values > high)]
        if len(outside):
            more = f" ({hint})" if hint else ""
            wrong.append(f"{name} = {outside[0]:g}; allowed: {low:g} to {high:g} {unit}{more}")
    if wrong:
        raise ValueError("\n".join(wrong))
