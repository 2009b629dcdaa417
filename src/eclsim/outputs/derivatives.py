"""Exact derivatives of outputs with respect to parameters.

To first order every measure of a beat is a weighted sum of its recorded signals (see `measures`), with
weights that follow from the beat itself. One further beat with tangents sums the tangents with these weights
as it proceeds, so only one number per measure and direction is stored.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import jax
import numpy as np

from eclsim.beat.compilation import Key
from eclsim.beat.recording import MEAN, has_mean
from eclsim.circuit.network import Circuit
from eclsim.devices.description import Law
from eclsim.devices.registry import cached_by_devices
from eclsim.orbit.derivatives import OrbitDerivatives, orbit_derivatives
from eclsim.orbit.equation import OrbitProblem
from eclsim.orbit.iteration import compiled_search
from eclsim.outputs.measures import Measures, Points, jacobian, single, whole_beat
from eclsim.outputs.registry import computed, output
from eclsim.outputs.signals import needed_signals, output_names
from eclsim.units import ML_S_PER_L_MIN

WeightedSum = tuple[str, int]
"""A weighted sum that a measure depends on: its signal and its index."""


class LawResult(NamedTuple):
    """A result of a law that a measure depends on: index of the law's application, and of the result."""

    call: int
    place: int


@dataclass(frozen=True)
class Dual:
    """A number and its first-order dependence on named quantities.

    Args:
        value: the number.
        slopes: d value / d quantity, for each quantity that it depends on.
    """

    value: float
    slopes: Mapping[Hashable, float] = field(default_factory=dict)

    def _combined(self, other: Dual, left: float, right: float, value: float) -> Dual:
        slopes = {k: left * v for k, v in self.slopes.items()}
        for k, v in other.slopes.items():
            slopes[k] = slopes.get(k, 0.0) + right * v
        return Dual(value, slopes)

    def __add__(self, other: Dual | float) -> Dual:
        o = _dual(other)
        return self._combined(o, 1.0, 1.0, self.value + o.value)

    __radd__ = __add__

    def __neg__(self) -> Dual:
        return self * -1.0

    def __sub__(self, other: Dual | float) -> Dual:
        return self + (-_dual(other))

    def __rsub__(self, other: Dual | float) -> Dual:
        return _dual(other) - self

    def __mul__(self, other: Dual | float) -> Dual:
        o = _dual(other)
        return self._combined(o, o.value, self.value, self.value * o.value)

    __rmul__ = __mul__

    def __truediv__(self, other: Dual | float) -> Dual:
        o = _dual(other)
        return self._combined(o, 1.0 / o.value, -self.value / o.value**2, self.value / o.value)

    def __rtruediv__(self, other: Dual | float) -> Dual:
        return _dual(other) / self

    def __pow__(self, power: int) -> Dual:
        return self._combined(Dual(0.0), power * self.value ** (power - 1), 0.0, self.value**power)


def _dual(x: Dual | float) -> Dual:
    return x if isinstance(x, Dual) else Dual(float(x))


class LinearMeasures(Measures):
    """Measures of one member as dual numbers, with their dependence on weighted sums, laws and parameters.

    `sums` holds the weights of each weighted sum at the grid points, shape (points,). `applied` holds for
    each application of a law its arguments and the derivatives with respect to them, shape (results,
    arguments).
    """

    def __init__(
        self,
        waveforms: Mapping[str, np.ndarray],
        phases: np.ndarray,
        circuit: Circuit | None = None,
        parameters: Mapping[str, float] | None = None,
    ):
        super().__init__(waveforms, phases, circuit, parameters)
        self.sums: dict[WeightedSum, np.ndarray] = {}
        self.applied: list[tuple[list[Dual], np.ndarray]] = []

    def parameter(self, name: str) -> Dual:
        """A parameter, with a derivative of 1 with respect to itself."""
        return Dual(float(self._parameters[name]), {name: 1.0})

    def apply(
        self,
        function: Law,
        numbers: Sequence[Dual | float],
        key: Key | None = None,
        without_search: Callable[[jax.Array, jax.Array], jax.Array] | None = None,
    ) -> Sequence[Dual]:
        """Apply a function to numbers; each result is a quantity of its own (see `slopes`)."""
        duals = [_dual(number) for number in numbers]
        at = np.array([number.value for number in duals])
        if without_search is None:
            table = np.asarray(jacobian(function, key)(at))
        else:
            table = np.asarray(jacobian(without_search, key)(at, single(function, key)(at)))
        self.applied.append((duals, table[:, 1:]))
        call = len(self.applied) - 1
        return [Dual(value, {LawResult(call, k): 1.0}) for k, value in enumerate(table[:, 0].tolist())]

    def slopes(self, numbers: Sequence[Dual], quantities: Sequence[Hashable]) -> np.ndarray:
        """Derivatives of measures by sums and parameters, (measures, quantities), by the chain rule."""
        column = {quantity: k for k, quantity in enumerate(dict.fromkeys(quantities))}
        of_results: list[np.ndarray] = []

        def rows(numbers: Sequence[Dual]) -> np.ndarray:
            table = np.zeros((len(numbers), len(column)))
            for row, number in zip(table, numbers, strict=True):
                for key, slope in number.slopes.items():
                    if isinstance(key, LawResult):
                        row += slope * of_results[key.call][key.place]
                    elif key in column:
                        row[column[key]] += slope
            return table

        for inputs, by_given in self.applied:
            of_results.append(by_given @ rows(inputs))
        return rows(numbers)[:, [column[quantity] for quantity in quantities]]

    def _positive(self, name: str, weights: np.ndarray, sign: float) -> Dual:
        # A sum is added also where nothing flows: if the set of sums depended on the state, the beat with
        # tangents would be compiled again for each set of connections with backward flow.
        ahead = sign * self.waveforms[name] > 0.0
        return self._whole({name: sign / ML_S_PER_L_MIN * ahead * weights})

    def _product(self, weights: Mapping[str, np.ndarray]) -> Dual:
        result = self._whole(weights)
        return Dual(0.5 * result.value, result.slopes)

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
    """First-order expansion of the outputs of a steady beat in the parameters.

    Args:
        values: values of the outputs, shape (outputs,).
        slopes: d output / d parameter, shape (outputs, parameters).
        orbit: first-order expansion of the beat itself.
        values_on_orbit: outputs after the Newton step that the derivatives give.
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
    values: Mapping[str, float] | None = None,
    circuit: Circuit | None = None,
) -> Linearisation:
    """Outputs of one member's orbit and their exact derivatives.

    Args:
        problem: orbit problem of one member.
        state: state on its orbit or close to it, shape (states,).
        outputs: names of outputs, as in the registry.
        parameters: names of parameters of the circuit, or `heart_rate_bpm`; those that the beat does not need
            affect outputs only.
        volume_slopes: d blood volume / d parameter [mL per unit], shape (parameters,).
        values: values of the parameters that the outputs need.
        circuit: circuit with exchanges, which the beat does not need; None for that of the program.

    Raises:
        NoDerivativesError: The equation of the beat is singular.
    """
    program = problem.program
    circuit = circuit or program.assembly.circuit
    signals = needed_signals(circuit, outputs)
    names, recorded = compiled_search(program, 1).record(state[:, None], problem.packed, signals)
    series = whole_beat(recorded[..., 0])
    waveforms = {name: np.ascontiguousarray(series[:, names.index(name)]) for name in signals}
    measures = LinearMeasures(waveforms, program.grid.phases, circuit, values)
    result = [_dual(computed(name, measures)) for name in outputs]
    keys = sorted(measures.sums)
    weights = np.array([measures.sums[key] for key in keys]).reshape(len(keys), -1)
    weights[:, -1] += weights[:, 0]
    usual = usual_sums(program.assembly.circuit)
    summed_signals, places = _places([name for name, _ in keys], usual)
    wide = np.zeros((program.grid.n_steps, len(summed_signals)))
    wide[:, places] = weights[:, 1:].T
    orbit = orbit_derivatives(problem, state, parameters, volume_slopes, summed_signals, wide)
    orbit = replace(orbit, sums=orbit.sums[places], sums_of_states=orbit.sums_of_states[places])
    table = measures.slopes(result, [*keys, *parameters])
    slopes, direct = np.ascontiguousarray(table[:, : len(keys)]), table[:, len(keys) :]
    at = np.array([number.value for number in result])
    return Linearisation(
        at, slopes @ orbit.sums + direct, orbit, at + slopes @ (orbit.sums_of_states @ orbit.step)
    )


def _places(sums: Sequence[str], usual: tuple[str, ...]) -> tuple[tuple[str, ...], list[int]]:
    """The list of signals that a beat with tangents sums, and the positions of the given sums in it.

    Such a beat is compiled for each list (some 10 s). With all usual sums in one list a program serves all
    usual questions about a circuit, and is not a tenth slower than with those of one question.
    """
    signals = usual if Counter(usual) >= Counter(sums) else tuple(sums)
    taken, places = Counter[str](), list[int]()
    for name in sums:
        places.append(signals.index(name) + taken[name])
        taken[name] += 1
    return signals, places


@cached_by_devices(64)
def usual_sums(circuit: Circuit) -> tuple[str, ...]:
    """Signals of the sums that all outputs of a circuit and its flows that carry gases need, sorted.

    The outputs that read parameters are not computed here, for which there are no values; they read means.
    """
    names = output_names(circuit)
    plain = [name for name in names if _reads_waveforms_alone(name)]
    read = dict.fromkeys(signal for name in names for signal in output(name).needs if name not in plain)
    flows = ["Q" + connection.name for connection in circuit.connections]
    carried = [flow + MEAN if has_mean(circuit, flow) else flow for flow in flows]
    return tuple(sorted([*_sums_of(plain, tuple(read), circuit), *carried, *carried]))


def _reads_waveforms_alone(name: str) -> bool:
    entry = output(name)
    return not (entry.parameters or entry.all_flows or entry.in_effect)


def _sums_of(outputs: Sequence[str], means: Sequence[str], circuit: Circuit) -> list[str]:
    """Signals of the weighted sums that outputs and means consist of, found with artificial waveforms."""
    phases = np.linspace(0.0, 1.0, 6)
    signals = needed_signals(circuit, outputs, means)
    waveforms = {name: 2.0 + k + np.sin(7.0 * phases + k) for k, name in enumerate(signals)}
    measures = LinearMeasures(waveforms, phases, circuit)
    for name in outputs:
        computed(name, measures)
    for signal in means:
        measures.mean(signal)
    return [signal for signal, _ in measures.sums]
