"""Means, extremes and loop areas of waveforms over one beat on a non-uniform grid.

Extremes are read off the parabola through the largest (smallest) point and its neighbours, so they do not
jump when a parameter moves the peak from one grid point to the next.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import jax.numpy as jnp
import numpy as np


class Measures:
    """The waveforms of a beat and what is measured on them.

    Args:
        waveforms: arrays (points[, patients]) over a whole beat, first and last point the same phase.
        phases: grid points from 0 to 1, shape (points,).
        values: parameters.
    """

    def __init__(self, waveforms: dict[str, Any], phases: np.ndarray, values: Any):
        self.waveforms = waveforms
        self.values = values
        self._phases = phases

    def __contains__(self, name: str) -> bool:
        return name in self.waveforms

    @cached_property
    def _weights(self) -> np.ndarray:
        width = np.diff(self._phases)
        return 0.5 * (np.r_[width, 0.0] + np.r_[0.0, width])

    def mean(self, name: str) -> Any:
        """Mean over the beat (trapezoidal rule)."""
        return jnp.tensordot(self._weights, self.waveforms[name], axes=(0, 0))

    def maximum(self, name: str) -> Any:
        """Largest value over the beat."""
        return _peak(self.waveforms[name], self._phases)

    def minimum(self, name: str) -> Any:
        """Smallest value over the beat."""
        return -_peak(-self.waveforms[name], self._phases)

    def at_maximum(self, name: str, of: str) -> Any:
        """Value of one waveform where another is largest."""
        index = jnp.argmax(self.waveforms[of], axis=0, keepdims=True)
        return jnp.take_along_axis(self.waveforms[name], index, axis=0)[0]

    def loop_area(self, pressure: str, volume: str) -> Any:
        """Work [mmHg mL] that a chamber does on its blood in a beat, -(loop integral of P dV)."""
        p, v = self.waveforms[pressure], self.waveforms[volume]
        return -jnp.sum(0.5 * (p[1:] + p[:-1]) * (v[1:] - v[:-1]), axis=0)


def _peak(series: Any, phases: np.ndarray) -> Any:
    """Top of the parabola through the largest point and its two neighbours; the beat is periodic."""
    points = series.shape[0] - 1
    top = jnp.argmax(series[:points], axis=0)
    widths = jnp.asarray(np.diff(phases))
    before, after = widths[(top - 1) % points], widths[top]
    take = lambda k: jnp.take_along_axis(series, ((top + k) % points)[None], axis=0)[0]  # noqa: E731
    left, peak, right = take(-1), take(0), take(1)
    rise, fall = (peak - left) / before, (peak - right) / after
    curvature = (rise + fall) / (before + after)
    slope = (rise * after - fall * before) / (before + after)
    flat = curvature <= 1e-12 * (1.0 + jnp.abs(peak))
    return jnp.where(flat, peak, peak + 0.25 * slope**2 / jnp.where(flat, 1.0, curvature))
