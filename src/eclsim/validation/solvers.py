"""Comparison with other solvers and implementations, and properties that hold for any solver.

Conservation of blood volume tests the assembly, not the accuracy, so it is reported beside the comparison of
the two solvers. Derivatives are compared as elasticities, parameter times d output / d parameter: the entries
of one output can be compared with its largest one whatever the units of the parameters.
"""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np

from eclsim.beat.heartbeat import beat_program
from eclsim.execution import Tasks, json_format
from eclsim.files import read_table
from eclsim.orbit.equation import OrbitOptions
from eclsim.orbit.iteration import compiled_search
from eclsim.orbit.model import Model
from eclsim.orbit.steady import Batch, solve, start_state
from eclsim.outputs.registry import leading_outputs, output
from eclsim.outputs.results import derivatives, simulate, simulate_adaptive
from eclsim.outputs.steady_beat import steady_beat
from eclsim.paper.comparison import Check, Explanation, Row, at_most, within
from eclsim.parameters import shi_hose2009
from eclsim.patient.circulation import shi_hose_circulation
from eclsim.validation.reference_cases import (
    DATA,
    PROTOCOLS,
    QUICK,
    case_names,
    reference_model,
    reference_result,
    waveform_statistics,
)
from eclsim.validation.robustness import CONFIGURATIONS, Effort, configuration_model

RELATIVE = 0.001
ABSOLUTE = {"mmHg": 0.01, "L/min": 0.002, "mL": 0.05}
"""A tenth of the tolerance of outputs of reference cases; 0.1 % of a flow near zero is meaningless."""
PERIODICITY = 1e-8
CONSERVATION = 1e-10
BEATS = 1000
ADAPTIVE_QUICK = tuple(PROTOCOLS["reference"]["adaptive"])


def adaptive_check(effort: Effort) -> Check:
    """Compare outputs of both solvers for the reference cases."""
    names = ADAPTIVE_QUICK if effort.quick else case_names()
    tasks = Tasks("adaptive", "cases", _both, names, {"cases": list(names)})
    rows = tuple(row for pair in effort.complete(tasks, json_format(list[Row])) for row in pair)
    title = f"Semi-implicit beat against Dopri8 with adaptive steps ({len(names)} cases)"
    beyond = [row for row in rows if row.holds and abs(row.percent or 0.0) > 100.0 * RELATIVE]
    remarks = tuple(
        f"{row.name} differs by {row.percent:+.2f} %, {row.difference:+.2g} {row.unit}" for row in beyond
    )
    return Check("adaptive", title, "0.1 %, or 0.01 mmHg, 0.002 L/min, 0.05 mL", rows, remarks=remarks)


def _both(name: str) -> list[Row]:
    result, other = reference_result(name), simulate_adaptive(reference_model(name))
    rows = []
    for entry in leading_outputs():
        if entry.name in result:
            expected, got = float(other[entry.name]), float(result[entry.name])
            tolerance = max(RELATIVE * abs(expected), ABSOLUTE[entry.unit])
            rows.append(within(f"{name} {entry.name}", expected, got, tolerance, entry.unit))
    return rows


def periodicity_check(quick: bool) -> Check:
    """Check the largest change of a state over one more plain beat, for each reference case."""
    rows = []
    for name in QUICK if quick else case_names():
        orbits = solve(Batch.of(reference_model(name)))
        before, after = orbits.states, orbits.wait(np.array([0]), orbits.states)
        change = np.max(np.abs(after - before) / np.maximum(np.abs(before), 1.0))
        rows.append(at_most(f"{name} change over a beat", float(change), PERIODICITY))
    return Check("periodicity", "Periodicity of the solved orbits", "1e-8 of each state", tuple(rows))


def conservation_check(quick: bool) -> Check:
    """Check the relative change of the blood volume over many plain beats, for every configuration."""
    models = {name: configuration_model(name) for name in CONFIGURATIONS}
    if not quick:
        models |= {name: reference_model(name) for name in case_names()}
    rows = [
        at_most(f"{name}: blood volume over {BEATS} beats", volume_error(model, BEATS), CONSERVATION)
        for name, model in models.items()
    ]
    return Check("conservation", f"Blood volume over {BEATS} beats", "1e-10 relative", tuple(rows))


def volume_error(model: Model, beats: int) -> float:
    """Largest relative change of the stressed blood volume during several beats."""
    program = beat_program(model.circuit)
    search, packed = compiled_search(program, 1), Batch.of(model).packed(program)
    state, volumes = start_state(model)[:, None], program.assembly.layout.volumes.where
    start, error = state[volumes].sum(), 0.0
    for _ in range(beats):
        state = search.wait(state, packed)
        error = max(error, abs(state[volumes].sum() / start - 1.0))
    return float(error)


# --- the circulation of Shi and Hose 2009 ---------------------------------------------------------

SHI_HOSE_SOURCE = "Shi and Hose 2009 CellML model; integrated independently with SciPy"


def shi_hose_check() -> Check:
    """Compare with the CellML model, an independent implementation of the same equations.

    The expected numbers come from a SciPy integration (DOP853, relative tolerance 1e-8) of the published
    CellML model, beat 20 from its initial state, when the state changes by 2e-5 per beat. They agree with the
    published traces to 0.005 mL and 0.003 mmHg. eclsim computes the periodic state. The model is not a
    healthy adult: its mean pulmonary arterial pressure is 40 mmHg.
    """
    values = {key: parameter.value for key, parameter in shi_hose2009.PARAMETERS.items()}
    result, rows = simulate(Model(shi_hose_circulation(), values, "Shi and Hose 2009")), []
    for row in read_table(DATA / "shi_hose2009.csv"):
        signal, _, kind = row["output"].partition(" ")  # an output, or mean, min or max of a waveform
        got = waveform_statistics(result, signal)[kind] if kind else float(result[signal])
        expected = float(row["value"])
        last_digit = 0.5 * 10.0 ** -len(row["value"].partition(".")[2])
        tolerance = max(RELATIVE * expected, last_digit)
        rows.append(within(row["output"], expected, got, tolerance, row["unit"], source=SHI_HOSE_SOURCE))
    title = "Shi and Hose 2009 (CellML) at the periodic state"
    return Check("shi-hose", title, "0.1 % of each scalar", tuple(rows))


# --- derivatives ------------------------------------------------------------------------------------


CASES: dict[str, str] = PROTOCOLS["gradients"]
"""Keys of `gradients.json`, and the reference cases they belong to."""
SHARE_OF_LARGEST = 0.01
BAR = "1 % of the largest of each output"
SHARE_OF_LARGEST_DIFFERENCES = 1e-5
STEP = 2e-5
"""Relative step h of the central differences, extrapolated from h and h/2 to fourth order.

A beat on a fixed grid has a kink wherever the opening or closing of a valve crosses a grid point. A step must
remain between two of them, or it measures the kinks.
"""
FINER = 2
"""Refinement of the grid: twice the resolution, i.e. half the step."""
GRID = (
    "this is the error of the default grid, for which the derivative is exact; with half the step it is "
    "within the tolerance"
)
TIGHT = OrbitOptions(tolerance=1e-12, error_tolerance=1e-11, quasi_newton_beats=60)


Names = tuple[str, ...]


def _exact(model: Model, outputs: Names, parameters: Names, resolution: int | None) -> np.ndarray:
    slopes = derivatives(model, outputs, parameters, resolution=resolution)
    return slopes.values * slopes["parameter_value"].values


def own_differences(model: Model, outputs: Names, parameters: Names) -> np.ndarray:
    """Central differences of tightly solved orbits, extrapolated; shape (outputs, parameters)."""
    factors = (1.0 + STEP, 1.0 - STEP, 1.0 + STEP / 2, 1.0 - STEP / 2)
    count = len(factors) * len(parameters)
    values: dict[str, np.ndarray | float] = dict(model.values)
    for k, name in enumerate(parameters):
        column = np.full(count, model.values[name])
        column[len(factors) * k : len(factors) * (k + 1)] *= factors
        values[name] = column
    beat = steady_beat(Batch(model.circuit, values, count), outputs, options=TIGHT, start=model.values)
    table = beat.values.reshape(len(outputs), len(parameters), len(factors))
    coarse = (table[..., 0] - table[..., 1]) / (2.0 * STEP)
    fine = (table[..., 2] - table[..., 3]) / STEP
    return (4.0 * fine - coarse) / 3.0


def gradient_checks() -> list[Check]:
    """Compare the derivatives of both cases in all ways."""
    published, finer, own = list[Row](), list[Row](), list[Row]()
    table = json.loads((DATA / "gradients.json").read_text(encoding="utf-8"))
    for key, case in CASES.items():
        model, printed = reference_model(case), np.array(table[key]["elasticity_fd"])
        names = tuple(table[key]["outputs"]), tuple(table[key]["params"])
        exact, half = (_exact(model, *names, resolution) for resolution in (None, FINER))
        half_step = _rows(case, names, half, printed, SHARE_OF_LARGEST)
        differences = own_differences(model, *names)
        own_rows = _rows(case, names, exact, differences, SHARE_OF_LARGEST_DIFFERENCES)
        whys = [Explanation(GRID, evidence) for evidence in zip(half_step, own_rows, strict=True)]
        published += _rows(case, names, exact, printed, SHARE_OF_LARGEST, whys)
        finer += half_step
        own += own_rows
    title = "Derivatives against central differences of the published code"
    return [
        Check("gradients", f"{title}, default grid", BAR, tuple(published)),
        Check("gradients-finer", f"{title}, half the step", BAR, tuple(finer)),
        Check(
            "own-gradients", "Derivatives against own central differences of the converged orbit",
            "1e-5 of the largest of each output", tuple(own),
        ),
    ]  # fmt: skip


def _rows(
    case: str,
    names: tuple[Names, Names],
    got: np.ndarray,
    expected: np.ndarray,
    share: float,
    explanations: Sequence[Explanation] | None = None,
) -> list[Row]:
    rows: list[Row] = []
    for i, name in enumerate(names[0]):
        tolerance = share * float(np.abs(expected[i]).max())
        for k, parameter in enumerate(names[1]):
            label, unit = f"{case} d {name} / d ln {parameter}", output(name).unit
            explanation = explanations[len(rows)] if explanations else None
            rows.append(within(label, expected[i, k], got[i, k], tolerance, unit, explanation=explanation))
    return rows
