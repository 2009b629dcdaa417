"""How the indices settle with the number of rows, read off the runs of one design.

An aligned part of 2^k rows of a scrambled Sobol sequence is itself a design of 2^k rows. So a design of N
rows holds N/n designs of n rows: repeats that cost no run. (The paper's Figure S-1.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eclsim.sensitivity.analysis import Finished
from eclsim.sensitivity.estimators import sobol_indices

SMALLEST = 16


@dataclass(frozen=True)
class Convergence:
    """Indices at doubling numbers of rows.

    Args:
        factors: names.
        outputs: names.
        rows: numbers of rows, shape (sizes,).
        repeats: number of designs of that size.
        mean: mean over the repeats, by index ("S1", "ST"), each of shape (sizes, outputs, factors).
        spread: standard deviation over the repeats; NaN where there is one.
        width: mean half width of the bootstrap intervals.
    """

    factors: tuple[str, ...]
    outputs: tuple[str, ...]
    rows: np.ndarray
    repeats: np.ndarray
    mean: dict[str, np.ndarray]
    spread: dict[str, np.ndarray]
    width: dict[str, np.ndarray]


def convergence(finished: Finished, smallest: int = SMALLEST) -> Convergence:
    """Means, spreads and intervals at `smallest`, twice that ... up to all rows."""
    design, outputs = finished.design, finished.indices.outputs
    factors = len(design.factors)
    values = finished.found.values.reshape(design.samples, design.runs_per_row, len(outputs))
    good = (finished.found.status == 0).reshape(design.samples, -1).all(axis=1)
    # The BA points serve second order alone.
    values = np.concatenate([values[:, : factors + 1], values[:, -1:]], axis=1)
    least = min(smallest, design.samples)
    sizes = [design.samples >> k for k in range(20, -1, -1) if design.samples >> k >= least]
    found: dict[str, list[np.ndarray]] = {f"{n}{k}": [] for n in ("S1", "ST") for k in ("", "_sd", "_conf")}
    for size in sizes:
        parts = [slice(k, k + size) for k in range(0, design.samples, size)]
        repeats = [
            sobol_indices(values[p][good[p]], factors, seed=design.seed) for p in parts if good[p].sum() > 1
        ]
        for name in ("S1", "ST"):
            each = np.stack([getattr(r, name) for r in repeats])
            found[name].append(each.mean(axis=0))
            alone = len(each) < 2
            found[f"{name}_sd"].append(np.full_like(each[0], np.nan) if alone else each.std(axis=0, ddof=1))
            found[f"{name}_conf"].append(np.mean([getattr(r, f"{name}_conf") for r in repeats], axis=0))
    stacked = {name: np.stack(parts) for name, parts in found.items()}
    return Convergence(
        design.factors,
        outputs,
        np.array(sizes),
        design.samples // np.array(sizes),
        *({n: stacked[n + end] for n in ("S1", "ST")} for end in ("", "_sd", "_conf")),
    )
