"""Means, extremes and loop areas of waveforms over one beat on a non-uniform grid.

Extremes lie between grid points: diastolic pressure ends within a millisecond of the valve's opening. If the
rate of a waveform is known (it follows from the flows), an extreme is that of the cubic with the values and
slopes at the neighbouring points, else that of the parabola through three points. Extremes therefore do not
jump when a parameter moves the peak from one grid point to the next.

Every measure is a weighted sum of waveform values, exactly or, for an extreme, to first order, since its
position does not matter to first order. `Measures` therefore finds weights, from which both the value and,
for derivatives, the dependence on the waveforms follow.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, lru_cache

import jax
import jax.numpy as jnp
import numpy as np

from eclsim.beat.compilation import Key, compiled
from eclsim.beat.recording import MEAN, RATE, one_way_mean
from eclsim.circuit.network import Circuit
from eclsim.devices.description import Law, Measured, Numbers
from eclsim.gas.network import FlowFunction, Quantity, gas_of
from eclsim.gas.tracers import ARTERIES, effective_shares, native_shares
from eclsim.units import ML_S_PER_L_MIN

PASSING = 1e-4
"""Change of a waveform over a beat, relative to its size, above which the beat has not settled."""
SIDE_BY_SIDE = 16
"""Number of members whose laws are computed together; more do not fit into the processor's caches."""
FEWEST_TO_COMPILE = 1024
"""Smallest batch in which laws are computed together: the laws of gases then take half the time per
member, but compile three times as long as for one."""
OPTIMISATION_LEVEL = 3
"""Optimisation level that vectorises loops over patients; it compiles half as fast."""
SMALLEST_VOLUME = 1e-6
"""Divisor used for a volume that is zero or less [mL]."""
Points = list[tuple[str, Numbers, Numbers]]
"""A sum over few points: waveform, index of the point, weight (each a number or one per patient)."""


class Measures:
    """The waveforms of a beat and the measures computed from them.

    Args:
        waveforms: arrays (points[, patients]) by name over a whole beat, with the first and last point at the
            same phase; pressures [mmHg], flows [mL/s], volumes [mL]; rates per unit of phase are name +
            `RATE`.
        phases: grid points from 0 to 1, shape (points,).
        circuit: circuit of the beat.
        parameters: numbers, or one for each patient, for outputs that depend on parameters.
        gases: the gas state, if it is not the steady one of these flows.
        batch: indices of the patients in their batch.
    """

    def __init__(
        self,
        waveforms: Mapping[str, np.ndarray],
        phases: np.ndarray,
        circuit: Circuit | None = None,
        parameters: Mapping[str, Numbers] | None = None,
        gases: Mapping[Quantity, Numbers] | None = None,
        batch: int = 1,
    ):
        self.waveforms, self._phases, self._batch = waveforms, phases, batch
        self._widths = np.diff(phases)
        self._circuit, self._parameters = circuit, parameters or {}
        self._cache: dict[tuple[str, ...], Numbers] = {} if gases is None else {("gas",): gases}

    def mean(self, name: str) -> Numbers:
        """Mean over the beat, from the volumes moved in each step if known, else by the trapezoidal rule."""
        if name + MEAN in self.waveforms:
            return self.cached(("mean", name), lambda: self._whole({name + MEAN: self._moved}))
        return self.cached(("mean", name), lambda: self._whole({name: self._trapezoid}))

    def measure_means(self, names: Sequence[str], table: np.ndarray) -> None:
        """Compute the means of many waveforms at once: the same numbers in less time.

        Args:
            names: names of the `waveforms`.
            table: these waveforms, shape (points, names, patients).
        """
        if not names:
            return
        points, _, patients = table.shape
        weighted = self._weights_of(names, patients) * table.reshape(points, -1)
        means = dict(zip(names, weighted.sum(axis=0).reshape(-1, patients), strict=True))
        for name in names:
            self._cache["mean", name] = means.get(name + MEAN, means[name])

    def measure_extremes(self, names: Sequence[str], table: np.ndarray) -> None:
        """Compute the extremes of many waveforms with known rates at once: the same numbers in less time.

        Args:
            names: names of the `waveforms`; those without a rate are left out.
            table: these waveforms, shape (points, names, patients).
        """
        place = {name: k for k, name in enumerate(names)}
        chosen = [name for name in names if name + RATE in place]
        if not chosen:
            return
        tables = {
            of: table.take([place[name + of] for name in chosen], axis=1).reshape(len(table), -1)
            for of in ("", RATE)
        }
        for kind, sign in (("maximum", 1.0), ("minimum", -1.0)):
            signed = sign * tables[""]
            points = self._cubic(signed, sign * tables[RATE], np.argmax(signed[:-1], axis=0))
            extremes = sum(weight * _at(tables[of], index) for of, index, weight in points)
            rows = np.reshape(extremes, (len(chosen), -1))
            self._cache.update({(kind, name): row for name, row in zip(chosen, rows, strict=True)})

    def measure_one_way(self, connections: Sequence[str], names: Sequence[str], table: np.ndarray) -> None:
        """Compute forward and backward means of many connections at once: the same numbers in less time.

        Args:
            connections: names of connections whose flows are among the `waveforms`.
            names: names of the `waveforms`.
            table: these waveforms, shape (points, names, patients).
        """
        flows = [f"Q{c}{MEAN}" if f"Q{c}{MEAN}" in self.waveforms else f"Q{c}" for c in connections]
        points, _, patients = table.shape
        series = table.take([names.index(name) for name in flows], axis=1).reshape(points, -1)
        weights = self._weights_of(flows, patients)
        for kind, sign in (("forward", 1.0), ("backward", -1.0)):
            means = (weights * np.maximum(sign * series, 0.0)).sum(axis=0) / ML_S_PER_L_MIN
            rows = means.reshape(-1, patients)
            self._cache.update({(kind, name): row for name, row in zip(connections, rows, strict=True)})

    def maximum(self, name: str) -> Numbers:
        """Largest value over the beat."""
        return self.cached(("maximum", name), lambda: self._sum(self._extreme(name, 1.0)))

    def maximum_before(self, name: str, phase: str) -> Numbers:
        """Largest value up to the phase given by a parameter."""
        return self._sum(self._extreme(name, 1.0, self._after(phase) <= 0.0))

    def maximum_after(self, name: str, phase: str) -> Numbers:
        """Largest value from the phase given by a parameter on."""
        return self._sum(self._extreme(name, 1.0, self._after(phase) >= 0.0))

    def _after(self, phase: str) -> np.ndarray:
        """Distance of each grid point after a phase, shape (points[, patients])."""
        return np.subtract.outer(self._phases, np.asarray(self._parameters[phase], dtype=float))

    def minimum(self, name: str) -> Numbers:
        """Smallest value over the beat."""
        return self.cached(("minimum", name), lambda: self._sum(self._extreme(name, -1.0)))

    def largest_ratio(self, above: str, below: str) -> Numbers:
        """Largest quotient of two waveforms, such as P / V."""
        ratio = self.waveforms[above] / np.maximum(self.waveforms[below], SMALLEST_VOLUME)
        index = np.argmax(ratio, axis=0)
        return self._sum([(above, index, 1.0)]) / self._sum([(below, index, 1.0)])

    def at_start(self, name: str) -> Numbers:
        """Value at phase 0, where the ventricles begin to contract."""
        return self._sum([(name, np.zeros(self.waveforms[name].shape[1:], dtype=int), 1.0)])

    @property
    def circuit(self) -> Circuit:
        """The circuit of the beat."""
        return self._circuit or Circuit()

    def forward(self, connection: str) -> Numbers:
        """Mean of a connection's forward flow, counted as 0 while it is negative [L/min]."""
        return self.cached(("forward", connection), lambda: self._one_way("Q" + connection, 1.0))

    def backward(self, connection: str) -> Numbers:
        """Mean of a connection's backward flow [L/min]; forward minus backward is the mean flow."""
        return self.cached(("backward", connection), lambda: self._one_way("Q" + connection, -1.0))

    def _one_way(self, flow: str, sign: float) -> Numbers:
        moved = flow + MEAN in self.waveforms
        name, weights = (flow + MEAN, self._moved) if moved else (flow, self._trapezoid)
        return self._positive(name, weights, sign)

    def _positive(self, name: str, weights: np.ndarray, sign: float) -> Numbers:
        return one_way_mean(self.waveforms[name], weights, sign)

    def parameter(self, name: str) -> Numbers:
        """Value of a parameter."""
        return self._parameters[name]

    def apply(
        self,
        function: Law,
        numbers: Sequence[Numbers],
        key: Key | None = None,
        without_search: Callable[[jax.Array, jax.Array], jax.Array] | None = None,
    ) -> Sequence[Numbers]:
        """Apply a function to numbers of shape (n,) and return its results.

        Args:
            function: function that JAX can trace.
            numbers: one number for each argument, or one for each patient.
            key: identifies the function, so that its programs are stored on disk; None for its own name, or
                what it consists of.
            without_search: see `FlowFunction`.
        """
        table = np.empty((len(numbers), *np.broadcast_shapes(*map(np.shape, numbers))))
        for k, number in enumerate(numbers):
            table[k] = number
        flat = table.reshape(len(table), -1)
        if (flat == flat[:, :1]).all():
            result = np.repeat(np.asarray(single(function, key)(flat[:, 0]))[:, None], flat.shape[1], axis=1)
        elif self._batch < FEWEST_TO_COMPILE:
            result = np.stack([np.asarray(single(function, key)(column)) for column in flat.T], axis=1)
        else:
            count = flat.shape[1]
            blocks = np.arange(-(-count // SIDE_BY_SIDE) * SIDE_BY_SIDE).reshape(-1, SIDE_BY_SIDE) % count
            parts = [np.asarray(side_by_side(function, key)(flat[:, block])) for block in blocks]
            result = np.concatenate(parts, axis=1)[:, :count]
        return list(result.reshape(-1, *table.shape[1:]))

    def gas(self, what: str, where: str, place: str) -> Numbers:
        """A quantity of the gas state (`eclsim.gas.network.Quantity`)."""
        return self.cached(("gas",), self._gas)[Quantity(what, where, place)]

    def _gas(self) -> dict[Quantity, Numbers]:
        function = gas_of(self.circuit)
        return dict(zip(function.quantities, self._carried(function, ()), strict=True))

    def effective(
        self, at: str, clearances: Sequence[Numbers], water: Sequence[Numbers]
    ) -> Sequence[Numbers]:
        """Shares of clearances [mL/min] that are effective for the patient, of a filter on a connection."""
        return self._carried(effective_shares(self.circuit, at), (*clearances, *water))

    def native(self, artery: str) -> Numbers:
        """Share of the blood in an artery that the left heart has pumped (`eclsim.gas.tracers`)."""
        shares = self.cached(("native",), lambda: self._carried(native_shares(self.circuit), ()))
        return shares[ARTERIES.index(artery)]

    def _carried(self, function: FlowFunction, more: Sequence[Numbers]) -> Sequence[Numbers]:
        """Apply a function of the mean flows of all connections, of parameters and of further numbers."""
        flows = [flow(name) for flow in (self.forward, self.backward) for name in function.connections]
        numbers = [*flows, *map(self.parameter, function.parameters), *more]
        return self.apply(function.compute, numbers, function.key, function.without_search)

    def loop_area(self, pressure: str, volume: str) -> Numbers:
        """Work of a chamber on its blood in a beat [mmHg mL], -(loop integral of P dV)."""
        p, v = self.waveforms[pressure], self.waveforms[volume]
        return self._product({pressure: _midpoint(-v), volume: _midpoint(p)})

    def cached(self, key: tuple[str, ...], measure: Callable[[], Measured]) -> Measured:
        """Compute a value once; several outputs share an extreme or a solution."""
        if key not in self._cache:
            self._cache[key] = measure()
        return self._cache[key]

    def _product(self, weights: Mapping[str, np.ndarray]) -> Numbers:
        """Value of a product of two waveforms: half of each weighted sum, but the slopes of both."""
        return 0.5 * self._whole(weights)

    def _whole(self, weights: Mapping[str, np.ndarray]) -> Numbers:
        """Weighted sum over all points, with weights (points[, patients])."""
        total: Numbers = 0.0
        for name, weight in weights.items():
            series = self.waveforms[name]
            wide = (
                weight.reshape(-1, *(1,) * (series.ndim - weight.ndim))
                if weight.ndim < series.ndim
                else weight
            )
            total = total + (wide * series).sum(axis=0)
        return total

    def _sum(self, points: Points) -> Numbers:
        """Weighted sum over few points."""
        return sum(weight * _at(self.waveforms[name], index) for name, index, weight in points)

    def _weights_of(self, names: Sequence[str], patients: int) -> np.ndarray:
        """Weights of the points in the means of waveforms, shape (points, names x patients)."""
        return _mean_weights(self._widths.tobytes(), tuple(n.endswith(MEAN) for n in names), patients)

    @cached_property
    def _moved(self) -> np.ndarray:
        return _weights(self._widths)[0]

    @cached_property
    def _trapezoid(self) -> np.ndarray:
        return _weights(self._widths)[1]

    def _extreme(self, name: str, sign: float, among: np.ndarray | None = None) -> Points:
        values = sign * self.waveforms[name]
        eligible = values if among is None else np.where(among, values, -np.inf)
        top = np.argmax(eligible[: len(values) - 1], axis=0)
        known = name + RATE in self.waveforms
        points = (
            self._cubic(values, sign * self.waveforms[name + RATE], top)
            if known
            else self._parabola(values, top)
        )
        return [(name + of, index, weight) for of, index, weight in points]

    def _cubic(self, values: np.ndarray, rates: np.ndarray, top: np.ndarray) -> Points:
        """Maximum of the Hermite cubic beside the largest point, as points of a waveform and its `RATE`.

        A passing beat does not continue before its start: what falls from there begins at its maximum.
        """
        points = len(values) - 1
        left = np.where(_at(rates, top) < 0.0, (top - 1) % points, top)
        width = self._widths[left]
        change = _at(values, left + 1) - _at(values, left)
        rise, fall = _at(rates, left) * width, _at(rates, left + 1) * width
        s = _stationary(rise, 3.0 * change - 2.0 * rise - fall, rise + fall - 2.0 * change, fall)
        at_start = _is_passing(values) & (top == 0) & (left != top)
        left, s = np.where(at_start, 0, left), np.where(at_start, 0.0, s)
        width = self._widths[left]
        last = s * s * (3.0 - 2.0 * s)
        return [
            ("", left, 1.0 - last),
            ("", left + 1, last),
            (RATE, left, width * s * (1.0 - s) ** 2),
            (RATE, left + 1, width * s * s * (s - 1.0)),
        ]

    def _parabola(self, values: np.ndarray, top: np.ndarray) -> Points:
        """Maximum of the parabola through the largest point and its two neighbours, see `_cubic`."""
        points = len(values) - 1
        before, after = self._widths[(top - 1) % points], self._widths[top]
        left, peak, right = (_at(values, (top + k) % points) for k in (-1, 0, 1))
        rise, fall = (peak - left) / before, (peak - right) / after
        curvature = (rise + fall) / (before + after)
        slope = (rise * after - fall * before) / (before + after)
        flat = curvature <= 1e-9 * (1.0 + np.abs(peak))
        flat |= _is_passing(values) & (top == 0)
        s = np.where(flat, 0.0, 0.5 * slope / np.where(flat, 1.0, curvature))
        return [
            ("", (top - 1) % points, s * (s - after) / (before * (before + after))),
            ("", top, (s + before) * (after - s) / (before * after)),
            ("", (top + 1) % points, s * (s + before) / (after * (before + after))),
        ]


def _is_passing(values: np.ndarray) -> np.ndarray:
    """Whether a waveform ends elsewhere than it began: the beat has not settled."""
    return np.abs(values[-1] - values[0]) > PASSING * (1.0 + np.abs(values[0]))


def whole_beat(recorded: np.ndarray) -> np.ndarray:
    """Signals at all grid points from phase 0 to 1: the steady beat starts where it ends."""
    return np.concatenate([recorded[-1:], recorded])


def in_two_columns(series: np.ndarray) -> np.ndarray:
    """The only member's signals (..., 1) twice: sums over a single column are rounded in another order."""
    result = np.empty((*series.shape[:-1], 2))  # filled column by column: 20 times as fast as `repeat`
    result[..., 0] = result[..., 1] = series[..., 0]
    return result


def _weights(widths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weights of the points in a mean: of means over the step before, and by the trapezoidal rule."""
    return np.r_[0.0, widths], 0.5 * (np.r_[widths, 0.0] + np.r_[0.0, widths])


@lru_cache(maxsize=16)
def _mean_weights(widths: bytes, moved: tuple[bool, ...], patients: int) -> np.ndarray:
    of_steps, trapezoid = _weights(np.frombuffer(widths))
    columns = np.stack([of_steps if one else trapezoid for one in moved], axis=1)
    result = np.repeat(columns, patients, axis=1)
    result.flags.writeable = False
    return result


@lru_cache(maxsize=64)
def single(function: Law, key: Key | None) -> Callable[..., jax.Array]:
    """Return the compiled function of one patient's numbers."""
    return compiled(function, _named("alone", function, key))


@lru_cache(maxsize=64)
def side_by_side(function: Law, key: Key | None) -> Callable[..., jax.Array]:
    """Return the compiled function of `SIDE_BY_SIDE` patients' numbers, shape (numbers, patients)."""
    several = jax.vmap(function, in_axes=1, out_axes=1)
    return compiled(several, _named("side by side", function, key), OPTIMISATION_LEVEL, function)


@lru_cache(maxsize=64)
def jacobian(function: Callable[..., jax.Array], key: Key | None) -> Callable[..., jax.Array]:
    """Return a function for the value (first column) and derivatives, shape (results, 1 + numbers).

    It takes one patient's numbers and, after them, arguments that are constant.
    """

    def table(numbers: jax.Array, *constant: jax.Array) -> jax.Array:
        value, along = jax.linearize(lambda x: function(x, *constant), numbers)
        return jnp.concatenate([value[None], jax.vmap(along)(jnp.eye(numbers.shape[0]))]).T

    return compiled(table, _named("jacobian", function, key), law=function)


def _named(what: str, function: Law, key: Key | None) -> Key:
    return (what, *((function,) if key is None else key))


def _stationary(rise: np.ndarray, second: np.ndarray, third: np.ndarray, fall: np.ndarray) -> np.ndarray:
    """Position in 0..1 of the maximum of a cubic that rises at 0 and falls at 1; an end for any other."""
    root = np.sqrt(np.maximum(second**2 - 3.0 * third * rise, 0.0))
    divisor = root - second
    inside = (rise > 0.0) & (fall < 0.0) & (divisor > 0.0)
    place = np.where(inside, rise / np.where(inside, divisor, 1.0), np.where(rise > 0.0, 1.0, 0.0))
    return np.clip(place, 0.0, 1.0)


def _at(series: np.ndarray, index: np.ndarray) -> np.ndarray:
    """Value of each patient at an index ([patients]) along the points."""
    return series[index] if np.ndim(index) == 0 else series[index, np.arange(len(index))]


def _midpoint(series: np.ndarray) -> np.ndarray:
    """Weights w such that sum(w x) is the sum of midpoints of x times the steps of the series.

    The sum is the area of the closed loop, and w is its derivative with respect to x.
    """
    steps = np.diff(series, axis=0)
    nothing = np.zeros_like(series[:1])
    return 0.5 * (np.concatenate([steps, nothing]) + np.concatenate([nothing, steps]))
