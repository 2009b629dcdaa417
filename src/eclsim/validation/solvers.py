"""eclsim against other solvers and other implementations, and what must hold whatever the solver is.

Blood volume tests the wiring and not the accuracy, so it stands beside the comparison of the two solvers.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from eclsim.beat.heartbeat import beat_program
from eclsim.execution import Tasks, json_format
from eclsim.orbit.iteration import compiled_search
from eclsim.orbit.model import Model
from eclsim.orbit.steady import Batch, solve, start_state
from eclsim.outputs.independent import simulate_adaptive
from eclsim.outputs.registry import contract
from eclsim.outputs.results import simulate
from eclsim.paper.comparison import Check, Row, at_most, near
from eclsim.parameters import shi_hose2009
from eclsim.patient.circulation import shi_hose_circulation
from eclsim.validation.effort import Effort
from eclsim.validation.reference_cases import (
    QUICK,
    case_names,
    read_table,
    reference_model,
    reference_result,
    waveform_statistics,
)
from eclsim.validation.robustness import CONFIGURATIONS, configuration_model

if TYPE_CHECKING:
    import xarray as xr

RELATIVE = 0.001
ABSOLUTE = {"mmHg": 0.01, "L/min": 0.002, "mL": 0.05}
"""A tenth of what an output of a reference case may be off by: 0.1 % of a flow near zero means nothing."""
PERIODICITY = 1e-8
CONSERVATION = 1e-10
BEATS = 1000
ADAPTIVE_QUICK = ("cvs_healthy_75bpm", "va_ecmo_default", "lvad_hvad_2600")


def adaptive_check(effort: Effort) -> Check:
    """Outputs of both solvers for the reference cases."""
    names = ADAPTIVE_QUICK if effort.quick else case_names()
    tasks = Tasks("adaptive", "cases", _both, names, {"cases": list(names)})
    rows = tuple(row for both in effort.complete(tasks, json_format(list[Row])) for row in both)
    title = f"Semi-implicit beat against Dopri8 with adaptive steps ({len(names)} cases)"
    beyond = [row for row in rows if row.holds and abs(row.percent or 0.0) > 100.0 * RELATIVE]
    remarks = tuple(
        f"{row.name} differs by {row.percent:+.2f} %, {row.difference:+.2g} {row.unit}" for row in beyond
    )
    return Check("adaptive", title, "0.1 %, or 0.01 mmHg, 0.002 L/min, 0.05 mL", rows, remarks=remarks)


def _both(name: str) -> list[Row]:
    result, other = reference_result(name), simulate_adaptive(reference_model(name))
    rows = []
    for entry in contract():
        if entry.name in result:
            expected, got = float(other[entry.name]), float(result[entry.name])
            tolerance = max(RELATIVE * abs(expected), ABSOLUTE[entry.unit])
            rows.append(near(f"{name} {entry.name}", expected, got, tolerance, entry.unit))
    return rows


def periodicity_check(quick: bool = False) -> Check:
    """Largest change of a state over one more plain beat, for each reference case."""
    rows = []
    for name in QUICK if quick else case_names():
        orbits = solve(Batch.of(reference_model(name)))
        before, after = orbits.states, orbits.wait(np.array([0]), orbits.states)
        change = np.max(np.abs(after - before) / np.maximum(np.abs(before), 1.0))
        rows.append(at_most(f"{name} change over a beat", float(change), PERIODICITY))
    return Check("periodicity", "Periodicity of the solved orbits", "1e-8 of each state", tuple(rows))


def conservation_check(quick: bool = False, beats: int = BEATS) -> Check:
    """Relative change of the blood volume over many plain beats, every configuration."""
    models = {name: configuration_model(name) for name in CONFIGURATIONS}
    if not quick:
        models |= {name: reference_model(name) for name in case_names()}
    rows = [
        at_most(f"{name}: blood volume over {beats} beats", volume_error(model, beats), CONSERVATION)
        for name, model in models.items()
    ]
    return Check("conservation", f"Blood volume over {beats} beats", "1e-10 relative", tuple(rows))


def volume_error(model: Model, beats: int) -> float:
    """Largest relative change of the stressed blood volume along some beats."""
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
    """Scalars of the CellML model, an independent implementation of the same equations.

    The expected numbers come from a SciPy integration (DOP853, relative tolerance 1e-8) of the published
    CellML model, beat 20 from its initial state, when the state changes by 2e-5 a beat; it agrees with the
    published traces to 0.005 mL and 0.003 mmHg. eclsim gives the periodic state. It is no healthy adult: its
    mean pulmonary arterial pressure is 40 mmHg.
    """
    rows = []
    for row in read_table("shi_hose2009.csv"):
        expected, got = float(row["value"]), _shi_hose_value(row["output"])
        last_digit = 0.5 * 10.0 ** -len(row["value"].partition(".")[2])
        tolerance = max(RELATIVE * expected, last_digit)
        rows.append(near(row["output"], expected, got, tolerance, row["unit"], source=SHI_HOSE_SOURCE))
    title = "Shi and Hose 2009 (CellML) at the periodic state"
    return Check("shi-hose", title, "0.1 % of each scalar", tuple(rows))


@lru_cache(maxsize=1)
def _shi_hose_result() -> xr.Dataset:
    values = {key: parameter.value for key, parameter in shi_hose2009.PARAMETERS.items()}
    return simulate(Model(shi_hose_circulation(), values, "Shi and Hose 2009"))


def _shi_hose_value(name: str) -> float:
    """An output of the registry, or a waveform and "mean", "min" or "max"."""
    signal, _, kind = name.partition(" ")
    result = _shi_hose_result()
    return waveform_statistics(result, signal)[kind] if kind else float(result[name])
