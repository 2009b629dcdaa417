"""Mixtures of Student's t distributions, each bent by a `Transport`: proposals for draws of a posterior."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaln, logsumexp

from eclsim.identification.transport import Transport

DEGREES = 5.0
"""Of freedom: the tails are longer than those of a posterior."""


@dataclass(frozen=True)
class Mixture:
    """Equal shares of several distributions.

    Args:
        transports: of each.
    """

    transports: tuple[Transport, ...]

    def draws(self, random: np.random.Generator, count: int) -> np.ndarray:
        """Hidden variables, shape (count, size); as many from each distribution as chance has it."""
        size = len(self.transports[0].centre)
        normal = random.standard_normal((count, size))
        u = normal / np.sqrt(random.chisquare(DEGREES, count) / DEGREES)[:, None]
        z = np.empty_like(u)
        source = random.integers(len(self.transports), size=count)
        for k, transport in enumerate(self.transports):
            z[source == k] = transport.z_of(u[source == k])[0]
        return z

    def log_density(self, z: np.ndarray) -> np.ndarray:
        """Logarithm of the density at points of shape (..., size)."""
        size = z.shape[-1]
        parts = []
        for transport in self.transports:
            u, log_slope = transport.u_of(z)
            parts.append(-0.5 * (DEGREES + size) * np.log1p(np.sum(u**2, axis=-1) / DEGREES) - log_slope)
        constant = (
            gammaln(0.5 * (DEGREES + size)) - gammaln(0.5 * DEGREES) - 0.5 * size * np.log(DEGREES * np.pi)
        )
        return logsumexp(parts, axis=0) - np.log(len(parts)) + constant
