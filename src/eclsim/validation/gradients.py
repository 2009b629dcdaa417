"""Derivatives: against central differences of the published code and of eclsim's own converged orbit.

Rows are elasticities, parameter times d output / d parameter, so that a row of one output can be compared
with its own largest entry whatever the units of the parameters are.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eclsim.orbit.equation import OrbitOptions
from eclsim.orbit.model import Model
from eclsim.orbit.steady import Batch
from eclsim.outputs.registry import output
from eclsim.outputs.results import derivatives
from eclsim.outputs.steady_beat import steady_beat
from eclsim.paper.comparison import Check, Explanation, Row, near
from eclsim.validation.reference_cases import DATA, reference_model

CASES = {"default": "va_ecmo_default", "s4": "s4_no_crrt_3425"}
"""Key of `gradients.json`, and the reference case it belongs to."""
OF_LARGEST = 0.01
BAR = "1 % of the largest of each output"
OF_LARGEST_OWN = 1e-5
STEP = 2e-5
"""Relative step h of the own differences, extrapolated from h and h/2 to fourth order.

The beat on a fixed grid has a kink wherever a valve's opening or closing crosses a grid point; a step must
stay between two of them, or it measures the kinks.
"""
FINER = 2
"""Resolution of the grid with half the step."""
GRID = (
    "exact for the default grid, whose own error this is: with half the step the derivative is within the bar"
)
TIGHT = OrbitOptions(tolerance=1e-12, error_tolerance=1e-11, quasi_newton_beats=60)


@dataclass(frozen=True)
class Elasticities:
    """Elasticities of the outputs, shape (outputs, parameters), on two grids and by differences."""

    outputs: tuple[str, ...]
    parameters: tuple[str, ...]
    exact: np.ndarray
    finer: np.ndarray
    published: np.ndarray
    own_differences: np.ndarray


def elasticities(key: str) -> Elasticities:
    """All of them for a case of `gradients.json`."""
    published = json.loads((DATA / "gradients.json").read_text(encoding="utf-8"))[key]
    model = reference_model(CASES[key])
    outputs, parameters = tuple(published["outputs"]), tuple(published["params"])
    exact, finer = (_exact(model, outputs, parameters, resolution) for resolution in (None, FINER))
    differences = own_differences(model, outputs, parameters)
    return Elasticities(outputs, parameters, exact, finer, np.array(published["elasticity_fd"]), differences)


def _exact(
    model: Model, outputs: tuple[str, ...], parameters: tuple[str, ...], resolution: int | None
) -> np.ndarray:
    slopes = derivatives(model, outputs, parameters, resolution=resolution)
    return slopes.values * slopes["parameter_value"].values


def own_differences(model: Model, outputs: tuple[str, ...], parameters: tuple[str, ...]) -> np.ndarray:
    """Central differences of tightly solved orbits, extrapolated; shape (outputs, parameters)."""
    factors = (1.0 + STEP, 1.0 - STEP, 1.0 + STEP / 2, 1.0 - STEP / 2)
    count = len(factors) * len(parameters)
    values: dict[str, np.ndarray | float] = dict(model.values)
    for k, name in enumerate(parameters):
        column = np.full(count, model.values[name])
        column[len(factors) * k : len(factors) * (k + 1)] *= factors
        values[name] = column
    beat = steady_beat(Batch(model.circuit, values, count), outputs, options=TIGHT, start=model.values)
    found = beat.values.reshape(len(outputs), len(parameters), len(factors))
    coarse = (found[..., 0] - found[..., 1]) / (2.0 * STEP)
    fine = (found[..., 2] - found[..., 3]) / STEP
    return (4.0 * fine - coarse) / 3.0


def checks() -> list[Check]:
    """All comparisons, of both cases."""
    published: list[Row] = []
    finer: list[Row] = []
    own: list[Row] = []
    for key, case in CASES.items():
        found = elasticities(key)
        half_step = _rows(case, found, found.finer, found.published, OF_LARGEST)
        differences = _rows(case, found, found.exact, found.own_differences, OF_LARGEST_OWN)
        whys = [Explanation(GRID, evidence) for evidence in zip(half_step, differences, strict=True)]
        published += _rows(case, found, found.exact, found.published, OF_LARGEST, whys)
        finer += half_step
        own += differences
    words = "Derivatives against central differences of the published code"
    return [
        Check("gradients", f"{words}, default grid", BAR, tuple(published)),
        Check("gradients-finer", f"{words}, half the step", BAR, tuple(finer)),
        Check(
            "own-gradients", "Derivatives against own central differences of the converged orbit",
            "1e-5 of the largest of each output", tuple(own),
        ),
    ]  # fmt: skip


def _rows(
    case: str,
    found: Elasticities,
    got: np.ndarray,
    expected: np.ndarray,
    share: float,
    explanations: Sequence[Explanation] | None = None,
) -> list[Row]:
    rows: list[Row] = []
    for i, name in enumerate(found.outputs):
        tolerance = share * float(np.abs(expected[i]).max())
        for k, parameter in enumerate(found.parameters):
            label, unit = f"{case} d {name} / d ln {parameter}", output(name).unit
            why = explanations[len(rows)] if explanations else None
            rows.append(near(label, expected[i, k], got[i, k], tolerance, unit, explanation=why))
    return rows
