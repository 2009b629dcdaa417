"""Proposals of samplers: mixtures of distributions with long tails, and jumps from one mode to another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaln, logsumexp

from eclsim.identification.transport import Transport

DEGREES = 5.0
"""Degrees of freedom of Student's t distribution, whose tails are longer than those of a posterior."""


@dataclass(frozen=True)
class Mixture:
    """Equally weighted mixture of Student's t distributions in the coordinates of several transports."""

    transports: tuple[Transport, ...]

    def draws(self, random: np.random.Generator, count: int) -> np.ndarray:
        """Draw latent variables, shape (count, size); the component of each draw is random."""
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
        terms = []
        for transport in self.transports:
            u, log_slope = transport.u_of(z)
            terms.append(-0.5 * (DEGREES + size) * np.log1p(np.sum(u**2, axis=-1) / DEGREES) - log_slope)
        constant = (
            gammaln(0.5 * (DEGREES + size)) - gammaln(0.5 * DEGREES) - 0.5 * size * np.log(DEGREES * np.pi)
        )
        return logsumexp(terms, axis=0) - np.log(len(terms)) + constant


@dataclass(frozen=True)
class Jumps:
    """Proposed jumps across the posterior, one after each trajectory of a sampler.

    A point is proposed from the distributions that the weighted draws of the posterior came from, and
    accepted or rejected by the Metropolis rule for proposals that do not depend on the present point. The
    chain keeps its distribution with any proposals; good ones carry it between arms of the posterior that no
    trajectory connects: Gabrié, Rotskoff and Vanden-Eijnden 2022, PNAS 119, e2109420119. The rule holds only
    if the potential is a function of the point alone, the same for the present and the proposed point.

    Args:
        z: proposed latent variables, shape (chains, draws, parameters).
        log_density: logarithm of the proposal density at z, shape (chains, draws).
        log_chance: logarithm of a uniform random number; a jump is refused if the ratio of densities is
            smaller.
        mixture: proposal distribution.
    """

    z: np.ndarray
    log_density: np.ndarray
    log_chance: np.ndarray
    mixture: Mixture

    @classmethod
    def draw(cls, mixture: Mixture, chains: int, draws: int, seed: int) -> Jumps:
        """Draw proposals for several chains."""
        random = np.random.default_rng([seed, chains, draws])
        z = mixture.draws(random, chains * draws)
        shape = (chains, draws)
        chance = np.log(random.random(shape))
        return cls(z.reshape(*shape, -1), mixture.log_density(z).reshape(shape), chance, mixture)

    def log_ratio(self, z: np.ndarray, potential: float) -> float:
        """Logarithm of the ratio of posterior to proposal density at a point, up to a constant."""
        return -potential - float(self.mixture.log_density(z))

    def refused(self, chain: int, draw: int, log_ratio: float, potential: float) -> bool:
        """Whether the jump from a point with this ratio to the proposal, with its potential, is refused."""
        proposal_ratio = -potential - self.log_density[chain, draw]
        return not self.log_chance[chain, draw] + log_ratio - proposal_ratio <= 0.0
