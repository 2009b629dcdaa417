"""The posterior without Markov chains: draws from an approximation, weighted by the exact density.

All draws of a round are simulated as one batch of steady beats, so this takes seconds where chains take
minutes. The first rounds sample flatter densities, in which the measurements have less weight, so that no arm
of the posterior is missed. Each round fits its proposal (Student's t distribution in the coordinates of a
`Transport`) to the weighted draws of all earlier rounds. All draws are weighted by the mixture of all
proposals: adaptive multiple importance sampling, Cornuet, Marin, Mira and Robert 2012, Scandinavian Journal
of Statistics 39, 798-812. The largest weights are smoothed with a generalised Pareto distribution. Its shape
k tells whether the weights can be trusted, which is the case below 0.7: Vehtari, Simpson, Gelman, Yao and
Gabry 2024, JMLR 25, 1-58.

In the coordinates of a `Transport`, a curved posterior is nearly a standard normal distribution. They are
defined by a triangular map (Parno and Marzouk 2018, SIAM/ASA J. Uncertain. Quantif. 6, 645-682), one variable
after the other, those least determined by the measurements first:

    z_k = m_k(z_1 .. z_k-1) + exp(s_k(z_1 .. z_k-1)) g_k(u_k)

Here m is quadratic and s linear in the preceding variables, which are squashed so that neither grows without
limit where there were no draws. g is the sinh-arcsinh function, which allows a sharp edge on one side and a
long tail on the other (Jones and Pewsey 2009, Biometrika 96, 761). The map is one to one for all
coefficients, so they affect the efficiency of a sampler, never the distribution it samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from scipy.special import gammaln, logsumexp

from eclsim.identification.density import Gaussian, PosteriorDensity

if TYPE_CHECKING:
    import jax

Array = TypeVar("Array", np.ndarray, "jax.Array")
SQUASHING_SCALE = 3.0
"""Standard deviations beyond which a variable hardly changes the coefficients further."""
RIDGE = 0.01
"""Ridge penalty on every coefficient except the constant, relative to the total weight of the draws."""
ROUNDS = 4
DIFFERENCE = 1e-5
LARGEST_LOG_SCALE = 1.5
"""Largest contribution of the preceding variables to s."""
SHAPE_RIDGE = 0.003
SHAPE_BOUNDS = ((-2.0, 2.0), (-2.0, 2.0), (-1.5, 1.5), (-0.7, 0.7))
FEWEST_FOR_CURVES = 150.0
"""With fewer effective draws than this the map remains linear."""
DEGREES = 5.0
"""Degrees of freedom of Student's t distribution, whose tails are longer than those of a posterior."""


@dataclass(frozen=True)
class Transport:
    """The map from u to z.

    Args:
        order: indices of the variables from the first to the last.
        centre: mean of the draws that the map was fitted to, shape (size,).
        spread: standard deviations of these draws, shape (size,).
        middles: coefficients of m, row k for the k-th variable of the order, shape (size, features).
        scales: coefficients of s, shape (size, size + 1).
        shapes: location, logarithm of the scale, skewness and logarithm of the tail weight of g, shape
            (size, 4).
    """

    order: np.ndarray
    centre: np.ndarray
    spread: np.ndarray
    middles: np.ndarray
    scales: np.ndarray
    shapes: np.ndarray

    @classmethod
    def linear(cls, centre: np.ndarray, covariance: np.ndarray) -> Transport:
        """Return the map of a normal distribution: m is linear, s constant."""
        size = len(centre)
        spread = np.sqrt(np.diag(covariance))
        order = np.argsort(-spread, kind="stable")
        root = np.linalg.cholesky((covariance / np.outer(spread, spread))[np.ix_(order, order)])
        middles, scales = np.zeros((size, size * (size + 1) + 1)), np.zeros((size, size + 1))
        for k in range(size):
            middles[k, 1 : k + 1] = root[k, :k] @ np.linalg.inv(root[:k, :k])
            scales[k, 0] = np.log(root[k, k])
        return cls(order, centre, spread, middles, scales, np.zeros((size, 4)))

    @classmethod
    def fit(cls, z: np.ndarray, weights: np.ndarray) -> Transport:
        """Return the map that brings weighted draws closest to a standard normal distribution."""
        weights = weights / weights.sum()
        centre = weights @ z
        away = z - centre
        covariance = (away.T * weights) @ away + 1e-9 * np.eye(len(centre))
        linear = cls.linear(centre, covariance)
        if 1.0 / np.sum(weights**2) < FEWEST_FOR_CURVES:
            return linear
        standard = (away / linear.spread)[:, linear.order]
        middles, scales = np.zeros_like(linear.middles), np.zeros_like(linear.scales)
        shapes = np.zeros((z.shape[1], 4))
        try:
            for k in range(z.shape[1]):
                residuals = _fit_one(k, standard, weights, middles[k], scales[k])
                shapes[k] = _fit_shape(residuals, weights)
        except np.linalg.LinAlgError:  # draws lie in a plane: nothing to fit a curve to
            return linear
        return cls(linear.order, centre, linear.spread, middles, scales, shapes)

    def z_of(self, u: Array, xp: ModuleType = np) -> tuple[Array, Array]:
        """Return z and the logarithm of |dz/du| for u of shape (..., size); `xp` is numpy or jax.numpy."""
        standard = []
        log_slope = xp.asarray(np.log(self.spread).sum())
        for k in range(len(self.order)):
            middle, scale = _coefficients(k, standard, self.middles[k], self.scales[k], xp)
            value, log_change = _sinh_arcsinh(u[..., k], self.shapes[k], xp)
            standard.append(middle + xp.exp(scale) * value)
            log_slope = log_slope + scale + log_change
        ordered = xp.stack([standard[k] for k in np.argsort(self.order)], axis=-1)
        return self.centre + self.spread * ordered, log_slope

    def jacobian(self, u: np.ndarray) -> np.ndarray:
        """dz/du at one point, shape (size, size)."""
        shifts = DIFFERENCE * np.eye(len(u))
        return (self.z_of(u + shifts)[0] - self.z_of(u - shifts)[0]).T / (2.0 * DIFFERENCE)

    def u_of(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return u for z, and the logarithm of |dz/du| there."""
        standard = ((z - self.centre) / self.spread)[..., self.order]
        before = [standard[..., k] for k in range(len(self.order))]
        u, log_slope = [], np.full(z.shape[:-1], np.log(self.spread).sum())
        for k in range(len(self.order)):
            middle, scale = _coefficients(k, before[:k], self.middles[k], self.scales[k], np)
            u.append(_inverse_sinh_arcsinh((before[k] - middle) * np.exp(-scale), self.shapes[k]))
            log_slope = log_slope + scale + _sinh_arcsinh(u[-1], self.shapes[k], np)[1]
        return np.stack(u, axis=-1), log_slope


def _sinh_arcsinh(u: Array, shape: np.ndarray, xp: ModuleType) -> tuple[Array, Array]:
    """Return g(u) and the logarithm of its slope."""
    location, log_scale, skew, log_tail = shape
    inner = (xp.arcsinh(u) + skew) * np.exp(log_tail)
    slope = log_scale + log_tail + xp.log(xp.cosh(inner)) - 0.5 * xp.log1p(u**2)
    return location + np.exp(log_scale) * xp.sinh(inner), slope


def _inverse_sinh_arcsinh(value: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """Inverse of g."""
    location, log_scale, skew, log_tail = shape
    return np.sinh(np.arcsinh((value - location) * np.exp(-log_scale)) * np.exp(-log_tail) - skew)


def _fit_shape(residuals: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Fit the shape of g that makes the residuals of a variable most nearly standard normal."""
    from scipy.optimize import minimize

    def loss(shape: np.ndarray) -> float:
        u = _inverse_sinh_arcsinh(residuals, shape)
        total = weights @ (0.5 * u**2 + _sinh_arcsinh(u, shape, np)[1]) + SHAPE_RIDGE * shape @ shape
        return float(total) if np.isfinite(total) else 1e10

    return minimize(loss, np.zeros(4), method="L-BFGS-B", bounds=SHAPE_BOUNDS).x


def _squashed(value: Array, xp: ModuleType) -> Array:
    return value / xp.sqrt(1.0 + (value / SQUASHING_SCALE) ** 2)


def _coefficients(
    k: int, before: Sequence[Array], middles: np.ndarray, scales: np.ndarray, xp: ModuleType
) -> tuple[Array, Array]:
    """Return m and s of the k-th variable; squares and products of the preceding variables are squashed."""
    squashed = [_squashed(b, xp) for b in before]
    middle, scale, change, place = middles[0], scales[0], 0.0, k + 1
    for a in range(k):
        middle = middle + middles[1 + a] * before[a]
        change = change + scales[1 + a] * squashed[a]
        for b in range(a + 1):
            middle = middle + middles[place] * squashed[a] * squashed[b]
            place += 1
    if k:
        scale = scale + LARGEST_LOG_SCALE * xp.tanh(change / LARGEST_LOG_SCALE)
    return middle, scale


def _fit_one(
    k: int, standard: np.ndarray, weights: np.ndarray, middles: np.ndarray, scales: np.ndarray
) -> np.ndarray:
    """Regress one variable on the preceding ones, mean and spread in turn; returns the residuals."""
    before = standard[:, :k]
    squashed = _squashed(before, np)
    products = [squashed[:, a] * squashed[:, b] for a in range(k) for b in range(a + 1)]
    ones = np.ones((len(standard), 1))
    columns = np.concatenate([ones, before, *(p[:, None] for p in products)], axis=1)
    spread_columns = np.concatenate([ones, squashed], axis=1)
    log_scale, residuals, coefficients = np.zeros(len(standard)), standard[:, k], middles
    for _ in range(ROUNDS):
        precision = weights * np.exp(-2.0 * log_scale)
        ridge = RIDGE * precision.sum() * np.diag([0.0, *[1.0] * (columns.shape[1] - 1)])
        normal = (columns.T * precision) @ columns + ridge
        coefficients = np.linalg.solve(normal, (columns.T * precision) @ standard[:, k])
        residuals = standard[:, k] - columns @ coefficients
        _fit_scale(residuals, spread_columns, weights, scales[: k + 1])
        change = LARGEST_LOG_SCALE * np.tanh(spread_columns[:, 1:] @ scales[1 : k + 1] / LARGEST_LOG_SCALE)
        log_scale = scales[0] + change
    middles[: len(coefficients)] = coefficients
    return residuals * np.exp(-log_scale)


def _fit_scale(residuals: np.ndarray, columns: np.ndarray, weights: np.ndarray, scales: np.ndarray) -> None:
    """Fit the logarithm of the spread of the residuals by Newton's method; the problem is convex."""
    scales[0] = 0.5 * np.log(weights @ residuals**2)
    scales[1:] = 0.0
    ridge = RIDGE * np.diag([0.0, *[1.0] * (len(scales) - 1)])
    for _ in range(8):
        square = weights * residuals**2 * np.exp(-2.0 * (columns @ scales))
        gradient = columns.T @ (weights - square) + ridge @ scales
        curvature = 2.0 * (columns.T * square) @ columns + ridge
        step = -np.linalg.solve(curvature, gradient)
        scales += step * min(1.0, 0.5 / max(float(np.abs(step).max()), 1e-12))


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


# --- weighted draws of the posterior ----------------------------------------------------------------


TEMPERATURES = (0.02, 0.08, 0.25, 0.6, 1.0, 1.0, 1.0)
"""Weight of the measurements in each round."""
LARGEST_SHAPE = 0.7
FEWEST_EFFECTIVE = 400
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
