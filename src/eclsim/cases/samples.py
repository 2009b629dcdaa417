"""Samples of a patient's parameters for studies of uncertainty: misleading ones are refused."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence, Sized

from eclsim.arguments import written
from eclsim.cases.quantities import quantity
from eclsim.inputs.mistakes import CaseError, Mistake
from eclsim.spelling import did_you_mean


def as_samples(samples: Mapping[str, Sequence[float]]) -> Mapping[str, Sequence[float]]:
    """Check that samples are lists of numbers by parameter, and return them.

    Raises:
        TypeError: They are not.
    """
    allowed = 'lists of numbers by parameter, such as {"Rmc": [0.8, 0.9]}'
    if not isinstance(samples, Mapping):
        raise TypeError(f"samples: {written(samples)} names no parameter; allowed: {allowed}")
    for name, values in samples.items():
        if isinstance(values, str) or not (isinstance(values, Iterable) and isinstance(values, Sized)):
            raise TypeError(f"samples of {name}: {written(values)}; allowed: {allowed}")
        if wrong := [one for one in values if isinstance(one, str) or not hasattr(one, "__float__")]:
            raise TypeError(f"samples of {name}: {written(wrong[0])} is not a number; allowed: {allowed}")
    return samples


def check_samples(samples: Mapping[str, Sequence[float]], known: Collection[str]) -> None:
    """Refuse samples of unequal length, out of range, or of parameters that the study does not read.

    Args:
        samples: values of each parameter, in its unit, one per sample.
        known: names of the parameters that the study reads.

    Raises:
        CaseError: There are such samples; all are listed.
    """
    if mistakes := list(_mistakes(samples, known)):
        raise CaseError(mistakes)


def _mistakes(samples: Mapping[str, Sequence[float]], known: Collection[str]) -> Iterator[Mistake]:
    counts = {name: len(values) for name, values in samples.items()}
    if len({*counts.values()}) != 1 or 0 in counts.values():
        text = ", ".join(f"{name} {count}" for name, count in counts.items())
        yield Mistake("samples", "numbers of samples", text, "the same for every parameter, at least one")
    for name, values in samples.items():
        if name not in known:
            message = "not a parameter that this study uses"
            yield Mistake(name, message, suggestion=did_you_mean(name, known))
            continue
        parameter = quantity(name)
        for number, value in enumerate(map(float, values), start=1):
            if not math.isfinite(value) or (parameter is not None and not parameter.accepts(value)):
                allowed = "finite numbers" if parameter is None else parameter.allowed
                yield Mistake(name, f"sample {number} is out of range", f"{value:g}", allowed)
                break
