"""Which parameters a set of measurements can tell apart, and a set worth fitting, from scaled derivatives.

Scaled sensitivities and the collinearity index: Brun, Reichert and Kuensch 2001, doi 10.1029/2000WR900350.
Orthogonality: Yao et al. 2003, doi 10.1081/PRE-120024426. The Fisher information is that of independent
normal errors with the given standard uncertainties; its inverse bounds the variance of any unbiased estimate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

_CHUNK = 50_000
_SINGULAR = 1e-12


@dataclass(frozen=True)
class ScaledSensitivities:
    """How many standard uncertainties a measurement moves if a parameter changes by 100 %, to first order.

    Args:
        outputs: measurements.
        parameters: parameters.
        matrix: shape (outputs, parameters).
    """

    outputs: tuple[str, ...]
    parameters: tuple[str, ...]
    matrix: np.ndarray

    @classmethod
    def of(
        cls,
        outputs: Sequence[str],
        parameters: Sequence[str],
        derivatives: np.ndarray,
        parameter_values: np.ndarray,
        uncertainties: np.ndarray,
    ) -> ScaledSensitivities:
        """From derivatives (outputs, parameters) in the units of both."""
        matrix = np.asarray(derivatives) * parameter_values / np.asarray(uncertainties)[:, None]
        return cls(tuple(outputs), tuple(parameters), matrix)

    @property
    def effect(self) -> np.ndarray:
        """Length of each column: effect of a parameter on all measurements together, shape (parameters,)."""
        return np.linalg.norm(self.matrix, axis=0)

    @property
    def directions(self) -> np.ndarray:
        """Columns of length one; zero where a parameter has no effect."""
        effect = self.effect
        return np.where(effect > 0, self.matrix / np.where(effect > 0, effect, 1.0), 0.0)

    @property
    def cosines(self) -> np.ndarray:
        """Cosine of the angle between the effects of two parameters, shape (parameters, parameters)."""
        return np.clip(self.directions.T @ self.directions, -1.0, 1.0)

    @property
    def orthogonality(self) -> np.ndarray:
        """Sine of that angle: 1 for effects that have nothing in common, 0 for effects that are the same."""
        return np.sqrt(np.maximum(1.0 - self.cosines**2, 0.0))

    def collinearity(self, chosen: Sequence[str]) -> float:
        """Collinearity index of a set: by how much a change of one can be made up for by the others."""
        if len(chosen) > len(self.outputs):
            return float("inf")
        columns = self.directions[:, [self.parameters.index(p) for p in chosen]]
        return float(_collinearity(columns.T @ columns))

    def closest(self, chosen: Sequence[str], name: str) -> tuple[float, list[str]]:
        """How nearly others of a set make up for one: share of its effect left over, and the weightiest."""
        others = [p for p in chosen if p != name]
        columns = self.matrix[:, [self.parameters.index(p) for p in others]]
        target = self.matrix[:, self.parameters.index(name)]
        weights, *_ = np.linalg.lstsq(columns, target, rcond=None)
        left = np.linalg.norm(target - columns @ weights) / max(float(np.linalg.norm(target)), 1e-300)
        share = np.abs(weights) * np.linalg.norm(columns, axis=0)
        order = np.argsort(-share)
        return float(left), [others[k] for k in order if share[k] > 0.25 * share.max()][:3]


@dataclass(frozen=True)
class SubsetIndices:
    """Collinearity indices of all sets of one size.

    Args:
        size: number of parameters in a set.
        count: number of sets.
        best: parameters of the set with the smallest index.
        smallest: that index.
        quantiles: 5, 50 and 95 % of the indices; infinite where a set cannot be told apart at all.
        below_limit: number of sets at or below the limit.
    """

    size: int
    count: int
    best: tuple[str, ...]
    smallest: float
    quantiles: tuple[float, float, float]
    below_limit: int


def all_subsets(scaled: ScaledSensitivities, limit: float) -> list[SubsetIndices]:
    """Collinearity indices of every set of every size, from pairs to as many as there are measurements.

    Larger sets have an infinite index: fewer numbers are measured than are looked for.
    """
    products = scaled.directions.T @ scaled.directions
    names, sizes = scaled.parameters, []
    for size in range(2, min(len(scaled.outputs), len(names)) + 1):
        sets = np.array(list(combinations(range(len(names)), size)))
        chunks = [sets[k : k + _CHUNK] for k in range(0, len(sets), _CHUNK)]
        values = np.concatenate([_collinearity(products[c[:, :, None], c[:, None, :]]) for c in chunks])
        best = int(np.argmin(values))
        low, middle, high = np.quantile(values, (0.05, 0.5, 0.95), method="nearest").tolist()
        chosen = tuple(names[k] for k in sets[best])
        below = int((values <= limit).sum())
        sizes.append(SubsetIndices(size, len(sets), chosen, float(values[best]), (low, middle, high), below))
    return sizes


def _collinearity(products: np.ndarray) -> np.ndarray:
    """1 / sqrt(smallest eigenvalue) of the products of unit columns, shape (..., size, size)."""
    smallest = np.linalg.eigvalsh(products)[..., 0]
    singular = smallest <= _SINGULAR
    return np.where(singular, np.inf, 1.0 / np.sqrt(np.where(singular, 1.0, smallest)))


@dataclass(frozen=True)
class FisherInformation:
    """Information of the measurements about relative changes of the parameters.

    Args:
        matrix: shape (parameters, parameters).
        eigenvalues: largest first.
        eigenvectors: a column each: combinations of parameters, best determined first.
    """

    matrix: np.ndarray
    eigenvalues: np.ndarray
    eigenvectors: np.ndarray


def fisher_information(scaled: ScaledSensitivities) -> FisherInformation:
    """Fisher information and its eigenvectors, from the singular values of the scaled sensitivities."""
    _, singular, right = np.linalg.svd(scaled.matrix)
    values = np.zeros(len(scaled.parameters))
    values[: len(singular)] = singular**2
    signs = np.sign(right[np.arange(len(right)), np.abs(right).argmax(axis=1)])
    return FisherInformation(scaled.matrix.T @ scaled.matrix, values, (right * signs[:, None]).T)


def relative_errors(scaled: ScaledSensitivities, chosen: Sequence[str]) -> dict[str, float]:
    """Smallest standard error of each parameter [share of its value] if these are fitted together."""
    columns = scaled.matrix[:, [scaled.parameters.index(p) for p in chosen]]
    if len(chosen) > len(scaled.outputs) or np.linalg.matrix_rank(columns) < len(chosen):
        return dict.fromkeys(chosen, float("inf"))
    inverse = np.linalg.pinv(columns)
    return dict(zip(chosen, np.linalg.norm(inverse, axis=1).tolist(), strict=True))


@dataclass(frozen=True)
class Proposal:
    """A set to fit.

    Args:
        chosen: parameters, in the order in which they were taken: each time the one that says most beyond
            the others.
        excluded: reason for each parameter left out.
        collinearity: index of the set.
        relative_errors: smallest standard error of each [share of its value] if all are fitted together.
    """

    chosen: tuple[str, ...]
    excluded: dict[str, str]
    collinearity: float
    relative_errors: dict[str, float]


def propose(scaled: ScaledSensitivities, limit: float = 10.0, threshold: float = 1.0) -> Proposal:
    """Take, one by one, the parameter with the most effect that the ones taken do not have.

    Args:
        scaled: scaled sensitivities.
        limit: largest collinearity index of the set (Brun et al. 2001 found sets above 10 to 15 not
            identifiable).
        threshold: smallest effect, in standard uncertainties for a change of 100 %.
    """
    effect = dict(zip(scaled.parameters, scaled.effect.tolist(), strict=True))
    weak = [p for p in scaled.parameters if effect[p] < threshold]
    chosen: list[str] = []
    left = [p for p in scaled.parameters if p not in weak]
    while left and len(chosen) < len(scaled.outputs):
        ranked = sorted(left, key=lambda p: -_own_effect(scaled, chosen, p))
        best = next((p for p in ranked if _fits(scaled, [*chosen, p], limit, threshold)), None)
        if best is None:
            break
        chosen.append(best)
        left.remove(best)
    excluded = {p: _weak_reason(scaled, p, effect[p], threshold) for p in weak}
    excluded |= {p: _reason(scaled, chosen, p, limit, threshold) for p in left}
    ordered = {p: excluded[p] for p in sorted(excluded, key=lambda p: -effect[p])}
    gamma = scaled.collinearity(chosen) if chosen else float("nan")
    return Proposal(tuple(chosen), ordered, gamma, relative_errors(scaled, chosen))


def _own_effect(scaled: ScaledSensitivities, chosen: list[str], name: str) -> float:
    """Effect of a parameter that no combination of the chosen ones has."""
    target = scaled.matrix[:, scaled.parameters.index(name)]
    if not chosen:
        return float(np.linalg.norm(target))
    return scaled.closest([*chosen, name], name)[0] * float(np.linalg.norm(target))


def _fits(scaled: ScaledSensitivities, chosen: list[str], limit: float, threshold: float) -> bool:
    return scaled.collinearity(chosen) <= limit and _own_effect(scaled, chosen[:-1], chosen[-1]) >= threshold


def _weak_reason(scaled: ScaledSensitivities, name: str, effect: float, threshold: float) -> str:
    column = np.abs(scaled.matrix[:, scaled.parameters.index(name)])
    most = scaled.outputs[int(column.argmax())]
    if effect == 0.0:
        return "no effect on any measurement"
    return (
        f"too little effect: a change of 100 % moves {most} most, by {column.max():.2g} of its uncertainty "
        f"(all together {effect:.2g}, needed {threshold:g})"
    )


def _reason(scaled: ScaledSensitivities, chosen: list[str], name: str, limit: float, threshold: float) -> str:
    left, others = scaled.closest([*chosen, name], name)
    like = " and ".join(others)
    if len(chosen) >= len(scaled.outputs):
        return f"as many parameters as measurements ({len(chosen)}) are taken; its effect is that of {like}"
    gamma = scaled.collinearity([*chosen, name])
    if gamma > limit:
        cosine = scaled.cosines[scaled.parameters.index(name), scaled.parameters.index(others[0])]
        return (
            f"cannot be told from {like}: collinearity index {gamma:.3g} with the set (limit {limit:g}), "
            f"cosine {cosine:+.3f} with {others[0]}"
        )
    own = left * float(np.linalg.norm(scaled.matrix[:, scaled.parameters.index(name)]))
    return (
        f"nearly all its effect is that of {like}: {own:.2g} uncertainties are its own (needed {threshold:g})"
    )
