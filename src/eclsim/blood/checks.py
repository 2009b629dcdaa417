"""Checks of the arguments and results of `eclsim.blood`; traced JAX values, which have none, pass."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, NamedTuple, cast

import jax
import numpy as np
from jax.core import Tracer

from eclsim.arguments import written
from eclsim.blood.acid_base import excess_of
from eclsim.blood.types import Array, Blood
from eclsim.spelling import spelling_hint

if TYPE_CHECKING:
    from eclsim.blood.gases import BloodGases


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
    "pco2": Allowed(0.01, 1000.0, "mmHg", "5.33 kPa are 40 mmHg"),
    "saturation": Allowed(0.0, 1.0, "a fraction", "95 % is 0.95"),
    "oxygen": Allowed(0.0, 80.0, "mL/dL", "200 mL/L are 20 mL/dL, 9 mmol/L are 20 mL/dL"),
    "carbon_dioxide": Allowed(0.0, 1000.0, "mL/dL", "480 mL/L are 48 mL/dL, 22 mmol/L are 49 mL/dL"),
    "ph": Allowed(5.0, 9.0, "", "40 nmol/L of hydrogen ions are 7.40"),
    "haemoglobin": Allowed(0.0, 33.0, "g/dL", "150 g/L are 15 g/dL, 9.3 mmol/L are 15 g/dL"),
    "base_excess": Allowed(-100.0, 100.0, "mmol/L"),
    "temperature": Allowed(0.0, 50.0, "C", "310.15 K are 37 C"),
    "oxygen_capacity": Allowed(1.0, 1.6, "mL/g", "1.34 to 1.39 are in use"),
    "dpg": Allowed(0.0, 30.0, "mmol/L", "in red cells, 4.65 is usual"),
}
"""Bounds that any blood satisfies, wide enough for any computation.

Haemoglobin ends where blood is red cells without plasma. Contents end where no haemoglobin and pressure
reach; `refuse_results` has the narrower bound of the blood's own haemoglobin."""
ALLOWED_BY_LAW = {
    "dash2016": {"temperature": Allowed(10.0, 50.0, "C", "in colder blood the law's P50 falls to 0")}
}
"""Narrower bounds of a law."""
UNUSED_ARGUMENTS = {
    "severinghaus1979": {"dpg": "its curve is of usual 2,3-diphosphoglycerate; law='dash2016' reads it"},
    "dash2016": {"oxygen_capacity": "four molecules for each haemoglobin are 1.398 mL/g in this law"},
}
"""By law, the arguments that it does not use, and the reason."""
OTHER_NAMES = {
    "hb": "haemoglobin", "hgb": "haemoglobin", "be": "base_excess", "temp": "temperature", "t": "temperature",
    "so2": "saturation", "sao2": "saturation", "svo2": "saturation", "s": "saturation", "pao2": "po2",
    "paco2": "pco2", "o2": "oxygen", "cao2": "oxygen", "co2": "carbon_dioxide", "pha": "ph",
}  # fmt: skip
"""Short names in use at the bedside."""
LARGEST_EXCESS = 1e-6
"""Largest imbalance of bicarbonate [mmol/L] of a pH that was found."""
SLACK = 1e-6
"""Relative rounding of a pressure that was found from a content."""


def refuse_names(function: str, given: Iterable[str], own: Iterable[str]) -> None:
    """Raise `TypeError` for an argument that a function does not have, with the nearest spelling.

    Args:
        function: name of the function.
        given: names of properties of blood as given.
        own: names of the function's other arguments.
    """
    known = (*own, "law", *Blood._fields)
    for name in given:
        if name not in Blood._fields:
            other = OTHER_NAMES.get(name.lower(), "")
            hint = spelling_hint(other or name, known if not other or other in known else ())
            raise TypeError(f"blood.{function}() has no argument '{name}'; allowed: {', '.join(known)}{hint}")


def refuse_arguments(given: Mapping[str, object], law: str) -> None:
    """Raise `ValueError` with all arguments that a law cannot use.

    These are values that are impossible in the expected unit, and arguments that would have no effect.

    What is no number raises `TypeError`.

    Args:
        given: arguments by name; traced JAX values and NaN are not checked.
        law: name of the set of equations.
    """
    wrong = [f"{name}: {why}" for name, why in UNUSED_ARGUMENTS.get(law, {}).items() if name in given]
    for name, value in given.items():
        if isinstance(value, Tracer):
            continue
        array = np.asarray(value)
        if array.dtype.kind not in "iuf":
            kind = ": a text" if array.dtype.kind in "US" else ""
            raise TypeError(f"{name} = {written(value)}{kind}; allowed: a number, or an array of numbers")
        if name not in ALLOWED:
            continue
        low, high, unit, hint = ALLOWED_BY_LAW.get(law, {}).get(name, ALLOWED[name])
        values = np.atleast_1d(array)
        outside = values[(values < low) | (values > high)]
        if len(outside):
            more = f" ({hint})" if hint else ""
            wrong.append(f"{name} = {outside[0]:g}; allowed: {low:g} to {high:g} {unit}".rstrip() + more)
    if wrong:
        raise ValueError("\n".join(wrong))


def blood_of(given: Mapping[str, object]) -> Blood:
    """Blood of properties by name, with lists as arrays: JAX takes a list for several arguments."""
    arrays = {
        name: value
        if isinstance(value, (float, int, np.ndarray, jax.Array))
        else np.asarray(value, dtype=float)
        for name, value in given.items()
    }
    return Blood(**cast("dict[str, Array]", arrays))


def refuse_results(found: BloodGases, given: Mapping[str, Array], blood: Blood) -> None:
    """Raise `ValueError` where no blood has the gases that were asked for, or the search for its pH failed.

    Args:
        found: gases of blood.
        given: the values they were found from, by name of the argument; NaN are not judged.
        blood: its properties.
    """
    inputs = {**given, "haemoglobin": blood.haemoglobin, "base_excess": blood.base_excess}
    if any(isinstance(value, Tracer) for value in (*found, *given.values(), *blood)):
        return
    po2, pco2, ph, saturation = (np.asarray(value) for value in found[:4])
    known = np.ones(po2.shape, bool)
    for value in (*given.values(), *blood):
        known = known & ~np.isnan(np.asarray(value, dtype=float))
    lines = _pressures_outside(found, known, inputs)
    if not lines:
        low, high = ALLOWED["ph"][:2]
        bare = Blood(*(np.asarray(value, dtype=float) for value in blood))
        with np.errstate(all="ignore"):
            balanced = np.abs(excess_of(pco2, ph, saturation, bare)) < LARGEST_EXCESS * (1.0 + pco2)
        wrong = known & ~((ph >= low) & (ph <= high) & balanced)
        reason = f"no blood; allowed: values that give a pH of {low:g} to {high:g}"
        if np.isnan(po2[wrong]).any():
            reason = "no blood: no partial pressures give them"
        lines += [f"{_at(wrong, inputs)}: {reason}"] if wrong.any() else []
    if lines:
        raise ValueError("\n".join(lines))


def _pressures_outside(found: BloodGases, known: np.ndarray, inputs: Mapping[str, Array]) -> list[str]:
    """Mistakes of contents: those that need pressures which no blood has."""
    lines = []
    for name, argument, value in (("po2", "oxygen", found.po2), ("pco2", "carbon_dioxide", found.pco2)):
        low, high, unit, _ = ALLOWED[name]
        pressures = np.asarray(value)
        outside = known & ((pressures < low * (1.0 - SLACK)) | (pressures > high * (1.0 + SLACK)))
        if argument in inputs and outside.any():
            pressure = f"{name} would be {pressures[outside].ravel()[0]:.4g}"
            lines.append(f"{_at(outside, inputs)}: {pressure}; allowed: {low:g} to {high:g} {unit}")
            lines[-1] += f" ({ALLOWED[argument].hint})"
    return lines


def refuse_excess(excess: Array, given: Mapping[str, Array]) -> None:
    """Raise `ValueError` where a measured pH means a base excess that no blood has.

    Args:
        excess: base excess [mmol/L].
        given: the values it follows from, by name.
    """
    if isinstance(excess, Tracer):
        return
    low, high, unit, _ = ALLOWED["base_excess"]
    wrong = (np.asarray(excess) < low) | (np.asarray(excess) > high)
    if wrong.any():
        reached = f"the base excess would be {np.asarray(excess)[wrong].ravel()[0]:.4g}"
        raise ValueError(f"{_at(wrong, given)}: {reached}; allowed: {low:g} to {high:g} {unit}")


def _at(chosen: np.ndarray, values: Mapping[str, Array]) -> str:
    """Values at the first place of those chosen, as text."""
    first = np.argmax(chosen.ravel())
    each = {n: np.broadcast_to(np.asarray(v, dtype=float), chosen.shape).ravel() for n, v in values.items()}
    return ", ".join(f"{name} = {value[first]:.4g}" for name, value in each.items())
