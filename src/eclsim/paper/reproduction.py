"""Every table and figure of the paper beside what eclsim computes, with the reason where they differ."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from eclsim.paper.settings import PARTS, ReproductionSettings

if TYPE_CHECKING:
    from eclsim.paper.cohort import CohortPart
    from eclsim.paper.crrt import CrrtPart
    from eclsim.paper.positions import PositionsPart
    from eclsim.paper.rows import Row
    from eclsim.paper.sensitivity import SensitivityPart


@dataclass(frozen=True)
class Reproduction:
    """The comparison; a part that was not asked for is None.

    Args:
        crrt: Figures 5 and 6, the numbers of sections 3.3 and 4.
        sensitivity: Figures 3, S-1, S-3, S-4, Table 2.
        positions: Figures 7, S-5, S-6, S-7.
        cohort: Table 1, Figures 4 and S-2.
        tables: a row for each value of Tables S-1 to S-4.
    """

    crrt: CrrtPart
    sensitivity: SensitivityPart | None
    positions: PositionsPart | None
    cohort: CohortPart | None
    tables: tuple[Row, ...]

    @property
    def parts(self) -> tuple[str, ...]:
        """Parts that were computed."""
        return tuple(name for name in PARTS if getattr(self, name) is not None)

    @property
    def rows(self) -> tuple[Row, ...]:
        """Numbers and statements of the text, Tables 1 and 2; without Tables S-1 to S-4."""
        parts = (self.cohort, self.sensitivity, self.crrt, self.positions)
        return tuple(row for part in parts if part is not None for row in part.rows)


def reproduce(
    folder: Path,
    settings: ReproductionSettings | None = None,
    parts: Sequence[str] = PARTS,
    progress: Callable[[str], None] = lambda _: None,
) -> Reproduction:
    """Compute everything and set it beside the paper.

    Args:
        folder: keeps what takes long, so that it can be gone on with.
        settings: how much is computed.
        parts: of `PARTS`; the CRRT study is always done.
        progress: is told what is being computed.
    """
    from eclsim.paper.cohort import reproduce_cohort
    from eclsim.paper.crrt import reproduce_crrt, table_rows
    from eclsim.paper.positions import reproduce_positions
    from eclsim.paper.sensitivity import reproduce_sensitivity

    chosen = settings or ReproductionSettings()
    crrt = reproduce_crrt(progress)
    sensitivity = positions = cohort = None
    if "sensitivity" in parts:
        sensitivity = reproduce_sensitivity(folder / "sensitivity", chosen.samples, chosen.resume, progress)
    if "positions" in parts:
        positions = reproduce_positions(
            folder / "positions", crrt.unstated, chosen.samples, chosen.resume, progress
        )
    if "cohort" in parts:
        cohort = reproduce_cohort(folder / "cohort", chosen.cohort, chosen.explore, chosen.resume, progress)
    return Reproduction(crrt, sensitivity, positions, cohort, tuple(table_rows()))
