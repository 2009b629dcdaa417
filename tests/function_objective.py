"""A function of the parameters in the place of the simulated patient, for tests of the search alone."""

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np

from eclsim.identification.objective import Evaluation


class FunctionObjective:
    """Residuals given by a formula; derivatives by central differences.

    Args:
        function: residuals (members, residuals) of parameters (members, parameters).
        shifts: of the parameters, one for each data point.
    """

    def __init__(self, function: Callable[[np.ndarray], np.ndarray], shifts: np.ndarray | None = None):
        self.function = function
        self.shifts = np.zeros(1) if shifts is None else shifts
        self.targets = tuple(self.shifts)
        size = function(np.zeros((1, 2))).shape[1]
        self.outputs = tuple(f"r{k}" for k in range(size))
        self.weights = np.ones((len(self.shifts), size))

    def evaluate(self, points, x: np.ndarray, options=None, resolution=None, tangents=None) -> Evaluation:
        found = self.function(x - self.shifts[points][:, None])
        zeros = np.zeros(len(x))  # no orbits here
        beats = SimpleNamespace(status=zeros, without_gases=zeros > 0.0)
        evaluation = Evaluation(beats, found, found)  # type: ignore[arg-type]
        object.__setattr__(evaluation, "points", points)
        return evaluation

    def resolutions(self, points: np.ndarray, x: np.ndarray) -> np.ndarray:
        return np.ones(len(points), dtype=int)

    def linearise(self, evaluation: Evaluation, members: list[int], x: np.ndarray) -> tuple:
        points = evaluation.points[members]  # type: ignore[attr-defined]  # kept above
        columns = []
        for k in range(x.shape[1]):
            step = 1e-6 * (np.arange(x.shape[1]) == k)
            shift = self.shifts[points][:, None]
            columns.append((self.function(x + step - shift) - self.function(x - step - shift)) / 2e-6)
        return np.stack(columns, axis=2), [None] * len(points)
