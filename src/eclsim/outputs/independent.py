"""The steady beat by the independent path, in the form of `simulate`."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr

from eclsim.beat.grid import PhaseGrid
from eclsim.beat.heartbeat import beat_program
from eclsim.beat.recording import all_signals, with_rates
from eclsim.circuit.assembly import assemble
from eclsim.orbit.adaptive import AdaptiveBeats, AdaptiveOptions, Waited
from eclsim.orbit.ejection import AORTIC_VALVE, LVAD, PULMONARY_ARTERY, judged, native_output
from eclsim.orbit.equation import Orbits
from eclsim.orbit.inputs import allowed_values
from eclsim.orbit.model import Model
from eclsim.orbit.status import Status
from eclsim.orbit.steady import Batch, SteadyBeats
from eclsim.outputs.dataset import labelled, outcome
from eclsim.outputs.evaluation import output_names
from eclsim.outputs.measures import Measures
from eclsim.outputs.registry import output

RECORDED = PhaseGrid(4)
"""Grid of the recorded beat: fine enough that reading off extremes and means adds nothing to the error."""

NATIVE = {AORTIC_VALVE: "aortic_valve_flow", LVAD: "lvad_flow", PULMONARY_ARTERY: "CO"}
"""Connections that carry the native output, and the outputs [L/min] that are their mean flows."""
ANY_STEP = 2**30
"""Resolution that stands for steps that adapt themselves."""


def simulate_adaptive(
    model: Model, policy: str | None = None, options: AdaptiveOptions | None = None
) -> xr.Dataset:
    """The steady beat of a model, waited for with adaptive steps of tight tolerance.

    Args:
        model: circuit and values.
        policy: blood volume policy, "as_published" or "patient_held"; left out, the model's.
        options: tolerance and patience.

    Returns:
        Waveforms over `phase`, scalar outputs, and in the attributes whether and how it converged.
    """
    beats = AdaptiveBeats(model, options)
    policy = policy or model.policy
    batch = Batch(model.circuit, model.values, 1, policy)
    batch.volume()  # refuses an unknown policy
    refused = bool(allowed_values(model.circuit).refused(batch.packed(beat_program(model.circuit))).any())
    waited = _nothing(batch) if refused else beats.wait(policy)
    signals = with_rates(model.circuit, all_signals(beats.program.explicit.assembly))
    _, recorded = beats.record(waited.state, RECORDED.phases, signals)
    series = dict(zip(signals, recorded.T, strict=True))
    measures = Measures(series, RECORDED.phases)
    outputs = {n: float(output(n).compute(measures)) for n in output_names(model.circuit)}
    status, sentence = outcome(_as_steady(batch, waited, outputs, refused), outputs)
    attributes = {
        "id": model.name,
        "converged": int(status is Status.CONVERGED),
        "status": status.name.lower(),
        "message": sentence,
        "beats": waited.beats,
        "residual": waited.change,
        "drift_ml_per_beat": waited.drift,
        "blood_volume_policy": policy,
        "tolerance": beats.options.tolerance,
        "solver": "adaptive",
    }
    return labelled(model, series, RECORDED.phases, outputs, attributes)


def _nothing(batch: Batch) -> Waited:
    """Nothing was waited for: a value is not allowed."""
    return Waited(np.full(assemble(batch.circuit).layout.size, np.nan), 0, np.inf, np.inf, False)


def _as_steady(batch: Batch, waited: Waited, outputs: Mapping[str, float], refused: bool) -> SteadyBeats:
    """The end of waiting in the form that `outcome` judges."""
    finite = np.isfinite(waited.change)
    status = Status.CONVERGED if waited.steady else Status.NOT_CONVERGED if finite else Status.NOT_FINITE
    native = native_output({place: outputs[name] for place, name in NATIVE.items() if name in outputs})
    status = Status.INVALID_INPUT if refused else judged(status, native)
    change, drift = np.array([waited.change]), np.array([waited.drift])
    orbits = Orbits(waited.state[:, None], np.array([status]), np.array([waited.beats]), change, drift)
    return SteadyBeats(batch, orbits, np.array([ANY_STEP]), np.array([native]))
