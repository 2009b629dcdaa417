"""Coordinates in which a curved posterior is nearly a standard normal distribution.

They are defined by a triangular map (Parno and Marzouk 2018, SIAM/ASA J. Uncertain. Quantif. 6, 645-682), one
variable after the other, those least determined by the measurements first:

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
from scipy.optimize import minimize

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
