"""Saltelli's design (the combinations of inputs that are run) and Sobol indices from its runs.

Each of the N rows of the design is a pair of points A and B of a scrambled Sobol sequence, and the points
that exchange one factor between them: A, AB_1 .. AB_F, BA_1 .. BA_F, B, in this order. The numbers equal
those of `SALib.sample.sobol.sample` for the same seed, bit for bit. Any row can be computed without the
others, so a shard, a resumed run and a worker on another machine all use the same design.

First and total order: Saltelli et al. 2010, doi 10.1016/j.cpc.2009.09.018 (the total order is Jansen's).
Second order: Saltelli 2002, doi 10.1016/S0010-4655(02)00280-1. Definitions, centring and resampling are those
of `SALib.analyze.sobol`, whose numbers these functions reproduce to rounding, for all outputs and factors at
once: a resample is a row of counts, so that the bootstrap is one matrix product.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from eclsim.sensitivity.inputs import Description, Input, described_input

RUNS_PER_BLOCK = 2048
"""Largest number of runs per block, the unit of work; a block has the largest such power of two of rows."""


class DesignError(ValueError):
    """Raised for an impossible design; the message says what is allowed."""


@dataclass(frozen=True)
class Design:
    """A Saltelli design.

    Args:
        inputs: varied inputs.
        samples: N, number of rows; a power of two.
        seed: seed of the scrambling, 0 or more.
        groups: name of the factor that each input belongs to; empty makes each input its own factor. The
            inputs of a factor are exchanged together and have one index.
        second_order: whether the BA points are included: N (2 F + 2) runs, else N (F + 2).
    """

    inputs: tuple[Input, ...]
    samples: int
    seed: int = 1
    groups: tuple[str, ...] = ()
    second_order: bool = True

    def __post_init__(self) -> None:
        names = [i.name for i in self.inputs]
        repeated = sorted({n for n in names if names.count(n) > 1})
        if not names or repeated:
            raise DesignError(
                f"inputs: {'none given' if not names else 'given twice: ' + ', '.join(repeated)}"
            )
        if self.samples < 2 or self.samples & (self.samples - 1):
            raise DesignError(
                f"samples = {self.samples}: allowed: a power of two from 2, such as 1024 or 2048"
            )
        if self.groups and len(self.groups) != len(self.inputs):
            raise DesignError(f"groups: {len(self.groups)} names for {len(self.inputs)} inputs")
        if self.seed < 0:
            raise DesignError(f"seed = {self.seed}: allowed: 0, 1, 2 ...")

    @property
    def factors(self) -> tuple[str, ...]:
        """Names of the factors, which are inputs or groups, in order of appearance."""
        return tuple(dict.fromkeys(self.groups or (i.name for i in self.inputs)))

    @property
    def runs_per_row(self) -> int:
        """Number of model runs of one row."""
        return (2 if self.second_order else 1) * len(self.factors) + 2

    @property
    def evaluations(self) -> int:
        """Number of model runs of the whole design."""
        return self.samples * self.runs_per_row

    @property
    def rows_per_block(self) -> int:
        """Number of rows per block; it depends on the design alone."""
        rows = max(1, RUNS_PER_BLOCK // self.runs_per_row)
        return min(self.samples, 1 << (rows.bit_length() - 1))

    @property
    def blocks(self) -> int:
        """Number of blocks."""
        return self.samples // self.rows_per_block

    @cached_property
    def _exchanged(self) -> np.ndarray:
        """Whether a point of a row has the coordinate of B, shape (runs per row, inputs)."""
        labels = np.array(self.groups or [i.name for i in self.inputs])
        members = np.array([labels == factor for factor in self.factors])
        first, last = np.zeros((1, len(labels)), dtype=bool), np.ones((1, len(labels)), dtype=bool)
        points = [first, members, ~members, last] if self.second_order else [first, members, last]
        return np.concatenate(points)

    def unit(self, first_row: int = 0, last_row: int | None = None) -> np.ndarray:
        """Coordinates in [0, 1) of all runs of some rows, shape (rows x runs per row, inputs)."""
        count = len(self.inputs)
        pair = _sobol_sequence(2 * count, self.samples, self.seed)[first_row:last_row]
        points = np.where(self._exchanged, pair[:, None, count:], pair[:, None, :count])
        return points.reshape(-1, count)

    def settings(self, unit: np.ndarray) -> dict[str, np.ndarray]:
        """Values of every parameter that the inputs set, each of shape (runs,)."""
        result: dict[str, np.ndarray] = {}
        for k, chosen in enumerate(self.inputs):
            result |= chosen.settings(unit[:, k])
        return result

    def block_rows(self, block: int) -> tuple[int, int]:
        """First row and row after the last of a block."""
        return block * self.rows_per_block, (block + 1) * self.rows_per_block

    def description(self) -> Description:
        """Plain data that determine the numbers of a row.

        The number of rows is not included: a design is the beginning of the same design with more rows.
        """
        beginning = _sobol_sequence(2 * len(self.inputs), self.samples, self.seed)[:2]
        return {
            "inputs": [i.description() for i in self.inputs],
            "groups": list(self.groups),
            "seed": self.seed,
            "second_order": self.second_order,
            "rows_per_block": self.rows_per_block,
            "sequence": hashlib.sha256(beginning.tobytes()).hexdigest()[:16],
        }

    @classmethod
    def described(cls, description: Description, samples: int) -> Design:
        """Return the design with a given description."""
        inputs = tuple(described_input(d) for d in description["inputs"])
        groups = tuple(description["groups"])
        return cls(inputs, samples, description["seed"], groups, description["second_order"])


@lru_cache(maxsize=8)
def _sobol_sequence(dimensions: int, samples: int, seed: int) -> np.ndarray:
    """Points of the scrambled Sobol sequence (Owen), shape (samples, dimensions)."""
    from scipy.stats import qmc

    # `seed`, not `rng`, as in SALib: the two scramble differently.
    sequence = qmc.Sobol(d=dimensions, scramble=True, seed=seed).random(samples)  # pyright: ignore[reportCallIssue]  # old name
    sequence.flags.writeable = False
    return sequence


# --- indices from the runs of a design, with bootstrap intervals ------------------------------------


RESAMPLES = 100
CONFIDENCE = 0.95
ROUNDING = 1e-8
"""An output with a smaller relative standard deviation counts as constant, as rounding varies it."""
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
        sum_covariance: covariance over the resamples of the total orders summed over the outputs, shape
            (factors, factors); None if it was not computed.
    """

    S1: np.ndarray
    S1_conf: np.ndarray
    ST: np.ndarray
    ST_conf: np.ndarray
    S2: np.ndarray | None = None
    S2_conf: np.ndarray | None = None
    sum_covariance: np.ndarray | None = None

    def sum_conf(self) -> np.ndarray | None:
        """Half width of the interval of each sum of total orders, shape (factors,).

        The outputs come from the same runs, so their errors do not average out.
        """
        if self.sum_covariance is None:
            return None
        return interval_width() * np.sqrt(np.diag(self.sum_covariance))

    def order_of_sums_known(self, first: int, second: int) -> bool:
        """Whether two sums of total orders differ by more than the half width of their difference."""
        sums, spread = self.ST.sum(axis=0), self.sum_covariance
        if spread is None:
            return True
        variance = spread[first, first] + spread[second, second] - 2.0 * spread[first, second]
        return bool(abs(sums[first] - sums[second]) > interval_width() * np.sqrt(max(variance, 0.0)))


def interval_width() -> float:
    """Half width of the intervals in standard deviations of the resamples."""
    from scipy.stats import norm

    return float(norm.ppf(0.5 + CONFIDENCE / 2))


def sobol_indices(values: np.ndarray, factors: int, *, seed: int = 1, size: float = 0.0) -> Estimates:
    """Compute the indices of every output; zero for an output that does not vary.

    Args:
        values: outputs of all runs, shape (rows, runs per row, outputs), without any failed row.
        factors: number of factors.
        seed: seed of the resampling.
        size: smallest size of an output, in its unit, with which the standard deviation is compared.
    """
    rows, scaled = len(values), _scaled(values, size)
    a, b, ab = scaled[:, 0], scaled[:, -1], scaled[:, 1 : factors + 1]
    chosen = np.random.default_rng(seed).integers(rows, size=(rows, RESAMPLES))
    counts = np.bincount((chosen + rows * np.arange(RESAMPLES)).ravel(), minlength=rows * RESAMPLES)
    weights = np.concatenate([np.ones((1, rows)), counts.reshape(RESAMPLES, rows)]) / rows
    mean = 0.5 * _means(weights, a + b)
    variance = 0.5 * _means(weights, a**2 + b**2) - mean**2  # of A and B together
    first = _over(_means(weights, b[:, None] * (ab - a[:, None])), variance)
    total = _over(_means(weights, 0.5 * (a[:, None] - ab) ** 2), variance)
    width = interval_width()
    estimates = Estimates(
        *_with_width(first, width), *_with_width(total, width),
        sum_covariance=np.atleast_2d(np.cov(total[1:].sum(axis=-1), rowvar=False)),
    )  # fmt: skip
    if values.shape[1] < 2 * factors + 2:
        return estimates
    pairs, widths = _with_width(_second_order(scaled, weights, first, variance), width)
    return replace(estimates, S2=pairs, S2_conf=widths)


def varies(values: np.ndarray, size: float = 0.0) -> np.ndarray:
    """Whether each output varies by more than rounding, shape (outputs,); arguments as in `sobol_indices`."""
    flat = values.reshape(-1, values.shape[-1])
    return flat.std(axis=0) > ROUNDING * np.maximum(np.abs(flat.mean(axis=0)), size)


def _scaled(values: np.ndarray, size: float) -> np.ndarray:
    """Centre and scale each output over all runs."""
    flat = values.reshape(-1, values.shape[-1])
    spread = flat.std(axis=0)
    usable = varies(values, size)
    return np.where(usable, (values - flat.mean(axis=0)) / np.where(usable, spread, 1.0), 0.0)


def _means(weights: np.ndarray, terms: np.ndarray) -> np.ndarray:
    """Weighted means over the rows, shape (1 + resamples, ...)."""
    return (weights @ terms.reshape(len(terms), -1)).reshape(len(weights), *terms.shape[1:])


def _over(means: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Divide by the variance; an output that does not vary has indices of zero."""
    shape = (len(variance), *(1,) * (means.ndim - 2), variance.shape[-1])
    divisor = variance.reshape(shape)
    usable = divisor > _NO_VARIANCE
    return np.where(usable, means / np.where(usable, divisor, 1.0), 0.0)


def _second_order(
    scaled: np.ndarray, weights: np.ndarray, first: np.ndarray, variance: np.ndarray
) -> np.ndarray:
    """Closed second-order term less both first orders, shape (1 + resamples, factors, factors, outputs)."""
    factors = first.shape[1]
    ab, ba = scaled[:, 1 : factors + 1], scaled[:, factors + 1 : 2 * factors + 1]
    result = np.full((len(weights), factors, factors, scaled.shape[-1]), np.nan)
    products = scaled[:, 0] * scaled[:, -1]
    for j in range(factors - 1):
        terms = ba[:, j, None] * ab[:, j + 1 :] - products[:, None]
        closed = _over(_means(weights, terms), variance)
        result[:, j, j + 1 :] = closed - first[:, j, None] - first[:, j + 1 :]
    return result


def _with_width(resampled: np.ndarray, width: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the estimate and the half width of its interval, with outputs as the first dimension."""
    spread = width * resampled[1:].std(axis=0, ddof=1)
    return np.moveaxis(resampled[0], -1, 0), np.moveaxis(spread, -1, 0)
