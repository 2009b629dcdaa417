"""Broyden's method for many small systems at once, each with its own inverse Jacobian.

The inverse is a common matrix plus one rank-one term per iteration and system ("good Broyden",
Broyden 1965, doi 10.1090/S0025-5718-1965-0198670-6; Kelley 1995, chapter 7).
"""

from __future__ import annotations

import numpy as np


class InverseJacobian:
    """Approximate inverse Jacobians of systems of size n, shape (n, systems) for a vector of each."""

    def __init__(self, common: np.ndarray, systems: int):
        self._common = common
        self._left: list[np.ndarray] = []
        self._right: list[np.ndarray] = []
        self._systems = systems

    def times(self, vectors: np.ndarray) -> np.ndarray:
        """Inverse times one vector of each system."""
        found = self._common @ vectors
        for left, right in zip(self._left, self._right, strict=True):
            found += left * np.einsum("ij,ij->j", right, vectors)
        return found

    def _transposed_times(self, vectors: np.ndarray) -> np.ndarray:
        found = self._common.T @ vectors
        for left, right in zip(self._left, self._right, strict=True):
            found += right * np.einsum("ij,ij->j", left, vectors)
        return found

    def learn(self, step: np.ndarray, change: np.ndarray) -> None:
        """Make the inverse map the observed change of the residual to the step that caused it."""
        image = self.times(change)
        right = self._transposed_times(step)
        scale = np.einsum("ij,ij->j", right, change)
        size = np.einsum("ij,ij->j", step, step)
        usable = np.abs(scale) > 1e-6 * size
        left = np.where(usable, (step - image) / np.where(usable, scale, 1.0), 0.0)
        self._left.append(left)
        self._right.append(right)

    def keep(self, chosen: np.ndarray) -> None:
        """Drop the systems that are not chosen (boolean mask or positions)."""
        self._left = [left[:, chosen] for left in self._left]
        self._right = [right[:, chosen] for right in self._right]
