"""Recomputation of the paper: figures and tables, extent, and files; imports no heavy packages."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eclsim.execution import Distribution

if TYPE_CHECKING:
    from eclsim.paper.cohort import CohortComparison
    from eclsim.paper.comparison import Row
    from eclsim.paper.crrt import CrrtComparison
    from eclsim.paper.sensitivity import SobolComparison

PARTS = ("crrt", "sensitivity", "positions", "cohort")
"""Parts of the paper: the CRRT study; sensitivity of the circulation; positions of the CRRT lines as inputs
of a sensitivity analysis; fits of the cohort."""
DEFAULT_SAMPLES = 512
DEFAULT_EXPLORE = 30


INDEX = "index.html"
FILES = (INDEX, "reproduction.csv", "reproduction.json")
PRELOAD = ("scipy.stats", "eclsim.sensitivity.runs", "eclsim.identification.cohort")
"""Modules that a worker imports before its first task."""
RUNS = "runs"
"""Folder of the results of long computations, so that they can be resumed."""


@dataclass(frozen=True)
class ReproductionSettings:
    """Extent of the computation.

    Args:
        samples: number of rows N of the sensitivity analyses; 2048 in the paper.
        explore: number of explored parameter sets for each free parameter in the fits of the cohort.
        cohort: table of measurements; None for the synthetic cohort.
    """

    samples: int = DEFAULT_SAMPLES
    explore: int = DEFAULT_EXPLORE
    cohort: Path | None = None


@dataclass(frozen=True)
class Reproduction:
    """The comparison; parts that were not requested are None.

    Args:
        crrt: Figures 5 and 6, and the numbers of sections 3.3 and 4.
        sensitivity: Figures 3, S-1, S-3, S-4, Table 2.
        positions: Figures 7, S-5, S-6, S-7.
        cohort: Table 1, Figures 4 and S-2.
        tables: one row for each value of Tables S-1 to S-4.
    """

    crrt: CrrtComparison
    sensitivity: SobolComparison | None
    positions: SobolComparison | None
    cohort: CohortComparison | None
    tables: tuple[Row, ...]

    @property
    def parts(self) -> tuple[str, ...]:
        """Parts that were computed."""
        return tuple(name for name in PARTS if getattr(self, name) is not None)

    @property
    def rows(self) -> tuple[Row, ...]:
        """Numbers and statements of the text and of Tables 1 and 2, without Tables S-1 to S-4."""
        parts = (self.cohort, self.sensitivity, self.crrt, self.positions)
        return tuple(row for part in parts if part is not None for row in part.rows)


def reproduce(
    folder: Path,
    settings: ReproductionSettings | None = None,
    parts: Sequence[str] = PARTS,
    progress: Callable[[str], None] = lambda _: None,
    distribution: Distribution | None = None,
) -> Reproduction:
    """Compute everything and compare it with the paper.

    Args:
        folder: folder that stores long computations, so that they can be resumed.
        settings: extent of the computation.
        parts: names from `PARTS`; the CRRT study is always included, except in a shard.
        progress: called with a description of the current step.
        distribution: where and which runs of the long parts are computed; None for all of them in this
            process, from the start.

    Raises:
        ExecutionError: A folder holds something else, or workers cannot be reached.
        ShardDone: This run computed one shard only; its runs are in the folder.
    """
    from eclsim.paper.cohort import reproduce_cohort
    from eclsim.paper.crrt import reproduce_crrt, search_unprinted_values, table_rows
    from eclsim.paper.sensitivity import reproduce_circulation, reproduce_positions

    chosen = settings or ReproductionSettings()
    distribution = distribution or Distribution(force=True)
    with distribution.running(PRELOAD) as executor:
        long_parts: dict[str, Callable[[Path], object]] = {
            "sensitivity": lambda at: reproduce_circulation(at, chosen.samples, executor, progress),
            "positions": lambda at: reproduce_positions(
                at, search_unprinted_values(), chosen.samples, executor, progress
            ),
            "cohort": lambda at: reproduce_cohort(at, chosen.cohort, chosen.explore, executor, progress),
        }
        names = [name for name in long_parts if name in parts]
        results = executor.run_each([partial(long_parts[name], folder / name) for name in names])
    compared: dict[str, Any] = dict.fromkeys(long_parts) | dict(zip(names, results, strict=True))
    return Reproduction(reproduce_crrt(progress), tables=tuple(table_rows()), **compared)


# --- numbered figures and tables of the paper -----------------------------------------------------


@dataclass(frozen=True, slots=True)
class Item:
    """A figure or table of the paper.

    Args:
        number: number in the paper, such as "S-1".
        part: part of the recomputation that it belongs to.
        caption: caption of the recomputed figure or table.
        drawings: names of its drawings; none for a table.
    """

    number: str
    part: str
    caption: str
    drawings: tuple[str, ...] = ()

    @property
    def kind(self) -> str:
        """Kind of the item, "Figure" or "Table"."""
        return "Figure" if self.drawings else "Table"

    @property
    def title(self) -> str:
        """Kind and number, such as "Figure 3"."""
        return f"{self.kind} {self.number}"

    @property
    def key(self) -> str:
        """Name in files and links."""
        return f"{self.kind}_{self.number}".lower().replace("-", "")

    @property
    def files(self) -> tuple[str, ...]:
        """Names of its files."""
        if not self.drawings:
            return (f"{self.key}.csv",)
        letters = "" if len(self.drawings) == 1 else "abcdefgh"
        return tuple(f"{self.key}{letters[k : k + 1]}.svg" for k in range(len(self.drawings)))


_SENSITIVITY, _POSITIONS = "sensitivity of V-A ECMO", "positions of the CRRT lines as inputs"

ITEMS = (
    Item("1", "crrt", "the model: patient, ECMO and CRRT, with the mean pressures and flows of scheme g",
         ("circuit",)),
    Item("2", "crrt", "the nine ways of connecting the CRRT, ranked for this patient", ("schemes",)),
    Item("3", "sensitivity", f"total orders, {_SENSITIVITY}", ("total",)),
    Item("4", "cohort", "a cohort's measured and simulated values, and their distributions",
         ("scatter", "boxes")),
    Item("5", "crrt", "two beats of every scheme at 3425 rpm: patient, right ventricle, CRRT lines",
         ("beat",)),
    Item("6", "crrt", "cycle means of every scheme over the ECMO flow", ("speeds",)),
    Item("7", "positions", f"total orders, {_POSITIONS}", ("total",)),
    Item("S-1", "sensitivity", f"total orders against the number of rows, {_SENSITIVITY}", ("convergence",)),
    Item("S-2", "cohort", "slices through the objective of one data point", ("slices",)),
    Item("S-3", "sensitivity", f"total less first order, {_SENSITIVITY}", ("difference",)),
    Item("S-4", "sensitivity", f"total orders summed over the outputs, {_SENSITIVITY}", ("sums",)),
    Item("S-5", "positions", f"total orders summed over the outputs, {_POSITIONS}", ("sums",)),
    Item("S-6", "positions", f"distributions of the outputs, {_POSITIONS}", ("distributions",)),
    Item("S-7", "positions", f"total less first order, {_POSITIONS}", ("difference",)),
    Item("1", "cohort", "what was measured: median, smallest, largest"),
    Item("2", "sensitivity", "sums of the total orders of the parameters that are fitted"),
    Item("S-1", "crrt", "parameters of the circulation"),
    Item("S-2", "crrt", "parameters of the ECMO circuit"),
    Item("S-3", "crrt", "parameters of the CRRT circuit"),
    Item("S-4", "crrt", "fitted parameters of the patient of section 3.3"),
)  # fmt: skip
"""All numbered figures and tables of the paper."""


def items_of(parts: Sequence[str]) -> tuple[Item, ...]:
    """Figures and tables of some parts; those of the CRRT study are always included."""
    return tuple(item for item in ITEMS if item.part in ("crrt", *parts))


def file_names() -> tuple[str, ...]:
    """Names of all files that may be written."""
    return (*FILES, *(name for item in ITEMS for name in item.files))
