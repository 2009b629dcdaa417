"""The region of a design's inputs that holds most of its failed runs.

One or two inputs describe it. A condition is a threshold on one input beyond which most failed runs lie, but
few others. It is placed where the two distribution functions differ most (the Kolmogorov-Smirnov statistic).
A second condition is searched for among the runs that meet the first. Runs of a row share their values, so
rows are counted, not runs. A difference is significant if chance exceeds it for any input in less than one of
a hundred designs (Dvoretzky, Kiefer and Wolfowitz, with Massart's constant: 1990, doi
10.1214/aop/1176990746).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from eclsim.outputs.results import unit_of_value
from eclsim.reporting.numbers import number
from eclsim.sensitivity.design import Design

CHANCE_LEVEL = 0.01
MOST_CONDITIONS = 2


@dataclass(frozen=True)
class Condition:
    """A range of one input.

    Args:
        name: name of the input.
        relation: ">", "<" or "=".
        limit: threshold, or the choice.
    """

    name: str
    relation: str
    limit: float | str

    def __str__(self) -> str:
        limit = self.limit
        if not isinstance(limit, str):
            limit = number(limit, digits=3, unit=unit_of_value(self.name))
        return f"{self.name} {self.relation} {limit}"


@dataclass(frozen=True)
class FailedRegion:
    """Region that holds most of the failed runs.

    Args:
        conditions: conditions that define the region; the first is the most informative.
        failed: number of failed runs in the region.
        of_failed: number of all failed runs.
        share: share of failed runs among the runs in the region.
        share_elsewhere: share of failed runs among all others.
    """

    conditions: tuple[Condition, ...]
    failed: int
    of_failed: int
    share: float
    share_elsewhere: float

    @property
    def where(self) -> str:
        """The conditions in words."""
        return " and ".join(map(str, self.conditions))

    def __str__(self) -> str:
        return (
            f"runs fail mostly where {self.where}: {self.failed} of the {self.of_failed} failed ones are "
            f"there ({percent(self.share)} of the runs there, {percent(self.share_elsewhere)} elsewhere)"
        )

    def as_object(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {**vars(self), "conditions": [vars(condition) for condition in self.conditions]}


def failed_region(design: Design, failed: np.ndarray) -> FailedRegion | None:
    """Find the region that holds most of the failed runs; None if no input separates them.

    Args:
        design: design of the runs.
        failed: whether each run failed, shape (runs,).
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
    """Difference that chance does not exceed for any input and side, at `CHANCE_LEVEL`."""
    rows, sides = len(np.unique(failed_rows)), 2 * len(columns)
    return float(np.sqrt(np.log(max(sides, 1) / CHANCE_LEVEL) / (2.0 * rows))) if rows else np.inf


def _conditions(
    name: str, values: np.ndarray, in_region: np.ndarray, failed: np.ndarray
) -> Iterator[tuple[Condition, np.ndarray]]:
    """Conditions on an input (each choice, or the best threshold on each side) and the runs meeting them."""
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


def percent(share: float) -> str:
    """A share in percent; 100 only if it is exactly all."""
    if 0.995 <= share < 1.0:
        return "> 99 %"
    return f"{100.0 * share:.0f} %" if share >= 0.1 else f"{100.0 * share:.2g} %"
