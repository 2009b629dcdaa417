"""Patients and animals made to have measured values: what a study's answer is computed in."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from eclsim.orbit.model import Model
from eclsim.outputs.results import simulate_many

Measure = Callable[[Mapping[str, np.ndarray]], np.ndarray]
"""From values of some parameters, each of shape (variants,), to quantities, shape (variants, quantities)."""
_ACCURACY, _STEPS = 1e-6, 40


class UnreachableError(ArithmeticError):
    """No values of the parameters give what was measured."""


def with_quantities(patient: Model, unknown: Sequence[str], measure: Measure, goal: Sequence[float]) -> Model:
    """The patient whose quantities are those of a goal, by Newton's method with differences.

    Parameters above 0 are sought by their logarithm, those at or below 0 as they are (volumes in mL).

    Raises:
        UnreachableError: it is not met within the steps allowed.
    """
    start = np.array([patient.values[name] for name in unknown])
    logarithmic = (start > 0.0) & [not name.endswith("_ml") for name in unknown]
    difference, longest = np.where(logarithmic, 1e-3, 1.0), np.where(logarithmic, 0.4, 400.0)
    target, moved = np.array(goal), np.zeros(len(start))

    def values(points: np.ndarray) -> dict[str, np.ndarray]:
        columns = np.where(logarithmic, start * np.exp(np.where(logarithmic, points, 0.0)), start + points)
        return dict(zip(unknown, columns.T, strict=True))

    for _ in range(_STEPS):
        table = measure(values(np.vstack([moved, moved + np.diag(difference)])))
        missing = target - table[0]
        if np.all(np.abs(missing) < _ACCURACY * np.maximum(np.abs(target), 1.0)):
            return patient.with_values({name: float(v) for name, v in values(moved).items()})
        if not np.isfinite(table).all():
            break
        step = np.linalg.solve((table[1:] - table[0]).T / difference, missing)
        moved = moved + step / max(1.0, float(np.max(np.abs(step) / longest)))
    names = ", ".join(unknown)
    raise UnreachableError(f"{patient.name}: no {names} give {goal}; the last try gave {table[0].tolist()}")


def with_outputs(patient: Model, unknown: Sequence[str], goal: Mapping[str, float]) -> Model:
    """The same for outputs of the registry."""

    def measure(values: Mapping[str, np.ndarray]) -> np.ndarray:
        results = simulate_many(patient, values, list(goal))
        return np.stack([results[name].values for name in goal], axis=-1)

    return with_quantities(patient, unknown, measure, list(goal.values()))
