"""The result of an analysis: indices of every output, and what is read off them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from eclsim.sensitivity.design import Design
from eclsim.sensitivity.estimators import RESAMPLES, Estimates, sobol_indices
from eclsim.sensitivity.evaluation import Evaluated

SHARE = 0.9


@dataclass(frozen=True)
class FailedRun:
    """One run that has no result.

    Args:
        run: position in the design.
        row: row of the design that is left out with it.
        point: what it was: A, B, AB or BA and the factor exchanged.
        status: how it ended.
        inputs: value or choice of each input.
    """

    run: int
    row: int
    point: str
    status: str
    inputs: dict[str, Any]


@dataclass(frozen=True)
class Indices:
    """Sobol indices of some outputs with respect to some factors.

    Args:
        factors: names of the inputs or groups.
        outputs: names of the outputs.
        estimates: the numbers.
        samples: rows of the design.
        evaluations: model runs.
        failed: runs without a result; all runs of their rows are left out of the estimates.
        rows_used: rows that the estimates rest on.
        seconds: wall clock time.
    """

    factors: tuple[str, ...]
    outputs: tuple[str, ...]
    estimates: Estimates
    samples: int
    evaluations: int
    failed: tuple[FailedRun, ...]
    rows_used: int
    seconds: float = 0.0

    @property
    def sums(self) -> dict[str, float]:
        """Total order summed over the outputs, largest first (the paper's Table 2)."""
        total = self.estimates.ST.sum(axis=0)
        return {self.factors[k]: float(total[k]) for k in np.argsort(-total, kind="stable")}

    def ranking(self, output: str) -> list[str]:
        """Factors by their total order, largest first."""
        total = self.estimates.ST[self.outputs.index(output)]
        return [self.factors[k] for k in np.argsort(-total, kind="stable")]

    def selected(self, share: float = SHARE) -> dict[str, list[str]]:
        """For each output the fewest factors whose total orders add to a share of all total orders."""
        chosen = {}
        for output, total in zip(self.outputs, self.estimates.ST, strict=True):
            order = np.argsort(-total, kind="stable")
            summed = np.cumsum(total[order])
            needed = int(np.searchsorted(summed, share * summed[-1])) + 1 if summed[-1] > 0 else 0
            chosen[output] = [self.factors[k] for k in order[:needed]]
        return chosen

    def union(self, share: float = SHARE) -> list[str]:
        """Factors selected for any output, those with the largest sums first."""
        chosen = {name for names in self.selected(share).values() for name in names}
        return [name for name in self.sums if name in chosen]

    def as_object(self, second_order: bool = False) -> dict[str, Any]:
        """As plain data for JSON."""
        return {
            "samples": self.samples,
            "evaluations": self.evaluations,
            "failed": len(self.failed),
            "rows_used": self.rows_used,
            "seconds": round(self.seconds, 3),
            "outputs": {o: self._output_object(k, second_order) for k, o in enumerate(self.outputs)},
            "sum_ST": self.sums,
            "selected": self.selected(),
            "union": self.union(),
        }

    def _output_object(self, k: int, second_order: bool) -> dict[str, Any]:
        e = self.estimates
        found: dict[str, Any] = {}
        for name, values in (("S1", e.S1), ("S1_conf", e.S1_conf), ("ST", e.ST), ("ST_conf", e.ST_conf)):
            found[name] = dict(zip(self.factors, values[k].tolist(), strict=True))
        if second_order and e.S2 is not None and e.S2_conf is not None:
            for name, pairs in (("S2", e.S2), ("S2_conf", e.S2_conf)):
                found[name] = {
                    one: {self.factors[j]: float(pairs[k, i, j]) for j in range(i + 1, len(self.factors))}
                    for i, one in enumerate(self.factors[:-1])
                }
        return found


def indices_of(
    design: Design,
    outputs: tuple[str, ...],
    found: Evaluated,
    *,
    seed: int | None = None,
    resamples: int = RESAMPLES,
    seconds: float = 0.0,
) -> Indices:
    """Indices from the runs of a design, or of its first rows.

    A row with a failed run is left out whole: the estimators compare the runs of a row with each other.
    """
    values = found.values.reshape(-1, design.runs_per_row, len(outputs))
    good = (found.status == 0).reshape(len(values), -1).all(axis=1)
    if good.sum() < 2:
        raise ValueError(
            f"{int((~good).sum())} of {len(good)} rows have a failed run: nothing left to estimate from"
        )
    seed = design.seed if seed is None else seed
    estimates = sobol_indices(values[good], len(design.factors), seed=seed, resamples=resamples)
    failed = tuple(
        _failed_run(design, int(run), int(found.status[run])) for run in np.flatnonzero(found.status)
    )
    return Indices(
        design.factors, outputs, estimates, len(values), len(found.status), failed, int(good.sum()), seconds
    )


def _failed_run(design: Design, run: int, status: int) -> FailedRun:
    from eclsim.orbit.status import Status

    row, position = divmod(run, design.runs_per_row)
    unit = design.unit(row, row + 1)[position : position + 1]
    inputs = {i.name: i.table_column(unit[:, k])[0] for k, i in enumerate(design.inputs)}
    return FailedRun(run, row, point_name(design, position), Status(status).name.lower(), inputs)


def point_name(design: Design, position: int) -> str:
    """Name of a point of a row: A, AB or BA with the factor exchanged, B."""
    if position == 0:
        return "A"
    if position == design.runs_per_row - 1:
        return "B"
    kind, factor = divmod(position - 1, len(design.factors))
    return f"{('AB', 'BA')[kind]} {design.factors[factor]}"
