"""The posterior without Markov chains: draws from an approximation, weighted by the exact density.

All draws of a round are simulated as one batch of steady beats, so this takes seconds where chains take
minutes. The first rounds sample flatter densities, in which the measurements have less weight, so that no arm
of the posterior is missed. Each round fits its proposal (Student's t distribution in the coordinates of a
`Transport`) to the weighted draws of all earlier rounds. All draws are weighted by the mixture of all
proposals: adaptive multiple importance sampling, Cornuet, Marin, Mira and Robert 2012, Scandinavian Journal
of Statistics 39, 798-812. The largest weights are smoothed with a generalised Pareto distribution. Its shape
k tells whether the weights can be trusted, which is the case below 0.7: Vehtari, Simpson, Gelman, Yao and
Gabry 2024, JMLR 25, 1-58.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from eclsim.identification.density import Gaussian, PosteriorDensity
from eclsim.identification.proposals import Mixture
from eclsim.identification.transport import Transport

TEMPERATURES = (0.02, 0.08, 0.25, 0.6, 1.0, 1.0, 1.0)
"""Weight of the measurements in each round."""
LARGEST_SHAPE = 0.7
FEWEST_EFFECTIVE = 400
"""With fewer effective draws, of chains or weighted, intervals are not trusted."""
GOOD_SHAPE = 0.6
GOOD_EFFECTIVE = 600
MOST_FURTHER_ROUNDS = 6
"""Largest number of rounds that are added until the weights are good."""


@dataclass(frozen=True)
class WeightedDraws:
    """Weighted draws of a posterior.

    Args:
        z: latent variables, shape (draws, parameters).
        outputs: outputs of the model at z, shape (draws, outputs).
        weights: weights of the draws, which sum to 1, shape (draws,).
        shape: Pareto k of the largest weights.
        proposals: distributions that the draws come from, and finally one fitted to all draws.
    """

    z: np.ndarray
    outputs: np.ndarray
    weights: np.ndarray
    shape: float
    proposals: Mixture

    @property
    def transport(self) -> Transport:
        """Coordinates fitted to all weighted draws."""
        return self.proposals.transports[-1]

    @property
    def effective(self) -> float:
        """Effective number of draws."""
        return effective_number(self.weights)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons why the draws cannot be trusted; empty if they can."""
        reasons = []
        if not self.shape < LARGEST_SHAPE:
            reasons.append(f"Pareto k of the weights is {self.shape:.2f} (below {LARGEST_SHAPE})")
        if self.effective < FEWEST_EFFECTIVE:
            reasons.append(f"{self.effective:.0f} effective draws (at least {FEWEST_EFFECTIVE})")
        return tuple(reasons)

    @property
    def doubts(self) -> tuple[str, ...]:
        """The reasons, with advice."""
        return tuple(f"{reason}: sample with chains" for reason in self.reasons)

    @property
    def without_beat(self) -> int:
        """Number of draws at which the model has no steady beat; their weight is 0."""
        return int((~np.isfinite(self.outputs).all(axis=1)).sum())

    def tempered(self) -> tuple[np.ndarray, float]:
        """Weights that can be trusted: raised to the largest power, at most 1, for which no reason remains.

        A smaller power moves the distribution from the posterior towards the wider proposals.

        Returns:
            Weights, which sum to 1, and the power.
        """

        def raised(power: float) -> np.ndarray:
            powers = np.where(self.weights > 0.0, np.maximum(self.weights, 1e-300) ** power, 0.0)
            return powers / powers.sum()

        most = 1.0 if self.shape < LARGEST_SHAPE else LARGEST_SHAPE / self.shape
        if effective_number(raised(most)) >= FEWEST_EFFECTIVE:
            return (self.weights, 1.0) if most == 1.0 else (raised(most), most)
        low = 0.0
        for _ in range(30):
            power = 0.5 * (low + most)
            enough = effective_number(raised(power)) >= FEWEST_EFFECTIVE
            low, most = (power, most) if enough else (low, power)
        return raised(low), low

    def resample(self, count: int, seed: int) -> np.ndarray:
        """Indices of equally weighted draws (systematic resampling), shape (count,)."""
        places = (np.arange(count) + np.random.default_rng(seed).random()) / count
        return np.searchsorted(np.cumsum(self.weights), places).clip(max=len(self.weights) - 1)


def effective_number(weights: np.ndarray) -> float:
    """Effective number of draws, given weights that sum to 1."""
    return 1.0 / float(np.sum(weights**2))


def importance_sample(
    posterior: PosteriorDensity, gaussian: Gaussian, count: int = 1024, seed: int = 0
) -> WeightedDraws:
    """Draw in rounds, each from a proposal fitted to all earlier rounds.

    Where the density has several solutions, each has a proposal of its own, fitted to the draws nearest to
    it: one map would have to span the gap between them, and a narrow solution would be missed.

    Args:
        posterior: posterior density to sample.
        gaussian: Gaussian approximation of it.
        count: number of draws of each round and solution.
        seed: seed of the random numbers; the same seed gives the same draws.
    """
    random = np.random.default_rng(seed)
    scaled = gaussian.jacobian / posterior.scale[:, None]
    flat = np.linalg.inv(TEMPERATURES[0] * scaled.T @ scaled + np.eye(len(gaussian.centre)))
    latest = [Transport.linear(gaussian.centre, flat)]
    latest += [Transport.linear(other.centre, other.covariance) for other in gaussian.others]
    proposals = [*latest]
    z, outputs = np.empty((0, len(gaussian.centre))), np.empty((0, len(posterior.outputs)))
    weights, shape = np.empty(0), np.inf
    for number in range(len(TEMPERATURES) + MOST_FURTHER_ROUNDS):
        planned = number < len(TEMPERATURES)
        if not planned and shape < GOOD_SHAPE and effective_number(weights) > GOOD_EFFECTIVE:
            break
        temper = TEMPERATURES[number + 1] if number + 1 < len(TEMPERATURES) else 1.0
        new = Mixture(tuple(latest)).draws(random, count * len(latest))
        z = np.concatenate([z, new])
        outputs = np.concatenate([outputs, posterior.simulate(new, gaussian.centre)])
        density = Mixture(tuple(proposals)).log_density(z)
        weights, shape = smoothed(-posterior.potential(z, outputs, temper) - density)
        nearest = gaussian.nearest(z)
        for k in np.unique(nearest[weights > 0.0]):
            latest[k] = Transport.fit(z[nearest == k], weights[nearest == k])
        proposals += latest
    if gaussian.others:
        proposals.append(Transport.fit(z, weights))
    return WeightedDraws(z, outputs, weights, shape, Mixture(tuple(proposals)))


def smoothed(log_weights: np.ndarray) -> tuple[np.ndarray, float]:
    """Return Pareto-smoothed weights that sum to 1, and the shape k of the distribution of the largest."""
    finite = np.isfinite(log_weights)
    weights = np.where(finite, np.exp(log_weights - log_weights[finite].max(initial=-np.inf)), 0.0)
    count = int(min(0.2 * finite.sum(), 3.0 * np.sqrt(finite.sum())))
    if count < 5:
        return weights / max(weights.sum(), 1e-300), np.inf
    order = np.argsort(weights)
    largest = order[-count:]
    limit = weights[order[-count - 1]]
    shape, scale = pareto_fit(weights[largest] - limit)
    ranks = (np.arange(count) + 0.5) / count
    weights[largest] = np.minimum(limit + scale * np.expm1(-shape * np.log1p(-ranks)) / shape, 1.0)
    return weights / weights.sum(), shape


def pareto_fit(exceedances: np.ndarray) -> tuple[float, float]:
    """Fit shape and scale of a generalised Pareto distribution (Zhang, Stephens 2009, Technometrics 51, 316).

    Args:
        exceedances: amounts by which values exceed the threshold, increasing.
    """
    count = len(exceedances)
    exceedances = np.maximum(exceedances, 1e-300)
    grid = np.arange(1, 30 + int(np.sqrt(count)) + 1)
    b = 1.0 / exceedances[-1] + (1.0 - np.sqrt(len(grid) / (grid - 0.5))) / (
        3.0 * exceedances[int(count / 4 + 0.5) - 1]
    )
    k = np.mean(np.log1p(-b[:, None] * exceedances), axis=1)
    likelihood = count * (np.log(-b / k) - k - 1.0)
    share = np.exp(likelihood - logsumexp(likelihood))
    best = float(share @ b)
    shape = float(np.mean(np.log1p(-best * exceedances)))
    return (shape * count + 0.5 * 10.0) / (count + 10.0), -shape / best


def weighted_quantile(values: np.ndarray, weights: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """Quantiles of weighted values."""
    order = np.argsort(values)
    total = np.cumsum(weights[order]) - 0.5 * weights[order]
    return np.interp(shares, total / weights.sum(), values[order])
