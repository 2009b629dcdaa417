"""Exact derivatives of outputs with respect to parameters.

To first order every measure of a beat is a weighted sum of what the beat records (see `measures`). The
weights follow from the beat itself; one more beat with tangents sums the tangents with them on the way, so
nothing but one number per measure and direction is kept.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr

from eclsim.beat.heartbeat import beat_program
from eclsim.orbit.derivatives import OrbitTangents, orbit_tangents
from eclsim.orbit.model import Model
from eclsim.orbit.status import NoDerivativesError
from eclsim.orbit.steady import Batch, SteadyBeats, steady_beats
from eclsim.outputs.dual import Dual
from eclsim.outputs.measures import Measures, Points
from eclsim.outputs.registry import output
from eclsim.outputs.signals import whole_beat

Sum = tuple[str, int]
"""A weighted sum that a measure depends on: its signal and its number."""


class LinearMeasures(Measures):
    """Measures of one patient as numbers that know the weighted sums they depend on.

    `sums` holds for each its weights at the grid points, shape (points,).
    """

    def __init__(self, waveforms: Mapping[str, np.ndarray], phases: np.ndarray):
        super().__init__(waveforms, phases)
        self.sums: dict[Sum, np.ndarray] = {}

    def _product(self, weights: Mapping[str, np.ndarray]) -> Dual:
        found = self._whole(weights)
        return Dual(0.5 * found.value, found.slopes)

    def _whole(self, weights: Mapping[str, np.ndarray]) -> Dual:
        value, slopes = 0.0, {}
        for name, weight in weights.items():
            key = (name, len(self.sums))
            self.sums[key] = weight
            slopes[key] = 1.0
            value += float(weight @ self.waveforms[name])
        return Dual(value, slopes)

    def _sum(self, points: Points) -> Dual:
        weights: dict[str, np.ndarray] = {}
        for name, index, weight in points:
            weights.setdefault(name, np.zeros(len(self.waveforms[name])))[index] += weight
        return self._whole(weights)


def output_derivatives(
    model: Model,
    outputs: tuple[str, ...],
    parameters: tuple[str, ...],
    policy: str | None = None,
    resolution: int | None = None,
    throw: bool = True,
) -> xr.DataArray:
    """d output / d parameter of a model's steady beat.

    Args:
        model: circuit and values.
        outputs: names of the registry.
        parameters: names that the circuit reads, or `heart_rate_bpm`.
        policy: blood volume policy; left out, the model's.
        resolution: of the phase grid; left out, what the circuit's time constants need. The derivatives are
            exact for the grid; twice the resolution brings them from 0.6 % to 0.4 % of the continuous ones.
        throw: False gives NaN and says why in the attributes where there are no derivatives.

    Returns:
        Array with dimensions (output, parameter); coordinates `value` and `parameter_value` hold the point,
        attributes `status` ("converged", else as `Status`, or "singular") and `message` say what they are of.

    Raises:
        NoDerivativesError: no steady beat was found, or its equation is singular.
    """
    batch = Batch(model.circuit, model.values, 1, policy or model.policy)
    steady = steady_beats(batch, resolution=resolution)
    status, message = steady.status().name.lower(), steady.message()
    try:
        values, gradient = member_derivatives(steady, outputs, parameters)
    except NoDerivativesError as error:
        if throw:
            raise NoDerivativesError(error.status, error.reason, model.name) from None
        status, message = error.word, error.reason
        values, gradient = np.full(len(outputs), np.nan), np.full((len(outputs), len(parameters)), np.nan)
    return xr.DataArray(
        gradient,
        dims=("output", "parameter"),
        coords={
            "output": list(outputs),
            "parameter": list(parameters),
            "value": ("output", values),
            "parameter_value": ("parameter", [model.values[p] for p in parameters]),
        },
        attrs={
            "long_name": "derivative of the output with respect to the parameter",
            "id": model.name,
            "status": status,
            "message": message,
        },
    )


def member_derivatives(
    steady: SteadyBeats, outputs: tuple[str, ...], parameters: tuple[str, ...], member: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Outputs of one patient of a batch, shape (outputs,), and their derivatives (outputs, parameters).

    Raises:
        NoDerivativesError: no steady beat was found for the patient, or its equation is singular.
    """
    return member_tangents(steady, outputs, parameters, member)[:2]


def member_tangents(
    steady: SteadyBeats, outputs: tuple[str, ...], parameters: tuple[str, ...], member: int = 0
) -> tuple[np.ndarray, np.ndarray, OrbitTangents]:
    """As `member_derivatives`, and the derivatives of the beat itself."""
    steady.require_steady(member)
    program = beat_program(steady.batch.circuit, int(steady.resolution[member]))
    signals = program.signals
    packed = steady.batch.packed(program)[:, member]
    _, recorded = program.trace(signals)(steady.orbits.states[:, member], packed)
    series = np.ascontiguousarray(whole_beat(np.asarray(recorded)).T)
    measures = LinearMeasures(dict(zip(signals, series, strict=True)), program.grid.phases)
    found = [output(name).compute(measures) for name in outputs]
    keys = sorted(measures.sums)
    weights = np.array([measures.sums[key] for key in keys])
    weights[:, -1] += weights[:, 0]
    summed = tuple(name for name, _ in keys)
    tangents = orbit_tangents(steady, parameters, summed, weights[:, 1:].T, member)
    place = {key: k for k, key in enumerate(keys)}
    slopes = np.zeros((len(found), len(keys)))
    for row, number in zip(slopes, found, strict=True):
        for key, slope in number.slopes.items():
            row[place[key]] = slope
    return np.array([float(d.value) for d in found]), slopes @ tangents.sums, tangents
