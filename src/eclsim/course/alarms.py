"""Limits that a course violates, each with its start and end."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from eclsim.course.timeline import BEFORE_S, MINUTE
from eclsim.devices.description import CAUTION, GRAVEST_FIRST, Finding, labelled_sentence
from eclsim.files import finite
from eclsim.outputs.alarms import KINDS, breach
from eclsim.outputs.limits import COURSE_LIMITS, consecutive_runs, group_of
from eclsim.outputs.registry import find_output
from eclsim.slow import DerivedQuantity

LimitKey = tuple[str, str, str]
"""Key of a limit: kind, output or waveform, and the sentence without its numbers."""
FindingsByMoment = dict[int, "Finding"]
"""The findings for one limit, by index of the moment at which it is violated."""
NUMBER = re.compile(r"[-+]?\d+(\.\d+)?")
"""Numbers are removed before sentences are compared, since a limit's value may change between moments."""

ARREST_MMHG, ARREST_MIN = 30.0, 10.0
"""Mean arterial pressure and time below it after which a course describes no living patient (convention)."""
NO_PATIENT = "that no patient can have (a chamber without blood, a vein sucked shut, not survived)"
"""Description of the moments of a course whose numbers are to be ignored."""


class Alarm(NamedTuple):
    """A limit that is violated for some time.

    Attributes:
        at_min: start [min]: the crossing of the limit between two moments, or the start of a beat.
        until_min: end [min], or the first moment at which the quantity is not determined; None if the limit
            is still violated at the end of the course.
        kind: "collapse", "alarm", "warning" or "caution".
        quantity: the output or waveform.
        limit: limit that is violated; None if there is none.
        worst: the value farthest beyond it.
        sentence: description with the time.
    """

    at_min: float
    until_min: float | None
    kind: str
    quantity: str
    limit: float | None
    worst: float
    sentence: str

    @property
    def labelled(self) -> str:
        """The sentence after the label of its kind."""
        return labelled_sentence(self.kind, self.sentence)


def alarms_text(broken: Sequence[Alarm]) -> str:
    """Alarms as JSON without NaN, as in the attribute `alarms` of a course."""
    return json.dumps(finite([alarm._asdict() for alarm in broken]), allow_nan=False)


def clock_time(minute: float, seconds: bool = False) -> str:
    """Hours and minutes from the start, such as 03:12, or 03:12:45 with seconds."""
    minutes = int(np.floor(minute + 1e-6))
    end = f":{int(60.0 * (minute - minutes) + 1e-4):02d}" if seconds else ""
    return f"{minutes // 60:02d}:{minutes % 60:02d}{end}"


def alarms(
    findings: Sequence[Sequence[Finding]],
    outputs: Mapping[str, np.ndarray],
    minute: np.ndarray,
    by_beat: np.ndarray | None = None,
    shown: Sequence[DerivedQuantity] = (),
) -> list[Alarm]:
    """Alarms of one patient, sorted by severity and then by time.

    Args:
        findings: findings at each moment.
        outputs: outputs by name, at each moment.
        minute: time of each moment [min].
        by_beat: whether each moment is a beat of a consecutive series, whose alarms are given to the second.
        shown: derived quantities that are no outputs, with their names in words and units.
    """
    named = {quantity.name: (quantity.description, quantity.unit) for quantity in shown}
    by_beat = np.zeros(len(minute), dtype=bool) if by_beat is None else by_beat
    by_limit: dict[LimitKey, FindingsByMoment] = {}
    for k, of_moment in enumerate(findings):
        for finding in of_moment:
            wording = NUMBER.sub("", finding.sentence) if finding.kind in GRAVEST_FIRST else ""
            by_limit.setdefault((finding.kind, finding.quantity, wording), {})[k] = finding
    candidates = []
    for broken in _with_equivalent_breaches(by_limit, outputs):
        values = outputs.get(next(iter(broken.values())).quantity)
        candidates += [
            _alarm(run, broken, minute, values, by_beat, named) for run in consecutive_runs(sorted(broken))
        ]
    candidates.sort(key=lambda alarm: (KINDS.index(alarm.kind), alarm.at_min))
    return [
        alarm
        for k, alarm in enumerate(candidates)
        if not any(
            _makes_redundant(one, alarm) and (j < k or not _makes_redundant(alarm, one))
            for j, one in enumerate(candidates)
        )
    ]


def not_survived(minute: np.ndarray, outputs: Mapping[str, np.ndarray]) -> list[Alarm]:
    """Alarm on the first time without a circulation that lasts too long to survive; empty if none does.

    It has no limit, as a pressure alone does not break it, and no end, as a later pressure does not help.

    Args:
        minute: time of each moment [min].
        outputs: outputs by name, at each moment.
    """
    pressure = outputs.get("MAP")
    below = [] if pressure is None else np.flatnonzero(np.asarray(pressure) < ARREST_MMHG).tolist()
    for run in consecutive_runs(below):
        if minute[run[-1]] - minute[run[0]] >= ARREST_MIN:
            begin = clock_time(minute[run[0]])
            text = (
                f"mean arterial pressure below {ARREST_MMHG:g} mmHg from {begin} for more than "
                f"{ARREST_MIN:g} min: a circulatory arrest that the brain does not survive; nothing after it "
                "describes a patient, even if pressure returns (a convention of this project)"
            )
            worst = float(np.min(np.asarray(pressure)[run]))
            return [Alarm(float(minute[run[0]]), None, "collapse", "MAP", None, worst, text)]
    return []


def is_not_survived(alarm: Alarm) -> bool:
    """Whether an alarm is that of `not_survived`."""
    return alarm.kind == "collapse" and alarm.quantity == "MAP" and alarm.limit is None


def after_arrest(broken: Sequence[Alarm], minute: np.ndarray) -> np.ndarray:
    """Whether each moment comes after an arrest that is not survived."""
    ends = [alarm.at_min + ARREST_MIN for alarm in broken if is_not_survived(alarm)]
    return minute >= min(ends, default=np.inf)


def finding_after_arrest(alarms: str, minute: float, pressure: float) -> list[Finding]:
    """The finding about a beat of a course that comes after an arrest that is not survived, or none.

    Args:
        alarms: alarms of the course as JSON, as in its attribute.
        minute: time of the beat [min].
        pressure: its mean arterial pressure [mmHg].
    """
    broken = [alarm for one in json.loads(alarms) if is_not_survived(alarm := Alarm(**one))]
    if not after_arrest(broken, np.array([minute])).any():
        return []
    return [Finding.without_limit("collapse", "MAP", pressure, broken[0].sentence, "MAP")]


def findings_of_derived_quantities(shown: Sequence[DerivedQuantity], moments: int) -> list[list[Finding]]:
    """Limits that derived quantities violate at each moment; only the most severe one of each quantity.

    Args:
        shown: quantities with their values at the moments.
        moments: number of moments.
    """
    result: list[list[Finding]] = [[] for _ in range(moments)]
    for quantity in shown:
        limits = [limit for limit in COURSE_LIMITS if limit.quantity == quantity.name]
        limits.sort(key=lambda limit: GRAVEST_FIRST.index(limit.kind))
        for k, value in enumerate(quantity.values):
            limit = next((limit for limit in limits if limit.broken_by(float(value))), None)
            if limit is not None:
                result[k].append(breach(limit, float(value), quantity.description, quantity.unit))
    return result


def _with_equivalent_breaches(
    by_limit: Mapping[LimitKey, FindingsByMoment], outputs: Mapping[str, np.ndarray]
) -> list[FindingsByMoment]:
    """Moments at which each limit is violated, also where the findings name an equivalent output instead."""
    groups: dict[str, set[int]] = {}
    for (kind, quantity, _), broken in by_limit.items():
        if kind in GRAVEST_FIRST:
            groups.setdefault(group_of(quantity), set()).update(broken)
    result = []
    for (kind, quantity, _), broken in by_limit.items():
        values, first = outputs.get(quantity), next(iter(broken.values()))
        limit = first.limit if all(f.limit == first.limit for f in broken.values()) else None
        if kind in GRAVEST_FIRST and values is not None and limit is not None:
            beyond = np.sign(first.value - limit) * (values - limit) > 0.0
            hidden = [k for k in groups[group_of(quantity)] if beyond[k] and k not in broken]
            broken = broken | {k: replace(first, value=float(values[k])) for k in hidden}
        result.append(broken)
    return result


def _makes_redundant(one: Alarm, other: Alarm) -> bool:
    """Whether an alarm makes another redundant: as severe and as long, for an equivalent output."""
    if CAUTION in (one.kind, other.kind) or one is other or one.limit is None or other.limit is None:
        return False
    gravity = KINDS.index(other.kind) - KINDS.index(one.kind)
    ends = [np.inf if alarm.until_min is None else alarm.until_min for alarm in (one, other)]
    sides = np.sign((one.worst - one.limit, other.worst - other.limit))
    return (
        group_of(one.quantity) == group_of(other.quantity)
        and sides[0] == sides[1]
        and (gravity > 0 or (gravity == 0 and one.limit == other.limit))
        and one.at_min <= other.at_min
        and ends[0] >= ends[1]
    )


def _alarm(
    run: list[int],
    broken: dict[int, Finding],
    minute: np.ndarray,
    values: np.ndarray | None,
    by_beat: np.ndarray,
    named: Mapping[str, tuple[str, str]],
) -> Alarm:
    first, begun, over = broken[run[0]], run[0], run[-1] + 1
    limit = np.nan if first.limit is None else first.limit

    def crossing(place: int) -> float:
        means = None if by_beat[place] else values  # of a beat, which begins at this minute
        return _crossing(place - 1, place, limit, minute, means)

    at, until = crossing(begun), None if over >= len(minute) else crossing(over)
    worst = max((broken[k].value for k in run), key=lambda value: abs(value - limit))
    begin = clock_time(at, by_beat[begun])
    end = "" if until is None else clock_time(until, by_beat[over] or by_beat[over - 1])
    if until is not None and begin == end:
        begin, end = clock_time(at, True), clock_time(until, True)
    lost = until is not None and values is not None and bool(np.isnan(values[over]))
    sentence = _sentence(first, begin, end, worst, named, lost)
    return Alarm(at, until, first.kind, first.quantity, first.limit, worst, sentence)


def _crossing(left: int, right: int, limit: float, minute: np.ndarray, values: np.ndarray | None) -> float:
    """Time when an output crosses its limit between two moments; the event's time if the change is sudden."""
    if left < 0:
        return float(minute[0])
    sudden = minute[right] - minute[left] < 1.001 * BEFORE_S / MINUTE
    if values is None or sudden or not (values[left] - limit) * (values[right] - limit) < 0.0:
        return float(minute[right])
    share = (limit - values[left]) / (values[right] - values[left])
    return float(minute[left] + share * (minute[right] - minute[left]))


def _sentence(
    finding: Finding,
    begin: str,
    end: str,
    worst: float,
    named: Mapping[str, tuple[str, str]],
    lost: bool = False,
) -> str:
    """Sentence: "drainage pressure below -100 mmHg at 03:12, until 05:00 (-112 mmHg at worst): ...".

    If the quantity is `lost` at the end, it is not determined from then on.
    """
    until = f", not determined from {end} on" if lost else f", until {end}"
    when = f"at {begin}" + (until if end else "")
    entry = find_output(finding.quantity)
    words = named.get(finding.quantity) or (entry and (entry.long_name, entry.unit))
    limit = finding.limit if finding.kind in GRAVEST_FIRST else None
    if words is None or limit is None or f" {limit:g}" not in finding.sentence:
        return f"{when}: {finding.sentence}{_at_worst(finding, worst)}"
    long_name, unit = words
    side, unit = "below" if worst < limit else "above", "" if unit == "1" else f" {unit}"
    meaning = finding.sentence.partition(": ")[2]
    return f"{long_name} {side} {limit:g}{unit} {when} ({worst:.4g}{unit} at worst): {meaning}"


def _at_worst(finding: Finding, worst: float) -> str:
    """Worst value after the number that a sentence gives for its first moment; empty if it is the same."""
    if not (np.isfinite(worst) and np.isfinite(finding.value)) or finding.kind not in GRAVEST_FIRST:
        return ""
    stayed = abs(worst - finding.value) <= 0.05 * max(abs(worst), abs(finding.value))
    return "" if stayed else f" ({worst:.4g} at worst)"
