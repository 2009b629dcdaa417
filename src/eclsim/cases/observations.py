"""Grouping of single observations into rows of a cohort: values measured together form a data point.

LOINC and SNOMED CT codes are those of public FHIR profiles: HL7 vital signs; the intensive care module of the
German Medical Informatics Initiative for PCWP, CVP and the flow of extracorporeal gas exchange, which has no
LOINC code; HL7's value set of oxygen saturations for the arterial saturation, DICOM's context group 3524 for
the arterial partial pressures, and LOINC's own name for the mixed venous saturation. Pulse oximetry (59408-5)
is not read as a blood gas.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date, datetime, timedelta
from types import MappingProxyType

from eclsim.cases.cohort import COLUMNS, OPTIONAL
from eclsim.cases.sections import GRAMS_PER_MMOL, sections
from eclsim.inputs.mistakes import Remarks, shown
from eclsim.units import convert, known_unit, quantity_of, unit_in_words

LOINC, SNOMED = "http://loinc.org", "http://snomed.info/sct"


@dataclass(frozen=True, slots=True)
class Measurable:
    """A cohort column that clinical data may contain.

    Attributes:
        column: Name of the column.
        unit: Unit of the column.
        loinc: LOINC code; empty if there is none.
        snomed: SNOMED CT code; empty if there is none.
    """

    column: str
    unit: str
    loinc: str = ""
    snomed: str = ""


_CODES = {
    "heart_rate_bpm": ("8867-4", ""), "SP": ("8480-6", ""), "DP": ("8462-4", ""), "MAP": ("8478-0", ""),
    "MPAP": ("8414-5", ""), "PCWP": ("75994-4", ""), "CO": ("8741-1", ""), "PF": ("", "251288004"),
    "CVP": ("60985-9", "71420008"), "SaO2": ("2708-6", ""), "PaO2": ("2703-7", ""), "PaCO2": ("2019-8", ""),
    "SvO2": ("19224-5", ""), "haemoglobin_g_dl": ("718-7", ""), "height_cm": ("8302-2", ""),
    "weight_kg": ("29463-7", ""),
}  # fmt: skip
"""LOINC and SNOMED CT code of the columns that have one."""
PATIENT_COLUMNS = ("sex", "age_years")


def _measurables() -> Iterator[Measurable]:
    """Yield every column of a cohort that contains a number, besides the age."""
    for column, key in (COLUMNS | OPTIONAL).items():
        section, _, name = key.partition(".")
        field = sections()[section].fields()[name]
        if field.kind == "number" and column not in PATIENT_COLUMNS:
            yield Measurable(column, field.unit, *_CODES.get(column, ()))


MEASURABLES = tuple(_measurables())
"""Values that are read; those without a code are identified by the names of their columns."""
BY_CODE: MappingProxyType[str, Measurable] = MappingProxyType(
    {m.loinc: m for m in MEASURABLES if m.loinc}
    | {m.snomed: m for m in MEASURABLES if m.snomed}
    | {m.column: m for m in MEASURABLES}
)
_UCUM = {
    "mm[Hg]": "mmHg", "cm[H2O]": "cmH2O", "{beats}/min": "bpm", "{Beats}/min": "bpm", "/min": "bpm",
    "1/min": "bpm", "[lb_av]": "lb", "[in_i]": "in", "{rpm}": "rpm", "{rev}/min": "rpm", "m[H2O]": "",
    "l/min": "L/min", "Cel": "C", "[degF]": "°F", "[Ch]": "Fr",
}  # fmt: skip


class UnitError(ValueError):
    """A unit that is missing, unknown or of another quantity."""


def in_unit_of(value: float, unit: str, kind: Measurable) -> tuple[float, str]:
    """Convert a value to the unit of its column, and describe the conversion; empty without one.

    Raises:
        UnitError: The unit cannot be used; the message states what is allowed.
    """
    quantity = quantity_of(kind.unit)
    if not unit.strip():
        example = "1 or %" if kind.unit == "1" else kind.unit
        raise UnitError(f"no unit; {kind.column} needs one, such as {example}")
    if unit.strip() == kind.unit:
        return value, ""
    if quantity in ("rate", "speed") and unit.strip() in ("/min", "1/min"):
        return value, ""
    known = _known(unit)
    if known is None or quantity_of(known) != quantity:
        needed = unit_in_words(kind.unit)
        wrong = f"unit {unit!r} is not a unit of {quantity or kind.column}; {kind.column} is in {needed}"
        if kind.column == "haemoglobin_g_dl" and known == "mmol/L":
            wrong += f" (of the monomer, {value:g} mmol/L = {value * GRAMS_PER_MMOL:.3g} g/dL)"
        raise UnitError(wrong)
    if known == kind.unit:
        return value, ""
    converted = float(f"{convert(value, known, kind.unit):.6g}")
    return converted, " = ".join((_with_unit(value, known), _with_unit(converted, kind.unit)))


def _with_unit(value: float, unit: str) -> str:
    return f"{value:g}" if unit == "1" else f"{value:g} {unit}"


def are_different_units(one: str, other: str) -> bool:
    """Whether two spellings denote different units of one quantity, such as "mm[Hg]" and "kPa"."""
    known, also = _known(one), _known(other)
    same_quantity = known and also and quantity_of(known) == quantity_of(also)
    return bool(same_quantity) and known != also


def _known(unit: str) -> str | None:
    return known_unit(_UCUM.get(unit.strip(), unit))


# --- observations -----------------------------------------------------------------------------------


NOTHING_TO_FIT = "nothing that can be fitted"
SIZE_COLUMNS = ("height_cm", "weight_kg")
"""Columns measured once that apply to every data point of the patient."""


@dataclass(frozen=True, slots=True)
class Observation:
    """One value of one patient at one time, as written.

    Attributes:
        patient: Pseudonym.
        time: Time as written (ISO 8601).
        code: One of the codes in `BY_CODE`, or any other code, which is not read.
        value: The number.
        unit: Unit as written.
        place: Position for messages, such as "entry 7"; empty where `line` gives it.
        line: Line in a table; None outside a table.
    """

    patient: str
    time: str
    code: str
    value: float
    unit: str
    place: str = ""
    line: int | None = None


@dataclass(frozen=True, slots=True)
class About:
    """Data of a patient that apply to every data point.

    Attributes:
        cells: Cells by column.
        born: Date of birth, which gives the age at each data point; None if not known or if the age is a
            cell.
    """

    cells: dict[str, str] = field(default_factory=dict)
    born: date | None = None

    def cells_at(self, day: date) -> dict[str, str]:
        """Return the cells of a data point, with the age in completed years."""
        if self.born is None:
            return self.cells
        had_birthday = (day.month, day.day) >= (self.born.month, self.born.day)
        return {**self.cells, "age_years": str(day.year - self.born.year - (not had_birthday))}


@dataclass(slots=True)
class Imported(Remarks):
    """Rows of a cohort, with the remarks about their import.

    Attributes:
        rows: Cells by column of each data point, in order of patient and time.
    """

    rows: list[dict[str, str]] = field(default_factory=list)


def data_points(
    observations: Iterable[Observation], about: Mapping[str, About], within: timedelta, result: Imported
) -> None:
    """Group observations into rows.

    Args:
        observations: Observations in any order.
        about: Other data of each patient, by pseudonym.
        within: Observations of a patient up to this time after the first one of a data point belong to that
            point.
        result: Receives rows, errors, warnings and notes.
    """
    placed: dict[str, list[tuple[datetime, Observation, Measurable, float]]] = {}
    unread: dict[str, int] = {}
    for record in observations:
        kind = BY_CODE.get(record.code)
        if kind is None:
            unread[record.code] = unread.get(record.code, 0) + 1
            continue
        entry = _checked(record, kind, result)
        if entry is not None:
            placed.setdefault(record.patient, []).append((entry[0], record, kind, entry[1]))
    for code, count in unread.items():
        times = f"{count} times" if count > 1 else "once"
        result.warning("", f"code {shown(code)}, {times}: not read{_why_unread(code)}")
    for patient in sorted(placed):
        _rows_of(patient, placed[patient], about.get(patient, About()), within, result)
    if not result.rows and not result.mistakes:
        result.error("", NOTHING_TO_FIT, allowed=", ".join(BY_CODE))


def _why_unread(code: str) -> str:
    """Why a column of a cohort is not read, and what stands in its place; empty for any other code."""
    if code not in COLUMNS | OPTIONAL:
        return ""
    if code in ("patient_id", *PATIENT_COLUMNS):
        return ", as it is no measurement; it belongs to the patient"
    return ", as it is text; the cells have that of the base case, or are empty without one"


def _checked(record: Observation, kind: Measurable, result: Imported) -> tuple[datetime, float] | None:
    """Return the time and the converted value; None after recording an error."""
    key = f"{record.place} {kind.column}".strip()
    when = None
    try:
        when = datetime.fromisoformat(record.time.strip())
    except ValueError:
        wrong = "not a time in ISO 8601" if record.time.strip() else "no time"
        result.error(key, wrong, shown(record.time), "2024-03-01T08:00", line=record.line)
    if not math.isfinite(record.value):
        result.error(key, "not a finite number", f"{record.value}", line=record.line)
        return None
    try:
        value, converted = in_unit_of(record.value, record.unit, kind)
    except UnitError as error:
        result.error(key, str(error), f"{record.value:g}", line=record.line)
        return None
    if converted:
        result.note(f"{record.patient} {record.time} {kind.column}", converted, line=record.line)
    return (when, value) if when is not None else None


def _rows_of(
    patient: str,
    entries: Sequence[tuple[datetime, Observation, Measurable, float]],
    about: About,
    within: timedelta,
    result: Imported,
) -> None:
    with_zone = {when.tzinfo is not None: record.time.strip() for when, record, *_ in entries}
    if len(with_zone) > 1:
        both = f"{with_zone[True]} and {with_zone[False]}"
        message = "times with and without a time zone cannot be put in order"
        result.error(patient, message, both)
        return
    first: datetime | None = None
    row: dict[str, str] = {}
    rows: list[tuple[datetime, dict[str, str]]] = []
    spread = 0
    for when, record, kind, value in sorted(entries, key=lambda e: (e[0], e[2].column)):
        if first is None or when - first > within:
            first, time = when, record.time.strip()
            row = {"patient_id": patient, "measurement": time, **about.cells_at(when.date())}
            rows.append((first, row))
            if about.born is not None and when.date() < about.born:
                result.error(f"{patient} {time}", "before the patient's birth date: which date is right?")
        elif when > first:
            spread += 1
        text = f"{value:.10g}"
        if row.get(kind.column, text) != text and kind.column not in about.cells:
            both = f"{row[kind.column]} and {text} {kind.unit}"
            message = "two values of one data point: which one is right?"
            key = f"{patient} {row['measurement']} {kind.column}"
            result.error(key, message, both, line=record.line)
        row[kind.column] = text
    result.rows += _with_size(patient, rows, [*_HEAD, *PATIENT_COLUMNS], result)
    if spread:
        minutes = within.total_seconds() / 60.0
        values, belong = ("1 value", "belongs") if spread == 1 else (f"{spread} values", "belong")
        message = f"{values} up to {minutes:g} min after the first of a data point {belong} to it"
        result.note(patient, message)


_HEAD = ("patient_id", "measurement")


def _with_size(
    patient: str, rows: Sequence[tuple[datetime, dict[str, str]]], other: Sequence[str], result: Imported
) -> list[dict[str, str]]:
    """Add height and weight to data points: the last ones measured before each, else the first.

    Times at which only these were measured are not data points.
    """
    for name in SIZE_COLUMNS:
        known = [(when, row[name], row["measurement"]) for when, row in rows if name in row]
        for when, row in rows:
            if known and name not in row and not {*row} <= {*other, *SIZE_COLUMNS}:
                _, row[name], time = max((k for k in known if k[0] <= when), default=known[0])
                message = f"{row[name]}, measured {time}"
                result.note(f"{patient} {row['measurement']} {name}", message)
    measured = [row for _, row in rows if not {*row} <= {*other, *SIZE_COLUMNS}]
    return measured or [row for _, row in rows]
