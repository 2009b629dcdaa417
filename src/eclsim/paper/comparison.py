"""Comparison of a number with an expected one, with a verdict.

`eclsim reproduce` compares with numbers of the paper, `eclsim validate` with other solvers and with
measurements.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import TypeVar

YES_NO = "yes/no"
"""Unit of a statement: 1 if it holds."""


class Verdict(StrEnum):
    """Outcome of a comparison."""

    AGREES = "as printed"
    EXPLAINED = "explained"
    OTHER_DATA = "other data"
    DIFFERS = "differs"


@dataclass(frozen=True)
class Explanation:
    """Reason why a row misses, with evidence; the reason is valid only while all of its evidence holds.

    Args:
        text: text of the reason.
        evidence: rows that hold if the reason is right: the result of eclsim without the cause, or the number
            that the cause was shown to account for.
        undecided: whether the source leaves open which of the two is right.
    """

    text: str
    evidence: tuple[Row, ...] = ()
    undecided: bool = False

    @property
    def holds(self) -> bool:
        """Whether there is evidence, and all of it holds."""
        return bool(self.evidence) and all(row.holds for row in self.evidence)


@dataclass(frozen=True)
class Row:
    """A number compared with an expected one.

    Args:
        name: name of the compared quantity.
        got: number computed by eclsim.
        low: smallest number that passes.
        high: largest number that passes.
        unit: unit of all these numbers; `YES_NO` for a statement.
        expected: expected number; None if only a limit or a range is given.
        explanation: reason for a miss, if known; the row still counts as a miss.
        source: source of the expected number, such as a section of the paper.
        decimals: decimals of the expected number as printed.
        other_data: whether the expected number was measured on other patients or circuits than the model's.
    """

    name: str
    got: float
    low: float
    high: float
    unit: str = "1"
    expected: float | None = None
    explanation: Explanation | None = None
    source: str = ""
    decimals: int = 0
    other_data: bool = False

    @property
    def holds(self) -> bool:
        """Whether the number is within the limits; False for NaN."""
        return self.low <= self.got <= self.high

    @property
    def verdict(self) -> Verdict:
        """Outcome of the comparison."""
        if self.holds:
            return Verdict.AGREES
        if self.explanation is not None and self.explanation.holds:
            return Verdict.EXPLAINED
        return Verdict.OTHER_DATA if self.other_data else Verdict.DIFFERS

    @property
    def reason(self) -> str:
        """Reason for a miss, with evidence or supposed; empty if the row holds."""
        return "" if self.holds or self.explanation is None else self.explanation.text

    @property
    def explained(self) -> str:
        """Reason for a miss with valid evidence; else empty."""
        return self.reason if self.verdict is Verdict.EXPLAINED else ""

    @property
    def evidence(self) -> tuple[Row, ...]:
        """Rows that hold if the reason is right."""
        return () if self.explanation is None else self.explanation.evidence

    @property
    def got_explained(self) -> float | None:
        """The number computed without the cause of a miss, from the first row of evidence."""
        return self.evidence[0].got if self.evidence else None

    @property
    def difference(self) -> float:
        """The computed minus the expected number."""
        return math.nan if self.expected is None else self.got - self.expected

    @property
    def percent(self) -> float | None:
        """Difference in percent of the expected number; None for a statement, a range and zero."""
        if not self.expected or self.unit == YES_NO:
            return None
        return 100.0 * self.difference / abs(self.expected)

    @property
    def used(self) -> float:
        """Share of the tolerance that the error uses; 1 at the limit."""
        if not math.isfinite(self.got):
            return math.inf
        if self.expected is not None:
            room = self.high - self.expected if self.got >= self.expected else self.expected - self.low
            distance = abs(self.difference)
        elif self.low == 0.0 or math.isinf(self.high):
            room, distance = (self.high, self.got) if self.low == 0.0 else (self.got, self.low)
        else:
            middle = 0.5 * (self.low + self.high)
            room, distance = self.high - middle, abs(self.got - middle)
        return distance / room if room > 0.0 else (0.0 if distance == 0.0 else math.inf)

    def explained_by(self, reason: str, got: float, name: str = "", *, undecided: bool = False) -> Row:
        """Return the row with a reason for a miss, shown by an experiment that gives another number.

        Args:
            reason: text of the reason.
            got: number in the experiment.
            name: name of the row of the experiment; empty for that of this row.
            undecided: see `Explanation`.
        """
        shown = replace(self, name=name or self.name, got=float(got), explanation=None, source="")
        return replace(self, explanation=Explanation(reason, (shown,), undecided))

    def because(self, reason: str) -> Row:
        """Return the row with another reason for a miss, and its evidence."""
        return replace(self, explanation=Explanation(reason, self.evidence))


def within(
    name: str,
    expected: float,
    got: float,
    tolerance: float,
    unit: str = "1",
    *,
    explanation: Explanation | None = None,
    source: str = "",
) -> Row:
    """Return a row that holds within a tolerance of the expected number."""
    low, high = float(expected - tolerance), float(expected + tolerance)
    return Row(name, float(got), low, high, unit, float(expected), explanation, source)


def at_most(name: str, got: float, limit: float, unit: str = "1") -> Row:
    """Return a row that holds from zero up to a limit."""
    return Row(name, float(got), 0.0, limit, unit)


def at_least(name: str, got: float, limit: float, unit: str = "1") -> Row:
    """Return a row that holds from a limit upwards."""
    return Row(name, float(got), limit, math.inf, unit)


def printed_number(
    section: str,
    name: str,
    unit: str,
    printed: float,
    got: float,
    *,
    decimals: int = 0,
    tolerance: float | None = None,
    explained: float | None = None,
    reason: str = "",
    other_data: bool = False,
) -> Row:
    """Return a row for a number printed in a paper.

    Args:
        section: section where the number is printed.
        name: name of the quantity.
        unit: unit of the values.
        printed: number as printed.
        got: number computed from the values that the paper states and assumptions for the rest.
        decimals: number of printed decimals.
        tolerance: allowed difference; None for half a unit of the last printed digit.
        explained: number computed again without the supposed cause of the difference.
        reason: reason why the computed number differs from the printed one.
        other_data: whether the number was measured on other patients or circuits than the model's.
    """
    allowed = 0.5 * 10.0**-decimals if tolerance is None else tolerance
    evidence = () if explained is None else (within(name, printed, explained, allowed, unit),)
    row = within(name, printed, got, allowed, unit, explanation=Explanation(reason, evidence), source=section)
    return replace(row, decimals=max(decimals, 0), other_data=other_data)


def statement(
    section: str, sentence: str, holds: bool, reason: str = "", explained: bool | None = None
) -> Row:
    """Return a row for a statement of a paper's text: whether it holds for the computed results."""
    result = None if explained is None else float(explained)
    return printed_number(section, sentence, YES_NO, 1.0, float(holds), explained=result, reason=reason)


Computed = TypeVar("Computed")
Statement = tuple[str, str, Callable[[Computed], bool]] | tuple[str, str, Callable[[Computed], bool], str]
"""Section and text of a statement, whether it holds for results, and the reason if it does not."""


def statements(
    known: Iterable[Statement[Computed]], got: Computed, explained: Computed, reason: str = ""
) -> list[Row]:
    """Return a row for each statement: whether it holds, and without the supposed cause of the difference."""
    return [
        statement(section, sentence, holds(got), own[0] if own else reason, holds(explained))
        for section, sentence, holds, *own in known
    ]


@dataclass(frozen=True)
class Check:
    """Rows that answer one question.

    Args:
        key: short name.
        title: description of the comparison.
        bar: tolerance in words.
        rows: rows of the comparison.
        explained_pass: whether misses with a valid explanation are accepted.
        required: whether a missed tolerance fails the validation. Measurements of patients and devices are
            compared and shown to tell how far the model can be trusted, but do not fail it.
        remarks: sentences printed below the table.
        seconds: computation time [s].
    """

    key: str
    title: str
    bar: str
    rows: tuple[Row, ...]
    explained_pass: bool = False
    required: bool = True
    remarks: tuple[str, ...] = ()
    seconds: float = field(default=0.0, compare=False)

    @property
    def missed(self) -> tuple[Row, ...]:
        """Rows that do not hold."""
        return tuple(row for row in self.rows if not row.holds)

    @property
    def holds(self) -> bool:
        """Whether the tolerances are met."""
        failing = [row for row in self.missed if not (self.explained_pass and row.explained)]
        return bool(self.rows) and not failing


def worst(rows: Iterable[Row]) -> Row:
    """The row that uses the largest share of its tolerance."""
    return max(rows, key=lambda row: row.used)
