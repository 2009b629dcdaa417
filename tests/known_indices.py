"""Functions with known Sobol indices: what the estimators are checked against.

Ishigami and Homma 1990; Sobol's g-function (Saltelli and Sobol 1995); and Ishigami's function with a
categorical third input, whose indices follow in closed form.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eclsim.sensitivity.inputs import Categorical, Continuous
from eclsim.sensitivity.runs import Runs

ISHIGAMI_INPUTS = tuple(Continuous(name, -np.pi, np.pi) for name in ("x1", "x2", "x3"))


@dataclass(frozen=True)
class ExactIndices:
    """First and total order, in the order of the inputs."""

    S1: np.ndarray
    ST: np.ndarray


def runs_of(values: np.ndarray) -> Runs:
    """Runs of a function that needs no solver; non-finite values count as failed."""
    failed = ~np.isfinite(values).all(axis=1)
    zeros = np.zeros(len(values))
    return Runs(values, np.where(failed, 3, 0), zeros.astype(int), zeros, zeros.astype(bool))


def ishigami(x1: np.ndarray, x2: np.ndarray, x3: np.ndarray, a: float = 7.0, b: float = 0.1) -> np.ndarray:
    """sin x1 + a sin^2 x2 + b x3^4 sin x1."""
    return np.sin(x1) * (1.0 + b * x3**4) + a * np.sin(x2) ** 2


def ishigami_indices(a: float = 7.0, b: float = 0.1) -> ExactIndices:
    """Exact indices of `ishigami`."""
    alone_1 = 0.5 * (1.0 + b * np.pi**4 / 5.0) ** 2
    alone_2 = a**2 / 8.0
    together = b**2 * np.pi**8 * (1.0 / 18.0 - 1.0 / 50.0)
    variance = alone_1 + alone_2 + together
    first = np.array([alone_1, alone_2, 0.0])
    return ExactIndices(first / variance, (first + np.array([together, 0.0, together])) / variance)


@dataclass(frozen=True)
class IshigamiWithChoice:
    """Ishigami's function with levels in place of x3: sin x1 (1 + slope) + a sin^2 x2 + shift.

    Args:
        slopes: of sin x1 for each level, less 1: the interaction of the choice with x1.
        shifts: of the function for each level: the effect of the choice alone.
        a: factor of sin^2 x2.
    """

    slopes: tuple[float, ...] = (0.0, 0.6, 2.0, 5.0, 9.7)
    shifts: tuple[float, ...] = (-3.0, 0.0, 1.0, -2.0, 4.0)
    a: float = 7.0

    def inputs(self) -> tuple[Continuous, Continuous, Categorical]:
        """x1, x2 and the choice."""
        levels = tuple("abcdefghij"[: len(self.slopes)])
        choice = Categorical("choice", levels, (("slope", self.slopes), ("shift", self.shifts)))
        return ISHIGAMI_INPUTS[0], ISHIGAMI_INPUTS[1], choice

    def __call__(self, x1: np.ndarray, x2: np.ndarray, slope: np.ndarray, shift: np.ndarray) -> np.ndarray:
        """The function, with the numbers that the choice sets."""
        return np.sin(x1) * (1.0 + slope) + self.a * np.sin(x2) ** 2 + shift

    def exact(self) -> ExactIndices:
        """Exact indices of x1, x2 and the choice."""
        slope, shift = np.array(self.slopes), np.array(self.shifts)
        first = np.array([0.5 * (1.0 + slope.mean()) ** 2, self.a**2 / 8.0, shift.var()])
        together = 0.5 * slope.var()
        variance = first.sum() + together
        return ExactIndices(first / variance, (first + np.array([together, 0.0, together])) / variance)


def sobol_g(x: np.ndarray, a: Sequence[float]) -> np.ndarray:
    """Product of (|4 x - 2| + a) / (1 + a) over the inputs; x of shape (..., inputs) in [0, 1]."""
    weights = np.asarray(a, dtype=float)
    return np.prod((np.abs(4.0 * x - 2.0) + weights) / (1.0 + weights), axis=-1)


def sobol_g_indices(a: Sequence[float]) -> ExactIndices:
    """Exact indices of `sobol_g`."""
    of_input = 1.0 / (3.0 * (1.0 + np.asarray(a, dtype=float)) ** 2)
    product = np.prod(1.0 + of_input)
    variance = product - 1.0
    return ExactIndices(of_input / variance, of_input * (product / (1.0 + of_input)) / variance)
