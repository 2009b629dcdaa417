"""Exact derivatives of outputs with respect to parameters.

To first order every measure of a beat is a weighted sum of what the beat records (see `measures`). The
weights follow from the beat itself; one more beat with tangents sums the tangents with them on the way, so
nothing but one number per measure and direction is kept.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from eclsim.orbit.derivatives import OrbitDerivatives, orbit_derivatives
from eclsim.orbit.equation import OrbitProblem
from eclsim.orbit.iteration import compiled_search
from eclsim.outputs.measures import Measures, Points, whole_beat
from eclsim.outputs.registry import output
from eclsim.outputs.signals import needed_signals

Sum = tuple[str, int]
"""A weighted sum that a measure depends on: its signal and its number."""


@dataclass(frozen=True)
class Dual:
    """A number and its first-order dependence on named quantities.

    Args:
        value: the number.
        slopes: d value / d quantity, for each quantity that it depends on.
    """

    value: float
    slopes: Mapping[Hashable, float] = field(default_factory=dict)

    def _joined(self, other: Dual, mine: float, theirs: float, value: float) -> Dual:
        slopes = {k: mine * v for k, v in self.slopes.items()}
        for k, v in other.slopes.items():
            slopes[k] = slopes.get(k, 0.0) + theirs * v
        return Dual(value, slopes)

    def __add__(self, other: Dual | float) -> Dual:
        o = _dual(other)
        return self._joined(o, 1.0, 1.0, self.value + o.value)

    __radd__ = __add__

    def __neg__(self) -> Dual:
        return self * -1.0

    def __sub__(self, other: Dual | float) -> Dual:
        return self + (-_dual(other))

    def __rsub__(self, other: Dual | float) -> Dual:
        return _dual(other) - self

    def __mul__(self, other: Dual | float) -> Dual:
        o = _dual(other)
        return self._joined(o, o.value, self.value, self.value * o.value)

    __rmul__ = __mul__

    def __truediv__(self, other: Dual | float) -> Dual:
        o = _dual(other)
        return self._joined(o, 1.0 / o.value, -self.value / o.value**2, self.value / o.value)

    def __rtruediv__(self, other: Dual | float) -> Dual:
        return _dual(other) / self

    def __pow__(self, power: int) -> Dual:
        return self._joined(Dual(0.0), power * self.value ** (power - 1), 0.0, self.value**power)


def _dual(x: Dual | float) -> Dual:
    return x if isinstance(x, Dual) else Dual(float(x))


class LinearMeasures(Measures):
    """Measures of one member as numbers that know the weighted sums they depend on.

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


@dataclass(frozen=True)
class Linearisation:
    """Outputs of a steady beat to first order in the parameters.

    Args:
        values: shape (outputs,).
        slopes: d output / d parameter, shape (outputs, parameters).
        orbit: the beat itself to first order.
        values_on_orbit: outputs after the step of Newton's method that the derivatives give.
    """

    values: np.ndarray
    slopes: np.ndarray
    orbit: OrbitDerivatives
    values_on_orbit: np.ndarray


def linearise(
    problem: OrbitProblem,
    state: np.ndarray,
    outputs: Sequence[str],
    parameters: Sequence[str],
    volume_slopes: np.ndarray,
) -> Linearisation:
    """Outputs of one member's orbit and their exact derivatives.

    Args:
        problem: of one member.
        state: on its orbit or close to it, shape (states,).
        outputs: names of the registry.
        parameters: names that the circuit reads, or `heart_rate_bpm`.
        volume_slopes: d blood volume / d parameter [mL per unit], shape (parameters,).

    Raises:
        NoDerivativesError: the equation of the beat is singular.
    """
    program = problem.program
    signals = needed_signals(program.assembly.circuit, outputs)
    names, recorded = compiled_search(program, 1).record(state[:, None], problem.packed, signals)
    series = whole_beat(recorded[..., 0])
    waveforms = {name: np.ascontiguousarray(series[:, names.index(name)]) for name in signals}
    measures = LinearMeasures(waveforms, program.grid.phases)
    found = [output(name).compute(measures) for name in outputs]
    keys = sorted(measures.sums)
    weights = np.array([measures.sums[key] for key in keys])
    weights[:, -1] += weights[:, 0]
    summed = tuple(name for name, _ in keys)
    orbit = orbit_derivatives(problem, state, parameters, volume_slopes, summed, weights[:, 1:].T)
    place = {key: k for k, key in enumerate(keys)}
    slopes = np.zeros((len(found), len(keys)))
    for row, number in zip(slopes, found, strict=True):
        for key, slope in number.slopes.items():
            row[place[key]] = slope
    values = np.array([float(number.value) for number in found])
    return Linearisation(
        values, slopes @ orbit.sums, orbit, values + slopes @ (orbit.sums_of_states @ orbit.step)
    )
