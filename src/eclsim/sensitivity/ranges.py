"""Ranges of the inputs of a sensitivity analysis: read, checked, and described in words and as plain data."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from eclsim.arguments import Kind, number_of, written
from eclsim.inputs.named_values import named_texts
from eclsim.outputs.results import unit_of_value
from eclsim.reporting.numbers import number
from eclsim.sensitivity.inputs import Categorical, Continuous, Description, Input, InputError, Range

EXAMPLE = '{"Rmc": (0.5, 1.5), "Emaxlv": (0.4, 4.0, "log")}'


def checked_ranges(what: str, given: Mapping[str, Range]) -> dict[str, Range]:
    """Return the ranges of inputs by name, each (low, high) or (low, high, "log").

    Args:
        what: name of the argument, for messages.
        given: ranges in the units of the inputs.

    Raises:
        TypeError: They are no ranges.
        InputError: A bound is not finite, or not below the upper one, or not above 0 for a logarithm.
    """
    Kind(Mapping, f"ranges by input, such as {EXAMPLE}")(what, given)
    ranges = {name: _bounds(f"range of {name}", range_) for name, range_ in given.items()}
    if wrong := [f"range of {n}: {fault}" for n, range_ in ranges.items() if (fault := _fault(range_))]:
        raise InputError(wrong)
    return ranges


def _bounds(what: str, range_: Any) -> Range:
    allowed = '(low, high) or (low, high, "log")'
    if isinstance(range_, str) or not hasattr(range_, "__len__") or len(range_) not in (2, 3):
        raise TypeError(f"{what} = {written(range_)}; allowed: {allowed}")
    low, high, *scale = range_
    if scale and scale[0] != "log":
        raise InputError([f"{what} = {written(scale[0])} as third entry; allowed: {allowed}"])
    low, high = number_of(what, low), number_of(what, high)
    return (low, high, "log") if scale else (low, high)


def _fault(range_: Range) -> str:
    """Why a range is not allowed; empty if it is."""
    low, high = range_[:2]
    shown = f"{low:g} to {high:g}"
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        return f"{shown}; allowed: two numbers, the first of them smaller"
    if len(range_) == 3 and low <= 0.0:
        return f"{shown}, uniform in its logarithm; allowed: above 0"
    return ""


def read_ranges(texts: Sequence[str]) -> dict[str, Range]:
    """Parse the texts of --range, NAME=LOW:HIGH or NAME=LOW:HIGH:log, several of them separated by commas.

    Raises:
        InputError: A text has another form, or a name is given twice.
    """
    ranges: dict[str, Range] = {}
    wrong = []
    for given in named_texts(texts):
        name, shown = given.name, given.written[:60]
        parts = [part.strip() for part in given.text.split(":")]
        try:
            low, high = map(float, parts[:2])
        except ValueError:
            low = high = math.nan
        if not name or math.isnan(low + high) or parts[2:] not in ([], ["log"]):
            wrong.append(f"--range {shown}: allowed: NAME=LOW:HIGH or NAME=LOW:HIGH:log, as Rmc=0.5:1.5")
        elif name in ranges:
            wrong.append(f"--range {shown}: {given.twice}")
        else:
            ranges[name] = (low, high, "log") if parts[2:] else (low, high)
    if wrong:
        raise InputError(wrong)
    return ranges


# --- which range each input had ---------------------------------------------------------------------


def input_object(chosen: Input) -> Description:
    """Range or choices of an input as plain data, with the unit."""
    if isinstance(chosen, Categorical):
        return {"distribution": "equally likely", "choices": list(chosen.levels)}
    kind = "log-uniform" if chosen.log else "uniform"
    unit = unit_of_value(chosen.name)
    return {"distribution": kind, "low": chosen.low, "high": chosen.high, "unit": unit}


def input_rows(inputs: Sequence[Input]) -> Iterator[tuple[str, str, float | str, float | str, str, str]]:
    """Rows of a table of the inputs: name, distribution, low, high, unit, choices."""
    for chosen in inputs:
        about = {"low": "", "high": "", "unit": "", "choices": (), **input_object(chosen)}
        choices = "; ".join(about["choices"])
        yield chosen.name, about["distribution"], about["low"], about["high"], about["unit"], choices


def range_text(chosen: Input) -> str:
    """An input and its range in words, such as "Rmc 0.5 to 1.5 mmHg s/mL"."""
    if isinstance(chosen, Categorical):
        return f"{chosen.name} {', '.join(chosen.levels)}"
    unit = unit_of_value(chosen.name)
    bounds = f"{number(chosen.low)} to {number(chosen.high, unit='' if unit == '1' else unit)}"
    return f"{chosen.name} {bounds}{', uniform in its logarithm' if chosen.log else ''}"


def ranges_text(inputs: Sequence[Input]) -> str:
    """The ranges of all inputs in one sentence, without each name that has the common perturbation."""
    common = _common_share(inputs)
    parts = [f"uniform within ±{common:g} % of the central values"] if common else []
    return "; ".join(parts + [range_text(i) for i in inputs if not common or _share(i) != common])


def own_ranges_text(inputs: Sequence[Input]) -> str:
    """The same sentence if a number has another range than the common perturbation, else an empty text."""
    common = _common_share(inputs)
    others = [i for i in inputs if isinstance(i, Continuous) and (i.own or _share(i) != common)]
    return ranges_text(inputs) if others else ""


def _common_share(inputs: Sequence[Input]) -> float:
    """Half width that most ranges of the common perturbation have [%]; 0 if there are none."""
    shares = Counter(share for chosen in inputs if (share := _share(chosen)))
    return shares.most_common(1)[0][0] if shares else 0.0


def _share(chosen: Input) -> float:
    """Half width of a range of the common perturbation [% of its middle]; 0 for any other input."""
    if isinstance(chosen, Categorical) or chosen.own or not (middle := abs(chosen.low + chosen.high)):
        return 0.0
    return float(f"{100.0 * (chosen.high - chosen.low) / middle:.6g}")
