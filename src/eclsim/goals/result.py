"""Result of a search for settings, as data and in sentences."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import NamedTuple

from eclsim.goals.goal import Goal, Setting
from eclsim.outputs.alarms import Finding, sentences
from eclsim.outputs.registry import output

ALARM_KINDS = ("alarm", "collapse")
"""Kinds of findings that the message names first."""


NARROW_SHARE = 0.5
"""Closed share of a line from which it is named before settings: its resistance is four times that of an
open one."""


class ReachStatus(StrEnum):
    """How a search for settings ended."""

    REACHED = "reached"
    NOT_REACHED = "not_reached"
    NOT_CONVERGED = "not_converged"
    NO_STEADY_BEAT = "no_steady_beat"
    NO_STEADY_GASES = "no_steady_gases"


class GoalResult(NamedTuple):
    """One goal and the output at the settings found.

    Attributes:
        goal: goal that was requested.
        value: value of the output, in its unit.
        met: whether the goal is reached.
        binding: whether the output is at its bound or misses it, which prevents smaller settings.
        slopes: d output / d setting in the units of both, by setting.
    """

    goal: Goal
    value: float
    met: bool
    binding: bool
    slopes: Mapping[str, float]

    @property
    def sentence(self) -> str:
        """Description of the missed bound."""
        unit = output(self.goal.output).unit
        if math.isnan(self.value):
            return f"{self.goal.output} has no value there"
        return f"{_goal_with_reason(self.goal)} is not kept there: {self.value:.4g} {unit}"

    def as_object(self) -> dict[str, object]:
        """Plain data for JSON."""
        goal = self.goal
        return {
            "goal": str(goal), "output": goal.output, "low": goal.low, "high": goal.high,
            "value": self.value, "met": self.met, "binding": self.binding, "slopes": dict(self.slopes),
        }  # fmt: skip


@dataclass(frozen=True)
class Reached:
    """Result of `reach`.

    Args:
        id: id of the case.
        settings: settings that were varied, with their ranges.
        values: value of each setting, in its unit; NaN if no steady beat was found at all.
        goals: goals with the outputs at these settings.
        stops: bounds that were not requested but stopped the search, since no patient can be beyond them.
        status: how the search ended; without convergence, the settings are not the smallest.
        message: result in words; if a goal is not reached, with the reason.
        without: for each conflicting goal, the settings that reach all others (None if there are none); a
            goal whose own search did not converge is left out.
        outputs: all outputs of the beat by name.
        findings: limits that the beat violates, and cautions about its numbers.
        beats: number of beats solved in the search.
        not_kept: bounds of flows and gases that were not requested, that no varied setting keeps, and that
            are violated.
        tried: number of points throughout the ranges that were tried first.
        without_beat: number of these points without a determined steady beat.
        doubts: doubts about the fit that gave the parameters, if it is not good.
        kept: outputs that were kept within limits although no goal was stated for them, one goal for each:
            arterial PCO2 and pH, where sweep or ventilation may change.
    """

    id: str
    settings: tuple[Setting, ...]
    values: tuple[float, ...]
    goals: tuple[GoalResult, ...]
    status: ReachStatus
    message: str
    stops: tuple[GoalResult, ...] = ()
    without: Mapping[str, Mapping[str, float] | None] = field(default_factory=dict)
    outputs: Mapping[str, float] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    beats: int = 0
    not_kept: tuple[GoalResult, ...] = ()
    tried: int = 0
    without_beat: int = 0
    doubts: tuple[str, ...] = ()
    kept: tuple[GoalResult, ...] = ()

    def __repr__(self) -> str:
        return f"<Reached {self.id}: {self.message}>"

    @property
    def warnings(self) -> tuple[str, ...]:
        """Doubts about the parameters, and findings about the beat."""
        return (*self.doubts, *sentences(self.findings))

    @property
    def reached(self) -> bool:
        """Whether these are the smallest settings that reach all goals."""
        return self.status is ReachStatus.REACHED

    def as_object(self) -> dict[str, object]:
        """Plain data for JSON."""
        return {
            "id": self.id,
            "reached": self.reached,
            "status": self.status.value,
            "message": self.message,
            "settings": [
                {"name": s.name, "value": v, "unit": s.unit, "low": s.low, "high": s.high}
                for s, v in zip(self.settings, self.values, strict=True)
            ],
            "goals": [g.as_object() for g in self.goals],
            "stops": [{**g.as_object(), "because": g.goal.because} for g in self.stops],
            "not_kept": [{**g.as_object(), "because": g.goal.because} for g in self.not_kept],
            "kept": [g.as_object() for g in self.kept],
            "without": {goal: None if at is None else dict(at) for goal, at in self.without.items()},
            "outputs": dict(self.outputs),
            "warnings": list(self.warnings),
            "beats": self.beats,
            "tried": self.tried,
            "without_beat": self.without_beat,
        }  # fmt: skip


def led_by_narrow_lines(result: Reached, lines: Iterable[tuple[float, str]]) -> Reached:
    """The result whose message begins with nearly closed lines; it ends with others where a goal is missed.

    Args:
        result: result of the search.
        lines: closed share of the most narrowed line of each device, and which line that is in words.
    """
    first: list[str] = []
    last: list[str] = []
    for closed, text in lines:
        if closed >= NARROW_SHARE:
            first.append(text)
        elif closed > 0.0 and not result.reached:
            last.append(text)
    message = "; ".join((result.message, *last))
    if first:
        opened = "open it first" if len(first) == 1 else "open them first"
        message = f"{' and '.join(first)}: {opened}; as it is, {message}"
    return replace(result, message=message)


def broken_goals(outputs: Mapping[str, float], goals: Iterable[Goal]) -> Iterator[GoalResult]:
    """The goals that outputs miss or whose output has no value."""
    for goal in goals:
        value = outputs.get(goal.output, math.nan)
        if not goal.is_met(value):
            yield GoalResult(goal, value, met=False, binding=False, slopes={})


def gravest(missed: Iterable[GoalResult]) -> list[GoalResult]:
    """Missed goals without the later ones on the same side of an output: of alarm and warning, the alarm."""
    first: dict[tuple[str, bool], GoalResult] = {}
    for result in missed:
        first.setdefault((result.goal.output, result.value > result.goal.high), result)
    return list(first.values())


def kept_by_default(results: Iterable[GoalResult], names: Iterable[str]) -> tuple[GoalResult, ...]:
    """Bounds of outputs for which no goal was stated, joined to one goal for each output."""
    results, joined = [result for result in results if result.goal.because], []
    for name in names:
        own = [result for result in results if result.goal.output == name]
        if own:
            low, high = max(one.goal.low for one in own), min(one.goal.high for one in own)
            goal = Goal(name, low, high, because="kept by default", gives_way=True)
            met, binding = all(one.met for one in own), any(one.binding for one in own)
            joined.append(GoalResult(goal, own[0].value, met, binding, own[0].slopes))
    return tuple(joined)


def scan_gaps_text(tried: int, without_beat: int) -> str:
    """Number of points of the scan without a determined steady beat, as text; empty if there are none."""
    if not without_beat:
        return ""
    where = f"{without_beat} of the {tried} points tried first over the ranges"
    return f"; {where} had no steady beat that is determined"


def _with_unit(value: float, unit: str) -> str:
    """A number as text, with its unit if it has one."""
    return f"{value:.4g}" + (f" {unit}" if unit not in ("", "1") else "")


def message_of(
    settings: Sequence[Setting],
    values: Mapping[str, float],
    results: Sequence[GoalResult],
    without: Mapping[str, Mapping[str, float] | None],
    unfinished: str,
) -> str:
    """The result in sentences."""
    where = " and ".join(f"{s.name} = {_with_unit(values[s.name], s.unit)}" for s in settings)
    if unfinished:
        unmet = ", ".join(str(result.goal) for result in results if not result.met)
        goals = f"not reached: {unmet}" if unmet else "all goals are reached"
        return f"not converged ({unfinished}): {goals} with {where}; smaller or better settings may exist"
    if all(result.met for result in results):
        return f"all goals are reached with {where}{_binding_goals_text(settings, values, results)}"
    text = _unmet_text(gravest(result for result in results if not result.met))
    asked = sum(not result.goal.because for result in results)
    text += f" within the other goals, with {where}" if asked > 1 else f", with {where}"
    ends = [_at_end(s, values[s.name]) for s in settings]
    if any(ends):
        text += f" ({', '.join(filter(None, ends))})"
    held = [_goal_with_reason(r.goal) for r in results if r.goal.because and r.binding and r.met]
    if held:
        text += f"; it is limited by {' and '.join(held)}"
    for goal, others in without.items():
        if others is not None:
            numbers = " and ".join(f"{name} = {value:.4g}" for name, value in others.items())
            text += f"; without the goal {goal} all others are reached, with {numbers}"
    return text


def _unmet_text(unmet: Sequence[GoalResult]) -> str:
    """Goals that are missed, with the values found; of several, only the sum of the misses is smallest."""
    goals = [_goal_with_reason(result.goal) for result in unmet]
    found = [_with_unit(result.value, output(result.goal.output).unit) for result in unmet]
    if len(unmet) == 1:
        return f"{goals[0]} is not reached: the best is {found[0]}"
    return (
        f"{' and '.join(goals)} are not reached: the sum of their misses, each in hundredths of its bound, "
        f"is smallest at {' and '.join(found)} (either alone may come closer)"
    )


def _binding_goals_text(
    settings: Sequence[Setting], values: Mapping[str, float], results: Sequence[GoalResult]
) -> str:
    """Reasons why settings are not smaller: goals that smaller ones break, then others at their bounds."""
    at_bound = [result for result in results if result.binding]
    free = [s.name for s in settings if values[s.name] > s.low + 1e-6 * (s.high - s.low)]
    broken = [result for result in at_bound if any(_breaks_below(result, name) for name in free)]
    kept = [_goal_with_reason(result.goal) for result in at_bound if broken and result not in broken]
    stops = " and ".join(_goal_with_reason(result.goal) for result in broken or at_bound)
    if not stops:
        return ", the lowest of the range"
    also = f"; {' and '.join(kept)} {'are' if len(kept) > 1 else 'is'} at the bound too" if kept else ""
    return f"; smaller settings would break {stops}{also}"


def _breaks_below(result: GoalResult, setting: str) -> bool:
    """Whether a goal at its bound is missed if a setting is smaller."""
    at_low = abs(result.value - result.goal.low) < abs(result.value - result.goal.high)
    return result.slopes[setting] > 0.0 if at_low else result.slopes[setting] < 0.0


def broken_alarms_text(quantities: Iterable[str], where: str, goals: Mapping[str, bool]) -> str:
    """Sentence on outputs beyond alarm limits; empty if there are none.

    Outputs whose goal is missed are left out, since the answer says so already.

    Args:
        quantities: outputs or waveforms whose alarm limits are violated.
        where: when this is so, in words.
        goals: outputs with a goal that was asked for, and whether it is met.
    """
    alarming = list(dict.fromkeys(name for name in quantities if goals.get(name, True)))
    without, allowed = ([name for name in alarming if (name in goals) == known] for known in (False, True))
    text = ""
    for names, (one, several) in (
        (without, (": add a goal for it", ": add a goal for them")),
        (allowed, (", which its goal allows", ", which their goals allow")),
    ):
        if names:
            are, end = ("are", several) if len(names) > 1 else ("is", one)
            text += f"; {where} {', '.join(names)} {are} beyond alarm limits{end}"
    return text


def _goal_with_reason(goal: Goal) -> str:
    """A goal as text, with the reason if it was not requested."""
    return f"{goal} ({goal.because})" if goal.because else str(goal)


def _at_end(setting: Setting, value: float) -> str:
    """Text if a setting is at an end of its range, else empty."""
    span = setting.high - setting.low
    if value >= setting.high - 1e-6 * span:
        return f"{setting.name} at its highest"
    return f"{setting.name} at its lowest" if value <= setting.low + 1e-6 * span else ""
