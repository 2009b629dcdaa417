"""Labelled results: the steady beat of one model as an xarray Dataset."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from eclsim.beat.heartbeat import beat_program
from eclsim.beat.recording import MEAN, RATE
from eclsim.circuit.network import Circuit
from eclsim.orbit.equation import OrbitOptions
from eclsim.orbit.model import Model
from eclsim.orbit.status import Status
from eclsim.orbit.steady import Batch, SteadyBeats, steady_beats
from eclsim.outputs.alarms import findings, impossible
from eclsim.outputs.evaluation import output_names
from eclsim.outputs.measures import Measures
from eclsim.outputs.recirculation import recirculated_fraction
from eclsim.outputs.registry import output
from eclsim.outputs.sealed import sealed, shut_valves
from eclsim.outputs.signals import unstressed_volume, whole_beat

UNITS = {"P": "mmHg", "Q": "mL/s", "V": "mL"}
WORDS = {"P": "pressure in", "Q": "flow through", "V": "blood volume of"}


def simulate(
    model: Model,
    policy: str | None = None,
    options: OrbitOptions | None = None,
    resolution: int | None = None,
    repeated: bool = False,
) -> xr.Dataset:
    """The steady beat of a model.

    Args:
        model: circuit and values.
        policy: blood volume policy, "as_published" or "patient_held"; left out, the model's.
        options: accuracy and effort of the orbit solver.
        resolution: of the phase grid; left out, what the circuit's time constants need.
        repeated: True where many models are solved one by one: one more program is loaded or compiled, and
            each beat takes a third less time.

    Returns:
        Waveforms over `phase`, scalar outputs, and in the attributes whether and how it converged.
    """
    batch = Batch(model.circuit, model.values, 1, policy or model.policy)
    steady = steady_beats(batch, options, resolution=resolution, lone=repeated)
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
    result = labelled(model, series, program.grid.phases, outputs, attributes)
    doubt = steady.grid_doubt()
    result.attrs["warnings"] += [doubt] if doubt else []
    return result


def labelled(
    model: Model,
    series: dict[str, np.ndarray],
    phases: np.ndarray,
    outputs: dict[str, float],
    attributes: Any,
) -> xr.Dataset:
    """Waveforms and outputs with names, units and definitions."""
    rate = model.values["heart_rate_bpm"]
    period = 60.0 / rate if rate > 0.0 else np.nan
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
    result.attrs |= {"warnings": [], "impossible": 0, "one_of_many": 0}
    if attributes["status"] != Status.INVALID_INPUT.name.lower():
        circuit = model.circuit.with_chosen_sites(model.values)
        _add_recirculation(result, circuit)
        _add_findings(result, outputs, series, circuit)
    return result


def _add_findings(
    result: xr.Dataset, outputs: dict[str, float], series: dict[str, np.ndarray], circuit: Circuit
) -> None:
    """Warnings, whether the beat can be a patient's, and on each output what kinds of findings concern it."""
    extremes = {n: (float(v.min()), float(v.max())) for n, v in series.items()}
    said = findings(outputs, extremes, circuit)
    result.attrs["warnings"] = [
        f"impossible: {f.sentence}" if f.kind == "collapse" else f.sentence for f in said
    ]
    result.attrs["impossible"] = int(impossible(said))
    result.attrs["one_of_many"] = int(sealed(outputs, circuit) is not None)
    for finding in reversed(said):
        for name in finding.concerns:
            if name in result:
                result[name].attrs["finding"] = finding.kind


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


def outcome(steady: SteadyBeats, outputs: Mapping[str, Any], member: int = 0) -> tuple[Status, str]:
    """How a member's beat ended, and the sentence that says so: the same for one patient and for many.

    Args:
        steady: solved beats.
        outputs: numbers of the member by name; one that is not finite means that the beat has left them.
        member: which patient.
    """
    status = steady.status(member)
    if status is not Status.INVALID_INPUT and not all(np.isfinite(v) for v in outputs.values()):
        status = Status.NOT_FINITE
    message = steady.message(member, status)
    if status is Status.CONVERGED and shut_valves(outputs):
        found = sealed(outputs, steady.batch.circuit.with_chosen_sites(steady.batch.member(member)))
        message += f", but it is one of many: {found.reason}" if found else ""
    doubt = steady.grid_doubt(member)
    return status, f"{message}; {doubt}" if doubt else message
