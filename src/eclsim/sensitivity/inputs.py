"""Inputs of a sensitivity analysis: what is varied, over which range or which choices."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Continuous:
    """A number, uniform between two bounds.

    Args:
        name: parameter of the model.
        low: lower bound, in the parameter's unit.
        high: upper bound.
    """

    name: str
    low: float
    high: float

    def settings(self, unit: np.ndarray) -> dict[str, np.ndarray]:
        """Values of the parameter for numbers in [0, 1), scaled as SALib does."""
        return {self.name: unit * (self.high - self.low) + self.low}

    def table_column(self, unit: np.ndarray) -> np.ndarray:
        """What a table of samples shows."""
        return self.settings(unit)[self.name]

    def description(self) -> dict[str, Any]:
        """As plain data, for files and for comparing designs."""
        return {"name": self.name, "low": self.low, "high": self.high}


@dataclass(frozen=True)
class Categorical:
    """One of several choices, all equally likely; each choice sets one parameter or several.

    The choice is a function of the input's own coordinate in the design, so a row of the design that shares
    the coordinate shares the choice: what the estimators rely on.

    Args:
        name: of the input.
        levels: names of the choices.
        sets: parameter and its value for each level.
    """

    name: str
    levels: tuple[str, ...]
    sets: tuple[tuple[str, tuple[float, ...]], ...]

    def choose(self, unit: np.ndarray) -> np.ndarray:
        """Position of the chosen level for numbers in [0, 1)."""
        return np.minimum((unit * len(self.levels)).astype(int), len(self.levels) - 1)

    def settings(self, unit: np.ndarray) -> dict[str, np.ndarray]:
        """Values of all parameters that the choice sets."""
        chosen = self.choose(unit)
        return {parameter: np.asarray(values, dtype=float)[chosen] for parameter, values in self.sets}

    def table_column(self, unit: np.ndarray) -> np.ndarray:
        """Names of the chosen levels."""
        return np.array(self.levels, dtype=object)[self.choose(unit)]

    def description(self) -> dict[str, Any]:
        """As plain data, for files and for comparing designs."""
        return {"name": self.name, "levels": list(self.levels), "sets": {p: list(v) for p, v in self.sets}}


Input = Continuous | Categorical


def described_input(description: dict[str, Any]) -> Input:
    """The input that a description came from."""
    if "levels" not in description:
        return Continuous(description["name"], description["low"], description["high"])
    sets = tuple((name, tuple(values)) for name, values in description["sets"].items())
    return Categorical(description["name"], tuple(description["levels"]), sets)
