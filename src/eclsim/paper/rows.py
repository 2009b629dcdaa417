"""One number of the paper beside ours, and what to make of the two."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

YES_NO = "yes/no"
"""Unit of a statement: 1 if it holds."""


class Verdict(StrEnum):
    """What a comparison came to."""

    AS_PRINTED = "as printed"
    EXPLAINED = "explained"
    OTHER_DATA = "other data"
    DIFFERS = "differs"


@dataclass(frozen=True)
class Row:
    """One number.

    Args:
        section: where it is printed.
        quantity: what it is.
        unit: of the values; `YES_NO` for a statement.
        paper: as printed.
        ours: with what the paper states, the rest assumed.
        explained: computed once more with what is thought to make the difference, or None.
        digits: decimals printed.
        tolerance: half a unit of the last printed digit, and our own error.
        why: the reason where ours is not what is printed.
        other_data: whether the printed number was measured on patients or circuits that are not ours.
    """

    section: str
    quantity: str
    unit: str
    paper: float
    ours: float
    explained: float | None
    digits: int
    tolerance: float
    why: str = ""
    other_data: bool = False

    @property
    def difference(self) -> float:
        """Ours less the paper's."""
        return self.ours - self.paper

    @property
    def difference_percent(self) -> float:
        """Difference relative to the paper's value; not a number for a statement."""
        return 100.0 * self.difference / abs(self.paper) if self.paper and self.unit != YES_NO else np.nan

    @property
    def as_printed(self) -> bool:
        """Whether ours agrees with what is printed."""
        return abs(self.difference) <= self.tolerance

    @property
    def verdict(self) -> Verdict:
        """What the comparison came to."""
        if self.as_printed:
            return Verdict.AS_PRINTED
        if self.explained is not None and abs(self.explained - self.paper) <= self.tolerance:
            return Verdict.EXPLAINED
        return Verdict.OTHER_DATA if self.other_data else Verdict.DIFFERS

    def because(self, why: str) -> Row:
        """The same with a reason."""
        return replace(self, why=why)


def statement(section: str, words: str, ours: bool, why: str = "", explained: bool | None = None) -> Row:
    """A statement of the text: whether it holds for ours."""
    found = None if explained is None else float(explained)
    return Row(section, words, YES_NO, 1.0, float(ours), found, 0, 0.5, "" if ours else why)
