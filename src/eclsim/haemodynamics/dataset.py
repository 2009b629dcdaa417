"""Labelled results: the steady beat of one model as an xarray Dataset."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from eclsim.circuit.network import Circuit
from eclsim.haemodynamics.alarms import findings
from eclsim.haemodynamics.evaluation import output_names
from eclsim.haemodynamics.measures import Measures
from eclsim.haemodynamics.outputs import output
from eclsim.haemodynamics.recirculation import recirculated_fraction
from eclsim.haemodynamics.signals import unstressed_volume, whole_beat
from eclsim.solver.beat import beat_program
from eclsim.solver.model import AS_PUBLISHED, Model
from eclsim.solver.orbit import OrbitOptions
from eclsim.solver.recording import MEAN, RATE
from eclsim.solver.status import Status
from eclsim.solver.steady import Batch, SteadyBeats, steady_beats

NO_EJECTION_L_MIN = 0.02
UNITS = {"P": "mmHg", "Q": "mL/s", "V": "mL"}
WORDS = {"P": "pressure in", "Q": "flow through", "V": "blood volume of"}


def simulate(
    model: Model,
    policy: str = AS_PUBLISHED,
    options: OrbitOptions | None = None,
    resolution: int | None = None,
) -> xr.Dataset:
    """The steady beat of a model.

    Args:
        model: circuit and values.
        policy: blood volume policy, "as_published" or "patient_held".
        options: accuracy and effort of the orbit solver.
        resolution: of the phase grid; left out, what the circuit's time constants need.

    Returns:
        Waveforms over `phase`, scalar outputs, and in the attributes whether and how it converged.
    """
    steady = steady_beats(Batch(model.circuit, model.values, 1, policy), options, resolution=resolution)
    return dataset_of(model, steady)


def dataset_of(model: Model, steady: SteadyBeats) -> xr.Dataset:
    """Dataset of a batch of one."""
    program = beat_program(model.circuit, int(steady.resolution[0]))
    signals = program.signals
    _, recorded = program.trace(signals)(steady.orbits.states[:, 0], steady.batch.packed(program)[:, 0])
    series = dict(zip(signals, whole_beat(np.asarray(recorded)).T, strict=True))
    measures = Measures(series, program.grid.phases)
    outputs = {n: float(output(n).compute(measures)) for n in output_names(model.circuit)}
    status, sentence = outcome(steady, outputs)
    attributes = {
        "id": model.name,
        "converged": int(status is Status.CONVERGED),
        "status": status.name.lower(),
        "message": sentence,
        "beats": int(steady.orbits.beats[0]),
        "residual": float(steady.orbits.residual[0]),
        "drift_ml_per_beat": float(steady.orbits.drift[0]),
        "blood_volume_policy": steady.batch.policy,
        "steps_per_beat": program.grid.n_steps,
        "solver": "semi-implicit",
    }
    return labelled(model, series, program.grid.phases, outputs, attributes)


def labelled(
    model: Model,
    series: dict[str, np.ndarray],
    phases: np.ndarray,
    outputs: dict[str, float],
    attributes: Any,
) -> xr.Dataset:
    """Waveforms and outputs with names, units and definitions."""
    period = 60.0 / model.values["heart_rate_bpm"]
    phase = _variable("phase", phases, units="1", long_name="phase of the beat")
    time = _variable("phase", phases * period, units="s", long_name="time")
    data: dict[str, Any] = {}
    for name, values in series.items():
        if name.endswith((RATE, MEAN)):
            continue
        words = (
            f"{WORDS[name[0]]} {name[1:]}" if "pump" not in name or name[0] != "P" else f"head of {name[1:]}"
        )
        shift = unstressed_volume(model.circuit, name[1:], model.values) if name[0] == "V" else 0.0
        data[name] = _variable("phase", values + shift, units=UNITS[name[0]], long_name=words)
    for name, value in outputs.items():
        entry = output(name)
        data[name] = _variable(
            (), value, units=entry.unit, long_name=entry.long_name, definition=entry.definition
        )
    result = xr.Dataset(data, coords={"phase": phase, "time": time}, attrs=attributes)
    _add_recirculation(result, model.circuit.with_chosen_sites(model.values))
    extremes = {n: (float(v.min()), float(v.max())) for n, v in series.items()}
    result.attrs["warnings"] = [f.sentence for f in findings(outputs, extremes)]
    return result


def _add_recirculation(result: xr.Dataset, circuit: Circuit) -> None:
    fraction = recirculated_fraction(
        circuit, {c.name: _mean(result, "Q" + c.name) for c in circuit.connections}
    )
    if fraction is None:
        return
    flow = fraction * _mean(result, "Qcrrtpump") * 0.06
    definition = (
        "share of the access flow that left the return line and did not pass the patient (steady mixing)"
    )
    result["crrt_recirculated_fraction"] = _variable(
        (), fraction, units="1", long_name="recirculated share of the CRRT flow", definition=definition
    )
    result["crrt_recirculated_flow"] = _variable(
        (), flow, units="L/min", long_name="recirculated CRRT flow", definition=definition
    )


def _variable(dims: str | tuple[str, ...], values: Any, **labels: str) -> xr.Variable:
    """A labelled array; xarray's short way to it does not import dask, which takes half a second."""
    return xr.Variable(dims, np.asarray(values), labels, fastpath=True)


def _mean(result: xr.Dataset, name: str) -> float:
    return float(np.trapezoid(result[name].values, result["phase"].values))


def outcome(steady: SteadyBeats, outputs: dict[str, float]) -> tuple[Status, str]:
    """Status and sentence: a heart that does not eject and does not settle is named as such."""
    status = Status(int(steady.orbits.status[0]))
    if not all(np.isfinite(v) for v in outputs.values()):
        status = Status.NOT_FINITE
    drift = f"residual {steady.orbits.residual[0]:.1e}, drift {steady.orbits.drift[0]:.2g} mL a beat"
    left = outputs.get("aortic_valve_flow", np.inf) + outputs.get("lvad_flow", 0.0)
    native = max(left, outputs.get("CO", left))
    if status is Status.NOT_CONVERGED and native < NO_EJECTION_L_MIN:
        return Status.NO_EJECTION, f"{Status.NO_EJECTION.message} (native output {native:.3g} L/min, {drift})"
    return status, status.message if status is Status.CONVERGED else f"{status.message} ({drift})"
