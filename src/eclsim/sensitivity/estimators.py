"""Sobol indices from the runs of a Saltelli design, with bootstrap intervals.

First and total order: Saltelli et al. 2010, doi 10.1016/j.cpc.2009.09.018 (the total order is Jansen's).
Second order: Saltelli 2002, doi 10.1016/S0010-4655(02)00280-1. Definitions, centring and resampling are
those of `SALib.analyze.sobol`, whose numbers these functions reproduce to rounding, for all outputs and
factors at once: a resample is a row of counts, so that the bootstrap is one matrix product.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

RESAMPLES = 100
CONFIDENCE = 0.95
_NO_VARIANCE = np.finfo(float).eps


@dataclass(frozen=True)
class Estimates:
    """Indices and half widths of their intervals.

    Args:
        S1: first order, shape (outputs, factors).
        S1_conf: half width of its interval.
        ST: total order, shape (outputs, factors).
        ST_conf: half width of its interval.
        S2: second order, shape (outputs, factors, factors), filled above the diagonal, NaN elsewhere; None
            for a design without BA points.
        S2_conf: half width of its interval.
    """

    S1: np.ndarray
    S1_conf: np.ndarray
    ST: np.ndarray
    ST_conf: np.ndarray
    S2: np.ndarray | None = None
    S2_conf: np.ndarray | None = None


@dataclass(frozen=True)
class _Samples:
    """Centred outputs: A and B (rows, outputs), AB and BA (rows, factors, outputs)."""

    A: np.ndarray
    B: np.ndarray
    AB: np.ndarray
    BA: np.ndarray | None


def sobol_indices(
    values: np.ndarray,
    factors: int,
    *,
    seed: int = 1,
    resamples: int = RESAMPLES,
    confidence: float = CONFIDENCE,
) -> Estimates:
    """Indices of every output.

    Args:
        values: outputs of all runs, shape (rows, runs per row, outputs), without any failed row.
        factors: number of factors.
        seed: of the resampling.
        resamples: bootstrap resamples of the rows.
        confidence: level of the intervals.
    """
    from scipy.stats import norm

    samples = _separated(values, factors)
    rows = len(samples.A)
    chosen = np.random.default_rng(seed).integers(rows, size=(rows, resamples))
    counts = np.bincount((chosen + rows * np.arange(resamples)).ravel(), minlength=rows * resamples)
    weights = np.concatenate([np.ones((1, rows)), counts.reshape(resamples, rows)]) / rows
    variance = _variance(samples, weights)
    first = _over(_means(weights, samples.B[:, None] * (samples.AB - samples.A[:, None])), variance)
    total = _over(_means(weights, 0.5 * (samples.A[:, None] - samples.AB) ** 2), variance)
    width = float(norm.ppf(0.5 + confidence / 2))
    pairs = None if samples.BA is None else _second_order(samples, weights, first, variance)
    return Estimates(
        *_with_width(first, width),
        *_with_width(total, width),
        *((None, None) if pairs is None else _with_width(pairs, width)),
    )


def _separated(values: np.ndarray, factors: int) -> _Samples:
    """Centre and scale each output over all runs, then tell the points of a row apart."""
    flat = values.reshape(-1, values.shape[-1])
    spread = flat.std(axis=0)
    usable = spread > 0
    scaled = np.where(usable, (values - flat.mean(axis=0)) / np.where(usable, spread, 1.0), 0.0)
    second = values.shape[1] == 2 * factors + 2
    return _Samples(
        A=scaled[:, 0],
        B=scaled[:, -1],
        AB=scaled[:, 1 : factors + 1],
        BA=scaled[:, factors + 1 : 2 * factors + 1] if second else None,
    )


def _means(weights: np.ndarray, terms: np.ndarray) -> np.ndarray:
    """Weighted means over the rows, shape (1 + resamples, ...)."""
    return (weights @ terms.reshape(len(terms), -1)).reshape(len(weights), *terms.shape[1:])


def _variance(samples: _Samples, weights: np.ndarray) -> np.ndarray:
    """Variance of A and B together in each resample, shape (1 + resamples, outputs)."""
    mean = 0.5 * _means(weights, samples.A + samples.B)
    return 0.5 * _means(weights, samples.A**2 + samples.B**2) - mean**2


def _over(means: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Divide by the variance; an output that does not vary has indices of zero."""
    shape = (len(variance), *(1,) * (means.ndim - 2), variance.shape[-1])
    divisor = variance.reshape(shape)
    usable = divisor > _NO_VARIANCE
    return np.where(usable, means / np.where(usable, divisor, 1.0), 0.0)


def _second_order(
    samples: _Samples, weights: np.ndarray, first: np.ndarray, variance: np.ndarray
) -> np.ndarray:
    """Closed second-order term less both first orders, shape (1 + resamples, factors, factors, outputs)."""
    assert samples.BA is not None
    factors = samples.AB.shape[1]
    result = np.full((len(weights), factors, factors, samples.A.shape[-1]), np.nan)
    both = samples.A * samples.B
    for j in range(factors - 1):
        terms = samples.BA[:, j, None] * samples.AB[:, j + 1 :] - both[:, None]
        closed = _over(_means(weights, terms), variance)
        result[:, j, j + 1 :] = closed - first[:, j, None] - first[:, j + 1 :]
    return result


def _with_width(resampled: np.ndarray, width: float) -> tuple[np.ndarray, np.ndarray]:
    """The estimate and the half width of its interval, outputs first."""
    spread = width * resampled[1:].std(axis=0, ddof=1)
    return np.moveaxis(resampled[0], -1, 0), np.moveaxis(spread, -1, 0)
