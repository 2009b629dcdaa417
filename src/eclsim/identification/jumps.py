"""Jumps across the posterior, between the short trajectories of a sampler.

After each draw a point is proposed, from the distributions that the weighted draws of the posterior came
from, and taken or not by the rule of Metropolis for proposals that do not depend on the place. Whatever the
proposals, the chain keeps its distribution; good ones carry it between arms of the posterior that no
trajectory joins: Gabrié, Rotskoff and Vanden-Eijnden 2022, PNAS 119, e2109420119. The rule holds only if the
potential is a function of the point, the same for the place that is left and for the one that is entered: the
caller evaluates both in the same way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eclsim.identification.mixture import Mixture


@dataclass(frozen=True)
class Jumps:
    """Proposals, one for each draw of each chain.

    Args:
        z: hidden variables, shape (chains, draws, parameters).
        log_density: logarithm of the density they were drawn from, shape (chains, draws).
        log_chance: logarithm of a number between 0 and 1, below which the ratio of the densities must be.
        mixture: what they were drawn from.
    """

    z: np.ndarray
    log_density: np.ndarray
    log_chance: np.ndarray
    mixture: Mixture

    def level(self, z: np.ndarray, potential: float) -> float:
        """Logarithm of posterior over proposal density at a place, up to a constant."""
        return -potential - float(self.mixture.log_density(z))

    def refused(self, chain: int, draw: int, level: float, potential: float) -> bool:
        """Whether a jump from a place of that level to the proposal, with its potential, is refused."""
        there = -potential - self.log_density[chain, draw]
        return not self.log_chance[chain, draw] + level - there <= 0.0


def jumps(mixture: Mixture, chains: int, draws: int, seed: int) -> Jumps:
    """Draw proposals."""
    random = np.random.default_rng([seed, chains, draws])
    z = mixture.draws(random, chains * draws)
    shape = (chains, draws)
    chance = np.log(random.random(shape))
    return Jumps(z.reshape(*shape, -1), mixture.log_density(z).reshape(shape), chance, mixture)
