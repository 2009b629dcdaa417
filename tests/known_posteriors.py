"""Posteriors whose answer is known on paper."""

from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np

from eclsim.identification.density import Prior


@dataclass
class CurvedPosterior:
    """Two outputs of two hidden variables: y = (10 z1, z2 + bend z1^2); the likelihood is Gaussian."""

    bend: float = 0.0
    target: np.ndarray = field(default_factory=lambda: np.array([5.0, 1.0]))
    scale: np.ndarray = field(default_factory=lambda: np.array([4.0, 0.5]))
    outputs: tuple = ("first", "second")
    calls: int = 0

    @property
    def prior(self):
        return Prior(("a", "b"), np.zeros(2), np.log([0.1, 0.1]), np.log([10.0, 10.0]))

    def simulate(self, z, centre=None):
        self.calls += len(z)
        return np.stack([10.0 * z[..., 0], z[..., 1] + self.bend * z[..., 0] ** 2], axis=-1)

    def beats(self, z):
        values = self.simulate(z).T
        return SimpleNamespace(values=values, without_gases=np.zeros(len(z), dtype=bool))

    def potential(self, z, outputs, temper=1.0):
        misfit = np.sum(((outputs - self.target) / self.scale) ** 2, axis=-1)
        misfit = np.where(np.isfinite(misfit), misfit, np.inf)
        return 0.5 * temper * misfit + 0.5 * np.sum(z**2, axis=-1)

    def jacobian(self, z):
        return np.array([[10.0, 0.0], [2.0 * self.bend * z[0], 1.0]])

    def moments(self):
        """Mean and covariance of z by quadrature."""
        axis = np.linspace(-5.0, 5.0, 401)
        z = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
        weights = np.exp(-self.potential(z, self.simulate(z)))
        weights /= weights.sum()
        mean = weights @ z
        return mean, ((z - mean).T * weights) @ (z - mean)


@dataclass
class TwoArms(CurvedPosterior):
    """One output, z2 - (3 z1)^2, far from 0: the posterior is two arms with hardly anything between."""

    target: np.ndarray = field(default_factory=lambda: np.array([4.0]))
    scale: np.ndarray = field(default_factory=lambda: np.array([0.5]))
    outputs: tuple = ("first",)

    def simulate(self, z, centre=None):
        return (9.0 * z[..., 0] ** 2 - z[..., 1])[..., None]

    def jacobian(self, z):
        return np.array([[18.0 * z[0], -1.0]])


@dataclass
class TwoSolutions(CurvedPosterior):
    """y = ((z1 - 0.3)^2, z1 + z2): the first output has two narrow solutions, z1 = -1.7 and 2.3."""

    target: np.ndarray = field(default_factory=lambda: np.array([4.0, 0.0]))
    scale: np.ndarray = field(default_factory=lambda: np.array([0.15, 0.3]))

    def simulate(self, z, centre=None):
        return np.stack([(z[..., 0] - 0.3) ** 2, z[..., 0] + z[..., 1]], axis=-1)

    def jacobian(self, z):
        return np.array([[2.0 * (z[0] - 0.3), 0.0], [1.0, 1.0]])


class HalfBlind(TwoArms):
    """Many members side by side find no beat in the right arm, where one by one all is well."""

    def simulate(self, z, centre=None):
        result = super().simulate(z)
        if z.ndim > 1:
            result[z[:, 0] > 0.0] = np.nan
        return result


class AnalyticGradient:
    """Stands for a `GradientEvaluator`: the potential and its gradient of a `CurvedPosterior`."""

    last = None

    def __init__(self, posterior, centre, by_point=False):
        self.posterior = posterior

    def linear(self, z):
        return self.posterior.simulate(z), self.posterior.jacobian(z)

    def potential(self, z):
        p = self.posterior
        misfit = (p.simulate(z) - p.target) / p.scale
        return 0.5 * float(misfit @ misfit + z @ z), p.jacobian(z).T @ (misfit / p.scale) + z
