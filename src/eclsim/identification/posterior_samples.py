"""Samples of a patient's parameters from a CSV file, such as a posterior gives."""

from __future__ import annotations

import csv
import math
from pathlib import Path

from eclsim.inputs.files import decoded, read_bytes
from eclsim.inputs.mistakes import CaseError
from eclsim.parameters import did_you_mean, thiel2025

OPEN = ("total_blood_volume_ml", "heart_rate_bpm")
"""Quantities of a patient, beside the tables' parameters, that may be uncertain."""
MAXIMUM_BYTES = 50_000_000
MOST = 1000
MOST_MISTAKES = 20


class SamplesError(ValueError):
    """A file that holds no samples; names every mistake."""


def read_samples(path: str | Path) -> dict[str, list[float]]:
    """Values by parameter, one per sample; of more than 1000 samples every n-th is taken.

    Args:
        path: CSV with a head of parameter names in the units of the tables; a row for each sample.

    Raises:
        SamplesError: With every mistake.
    """
    try:
        text = decoded(read_bytes(str(path), MAXIMUM_BYTES, "a table"), str(path))
        rows = [row for row in csv.reader(text.split("\n"), strict=True) if row]
    except CaseError as error:
        raise SamplesError(str(error)) from None
    except csv.Error as error:
        raise SamplesError(f"{path}: cannot be read: {error}") from None
    if len(rows) < 2:
        raise SamplesError(
            f"{path}: no samples; needed are a head of parameter names and a row for each sample"
        )
    head = [name.strip() for name in rows[0]]
    mistakes = [_unknown(path, name) for name in head if name not in (*thiel2025.PARAMETERS, *OPEN)]
    mistakes += [
        f"{path}: column {name} is there twice" for name in sorted({n for n in head if head.count(n) > 1})
    ]
    values = [[_value(cell) for cell in row] for row in rows[1:]]
    for line, row in enumerate(values, start=2):
        if len(row) != len(head):
            mistakes.append(f"{path}:{line}: {len(row)} values, the head has {len(head)}")
        mistakes += [
            f"{path}:{line}: {name} is no number above 0"
            for name, value in zip(head, row, strict=False)
            if not (math.isfinite(value) and value > 0.0)
        ]
        mistakes += [
            f"{path}:{line}: {name} = {value:g}: outside the allowed range; allowed: {known.allowed}"
            for name, value in zip(head, row, strict=False)
            if (known := thiel2025.PARAMETERS.get(name)) and value > 0.0 and not known.accepts(value)
        ]
    if mistakes:
        raise SamplesError("; ".join(mistakes[:MOST_MISTAKES]))
    kept = values[:: math.ceil(len(values) / MOST)]
    return {name: [row[k] for row in kept] for k, name in enumerate(head)}


def _unknown(path: str | Path, name: str) -> str:
    hint = did_you_mean(name, (*thiel2025.PARAMETERS, *OPEN))
    return f"{path}: column '{name[:40]}' is no parameter" + (f"; did you mean {hint}?" if hint else "")


def _value(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return math.nan
