"""Common properties of all measurements in a series.

A patient has one set point for each reflex. If cases leave it open, the first measurement in the series gives
it, and the reflexes respond to changes from there. Parameters that are free are free at all times. Nothing is
learnt about a parameter at a time whose circuit does not use it, such as a shunt when no gases were measured.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import TYPE_CHECKING

from eclsim.arguments import WholeNumber, written
from eclsim.cases.cohort import mistakes_in_date, when
from eclsim.cases.quantities import with_values
from eclsim.identification.quantities import BOUNDS, OUTPUTS, possible_range, unit_of
from eclsim.identification.settings import (
    CLOTTED,
    MEASURED_AT_REST,
    CheckedFit,
    FitSettings,
    avoidable_assumptions,
    case_to_fit,
    checked_fit,
    measured_open_set_points,
    parameters_informed_by_gases,
    parameters_informed_by_pressures,
    remarks_on_assumptions,
    remarks_on_fixed_consumption,
    remarks_on_undetermined_output,
)
from eclsim.inputs.mistakes import CaseError, Mistake, shown
from eclsim.orbit.model import circuit_of
from eclsim.outputs.signals import parameters_read

if TYPE_CHECKING:
    from eclsim.cases.case import Case
    from eclsim.identification.points import TrackedPoint
    from eclsim.orbit.model import CaseSource

SECONDS_PER_HOUR = 3600.0
_TIME_IN_FILE_NAME = re.compile(r"(\d{4}-\d\d-\d\d)[T_ ](\d\d)[-.]?(\d\d)")
_CLOCK_TIME = re.compile(r"([01]?\d|2[0-3]):([0-5]\d)(?::([0-5]\d))?")

Points = Sequence[tuple[str, "Case"]]
"""Names and cases of the measurements in order."""
FEWEST_EQUAL_VALUES = 3
"""Fewer measurements than this may be identical to the last digit by chance."""


@dataclass
class Series:
    """Properties of a series, according to the cases read so far.

    Args:
        settings: settings of the fit, with free parameters and bounds.
        set_points: values of the set points that the cases leave open.
        read: parameters that the circuit of at least one case uses.
        limits: start value, lower and upper bound of each free parameter, from the first case that uses it.
        measured: outputs that were measured at any time.
        notes: notes on the set points.
    """

    settings: FitSettings
    set_points: dict[str, float] = field(default_factory=dict)
    read: set[str] = field(default_factory=set)
    limits: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    measured: set[str] = field(default_factory=set)
    notes: list[str] = field(default_factory=list)

    def learn(self, name: str, case: Case) -> None:
        """Add what a case tells about the series; `name` is that of the measurement."""
        for key, value in measured_open_set_points(case).items():
            if key not in self.set_points:
                self.set_points[key] = value
                source = f"the {MEASURED_AT_REST[key]} of {name} ({shown(value)})"
                message = (
                    f"left open, so {source} is used: reflexes are inactive there and respond to changes"
                )
                self.notes.append(str(Mistake(key, message)))
        here = self._read_by(case)
        self.read |= here
        checked = self.checked(case)[1]
        self.measured |= checked.targets.keys()
        for parameter, limits in checked.free.items():
            if parameter in here:
                self.limits.setdefault(parameter, limits)

    def checked(self, case: Case) -> tuple[Case, CheckedFit]:
        """Return a case with the set points of the series, and what can be fitted to it."""
        points = {key: v for key, v in self.set_points.items() if key in case.open_set_points}
        case = with_values(case, points)
        absent = (self.read & {*self.settings.names}) - self._read_by(case)
        row = replace(
            self.settings,
            parameters=tuple(n for n in self.settings.parameters if n not in absent),
            bounds={n: limits for n, limits in self.settings.bounds.items() if n not in absent},
        )
        checked = checked_fit(case, row)
        if absent:
            checked.mistakes = [mistake for mistake in checked.mistakes if mistake.key != "parameters"]
        return case_to_fit(case, row), checked

    def free(self) -> dict[str, tuple[float, float, float]]:
        """Start value, lower and upper bound of each free parameter."""
        return {name: self.limits[name] for name in self.settings.names if name in self.limits}

    def doubts(self, case: Case, checked: CheckedFit) -> tuple[str, ...]:
        """Doubts about the estimate from a case: unknown values that are held, and set points still open."""
        still_open = [str(w) for w in checked.warnings if w.key in case.open_set_points]
        free = self.settings.names
        held = (
            *avoidable_assumptions(case, checked.targets, free),
            *remarks_on_fixed_consumption(case, checked.targets, free),
            *remarks_on_undetermined_output(case, checked.targets, self.measured, free),
        )
        return (*held, *still_open)

    def remarks(self, case: Case) -> list[str]:
        """Remarks on values that are assumed at all times; `case` is one of the series."""
        return [*self.notes, *remarks_on_assumptions(case, self.measured, self.settings.names).values()]

    def _read_by(self, case: Case) -> set[str]:
        return {*parameters_read(circuit_of(case_to_fit(case, self.settings)))}


def named_cases(points: Sequence[tuple[str, CaseSource]]) -> Sequence[tuple[str, CaseSource]]:
    """Check and return the points as names with their cases.

    Raises:
        CaseError: There are no points, two have the same name, or the argument is something else, such as the
            path of a table.
    """
    allowed = 'a list of names with cases, such as [("2024-03-01T08:00", case), ...]; tables: eclsim track'
    listed = isinstance(points, Sequence) and not isinstance(points, str)
    for one in points if listed else [points]:
        if not (isinstance(one, (tuple, list)) and len(one) == 2 and isinstance(one[0], str)):
            pair = isinstance(one, (tuple, list)) and len(one) == 2
            wrong, what = (one[0], "a name") if pair else (one, "a pair of name and case")
            raise CaseError([Mistake("points", f"{written(wrong)} is not {what}", allowed=allowed)])
    if not points:
        raise CaseError([Mistake("points", "nothing to follow", allowed="one measurement or more")])
    if repeated := {name: count for name, count in Counter(name for name, _ in points).items() if count > 1}:
        raise CaseError([
            Mistake("points", f"the name of {count} measurements", shown(name), "a name of its own for each")
            for name, count in repeated.items()
        ])  # fmt: skip
    return points


def passed_over(left_out: Sequence[int], points: int) -> list[int]:
    """Check and return the numbers of measurements that are missing before each point.

    Raises:
        ValueError: There is not one whole number for each point.
    """
    lost = [WholeNumber()("left_out", one) for one in left_out] or [0] * points
    if len(lost) != points:
        raise ValueError(f"left_out: {len(lost)} numbers for {points} points; allowed: one for each")
    return lost


def series_of(settings: FitSettings, points: Iterable[tuple[str, Case]]) -> Series:
    """Return the common properties of a series, from name and case of each measurement in order."""
    series = Series(settings)
    for name, case in points:
        series.learn(name, case)
    return series


def series_parameters(points: Points, usual: Sequence[str]) -> tuple[str, ...]:
    """Parameters to follow: the usual ones, and those on which any gas or pressure measurement informs.

    A fit leaves out parameters that it cannot determine; here these are free, too, with wide intervals.
    """
    kinds = (parameters_informed_by_gases, parameters_informed_by_pressures)
    informed = (key for informed_by in kinds for _, case in points for key in informed_by(case))
    return tuple(dict.fromkeys((*informed, *usual)))


def falling_clotting(before: TrackedPoint, now: TrackedPoint) -> str:
    """A warning if the clotted share of an oxygenator has fallen by more than its uncertainty, else empty."""
    old, new = before.parameters.get(CLOTTED), now.parameters.get(CLOTTED)
    if old is None or new is None or not (new.median < old.lower and new.upper < old.median):
        return ""
    was, is_now = (f"{i.median:.2f} ({i.lower:.2f} to {i.upper:.2f})" for i in (old, new))
    return (
        f"the clotted share of the oxygenator fell from {was} to {is_now}: clots in an oxygenator do not "
        "clear by themselves; it was exchanged, or a gas measured behind it is wrong, now or before"
    )


def copied_measurements(before: TrackedPoint, now: TrackedPoint) -> str:
    """A warning if all measured values are identical to the last ones, else empty."""
    old, new = ({n: i.measured for n, i in point.innovations.items()} for point in (before, now))
    if len(new) < FEWEST_EQUAL_VALUES or old != new:
        return ""
    return (
        f"all {len(new)} measurements are the same as in {before.name}: if copied forward, they count twice "
        "and the intervals are too narrow; leave the row out"
    )


def notes_on_bounds(points: Iterable[TrackedPoint]) -> list[str]:
    """Return a note that names the outputs whose intervals end at a bound; empty if there are none."""
    ends = {
        (name, end)
        for point in points
        for intervals in (point.forecast, point.expected, point.outputs)
        for name, interval in intervals.items()
        for end in {interval.lower, interval.upper} & {*possible_range(name)}
    }
    listed = [
        f"{name} at {end:g} {unit_of(name)}" for name in OUTPUTS for end in BOUNDS if (name, end) in ends
    ]
    return [f"intervals are cut where no further values exist: {', '.join(listed)}"] if listed else []


def elapsed_hours(names: Sequence[str]) -> list[float | None] | None:
    """Hours from each measurement to the next, or None if the names are no times.

    Args:
        names: names of the measurements in order, such as 2024-03-01T08:00, in file names 2024-03-01T08-00,
            or clock times of one day, such as 08:00 and 12:00.

    Returns:
        None for the first measurement and hours for every other; None instead of the list if a name is no
        time, if only some have a time zone, or if clock times do not increase.

    Raises:
        CaseError: A date or time does not exist, or a time is not later than the one before it; the same
            time again would count twice.
    """
    labels = [_TIME_IN_FILE_NAME.sub(r"\1T\2:\3", name) for name in names]
    if impossible := [mistake for label in labels for mistake in mistakes_in_date(label)]:
        raise CaseError(impossible)
    known = [t for t in map(when, labels) if t is not None]
    if len(known) < len(names) or len({t.tzinfo is None for t in known}) > 1:
        return _hours_of_one_day(names)
    hours = [(later - earlier).total_seconds() / SECONDS_PER_HOUR for earlier, later in pairwise(known)]
    wrong = [
        Mistake(
            "measurement",
            f"{'earlier than' if passed else 'the same time as'} {shown(names[k])}, which comes before it",
            shown(names[k + 1]), "measurements in order of time, one for each",
        )
        for k, passed in enumerate(hours)
        if passed <= 0.0
    ]  # fmt: skip
    if wrong:
        raise CaseError(wrong)
    return [None, *hours]


def notes_on_time(names: Sequence[str], interval: float, left_out: Iterable[int] = ()) -> list[str]:
    """Notes on the time between measurements where their names do not give it in full.

    Args:
        names: names of the measurements in order.
        interval: time between measurements that is assumed where names are no times [h].
        left_out: number of missing measurements before each point.

    Raises:
        CaseError: As for `elapsed_hours`.
    """
    hours = elapsed_hours(names)
    if len(names) < 2:
        return []
    if hours is None:
        notes = [
            "not all names of the measurements are times such as 2024-03-01T08:00 (all with a time zone or "
            f"all without): {interval:g} h from one to the next are assumed (interval)"
        ]
        if lost := sum(left_out):
            notes.append(f"measurements left out: {lost}; each still counts as {interval:g} h of time")
        return notes
    if _hours_of_one_day(names) is not None:
        return [f"the names are clock times and taken as those of one day: {names[0]} to {names[-1]}"]
    return []


def _hours_of_one_day(names: Sequence[str]) -> list[float | None] | None:
    """Hours between clock times of one day; None for other names, and where the day is not the same."""
    clock = [_CLOCK_TIME.fullmatch(name.strip()) for name in names]
    if not all(clock):
        return None
    hours = [int(t[1]) + int(t[2]) / 60.0 + int(t[3] or 0) / SECONDS_PER_HOUR for t in clock if t]
    between = [later - earlier for earlier, later in pairwise(hours)]
    return [None, *between] if min(between, default=1.0) > 0.0 else None
