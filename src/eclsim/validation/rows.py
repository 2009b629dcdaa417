"""Rows of a comparison: what was expected, what came out, and whether it is within the bar."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Explanation:
    """Why a row misses, with what shows it. It counts only while all of its evidence holds.

    Args:
        text: the reason.
        evidence: rows that hold if the reason is the right one: what eclsim gives where the reason is taken
            away, or the very number that the reason was shown to account for.
    """

    text: str
    evidence: tuple[Row, ...]

    @property
    def holds(self) -> bool:
        """Whether there is evidence, and all of it holds."""
        return bool(self.evidence) and all(row.holds for row in self.evidence)


@dataclass(frozen=True)
class Row:
    """One number held against another.

    Args:
        name: what is compared.
        got: eclsim's number.
        low: smallest number that passes.
        high: largest number that passes.
        unit: unit of all of them.
        expected: the number compared with; None where only a limit or a range is given.
        explanation: why it misses, where that is known and shown; it stays a miss.
        source: where the expected number comes from.
    """

    name: str
    got: float
    low: float
    high: float
    unit: str = "1"
    expected: float | None = None
    explanation: Explanation | None = None
    source: str = ""

    @property
    def holds(self) -> bool:
        """Whether the number is within the bar; NaN is not."""
        return self.low <= self.got <= self.high

    @property
    def explained(self) -> str:
        """Why it misses; empty where it holds, and where the evidence for the reason no longer does."""
        if self.holds or self.explanation is None or not self.explanation.holds:
            return ""
        return self.explanation.text

    @property
    def percent(self) -> float | None:
        """Error in percent of the expected number."""
        if self.expected is None or self.expected == 0.0:
            return None
        return 100.0 * (self.got - self.expected) / abs(self.expected)

    @property
    def used(self) -> float:
        """Share of the tolerance that the error takes; 1 at the limit."""
        if not math.isfinite(self.got):
            return math.inf
        if self.expected is not None:
            room = self.high - self.expected if self.got >= self.expected else self.expected - self.low
            distance = abs(self.got - self.expected)
        elif self.low == 0.0 or math.isinf(self.high):
            room, distance = (self.high, self.got) if self.low == 0.0 else (self.got, self.low)
        else:
            middle = 0.5 * (self.low + self.high)
            room, distance = self.high - middle, abs(self.got - middle)
        return distance / room if room > 0.0 else (0.0 if distance == 0.0 else math.inf)


def near(
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
    def share(self) -> float:
        """Share of the rows that hold."""
        return 1.0 - len(self.missed) / len(self.rows) if self.rows else 0.0

    @property
    def holds(self) -> bool:
        """Whether the bar is reached."""
        failing = [row for row in self.missed if not (self.explained_pass and row.explained)]
        return bool(self.rows) and not failing


def worst(rows: Iterable[Row]) -> Row:
    """The row that takes the largest share of its tolerance."""
    return max(rows, key=lambda row: row.used)
