"""Whether draws can be trusted: R-hat, effective sample sizes, divergences, energies, trajectories.

Rank-normalised split R-hat, bulk and tail effective sample size after Vehtari, Gelman, Simpson, Carpenter and
Bürkner 2021, Bayesian Analysis 16, 667-718, doi 10.1214/20-BA1221; the limits are theirs. Energy fraction of
missing information (E-BFMI) after Betancourt 2016, arXiv 1604.00695, and his limit. A trajectory that is cut
at its largest length costs effective draws and biases nothing, so there is no limit on how many are: they are
counted, and named where draws are too few.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri
from scipy.stats import rankdata

LARGEST_R_HAT = 1.01
FEWEST_EFFECTIVE = 400
LARGEST_DIVERGENT_SHARE = 0.01
SMALLEST_ENERGY_FRACTION = 0.3


@dataclass(frozen=True)
class Diagnostics:
    """How well chains agree and mix, by parameter.

    Args:
        names: of the parameters.
        r_hat: shape (parameters,).
        effective_bulk: effective number of draws for the centre.
        effective_tail: and for the 5 % and 95 % quantiles.
        divergent: draws whose trajectory left the energy.
        draws: all draws.
        energy_fraction: E-BFMI of each chain, shape (chains,).
        saturated: draws whose trajectory was cut at its largest length.
    """

    names: tuple[str, ...]
    r_hat: np.ndarray
    effective_bulk: np.ndarray
    effective_tail: np.ndarray
    divergent: int
    draws: int
    energy_fraction: np.ndarray
    saturated: int

    @property
    def doubts(self) -> tuple[str, ...]:
        """Why the draws are not to be trusted; empty where they are."""
        doubts = []
        k = int(np.argmax(np.nan_to_num(self.r_hat, nan=np.inf)))
        if not self.r_hat[k] < LARGEST_R_HAT:
            doubts.append(
                f"R-hat of {self.names[k]} is {self.r_hat[k]:.3f} (below {LARGEST_R_HAT}): the chains "
                "disagree; sample longer"
            )
        fewest = np.minimum(self.effective_bulk, self.effective_tail)
        k = int(np.argmin(np.nan_to_num(fewest, nan=-1.0)))
        if not fewest[k] >= FEWEST_EFFECTIVE:
            cut = f"; {self.saturated} of {self.draws} trajectories were cut at their largest length"
            doubts.append(
                f"effective sample size of {self.names[k]} is {fewest[k]:.0f} (at least {FEWEST_EFFECTIVE}): "
                f"sample longer{cut if self.saturated else ''}"
            )
        if self.divergent > LARGEST_DIVERGENT_SHARE * self.draws:
            doubts.append(
                f"{self.divergent} of {self.draws} draws diverged (at most {LARGEST_DIVERGENT_SHARE:.0%}): "
                "doubt the intervals, and narrow --bounds to what is possible"
            )
        k = int(np.argmin(np.nan_to_num(self.energy_fraction, nan=-1.0)))
        if not self.energy_fraction[k] >= SMALLEST_ENERGY_FRACTION:
            doubts.append(
                f"E-BFMI of chain {k + 1} is {self.energy_fraction[k]:.2f} (at least "
                f"{SMALLEST_ENERGY_FRACTION}): the chain hardly reaches the tails; doubt the outer quantiles"
            )
        return tuple(doubts)


def diagnose(names: Sequence[str], draws: np.ndarray, statistics: Mapping[str, np.ndarray]) -> Diagnostics:
    """Diagnostics of draws.

    Args:
        names: of the parameters.
        draws: shape (chains, draws, parameters).
        statistics: of the sampler: whether each draw is "diverging", its "energy" (Hamiltonian), and whether
            its trajectory was cut at its largest length ("saturated"), each of shape (chains, draws).
    """
    each = [draws[:, :, k] for k in range(draws.shape[2])]
    return Diagnostics(
        tuple(names),
        np.array([r_hat(d) for d in each]),
        np.array([effective_bulk(d) for d in each]),
        np.array([effective_tail(d) for d in each]),
        int(statistics["diverging"].sum()),
        int(statistics["diverging"].size),
        np.array([energy_fraction(e) for e in statistics["energy"]]),
        int(statistics["saturated"].sum()),
    )


def energy_fraction(energy: np.ndarray) -> float:
    """E-BFMI of one chain: how much the energy changes from draw to draw, against how much it varies.

    Args:
        energy: Hamiltonian of the draws in order, shape (draws,).
    """
    finite = energy[np.isfinite(energy)]
    variation = np.sum((finite - finite.mean()) ** 2) if len(finite) > 1 else 0.0
    return float(np.sum(np.diff(finite) ** 2) / variation) if variation > 0.0 else np.nan


def r_hat(draws: np.ndarray) -> float:
    """Rank-normalised split R-hat of one quantity, the larger of centre and spread; draws (chains, draws)."""
    halves = _halves(draws)
    folded = np.abs(halves - np.median(halves))
    return max(_r_hat(_normal_ranks(halves)), _r_hat(_normal_ranks(folded)))


def effective_bulk(draws: np.ndarray) -> float:
    """Effective number of draws for the centre of the distribution."""
    return _effective(_normal_ranks(_halves(draws)))


def effective_tail(draws: np.ndarray) -> float:
    """The smaller effective number of draws for the 5 % and the 95 % quantile."""
    limits = np.quantile(draws, (0.05, 0.95))
    return min(_effective(_halves((draws <= limit).astype(float))) for limit in limits)


def _halves(draws: np.ndarray) -> np.ndarray:
    half = draws.shape[1] // 2
    return np.concatenate([draws[:, :half], draws[:, draws.shape[1] - half :]])


def _normal_ranks(draws: np.ndarray) -> np.ndarray:
    ranks = rankdata(draws, method="average").reshape(draws.shape)
    return ndtri((ranks - 0.375) / (draws.size + 0.25))


def _r_hat(draws: np.ndarray) -> float:
    count = draws.shape[1]
    within = np.mean(np.var(draws, axis=1, ddof=1))
    between = count * np.var(np.mean(draws, axis=1), ddof=1)
    if not within > 0.0:
        return 1.0 if between == 0.0 else np.inf
    return float(np.sqrt((between / within + count - 1) / count))


def _effective(draws: np.ndarray) -> float:
    """Geyer's initial monotone sequence over all chains."""
    chains, count = draws.shape
    if np.ptp(draws) == 0.0:
        return float(draws.size)
    covariance = np.stack([_autocovariance(d) for d in draws])
    within = np.mean(covariance[:, 0]) * count / (count - 1)
    variance = within * (count - 1) / count
    if chains > 1:
        variance += np.var(np.mean(draws, axis=1), ddof=1)
    correlation = 1.0 - (within - np.mean(covariance, axis=0) * count / (count - 1)) / variance
    correlation[0] = 1.0
    pairs = correlation[: count // 2 * 2].reshape(-1, 2).sum(axis=1)
    negative = np.flatnonzero(pairs < 0.0)
    pairs = np.minimum.accumulate(pairs[: negative[0] if len(negative) else len(pairs)])
    time = max(-1.0 + 2.0 * pairs.sum(), 1.0 / np.log10(draws.size))
    return float(draws.size / time)


def _autocovariance(draws: np.ndarray) -> np.ndarray:
    count = len(draws)
    spectrum = np.fft.rfft(draws - draws.mean(), 2 * count)
    return np.fft.irfft(spectrum * np.conj(spectrum))[:count] / count
