"""The steady beat computed by an independent method, and measured like any other."""

from __future__ import annotations

import numpy as np
import xarray as xr

from eclsim.beat.grid import PhaseGrid
from eclsim.beat.heartbeat import beat_program
from eclsim.beat.recording import all_signals, with_rates
from eclsim.gas.network import STATUS
from eclsim.orbit.independent import AdaptiveBeats, AdaptiveOptions, WaitingResult
from eclsim.orbit.inputs import allowed_values
from eclsim.orbit.model import Model
from eclsim.orbit.status import Status
from eclsim.orbit.steady import Batch, SolvedOrbits, start_state
from eclsim.outputs.measures import Measures
from eclsim.outputs.registry import output
from eclsim.outputs.results import labelled
from eclsim.outputs.signals import gas_dependent_outputs, needed_parameters, output_names
from eclsim.outputs.steady_beat import Waveforms, statistics_of, with_status

RECORDING_GRID = PhaseGrid(4)
"""Grid of the recorded beat, fine enough for extremes and means to add no error."""


def simulate_adaptive(
    model: Model, policy: str | None = None, options: AdaptiveOptions | None = None
) -> xr.Dataset:
    """Compute the steady beat of a model with adaptive steps of tight tolerance, without solving the orbit.

    Args:
        model: circuit and values.
        policy: blood volume policy, "as_published" or "patient_held"; None takes that of the model.
        options: tolerance and longest waiting time.

    Returns:
        Dataset as of `simulate`.
    """
    batch, beats = Batch.of(model, policy), AdaptiveBeats(model, options)
    batch.volume()  # raises an error for an unknown policy
    refused = bool(allowed_values(model.circuit).refused(batch.packed(beat_program(model.circuit))).any())
    nothing = WaitingResult(np.full(len(start_state(model)), np.nan), 0, np.inf, np.inf, False)
    waiting_result = nothing if refused else beats.wait(batch.policy)
    plain = all_signals(beats.program.explicit.assembly)
    _, recorded = beats.record(waiting_result.state, RECORDING_GRID.phases, with_rates(model.circuit, plain))
    names = with_rates(model.circuit, plain)
    known = output_names(model.circuit)
    parameters = batch.read_by_outputs(needed_parameters(model.circuit, known), np.array([0]))
    waves = {n: recorded[:, [k]] for k, n in enumerate(names)}
    measures = Measures(waves, RECORDING_GRID.phases, model.circuit, parameters)
    outputs = {n: output(n).compute(measures) for n in known}
    with_gas = bool(gas_dependent_outputs(model.circuit, known))
    gas_status = np.asarray(measures.gas(*STATUS) if with_gas else [0], dtype=int)
    series = recorded[:, [names.index(n) for n in plain]]
    beat = with_status(
        _orbits(batch, waiting_result, refused, beats.options.tolerance), tuple(outputs), outputs, plain,
        statistics_of(measures, plain, series[..., None]), {0: Waveforms(RECORDING_GRID.phases, series)},
        gas_status,
    )  # fmt: skip
    return labelled(beat, 0, model.name, model.doubts)


def _orbits(batch: Batch, waiting_result: WaitingResult, refused: bool, tolerance: float) -> SolvedOrbits:
    """Convert the state at the end of the waiting time to the result of a search."""
    finite = np.isfinite(waiting_result.change)
    status = (
        Status.CONVERGED if waiting_result.steady else Status.NOT_CONVERGED if finite else Status.NOT_FINITE
    )
    return SolvedOrbits(
        waiting_result.state[:, None], np.array([Status.INVALID_INPUT if refused else status]),
        np.array([waiting_result.beats]), np.array([waiting_result.change]), np.array([waiting_result.drift]),
        batch=batch, resolution=np.array([RECORDING_GRID.resolution]), width=1, adaptive_tolerance=tolerance,
    )  # fmt: skip
