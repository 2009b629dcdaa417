"""The steady beat by the independent path, in the form of `simulate`."""

from __future__ import annotations

import numpy as np
import xarray as xr

from eclsim.haemodynamics.dataset import labelled, outcome
from eclsim.haemodynamics.evaluation import output_names
from eclsim.haemodynamics.measures import Measures
from eclsim.haemodynamics.outputs import output
from eclsim.solver.adaptive import AdaptiveBeats, AdaptiveOptions, Waited
from eclsim.solver.grid import PhaseGrid
from eclsim.solver.model import AS_PUBLISHED, Model
from eclsim.solver.orbit import Orbits
from eclsim.solver.recording import all_signals, with_rates
from eclsim.solver.status import Status
from eclsim.solver.steady import Batch, SteadyBeats

RECORDED = PhaseGrid(4)
"""Grid of the recorded beat: fine enough that reading off extremes and means adds nothing to the error."""


def simulate_adaptive(
    model: Model, policy: str = AS_PUBLISHED, options: AdaptiveOptions | None = None
) -> xr.Dataset:
    """The steady beat of a model, waited for with adaptive steps of tight tolerance.

    Args:
        model: circuit and values.
        policy: blood volume policy, "as_published" or "patient_held".
        options: tolerance and patience.

    Returns:
        Waveforms over `phase`, scalar outputs, and in the attributes whether and how it converged.
    """
    beats = AdaptiveBeats(model, options)
    Batch(model.circuit, model.values, 1, policy).volume()  # refuses an unknown policy
    waited = beats.wait(policy)
    signals = with_rates(model.circuit, all_signals(beats.program.explicit.assembly))
    _, recorded = beats.record(waited.state, RECORDED.phases, signals)
    series = dict(zip(signals, recorded.T, strict=True))
    measures = Measures(series, RECORDED.phases)
    outputs = {n: float(output(n).compute(measures)) for n in output_names(model.circuit)}
    status, sentence = outcome(_as_steady(model, policy, waited), outputs)
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


def _as_steady(model: Model, policy: str, waited: Waited) -> SteadyBeats:
    """The end of waiting in the form that `outcome` judges."""
    finite = np.isfinite(waited.change)
    status = Status.CONVERGED if waited.steady else Status.NOT_CONVERGED if finite else Status.NOT_FINITE
    change, drift = np.array([waited.change]), np.array([waited.drift])
    orbits = Orbits(waited.state[:, None], np.array([status]), np.array([waited.beats]), change, drift)
    return SteadyBeats(Batch(model.circuit, model.values, 1, policy), orbits, np.zeros(1, dtype=int))
