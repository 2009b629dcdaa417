"""Region of the inputs in which runs failed: the one or two that set the failed runs apart from the others.

A threshold on one input that most of the failed runs lie beyond and few of the others: the one at which the
two distribution functions are furthest apart, which is the statistic of Kolmogorov and Smirnov. A second
input is looked for among the runs beyond the first. Runs of a row share their values, so that rows count and
not runs: a distance counts that chance gives among all inputs in less than one of a hundred designs
(Dvoretzky, Kiefer and Wolfowitz, with Massart's constant: 1990, doi 10.1214/aop/1176990746).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from eclsim.sensitivity.design import Design

CHANCE_LEVEL = 0.01
MOST_CONDITIONS = 2


@dataclass(frozen=True)
class Condition:
    """A range of one input.

    Args:
        name: of the input.
        relation: ">", "<" or "=".
        limit: the value that it is beyond, or the choice.
    """

    name: str
    relation: str
    limit: float | str

    def __str__(self) -> str:
        limit = self.limit if isinstance(self.limit, str) else f"{self.limit:.3g}"
        return f"{self.name} {self.relation} {limit}"


@dataclass(frozen=True)
class FailedRegion:
    """Region that holds most of the failed runs.

    Args:
        conditions: that hold there together; the first tells more than the second.
        failed: failed runs there.
        of_failed: all failed runs.
        share: of the runs there, those that failed.
        share_elsewhere: of all others.
    """

    conditions: tuple[Condition, ...]
    failed: int
    of_failed: int
    share: float
    share_elsewhere: float

    def __str__(self) -> str:
        where = " and ".join(map(str, self.conditions))
        return (
            f"runs fail mostly where {where}: {self.failed} of the {self.of_failed} failed ones are there "
            f"({100.0 * self.share:.2g} % of the runs there, {100.0 * self.share_elsewhere:.2g} % elsewhere)"
        )

    def as_object(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {**vars(self), "conditions": [vars(condition) for condition in self.conditions]}


def failed_region(design: Design, failed: np.ndarray) -> FailedRegion | None:
    """Region that holds most of the failed runs; None where no input sets them apart.

    Args:
        design: of the runs.
        failed: which of them failed, shape (runs,).
    """
    unit = design.unit(0, len(failed) // design.runs_per_row)
    columns = {chosen.name: chosen.table_column(unit[:, k]) for k, chosen in enumerate(design.inputs)}
    rows = np.arange(len(failed)) // design.runs_per_row
    in_region, conditions = np.ones(len(failed), dtype=bool), []
    for _ in range(MOST_CONDITIONS):
        best, best_condition, within = _least_by_chance(rows[in_region & failed], columns), None, in_region
        for name, values in columns.items():
            for condition, beyond in _conditions(name, values, in_region, failed):
                difference = float(beyond[in_region & failed].mean() - beyond[in_region & ~failed].mean())
                if difference > best:
                    best, best_condition, within = difference, condition, in_region & beyond
        if best_condition is None:
            break
        conditions.append(best_condition)
        in_region = within
        del columns[best_condition.name]
        if failed[in_region].all():
            break
    if not conditions:
        return None
    return FailedRegion(
        tuple(conditions), int(failed[in_region].sum()), int(failed.sum()), float(failed[in_region].mean()),
        float(failed[~in_region].mean()),
    )  # fmt: skip


def _least_by_chance(failed_rows: np.ndarray, columns: dict[str, np.ndarray]) -> float:
    """Distance that chance stays below, whichever of the inputs and sides is looked at."""
    rows, sides = len(np.unique(failed_rows)), 2 * len(columns)
    return float(np.sqrt(np.log(max(sides, 1) / CHANCE_LEVEL) / (2.0 * rows))) if rows else np.inf


def _conditions(
    name: str, values: np.ndarray, in_region: np.ndarray, failed: np.ndarray
) -> Iterator[tuple[Condition, np.ndarray]]:
    """Conditions on an input, and which runs meet each: every choice, or the best threshold on each side."""
    bad, good = values[in_region & failed], values[in_region & ~failed]
    if not len(bad) or not len(good):
        return
    if values.dtype == object or values.dtype.kind in "US":
        for choice in np.unique(bad.astype(str)):
            yield Condition(name, "=", str(choice)), values == choice
        return
    bad, good = np.sort(bad), np.sort(good)
    above = 1.0 - np.arange(len(bad)) / len(bad) - (1.0 - np.searchsorted(good, bad) / len(good))
    least = bad[int(np.argmax(above))]
    yield Condition(name, ">", float(least)), values >= least
    below = np.arange(1, len(bad) + 1) / len(bad) - np.searchsorted(good, bad, side="right") / len(good)
    most = bad[int(np.argmax(below))]
    yield Condition(name, "<", float(most)), values <= most
