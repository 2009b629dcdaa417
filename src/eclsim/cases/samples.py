"""Samples of a patient's parameters, as studies of doubt take them: refused where they would mislead."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence

from eclsim.cases.quantities import quantity
from eclsim.inputs.mistakes import CaseError, Mistake
from eclsim.spelling import did_you_mean


def check_samples(samples: Mapping[str, Sequence[float]], known: Collection[str]) -> None:
    """Refuse samples that would be paired wrongly, or taken for certain since nothing reads them.

    Args:
        samples: values of each parameter, in its unit, one per sample.
        known: names of the parameters that the study reads.

    Raises:
        CaseError: With every mistake.
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
            message = "no parameter that this study reads"
            yield Mistake(name, message, suggestion=did_you_mean(name, known))
            continue
        parameter = quantity(name)
        for number, value in enumerate(map(float, values), start=1):
            if not math.isfinite(value) or (parameter is not None and not parameter.accepts(value)):
                allowed = "finite numbers" if parameter is None else parameter.allowed
                yield Mistake(name, f"sample {number} is out of range", f"{value:g}", allowed)
                break
