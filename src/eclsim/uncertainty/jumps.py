"""Jumps across the posterior, between the short trajectories of a sampler.

After each draw a point is proposed, from the distributions that the weighted draws of the posterior came
from, and taken or not by the rule of Metropolis for proposals that do not depend on the place. Whatever the
proposals, the chain keeps its distribution; good ones carry it between arms of the posterior that no
trajectory joins: Gabrié, Rotskoff and Vanden-Eijnden 2022, PNAS 119, e2109420119. The proposals of all chains
are one batch of beats.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eclsim.uncertainty.density import Posterior
from eclsim.uncertainty.mixture import Mixture

MARGIN = 0.5
"""Of a logarithm: the batch's potential and the chain's own, on another grid, differ by less."""


@dataclass(frozen=True)
class Jumps:
    """Proposals, one for each draw of each chain.

    Args:
        z: hidden variables, shape (chains, draws, parameters).
        potential: U there, from the batch; infinite without a steady beat. Shape (chains, draws).
        log_density: logarithm of the density they were drawn from.
        log_chance: logarithm of a number between 0 and 1, below which the ratio of the densities must be.
        mixture: what they were drawn from.
    """

    z: np.ndarray
    potential: np.ndarray
    log_density: np.ndarray
    log_chance: np.ndarray
    mixture: Mixture

    def level(self, z: np.ndarray, potential: float) -> float:
        """Logarithm of posterior over proposal density at a place, up to a constant."""
        return -potential - float(self.mixture.log_density(z))

    def hopeless(self, chain: int, draw: int, level: float) -> bool:
        """Whether the batch's potential alone tells that a jump from a place of that level is refused."""
        return self._short(chain, draw, level, float(self.potential[chain, draw])) > MARGIN

    def refused(self, chain: int, draw: int, level: float, potential: float) -> bool:
        """Whether a jump from a place of that level to the proposal, with its own potential, is refused."""
        return not self._short(chain, draw, level, potential) <= 0.0

    def _short(self, chain: int, draw: int, level: float, potential: float) -> float:
        """By how much the ratio of the densities falls short, as a logarithm."""
        there = -potential - self.log_density[chain, draw]
        return float(self.log_chance[chain, draw] + level - there)


def jumps(posterior: Posterior, mixture: Mixture, chains: int, draws: int, seed: int) -> Jumps:
    """Draw proposals and evaluate them side by side."""
    random = np.random.default_rng([seed, chains, draws])
    z = mixture.draws(random, chains * draws)
    potential = posterior.potential(z, posterior.simulate(z, mixture.transports[-1].centre))
    shape = (chains, draws)
    chance = np.log(random.random(shape))
    density = mixture.log_density(z).reshape(shape)
    return Jumps(z.reshape(*shape, -1), potential.reshape(shape), density, chance, mixture)
