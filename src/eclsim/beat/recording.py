"""Recording of signals while a beat runs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from eclsim.circuit.assembly import Assembly, Constants, States
from eclsim.circuit.network import Circuit, Statistic
from eclsim.circuit.signals import Form, Kind, Signal
from eclsim.components.base import Number
from eclsim.spelling import spelling_hint
from eclsim.units import ML_S_PER_L_MIN

RATE, MEAN = Form.RATE.value, Form.MEAN.value
"""Suffixes of a signal's derivative with respect to phase, and of a flow's mean over a step."""


class Moment(NamedTuple):
    """Quantities at the end of a step.

    Attributes:
        volumes: stressed volumes of all compartments [mL].
        flows: flows through all connections [mL/s].
        activations: activations of all curves.
        constants: constants of the laws.
        period: length of the beat [s].
        means: mean flows over the step [mL/s]; None if the moment is not the end of a step.
    """

    volumes: list[Number]
    flows: list[Number]
    activations: Sequence[Number] | States
    constants: Constants
    period: Number
    means: list[Number] | None = None


class UnknownSignalError(KeyError):
    """Raised for a signal that the circuit does not have."""

    def __str__(self) -> str:
        return str(self.args[0])


def all_signals(assembly: Assembly) -> tuple[str, ...]:
    """Names of all signals of a circuit (`Circuit.signals`)."""
    return tuple(map(str, assembly.circuit.signals()))


def has_rate(circuit: Circuit, name: str) -> bool:
    """Whether a signal's rate follows from the flows: a volume, or the pressure of a passive compartment."""
    signal, laws = Signal.parse(name), {c.name: c.component for c in circuit.compartments}
    if signal.place not in laws or signal.kind is Kind.FLOW:
        return False
    law = laws[signal.place]
    return signal.kind is Kind.VOLUME or (law.constant_stiffness and law.activation is None)


def has_mean(circuit: Circuit, name: str) -> bool:
    """Whether a signal is the flow of a one-way path, whose mean does not follow from its sampled values."""
    signal = Signal.parse(name)
    return signal.kind is Kind.FLOW and any(
        c.component.one_way for c in circuit.connections if c.name == signal.place
    )


def with_means(circuit: Circuit, signals: tuple[str, ...]) -> tuple[str, ...]:
    """The signals, followed by the means of those that have one."""
    return signals + tuple(s + MEAN for s in signals if has_mean(circuit, s))


def with_rates(circuit: Circuit, signals: tuple[str, ...]) -> tuple[str, ...]:
    """The signals, followed by the rates of those that have one."""
    return signals + tuple(s + RATE for s in signals if has_rate(circuit, s))


def known_signal(circuit: Circuit, name: str, allowed: tuple[str, ...]) -> Signal:
    """The signal with a name; raises `UnknownSignalError` if the circuit has no such signal."""
    exists = {RATE: has_rate, MEAN: has_mean}.get(name[-1:])
    plain = name.removesuffix(RATE).removesuffix(MEAN)
    if plain in allowed and (exists is None or exists(circuit, plain)):
        return Signal.parse(name)
    known = f"{', '.join(allowed)}{spelling_hint(name, allowed)}"
    raise UnknownSignalError(f"this circuit has no signal '{name}'; allowed: {known}")


def step_weights(widths: np.ndarray, moved: Sequence[bool]) -> np.ndarray:
    """Weights of the steps in the mean of each signal over a beat, shape (steps, signals).

    Args:
        widths: widths of the steps, in phase.
        moved: for each signal, whether it is a flow's mean over the step, which is weighted by the step's
            width; values at the ends of steps are weighted by the trapezoidal rule.
    """
    trapezoid = 0.5 * (widths + np.roll(widths, -1))
    return np.stack([widths if whole else trapezoid for whole in moved], axis=1)


def one_way_mean(series: np.ndarray, weights: np.ndarray, sign: float) -> np.ndarray:
    """Mean [L/min] of a flow [mL/s], counted as 0 where it lacks the sign; series (points[, patients])."""
    if series.max() <= 0.0 if sign > 0.0 else series.min() >= 0.0:
        return np.zeros(series.shape[1:])
    one_way = np.maximum(sign * series, 0.0)
    # A product of matrices rounds each patient's sum by the place beside the others.
    total = weights @ one_way if one_way.ndim == 1 else (weights[:, None] * one_way).sum(axis=0)
    return total / ML_S_PER_L_MIN


class Recorder:
    """Selects signals by name: P or V + compartment, Q + connection, P + pump (pressure gained across it).

    Pressures are in mmHg, stressed volumes in mL and flows in mL/s, all at the end of a step; for rates and
    means see `eclsim.circuit.signals.Form`.
    """

    def __init__(self, assembly: Assembly, signals: tuple[str, ...]):
        self.assembly = assembly
        self._stores = [c.name for c in assembly.circuit.compartments]
        self._paths = [c.name for c in assembly.circuit.connections]
        allowed = all_signals(assembly)
        self.signals = tuple(known_signal(assembly.circuit, name, allowed) for name in signals)
        self._wants_rates = any(signal.form is Form.RATE for signal in self.signals)
        self._wants_pressures = any(signal.kind is Kind.PRESSURE for signal in self.signals)

    def pick(self, now: Moment) -> jax.Array:
        """The signals at one moment, stacked; shape (signals[, patients])."""
        pressures, stiffness = list[Number](), list[Number]()
        if self._wants_pressures:
            pressures, stiffness = self.assembly.pressures(now.volumes, now.activations, now.constants)
        zero = jnp.zeros_like(now.volumes[0])
        rates = self._volume_rates(now.flows, now.constants) if self._wants_rates else []
        picked = []
        for signal in self.signals:
            if signal.form is Form.RATE:
                position = self._stores.index(signal.place)
                per_volume = stiffness[position] if signal.kind is Kind.PRESSURE else 1.0
                value = rates[position] * now.period * per_volume
            elif signal.form is Form.MEAN:
                assert now.means is not None, "means are recorded with a step"
                value = now.means[self._paths.index(signal.place)]
            else:
                value = self._value(signal, now, pressures)
            picked.append(value + zero)
        return jnp.stack(picked) if picked else jnp.zeros((0, *zero.shape))

    def _volume_rates(self, flows: list[Number], constants: Constants) -> list[Number]:
        """Rate of change of every compartment's volume [mL/s]."""
        rates: list[Number] = [jnp.zeros_like(flows[0]) for _ in self._stores]
        for flow, (source, target) in zip(flows, self.assembly.ends, strict=True):
            self.assembly.add_at(source, rates, -flow, constants)
            self.assembly.add_at(target, rates, flow, constants)
        return rates

    def _value(self, signal: Signal, now: Moment, pressures: list[Number]) -> Number:
        if signal.kind is Kind.FLOW:
            return now.flows[self._paths.index(signal.place)]
        if signal.place in self._stores:
            values = now.volumes if signal.kind is Kind.VOLUME else pressures
            return values[self._stores.index(signal.place)]
        if signal.place not in self._paths:
            k = [s.name for s in self.assembly.circuit.surroundings].index(signal.place)
            return self.assembly.surrounding_pressures(now.volumes, now.constants)[k][0]
        source, target = self.assembly.ends[self._paths.index(signal.place)]
        up, down = (self.assembly.at(end, pressures, now.constants) for end in (source, target))
        return down - up


class Readings:
    """Readings of a circuit's controllers over a beat, accumulated step by step."""

    def __init__(self, assembly: Assembly):
        reads = [reading for control in assembly.circuit.controllers for reading in control.reads]
        self.statistics = [reading.statistic for reading in reads]
        names = [str(reading.signal) for reading in reads]
        self._moved = [
            s is Statistic.MEAN and has_mean(assembly.circuit, n)
            for n, s in zip(names, self.statistics, strict=True)
        ]
        names = [name + MEAN if moved else name for name, moved in zip(names, self._moved, strict=True)]
        self._recorder = Recorder(assembly, tuple(names))

    def initial(self, zero: Number) -> list[Number]:
        """Values of the readings before the first step."""
        first = {Statistic.MEAN: 0.0, Statistic.MAXIMUM: -jnp.inf, Statistic.MINIMUM: jnp.inf}
        return [first[statistic] + zero for statistic in self.statistics]

    def weights(self, widths: np.ndarray) -> np.ndarray | None:
        """Weights of the steps in each mean, shape (steps, readings); None if there are no readings."""
        return step_weights(widths, self._moved) if self._moved else None

    def updated(self, readings: list[Number], moment: Moment, weights: States | None) -> list[Number]:
        """The readings after one more step; `weights` holds the weight of each reading in this step."""
        if weights is None:
            return readings
        picked = self._recorder.pick(moment)
        rules = {Statistic.MAXIMUM: jnp.maximum, Statistic.MINIMUM: jnp.minimum}
        return [
            rules[s](old, picked[k]) if s in rules else old + weights[k] * picked[k]
            for k, (s, old) in enumerate(zip(self.statistics, readings, strict=True))
        ]
