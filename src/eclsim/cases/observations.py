"""From single observations to the rows of a cohort: what was measured together is a data point."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timedelta

from eclsim.cases.clinical_codes import BY_CODE, Measurable, UnitError, in_unit_of
from eclsim.inputs.mistakes import Mistake, shown

ABOUT = ("sex", "age_years")


@dataclass(frozen=True, slots=True)
class Observation:
    """One value of one patient at one time, as it was written.

    Attributes:
        patient: Pseudonym.
        time: When, as written (ISO 8601).
        code: One of the codes of `eclsim.cases.clinical_codes`, or a column's name.
        value: The number.
        unit: As written.
        place: What messages call it, such as "entry 7"; empty where `line` says it.
        line: Line in a table.
    """

    patient: str
    time: str
    code: str
    value: float
    unit: str
    place: str = ""
    line: int | None = None


@dataclass(slots=True)
class Imported:
    """Rows of a cohort, and everything there was to say.

    Attributes:
        rows: Cells by column of each data point, in order of patient and time.
        mistakes: What makes the import unusable.
        warnings: Doubts, and what was not read.
        notes: Conversions and groupings.
    """

    rows: list[dict[str, str]] = field(default_factory=list)
    mistakes: list[Mistake] = field(default_factory=list)
    warnings: list[Mistake] = field(default_factory=list)
    notes: list[Mistake] = field(default_factory=list)


def data_points(
    observations: Iterable[Observation],
    about: dict[str, dict[str, str]],
    within: timedelta,
    result: Imported,
) -> None:
    """Put observations into rows.

    Args:
        observations: In any order.
        about: What is known of each patient besides, by pseudonym: cells by column.
        within: Observations of a patient up to so long after the first of a data point belong to it.
        result: Gets rows, mistakes, warnings and notes.
    """
    placed: dict[str, list[tuple[datetime, Observation, Measurable, float]]] = {}
    unread: dict[str, int] = {}
    for seen in observations:
        what = BY_CODE.get(seen.code)
        if what is None:
            unread[seen.code] = unread.get(seen.code, 0) + 1
            continue
        entry = _checked(seen, what, result)
        if entry is not None:
            placed.setdefault(seen.patient, []).append((entry[0], seen, what, entry[1]))
    for code, count in unread.items():
        times = f"{count} times" if count > 1 else "once"
        result.warnings.append(Mistake("", f"code {shown(code)}, {times}: not read"))
    for patient in sorted(placed):
        _rows_of(patient, placed[patient], about.get(patient, {}), within, result)
    if not result.rows and not result.mistakes:
        result.mistakes.append(Mistake("", "nothing that can be fitted", allowed=", ".join(BY_CODE)))


def _checked(seen: Observation, what: Measurable, result: Imported) -> tuple[datetime, float] | None:
    """Time and converted value, or None with the reason kept."""
    key = f"{seen.place} {what.column}".strip()
    when, wrong = _time(seen.time)
    if wrong:
        result.mistakes.append(Mistake(key, wrong, shown(seen.time), "2024-03-01T08:00", line=seen.line))
    if not math.isfinite(seen.value):
        result.mistakes.append(Mistake(key, "no finite number", f"{seen.value}", line=seen.line))
        return None
    try:
        value, converted = in_unit_of(seen.value, seen.unit, what)
    except UnitError as error:
        result.mistakes.append(Mistake(key, str(error), f"{seen.value:g}", line=seen.line))
        return None
    if converted:
        result.notes.append(Mistake(f"{seen.patient} {seen.time} {what.column}", converted, line=seen.line))
    return (when, value) if when is not None else None


def _time(text: str) -> tuple[datetime | None, str]:
    try:
        when = datetime.fromisoformat(text.strip())
    except ValueError:
        return None, "no time in ISO 8601" if text.strip() else "no time"
    # Times without a zone are compared among themselves; a mixture has no order.
    return when, ""


def _rows_of(
    patient: str,
    entries: Sequence[tuple[datetime, Observation, Measurable, float]],
    about: dict[str, str],
    within: timedelta,
    result: Imported,
) -> None:
    if len({when.tzinfo is None for when, *_ in entries}) > 1:
        result.mistakes.append(Mistake(patient, "times with and without a zone: they have no order"))
        return
    first: datetime | None = None
    row: dict[str, str] = {}
    spread = 0
    for when, seen, what, value in sorted(entries, key=lambda e: (e[0], e[2].column)):
        if first is None or when - first > within:
            first, row = when, {"patient_id": patient, "measurement": seen.time.strip(), **about}
            result.rows.append(row)
        elif when > first:
            spread += 1
        text = f"{value:.10g}"
        if row.get(what.column, text) != text and what.column not in about:
            both = f"{row[what.column]} and {text} {what.unit}"
            message = "two values of one data point: which one is right?"
            result.mistakes.append(
                Mistake(f"{patient} {row['measurement']} {what.column}", message, both, line=seen.line)
            )
        row[what.column] = text
    if spread:
        minutes = within.total_seconds() / 60.0
        message = f"{spread} values up to {minutes:g} min after the first of a data point belong to it"
        result.notes.append(Mistake(patient, message))
