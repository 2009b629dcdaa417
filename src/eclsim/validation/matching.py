"""Patients and animals as starting points of comparisons: matched to measured values, with other pathways."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from eclsim.orbit.model import Model
from eclsim.outputs.results import simulate_many
from eclsim.regulation.attach import with_reflex
from eclsim.regulation.heldt import HELDT_2010
from eclsim.regulation.reflex import Effector, ReflexModel

Measure = Callable[[Mapping[str, np.ndarray]], np.ndarray]
"""Maps values of parameters, each of shape (variants,), to quantities, shape (variants, quantities)."""
_ACCURACY, _STEPS = 1e-6, 40


class UnreachableError(ArithmeticError):
    """Raised if no values of the parameters give the measured values."""


def with_quantities(patient: Model, unknown: Sequence[str], measure: Measure, goal: Sequence[float]) -> Model:
    """Return the patient whose quantities equal given values, by Newton's method with finite differences.

    The search uses logarithms of parameters above 0, and others unchanged (volumes in mL).

    Raises:
        UnreachableError: The values are not reached within the allowed steps.
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
    raise UnreachableError(
        f"{patient.name}: no values of {names} result in {goal}; the last attempt gave {table[0].tolist()}"
    )


def with_outputs(patient: Model, unknown: Sequence[str], goal: Mapping[str, float]) -> Model:
    """Return the patient whose outputs equal given values."""

    def measure(values: Mapping[str, np.ndarray]) -> np.ndarray:
        results = simulate_many(patient, values, list(goal))
        return np.stack([results[name].values for name in goal], axis=-1)

    return with_quantities(patient, unknown, measure, list(goal.values()))


# --- an experiment on missing pathways: the cardiopulmonary ones of another model ------------------


CARDIOPULMONARY = "cardiopulmonary"


def joined(own: ReflexModel, other: ReflexModel = HELDT_2010) -> ReflexModel:
    """Replace the cardiopulmonary pathways of a reflex, if any, by those of another one.

    The relative response of resistance per mmHg is that of all vascular beds of the other model together.
    """
    kept = [not pathway.name.endswith(CARDIOPULMONARY) for pathway in own.pathways]
    added = [k for k, pathway in enumerate(other.pathways) if pathway.name.endswith(CARDIOPULMONARY)]
    beds = other.effector("Rmc")
    conductance = sum(1.0 / reference for reference in beds.reference)
    shares = [
        sum(gains[k] / reference**2 for reference, gains in zip(beds.reference, beds.gains, strict=True))
        / conductance
        for k in added
    ]

    def with_both(effector: Effector) -> Effector:
        resistance = effector.parameter == "Rmc"
        gains = tuple(
            (*(g * keep for g, keep in zip(bed, kept, strict=True)),
             *(share * reference * resistance for share in shares))
            for reference, bed in zip(effector.reference, effector.gains, strict=True)
        )  # fmt: skip
        return replace(effector, gains=gains, least=beds.least if resistance else effector.least)

    blood = own.blood_volume_ml / other.blood_volume_ml
    return replace(
        own,
        reads=other.reads,
        pathways=(*own.pathways, *(other.pathways[k]._replace(name=f"other_{k}") for k in added)),
        drives=lambda d: [*own.drives(d[: len(own.reads)]), *(other.drives(d)[k] for k in added)],
        effectors=tuple(map(with_both, own.effectors)),
        venous_gains_ml=(
            *(gain * keep for gain, keep in zip(own.venous_gains_ml, kept, strict=True)),
            *(blood * other.venous_gains_ml[k] for k in added),
        ),
    )


def with_cardiopulmonary(patient: Model, own: ReflexModel) -> Model:
    """Replace the reflex `heldt2010` of a patient by another one joined with its cardiopulmonary pathways."""
    return replace(patient, circuit=with_reflex(replace(patient.circuit, controllers=()), joined(own)))
