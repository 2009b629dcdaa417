"""Comparison of a number with an expected one, and the verdict on it.

`eclsim reproduce` compares with what the paper prints, `eclsim validate` with other solvers and measurements.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from enum import StrEnum

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
    """Why a row misses, with what shows it. It counts only while all of its evidence holds.

    Args:
        text: the reason.
        evidence: rows that hold if the reason is the right one: what eclsim gives where the reason is taken
            away, or the very number that the reason was shown to account for.
        undecided: whether the source leaves open which of both is right.
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
    """One number compared with an expected one.

    Args:
        name: what is compared.
        got: eclsim's number.
        low: smallest number that passes.
        high: largest number that passes.
        unit: unit of all of them; `YES_NO` for a statement.
        expected: the number compared with; None where only a limit or a range is given.
        explanation: why it misses, where that is known; it stays a miss.
        source: where the expected number comes from; a section of the paper.
        decimals: of the expected number, as printed.
        other_data: whether the expected number was measured on patients or circuits that are not ours.
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
        """Whether the number is within the bar; NaN is not."""
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
        """Why it misses, shown or only supposed; empty where it holds."""
        return "" if self.holds or self.explanation is None else self.explanation.text

    @property
    def explained(self) -> str:
        """Why it misses; empty where it holds, and where the evidence for the reason no longer does."""
        return self.reason if self.verdict is Verdict.EXPLAINED else ""

    @property
    def evidence(self) -> tuple[Row, ...]:
        """Rows that hold if the reason is the right one."""
        return () if self.explanation is None else self.explanation.evidence

    @property
    def got_explained(self) -> float | None:
        """Our number with the reason taken away: that of the first evidence."""
        return self.evidence[0].got if self.evidence else None

    @property
    def difference(self) -> float:
        """Our number less the expected one."""
        return math.nan if self.expected is None else self.got - self.expected

    @property
    def percent(self) -> float | None:
        """Difference in percent of the expected number; None for a statement, a range and a zero."""
        if not self.expected or self.unit == YES_NO:
            return None
        return 100.0 * self.difference / abs(self.expected)

    @property
    def used(self) -> float:
        """Share of the tolerance that the error takes; 1 at the limit."""
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

    def because(self, reason: str) -> Row:
        """The same with another reason for a miss, and the evidence that it has."""
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
    """A row that holds within a tolerance of the expected number."""
    low, high = float(expected - tolerance), float(expected + tolerance)
    return Row(name, float(got), low, high, unit, float(expected), explanation, source)


def at_most(name: str, got: float, limit: float, unit: str = "1") -> Row:
    """A row that holds from zero up to a limit."""
    return Row(name, float(got), 0.0, limit, unit)


def at_least(name: str, got: float, limit: float, unit: str = "1") -> Row:
    """A row that holds from a limit on."""
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
    """A row for a number that a paper prints.

    Args:
        section: where it is printed.
        name: what it is.
        unit: of the values.
        printed: as printed.
        got: ours, with what the paper states and the rest assumed.
        decimals: printed ones.
        tolerance: left out, half a unit of the last printed digit.
        explained: computed once more with what is thought to make the difference.
        reason: why ours is not what is printed.
        other_data: whether the number was measured on patients or circuits that are not ours.
    """
    allowed = 0.5 * 10.0**-decimals if tolerance is None else tolerance
    evidence = () if explained is None else (within(name, printed, explained, allowed, unit),)
    row = within(name, printed, got, allowed, unit, explanation=Explanation(reason, evidence), source=section)
    return replace(row, decimals=max(decimals, 0), other_data=other_data)


def statement(
    section: str, sentence: str, holds: bool, reason: str = "", explained: bool | None = None
) -> Row:
    """A statement of a paper's text: whether it holds for ours."""
    result = None if explained is None else float(explained)
    return printed_number(section, sentence, YES_NO, 1.0, float(holds), explained=result, reason=reason)


@dataclass(frozen=True)
class Check:
    """Rows that answer one question.

    Args:
        key: short name.
        title: what is compared with what.
        bar: the tolerance in words.
        rows: the comparison.
        explained_pass: whether rows that miss and are explained do not count against the bar.
        required: whether missing the bar fails the validation. Measurements of patients and devices say how
            far the model can be trusted; they are compared and shown, and fail nothing.
        remarks: sentences to print below the table.
        seconds: time it took.
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
        """Whether the bar is reached."""
        failing = [row for row in self.missed if not (self.explained_pass and row.explained)]
        return bool(self.rows) and not failing


def worst(rows: Iterable[Row]) -> Row:
    """The row that takes the largest share of its tolerance."""
    return max(rows, key=lambda row: row.used)
