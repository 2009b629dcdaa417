"""How precisely the measurements determine the parameters: the Gaussian approximation at an optimum.

What is known before any measurement is that a parameter lies between its bounds, each logarithm as likely as
any other. Without it, a parameter that the measurements say nothing about would make the intervals of all
others infinite.
"""

from __future__ import annotations

import numpy as np

NORMAL_90 = 1.6448536269514722
"""Half width of the central 90 % of a normal distribution, in standard deviations."""
_DIGITS = 12


def prior_deviations(lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Standard deviation of a logarithm that lies anywhere between its bounds."""
    return (np.asarray(upper) - np.asarray(lower)) / np.sqrt(12.0)


def covariance(scaled: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """Covariance of the logarithms of the parameters, shape (parameters, parameters).

    Args:
        scaled: d output / d log parameter in standard uncertainties, shape (outputs, parameters).
        prior: standard deviations before any measurement.
    """
    return np.linalg.inv(scaled.T @ scaled + np.diag(1.0 / np.asarray(prior) ** 2))


def correlation(covariance_matrix: np.ndarray) -> np.ndarray:
    """Correlation matrix of a covariance matrix."""
    deviation = np.sqrt(np.diag(covariance_matrix))
    return covariance_matrix / np.outer(deviation, deviation)


def interval(x: float, error: float, lower: float, upper: float) -> tuple[float, float]:
    """The central 90 % of a parameter sought on a log scale, cut at its bounds, in its unit.

    Args:
        x: logarithm of the estimate.
        error: its standard error.
        lower: logarithm of the lower bound.
        upper: logarithm of the upper bound.
    """
    reach = NORMAL_90 * error
    return in_unit(max(x - reach, lower)), in_unit(min(x + reach, upper))


def in_unit(x: float) -> float:
    """A parameter from its logarithm, without the rounding of going there and back."""
    return float(f"{np.exp(x):.{_DIGITS}g}")
