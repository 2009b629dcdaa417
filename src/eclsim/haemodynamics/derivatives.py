"""Exact derivatives of outputs with respect to parameters."""

from __future__ import annotations

import numpy as np
import xarray as xr

from eclsim.haemodynamics.dual import Dual
from eclsim.haemodynamics.evaluation import needed_signals
from eclsim.haemodynamics.measures import Measures
from eclsim.haemodynamics.outputs import output
from eclsim.haemodynamics.signals import whole_beat
from eclsim.solver.beat import beat_program
from eclsim.solver.model import AS_PUBLISHED, Model
from eclsim.solver.sensitivities import orbit_tangents
from eclsim.solver.steady import Batch, SteadyBeats, steady_beats


def output_derivatives(
    model: Model, outputs: tuple[str, ...], parameters: tuple[str, ...], policy: str = AS_PUBLISHED
) -> xr.DataArray:
    """d output / d parameter of a model's steady beat.

    Args:
        model: circuit and values.
        outputs: names of the registry.
        parameters: names that the circuit reads, or `heart_rate_bpm`.
        policy: blood volume policy.

    Returns:
        Array with dimensions (output, parameter); coordinates `value` and `parameter_value` hold the point.
    """
    steady = steady_beats(Batch(model.circuit, model.values, 1, policy))
    values, gradient = member_derivatives(steady, outputs, parameters)
    return xr.DataArray(
        gradient,
        dims=("output", "parameter"),
        coords={
            "output": list(outputs),
            "parameter": list(parameters),
            "value": ("output", values),
            "parameter_value": ("parameter", [model.values[p] for p in parameters]),
        },
        attrs={"long_name": "derivative of the output with respect to the parameter"},
    )


def member_derivatives(
    steady: SteadyBeats, outputs: tuple[str, ...], parameters: tuple[str, ...], member: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Outputs of one patient of a batch, shape (outputs,), and their derivatives (outputs, parameters)."""
    signals = needed_signals(steady.batch.circuit, outputs)
    tangents = orbit_tangents(steady, parameters, signals, member)
    series = whole_beat(tangents.signals)
    slopes = np.concatenate([tangents.signal_tangents[:, :, -1:], tangents.signal_tangents], axis=2)
    waveforms = {name: Dual(series[:, k], slopes[k]) for k, name in enumerate(signals)}
    program = beat_program(steady.batch.circuit, int(steady.resolution[member]))
    measures = Measures(waveforms, program.grid.phases)
    found = [output(name).compute(measures) for name in outputs]
    return np.array([d.value for d in found]), np.stack(
        [np.broadcast_to(d.tangent, len(parameters)) for d in found]
    )
