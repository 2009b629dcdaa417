"""What of the paper is recomputed, by figure and table, and the names of the files; loads nothing heavy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

INDEX = "index.html"
FILES = (INDEX, "reproduction.csv", "reproduction.json")
RUNS = "runs"
"""Folder of what takes long, so that it can be gone on with."""


@dataclass(frozen=True, slots=True)
class Item:
    """A figure or table of the paper.

    Args:
        number: as the paper counts, such as "S-1".
        part: of the recomputation that it belongs to.
        words: what ours shows.
        drawings: names of its drawings; none for a table.
    """

    number: str
    part: str
    words: str
    drawings: tuple[str, ...] = ()

    @property
    def kind(self) -> str:
        """Figure or table."""
        return "Figure" if self.drawings else "Table"

    @property
    def title(self) -> str:
        """Kind and number."""
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
    Item(
        "1",
        "crrt",
        "the model: patient, ECMO and CRRT, with the mean pressures and flows of scheme g",
        ("circuit",),
    ),
    Item("2", "crrt", "the nine ways of connecting the CRRT, ranked for this patient", ("schemes",)),
    Item("3", "sensitivity", f"total orders, {_SENSITIVITY}", ("total",)),
    Item(
        "4",
        "cohort",
        "a cohort's measured and simulated values, and their distributions",
        ("scatter", "boxes"),
    ),
    Item(
        "5", "crrt", "two beats of every scheme at 3425 rpm: patient, right ventricle, CRRT lines", ("beat",)
    ),
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
)
"""Everything that is numbered in the paper."""


def items_of(parts: Sequence[str]) -> tuple[Item, ...]:
    """The figures and tables of some parts; those of the CRRT study are always there."""
    return tuple(item for item in ITEMS if item.part in ("crrt", *parts))


def file_names() -> tuple[str, ...]:
    """Names of all files that may be written."""
    return (*FILES, *(name for item in ITEMS for name in item.files))
