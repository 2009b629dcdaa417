"""What is known of the parameters before any measurement.

Every parameter has a hidden variable z of its own that is standard normal before any measurement; the
parameter is a rising function of it that ends at the bounds. Samplers and filters work on z: no bounds, one
scale, and a parameter that the measurements say nothing about keeps z at N(0, 1).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import ndtr, ndtri

PriorKind = Literal["log-uniform", "log-normal"]
DEVIATIONS_TO_BOUNDS = 2.0
"""Bounds of the log-normal prior are this many standard deviations from the start value (the wider side)."""
FARTHEST = 6.0
"""Largest |z| that a parameter is turned into: a share of 1e-9 of the prior lies beyond."""


@dataclass(frozen=True)
class Prior:
    """Independent priors of the logarithms of the parameters.

    Args:
        names: of the parameters.
        lower: logarithm of the lower bounds, shape (parameters,).
        upper: of the upper bounds.
        start: of the start values, the median of the log-normal kind before it is cut at the bounds.
        kind: "log-uniform", each logarithm between the bounds as likely as any other, or "log-normal".
    """

    names: tuple[str, ...]
    lower: np.ndarray
    upper: np.ndarray
    start: np.ndarray
    kind: PriorKind = "log-uniform"

    def x_of(self, z: np.ndarray) -> np.ndarray:
        """Logarithms of the parameters, shape (..., parameters) as z."""
        share = ndtr(z)
        if self.kind == "log-uniform":
            return self.lower + (self.upper - self.lower) * share
        first, last = self._ends()
        inside = self.start + self._spread() * ndtri(first + (last - first) * share)
        return np.clip(inside, self.lower, self.upper)

    def slopes(self, z: np.ndarray) -> np.ndarray:
        """d log parameter / dz, shape (..., parameters)."""
        density = np.exp(-0.5 * np.asarray(z) ** 2) / np.sqrt(2.0 * np.pi)
        if self.kind == "log-uniform":
            return (self.upper - self.lower) * density
        first, last = self._ends()
        standard = (self.x_of(z) - self.start) / self._spread()
        return self._spread() * (last - first) * density / (np.exp(-0.5 * standard**2) / np.sqrt(2.0 * np.pi))

    def z_of(self, x: np.ndarray) -> np.ndarray:
        """Hidden variables of logarithms; a parameter at a bound gives -`FARTHEST` or `FARTHEST`."""
        if self.kind == "log-uniform":
            share = (np.asarray(x) - self.lower) / (self.upper - self.lower)
        else:
            first, last = self._ends()
            share = (ndtr((np.asarray(x) - self.start) / self._spread()) - first) / (last - first)
        return np.clip(ndtri(np.clip(share, 0.0, 1.0)), -FARTHEST, FARTHEST)

    def _spread(self) -> np.ndarray:
        return np.maximum(self.upper - self.start, self.start - self.lower) / DEVIATIONS_TO_BOUNDS

    def _ends(self) -> tuple[np.ndarray, np.ndarray]:
        return ndtr((self.lower - self.start) / self._spread()), ndtr(
            (self.upper - self.start) / self._spread()
        )
