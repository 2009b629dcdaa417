"""Means, extremes and loop areas of waveforms over one beat on a non-uniform grid.

Extremes lie between grid points: diastolic pressure ends within a millisecond of the valve's opening. Where
the rate of a waveform is known (it follows from the flows), they are read off the cubic with the right values
and slopes, else off the parabola through three points, so that they do not jump when a parameter moves the
peak from one grid point to the next.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np

from eclsim.haemodynamics.dual import Dual
from eclsim.solver.recording import RATE

SMALLEST_VOLUME = 1e-6
"""Divisor [mL] in place of a volume that is zero or less."""


class Measures:
    """The waveforms of a beat and what is measured on them.

    A waveform is an array (points[, patients]) over a whole beat, first and last point the same phase, or a
    `Dual` of such arrays: then every measure carries its derivatives.

    Args:
        waveforms: by name; pressures [mmHg], flows [mL/s], volumes [mL].
        phases: grid points from 0 to 1, shape (points,).
    """

    def __init__(self, waveforms: Mapping[str, Any], phases: np.ndarray):
        self.waveforms = waveforms
        self._phases = phases
        self._found: dict[tuple[str, float], Any] = {}

    @cached_property
    def _weights(self) -> np.ndarray:
        width = np.diff(self._phases)
        return 0.5 * (np.r_[width, 0.0] + np.r_[0.0, width])

    def mean(self, name: str) -> Any:
        """Mean over the beat (trapezoidal rule)."""
        return self._linear(
            self.waveforms[name], lambda series: np.tensordot(series, self._weights, axes=(-1, 0))
        )

    def maximum(self, name: str) -> Any:
        """Largest value over the beat."""
        return self._extreme(name, 1.0)

    def minimum(self, name: str) -> Any:
        """Smallest value over the beat."""
        return self._extreme(name, -1.0) * -1.0

    def _extreme(self, name: str, sign: float) -> Any:
        """Largest value of sign * waveform; kept, since several outputs share it."""
        key = (name, sign)
        if key not in self._found:
            if name + RATE in self.waveforms:
                self._found[key] = self._cubic(self.waveforms[name], self.waveforms[name + RATE], sign)
            else:
                self._found[key] = self._parabola(self.waveforms[name], sign)
        return self._found[key]

    def largest_ratio(self, above: str, below: str) -> Any:
        """Largest quotient of two waveforms, such as P / V."""
        top, bottom = self.waveforms[above], self.waveforms[below]
        ratio = _value(top) / np.maximum(_value(bottom), SMALLEST_VOLUME)
        index = np.argmax(ratio, axis=0)
        return _at(top, index) / _at(bottom, index)

    def at_maximum(self, name: str, of: str) -> Any:
        """Value of one waveform where another is largest."""
        return _at(self.waveforms[name], np.argmax(_value(self.waveforms[of]), axis=0))

    def loop_area(self, pressure: str, volume: str) -> Any:
        """Work [mmHg mL] that a chamber does on its blood in a beat, -(loop integral of P dV)."""
        p, v = self.waveforms[pressure], self.waveforms[volume]
        middle = self._linear(p, lambda s: 0.5 * (s[..., 1:] + s[..., :-1]), keep=True)
        change = self._linear(v, lambda s: s[..., :-1] - s[..., 1:], keep=True)
        return self._linear(middle * change, lambda s: s.sum(axis=-1), moved=True)

    def _linear(self, series: Any, function: Any, keep: bool = False, moved: bool = False) -> Any:
        """Apply a linear function along the points, which it finds on the last axis."""

        def one(array: np.ndarray, axis: int) -> np.ndarray:
            found = function(array if moved else np.moveaxis(array, axis, -1))
            return found if keep or moved else np.asarray(found)

        if isinstance(series, Dual):
            return Dual(one(series.value, 0), one(series.tangent, 1))
        return one(series, 0)

    def _cubic(self, series: Any, rate: Any, sign: float) -> Any:
        """Top of the Hermite cubic beside the largest point; to first order its place does not matter."""
        values, rates = sign * _value(series), sign * _value(rate)
        points = len(values) - 1
        top = np.argmax(values[:points], axis=0)
        left = np.where(_at(rates, top) < 0.0, (top - 1) % points, top)
        width = np.diff(self._phases)[left]
        start, end = _at(values, left), _at(values, left + 1)
        rise, fall = _at(rates, left) * width, _at(rates, left + 1) * width
        s = _stationary(
            rise, 3.0 * (end - start) - 2.0 * rise - fall, rise + fall - 2.0 * (end - start), fall
        )
        last = s * s * (3.0 - 2.0 * s)
        found = _at(series, left) * (1.0 - last) + _at(series, left + 1) * last
        slopes = _at(rate, left) * (s * (1.0 - s) ** 2) + _at(rate, left + 1) * (s * s * (s - 1.0))
        return (found + slopes * width) * sign

    def _parabola(self, series: Any, sign: float) -> Any:
        """Top of the parabola through the largest point and its two neighbours; the beat is periodic."""
        values = sign * _value(series)
        points = len(values) - 1
        top = np.argmax(values[:points], axis=0)
        widths = np.diff(self._phases)
        before, after = widths[(top - 1) % points], widths[top]
        left, peak, right = (_at(values, (top + k) % points) for k in (-1, 0, 1))
        rise, fall = (peak - left) / before, (peak - right) / after
        curvature = (rise + fall) / (before + after)
        slope = (rise * after - fall * before) / (before + after)
        flat = curvature <= 1e-9 * (1.0 + np.abs(peak))
        place = np.where(flat, 0.0, 0.5 * slope / np.where(flat, 1.0, curvature))
        shares = (
            place * (place - after) / (before * (before + after)),
            (place + before) * (after - place) / (before * after),
            place * (place + before) / (after * (before + after)),
        )
        parts = [_at(series, (top + k) % points) * share for k, share in zip((-1, 0, 1), shares, strict=True)]
        return (parts[0] + parts[1] + parts[2]) * sign


def _stationary(rise: Any, second: Any, third: Any, fall: Any) -> np.ndarray:
    """Where in 0..1 a cubic that rises at 0 and falls at 1 is largest; an end where it does not."""
    root = np.sqrt(np.maximum(second**2 - 3.0 * third * rise, 0.0))
    divisor = root - second
    inside = (rise > 0.0) & (fall < 0.0) & (divisor > 0.0)
    place = np.where(inside, rise / np.where(inside, divisor, 1.0), np.where(rise > 0.0, 1.0, 0.0))
    return np.clip(place, 0.0, 1.0)


def _value(x: Any) -> np.ndarray:
    return x.value if isinstance(x, Dual) else x


def _at(series: Any, index: np.ndarray) -> Any:
    """Value of each patient at an index ([patients]) along the points."""
    if isinstance(series, Dual):
        if np.ndim(index) == 0:
            return Dual(series.value[index], series.tangent[:, index])
        wide = np.broadcast_to(index, (series.tangent.shape[0], 1, *index.shape))
        tangent = np.take_along_axis(series.tangent, wide, axis=1)[:, 0]
        return Dual(_at(series.value, index), tangent)
    return series[index] if np.ndim(index) == 0 else np.take_along_axis(series, index[None], axis=0)[0]
