"""Coordinates in which a curved posterior is nearly a standard normal distribution.

A triangular map (Parno and Marzouk 2018, SIAM/ASA J. Uncertain. Quantif. 6, 645-682): one variable after the
other, those least determined by the measurements first,

    z_k = m_k(z_1 .. z_k-1) + exp(s_k(z_1 .. z_k-1)) g_k(u_k)

with m quadratic and s linear in the variables before, which are squashed so that neither grows without limit
where no draws were, and g the sinh-arcsinh function, which makes room for a wall on one side and a long tail
on the other (Jones and Pewsey 2009, Biometrika 96, 761). Whatever the coefficients, the map is one to one, so
they decide how fast a sampler is, never what it finds.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

SQUASH = 3.0
"""Standard deviations beyond which a variable moves the coefficients little further."""
RIDGE = 0.01
"""Of the weight of all draws, on every coefficient but the constant."""
ROUNDS = 4
DIFFERENCE = 1e-5
LARGEST_LOG_SCALE = 1.5
"""Largest change of s by the variables before."""
DIFFERENCE = 1e-5
SHAPE_RIDGE = 0.003
SHAPE_BOUNDS = ((-2.0, 2.0), (-2.0, 2.0), (-1.5, 1.5), (-0.7, 0.7))
FEWEST_EFFECTIVE = 150.0
"""With fewer effective draws the map stays straight."""


@dataclass(frozen=True)
class Transport:
    """The map u -> z.

    Args:
        order: variables from the first to the last.
        centre: of the draws it was fitted to, shape (size,).
        spread: their standard deviations.
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
    def straight(cls, centre: np.ndarray, covariance: np.ndarray) -> Transport:
        """The map of a normal distribution: m is straight, s constant."""
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
    def fitted(cls, z: np.ndarray, weights: np.ndarray) -> Transport:
        """The map that takes weighted draws nearest to a standard normal distribution."""
        weights = weights / weights.sum()
        centre = weights @ z
        away = z - centre
        covariance = (away.T * weights) @ away + 1e-9 * np.eye(len(centre))
        found = cls.straight(centre, covariance)
        if 1.0 / np.sum(weights**2) < FEWEST_EFFECTIVE:
            return found
        standard = (away / found.spread)[:, found.order]
        middles, scales = np.zeros_like(found.middles), np.zeros_like(found.scales)
        shapes = np.zeros((z.shape[1], 4))
        try:
            for k in range(z.shape[1]):
                rest = _fit_one(k, standard, weights, middles[k], scales[k])
                shapes[k] = _fit_shape(rest, weights)
        except np.linalg.LinAlgError:  # draws in a plane: nothing to fit a curve to
            return found
        return cls(found.order, centre, found.spread, middles, scales, shapes)

    def z_of(self, u: Any, xp: Any = np) -> tuple[Any, Any]:
        """Variables and the logarithm of |dz/du|, for u of shape (..., size); `xp` is numpy or jax.numpy."""
        found: list[Any] = []
        log_slope = float(np.log(self.spread).sum())
        for k in range(len(self.order)):
            middle, scale = _at(k, found, self.middles[k], self.scales[k], xp)
            value, log_change = _bent(u[..., k], self.shapes[k], xp)
            found.append(middle + xp.exp(scale) * value)
            log_slope = log_slope + scale + log_change
        standard = xp.stack([found[k] for k in np.argsort(self.order)], axis=-1)
        return self.centre + self.spread * standard, log_slope

    def slopes(self, u: np.ndarray) -> np.ndarray:
        """dz/du at one point, shape (size, size)."""
        shifts = DIFFERENCE * np.eye(len(u))
        return (self.z_of(u + shifts)[0] - self.z_of(u - shifts)[0]).T / (2.0 * DIFFERENCE)

    def u_of(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Back again, and the logarithm of |dz/du| there."""
        standard = ((z - self.centre) / self.spread)[..., self.order]
        before = [standard[..., k] for k in range(len(self.order))]
        u, log_slope = [], np.full(z.shape[:-1], np.log(self.spread).sum())
        for k in range(len(self.order)):
            middle, scale = _at(k, before[:k], self.middles[k], self.scales[k], np)
            u.append(_straightened((before[k] - middle) * np.exp(-scale), self.shapes[k]))
            log_slope = log_slope + scale + _bent(u[-1], self.shapes[k], np)[1]
        return np.stack(u, axis=-1), log_slope


def _bent(u: Any, shape: np.ndarray, xp: Any) -> tuple[Any, Any]:
    """g(u) and the logarithm of its slope."""
    location, log_scale, skew, log_tail = shape
    inner = (xp.arcsinh(u) + skew) * np.exp(log_tail)
    slope = log_scale + log_tail + xp.log(xp.cosh(inner)) - 0.5 * xp.log1p(u**2)
    return location + np.exp(log_scale) * xp.sinh(inner), slope


def _straightened(value: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """Back from g."""
    location, log_scale, skew, log_tail = shape
    return np.sinh(np.arcsinh((value - location) * np.exp(-log_scale)) * np.exp(-log_tail) - skew)


def _fit_shape(rest: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """g that makes what is left of a variable most nearly standard normal."""
    from scipy.optimize import minimize

    def loss(shape: np.ndarray) -> float:
        u = _straightened(rest, shape)
        found = weights @ (0.5 * u**2 + _bent(u, shape, np)[1]) + SHAPE_RIDGE * shape @ shape
        return float(found) if np.isfinite(found) else 1e10

    return minimize(loss, np.zeros(4), method="L-BFGS-B", bounds=SHAPE_BOUNDS).x


def _squashed(value: Any, xp: Any) -> Any:
    return value / xp.sqrt(1.0 + (value / SQUASH) ** 2)


def _at(k: int, before: list[Any], middles: np.ndarray, scales: np.ndarray, xp: Any) -> tuple[Any, Any]:
    """m and s of the k-th variable; of those before, squares and products are squashed."""
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
    """Weighted regression of one variable on those before, mean and spread in turn; what is left over."""
    before = standard[:, :k]
    squashed = _squashed(before, np)
    products = [squashed[:, a] * squashed[:, b] for a in range(k) for b in range(a + 1)]
    ones = np.ones((len(standard), 1))
    columns = np.concatenate([ones, before, *(p[:, None] for p in products)], axis=1)
    spread_columns = np.concatenate([ones, squashed], axis=1)
    log_scale = np.zeros(len(standard))
    rest = standard[:, k]
    for _ in range(ROUNDS):
        precision = weights * np.exp(-2.0 * log_scale)
        ridge = RIDGE * precision.sum() * np.diag([0.0, *[1.0] * (columns.shape[1] - 1)])
        normal = (columns.T * precision) @ columns + ridge
        coefficients = np.linalg.solve(normal, (columns.T * precision) @ standard[:, k])
        rest = standard[:, k] - columns @ coefficients
        _fit_scale(rest, spread_columns, weights, scales[: k + 1])
        change = LARGEST_LOG_SCALE * np.tanh(spread_columns[:, 1:] @ scales[1 : k + 1] / LARGEST_LOG_SCALE)
        log_scale = scales[0] + change
    middles[: len(coefficients)] = coefficients
    return rest * np.exp(-log_scale)


def _fit_scale(rest: np.ndarray, columns: np.ndarray, weights: np.ndarray, scales: np.ndarray) -> None:
    """Newton's method for the logarithm of the spread of what is left, which is a convex problem."""
    scales[0] = 0.5 * np.log(weights @ rest**2)
    scales[1:] = 0.0
    ridge = RIDGE * np.diag([0.0, *[1.0] * (len(scales) - 1)])
    for _ in range(8):
        square = weights * rest**2 * np.exp(-2.0 * (columns @ scales))
        gradient = columns.T @ (weights - square) + ridge @ scales
        curvature = 2.0 * (columns.T * square) @ columns + ridge
        step = -np.linalg.solve(curvature, gradient)
        scales += step * min(1.0, 0.5 / max(float(np.abs(step).max()), 1e-12))
