"""Broyden's method for many small systems at once, each with its own inverse Jacobian.

The inverse is the one that the search starts with plus a rank-one term per iteration and system ("good
Broyden", Broyden 1965, doi 10.1090/S0025-5718-1965-0198670-6; Kelley 1995, chapter 7).
"""

from __future__ import annotations

import numpy as np

WORTH_LEARNING = 1e-6
"""Smallest image of a change along its step, as a share of the step's square, that is learnt from."""


class InverseJacobian:
    """Approximate inverse Jacobians of systems of size n, shape (n, systems) for a vector of each.

    Args:
        first: inverse that all start from, shape (n, n), or that each starts from, shape (n, n, systems).
        systems: how many systems.
        terms: largest number of rank-one terms, one for each call of `learn`.
    """

    def __init__(self, first: np.ndarray, systems: int, terms: int):
        self._first = first
        self._left = np.empty((terms, len(first), systems))
        self._right = np.empty_like(self._left)
        self._count = 0

    def times(self, vectors: np.ndarray) -> np.ndarray:
        """Inverse times one vector of each system."""
        found = _product(self._first, vectors)
        return found + self._terms(self._left, self._right, vectors) if self._count else found

    def _terms(self, left: np.ndarray, right: np.ndarray, vectors: np.ndarray) -> np.ndarray:
        """Sum of left (right . vector) over the rank-one terms."""
        shares = (right[: self._count] * vectors).sum(axis=1)
        return (left[: self._count] * shares[:, None]).sum(axis=0)

    def learn(self, step: np.ndarray, change: np.ndarray) -> None:
        """Make the inverse map the observed change of the residual to the step that caused it."""
        image = self.times(change)
        right = _product(self._first.swapaxes(0, 1), step) + self._terms(self._right, self._left, step)
        scale = (right * change).sum(axis=0)
        usable = np.abs(scale) > WORTH_LEARNING * (step * step).sum(axis=0)
        self._left[self._count] = np.where(usable, (step - image) / np.where(usable, scale, 1.0), 0.0)
        self._right[self._count] = right
        self._count += 1

    def keep(self, chosen: np.ndarray) -> None:
        """Drop the systems that are not chosen (boolean mask or positions)."""
        self._left, self._right = (self._of(terms, chosen) for terms in (self._left, self._right))
        if self._first.ndim == 3:
            self._first = self._first[:, :, chosen]

    def _of(self, terms: np.ndarray, chosen: np.ndarray) -> np.ndarray:
        """The chosen systems' share of the terms there are, with room for those to come."""
        used = terms[: self._count, :, chosen]
        found = np.empty((*terms.shape[:2], used.shape[2]))
        found[: self._count] = used
        return found


def _product(matrix: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """One matrix, or one for each system, times one vector of each system."""
    return matrix @ vectors if matrix.ndim == 2 else np.einsum("ijs,js->is", matrix, vectors)
