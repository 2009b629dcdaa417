"""Removal of fluid: the fastest constant net ultrafiltration that keeps a set of goals."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from eclsim.arguments import number_of
from eclsim.cases.case import Case
from eclsim.cases.events import LARGEST_ML, Event
from eclsim.cases.resolve import height_weight
from eclsim.cases.settings import apply_settings
from eclsim.course.course import follow
from eclsim.course.timeline import MINUTE, Timeline, case_with_settings
from eclsim.devices.description import CAUTION, labelled_sentence
from eclsim.devices.dialysed_blood import FEWER_SURVIVED_TEXT, HARMFUL_ML_KG_H
from eclsim.devices.registry import devices, named_output
from eclsim.goals.goal import Goal, GoalError, implicit_goals, read_goals
from eclsim.goals.result import ALARM_KINDS, broken_alarms_text
from eclsim.inputs.mistakes import CaseError
from eclsim.orbit.model import CaseSource, as_case, model_of
from eclsim.orbit.status import Status
from eclsim.outputs.limits import limits_of
from eclsim.outputs.registry import output
from eclsim.outputs.results import simulate
from eclsim.outputs.signals import output_names
from eclsim.simulation.target_flow import with_speed

if TYPE_CHECKING:
    import xarray as xr


ULTRAFILTRATION = "net_ultrafiltration_ml_h"
FILTRATION_FRACTION = "filtration_fraction"
"""Output whose limit restricts the rate by default: beyond it, the filter of the device clots."""
LEAST_ML_H = 1.0
"""Smallest rate that devices can be set to [mL/h]."""
RATES_PER_ROUND = 8
"""Number of rates per round, computed side by side."""
ROUNDS = 3
MOMENTS_PER_COURSE = 40
"""Number of moments of each course at which goals are checked."""
AFTERWARDS_H = 24.0
"""Shortest time for which the patient is followed after the removal, with nothing more removed [h]."""
ROUNDING = 1e-3
"""A march ends beyond a goal by this share of its scale; beats of steps and moments differ by less."""


class BrokenGoal(NamedTuple):
    """A goal that a course violates.

    Attributes:
        goal: goal as written.
        value: value of its output at that time.
        at_min: time of the first violation [min].
        unit: unit of the value.
        at_start: value of its output at the start; NaN if it is not known.
    """

    goal: str
    value: float
    at_min: float
    unit: str = ""
    at_start: float = math.nan


@dataclass(frozen=True)
class Removal:
    """Result of planning the removal of a volume.

    Args:
        id: id of the case.
        remove_ml: volume to remove [mL].
        keep: goals that must hold at all times.
        rate_ml_h: fastest rate [mL/h] up to `HARMFUL_ML_KG_H` that keeps the goals; where the time allowed
            needs more than that, the slowest that keeps them; NaN if none does.
        hours: duration of the removal [h].
        possible: whether any rate keeps the goals.
        limits: goals that the next rate tried above `fastest_ml_h` violates.
        afterwards: goals that are violated after the removal, though nothing more is removed, with the time
            from its end.
        fastest_ml_h: fastest rate that keeps the goals, whatever it is per kg of body weight [mL/h].
        message: result in words.
        tried: by rate, whether all goals were kept.
        warnings: limits that the patient violates at the rate found, and cautions.
    """

    id: str
    remove_ml: float
    keep: tuple[str, ...]
    rate_ml_h: float
    hours: float
    possible: bool
    limits: tuple[BrokenGoal, ...]
    message: str
    tried: dict[float, bool] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    afterwards: tuple[BrokenGoal, ...] = ()
    fastest_ml_h: float = math.nan

    def as_object(self) -> dict[str, Any]:
        """Plain data for JSON."""
        tried = [{"rate_ml_h": rate, "kept": kept} for rate, kept in sorted(self.tried.items())]
        named = {"limits": self.limits, "afterwards": self.afterwards}
        return (
            asdict(self)
            | {key: [one._asdict() for one in goals] for key, goals in named.items()}
            | {"tried": tried}
        )


def plan_removal(
    case: CaseSource,
    remove_ml: float,
    keep: str | Sequence[str | Goal],
    *,
    hours: float = 72.0,
    volume_policy: str | None = None,
) -> Removal:
    """Find the fastest constant net ultrafiltration that removes a volume without violating a goal.

    A rate above `HARMFUL_ML_KG_H`, above which fewer patients survived, is the answer only if the removal
    takes longer than `hours` without it; what the goals alone would allow is said beside the answer.

    Rates from the slowest, which takes `hours`, to the fastest that the filter allows are computed side by
    side. The interval between the last rate that keeps all goals and the first that does not is then divided
    again. The rate is found to about 1 %. Events of the case are left out. Unless a goal says otherwise, the
    filtration fraction must stay within its limit and no vein may collapse, provided that this holds at the
    slowest rate.

    Args:
        case: path of a case file, what `read_case` returned, or a case, with a device that removes fluid.
        remove_ml: volume to remove [mL].
        keep: goals such as "MAP > 60, drainage_pressure > -80, DO2 > 400".
        hours: longest allowed duration [h].
        volume_policy: blood volume policy; None takes that of the case.

    Raises:
        GoalError: Goals are not possible, or no device removes fluid.
        CaseError: The file is no case.
    """
    solved = with_speed(as_case(case), volume_policy)[0].model_copy(update={"events": ()})
    remove_ml, hours = _checked_task(remove_ml, hours)
    key = _filtration(solved, keep)
    slowest = max(remove_ml / hours, LEAST_ML_H)
    slow = _case_at_slowest(solved, key, slowest, f"remove {remove_ml:g} mL in {hours:g} h")
    outputs = output_names(model_of(slow).circuit)
    asked = read_goals(keep, outputs)
    goals = (*asked, *_implied_goals(slow, outputs, asked, volume_policy))
    harmful = HARMFUL_ML_KG_H * height_weight(solved.patient)[1]
    rates = first_rates(slowest, fastest_rate(solved, key, slowest), harmful)
    broken = _broken_by_rate(solved, key, rates, remove_ml, goals, volume_policy)
    removal = removal_result(solved.patient.id, remove_ml, goals, broken, harmful)
    if not removal.possible:
        return removal
    below = (found for rate, found in broken.items() if rate < removal.rate_ml_h)
    slower = max((one.at_min for found in below for one in found), default=0.0)
    removal = with_afterwards(solved, key, removal, goals, slower, volume_policy)
    return _with_warnings(solved, key, removal, asked, volume_policy)


def _checked_task(remove_ml: float, hours: float) -> tuple[float, float]:
    """Return volume [mL] and time [h] as numbers."""
    remove_ml, hours = number_of("remove_ml", remove_ml), number_of("hours", hours)
    if not (math.isfinite(remove_ml) and remove_ml > 0.0 and hours > 0.0):
        raise GoalError([f"remove {remove_ml:g} mL in {hours:g} h; allowed: positive numbers"])
    if remove_ml > LARGEST_ML:
        raise GoalError([f"remove {remove_ml:g} mL: implausibly large; allowed: up to {LARGEST_ML:g} mL"])
    return remove_ml, hours


def _case_at_slowest(case: Case, key: str, slowest: float, task: str) -> Case:
    """Return the case at the slowest rate; if its device cannot have it, an error that names the task."""
    try:
        return case_with_settings(case, {key: slowest}, case)
    except CaseError as error:
        (first, *_) = error.mistakes
        reason = f"{first.message}; allowed: {first.allowed}, or more hours"
        raise GoalError([f"{task}, {slowest:.0f} mL/h: {reason}"]) from None


def _broken_by_rate(
    case: Case, key: str, rates: np.ndarray, remove_ml: float, goals: Sequence[Goal], policy: str | None
) -> dict[float, list[BrokenGoal]]:
    """Goals that each rate violates, for the first rates and those by which the interval is divided."""
    broken = dict[float, list[BrokenGoal]]()
    for _ in range(ROUNDS):
        fresh = [float(rate) for rate in rates if float(rate) not in broken]
        courses = removal_courses(case, key, fresh, remove_ml, goals, policy)
        broken |= {
            rate: first_broken_goals(goals, result) for rate, result in zip(fresh, courses, strict=True)
        }
        below, above = bracketing_rates(_kept(broken))
        if below is None or above is None:
            break
        rates = np.linspace(below, above, RATES_PER_ROUND + 2)[1:-1]
    return broken


def _kept(broken: Mapping[float, Sequence[BrokenGoal]]) -> dict[float, bool]:
    """Whether each rate keeps all goals."""
    return {rate: not found for rate, found in broken.items()}


def _implied_goals(
    case: Case, outputs: Sequence[str], asked: Sequence[Goal], policy: str | None
) -> tuple[Goal, ...]:
    """Default goals that are not stated, if the steady beat at the slowest rate keeps them."""
    beat = simulate(case, policy)
    present = {name: float(beat[name]) for name in outputs if name in beat}
    goals = list(implicit_goals(outputs, asked, present, model_of(case).values))
    taken = {goal.output for goal in asked}
    for name in outputs:
        known = named_output(name)
        if known is None or name in taken or not known[1].name.endswith(FILTRATION_FRACTION):
            continue
        if ULTRAFILTRATION in known[0].device.section.fields():
            lowest = sorted(limits_of(name, outputs), key=lambda limit: limit.value)[:1]
            goals += [Goal(name, high=one.value, because=one.meaning) for one in lowest]
    return tuple(goal for goal in goals if goal.excess(float(beat[goal.output])) <= 0.0)


def with_afterwards(
    case: Case, key: str, removal: Removal, goals: Sequence[Goal], slower: float, policy: str | None
) -> Removal:
    """Add the goals that are violated after the removal, with nothing more removed.

    The patient is followed for a day, and at least as long as `slower` [min], when a slower rate violates a
    goal.
    """
    end = 60.0 * removal.hours
    until = max(end + 60.0 * AFTERWARDS_H, slower)
    removing = case_with_settings(case, {key: removal.rate_ml_h}, case)
    ended = removing.model_copy(update={"events": (Event(at_min=end, set={key: 0.0}),)})
    timeline = Timeline(ended, until * MINUTE)
    every = until / MOMENTS_PER_COURSE
    (result,) = follow(
        [timeline], [every], [goal.output for goal in goals], policy, broken=lambda beat: _breaks(goals, beat)
    )
    broken = tuple(one._replace(at_min=one.at_min - end) for one in first_broken_goals(goals, result))
    if not broken or broken[0].at_min <= 0.0:
        return removal
    reason = " and ".join(map(_break_sentence, broken))
    message = f"{removal.message}; after the removal, though nothing more is removed, {reason}"
    return replace(removal, message=message, afterwards=broken)


def _with_warnings(
    case: Case, key: str, removal: Removal, asked: Sequence[Goal], policy: str | None
) -> Removal:
    """Add the alarms and cautions of the course at the rate found."""
    minutes = 60.0 * removal.hours
    timeline = Timeline(case_with_settings(case, {key: removal.rate_ml_h}, case), minutes * MINUTE)
    (result,) = follow([timeline], [minutes / MOMENTS_PER_COURSE], None, policy, with_alarms=True)
    alarms = json.loads(result.attrs["alarms"])
    sentences, message = [labelled_sentence(one["kind"], one["sentence"]) for one in alarms], removal.message
    message += broken_alarms_text(
        (one["quantity"] for one in alarms if one["kind"] in ALARM_KINDS),
        "on the way",
        {goal.output: True for goal in asked},
    )
    weight = height_weight(case.patient)[1]
    if removal.rate_ml_h > HARMFUL_ML_KG_H * weight:
        per_kg = removal.rate_ml_h / weight
        sentences.insert(0, f"{removal.rate_ml_h:.0f} mL/h are {per_kg:.1f} mL/kg/h: {FEWER_SURVIVED_TEXT}")
    sentences += [labelled_sentence(CAUTION, text) for text in result.attrs["cautions"]]
    return replace(removal, message=message, warnings=tuple(sentences))


def first_rates(slowest: float, fastest: float, harmful: float) -> np.ndarray:
    """Rates from the slowest to the fastest; the harmful rate is one of them where it lies between."""
    rates = np.geomspace(slowest, fastest, RATES_PER_ROUND)
    if slowest < harmful < fastest:
        inner = 1 + int(np.argmin(np.abs(np.log(rates[1:-1] / harmful))))
        rates[inner] = harmful
    return rates


def bracketing_rates(tried: dict[float, bool]) -> tuple[float | None, float | None]:
    """The last of the consecutive slowest rates that keep all goals, and the next faster that does not.

    If no rate keeps them, the second is the slowest rate.
    """
    slowest = min((rate for rate, kept in tried.items() if kept), default=None)
    from_there = 0.0 if slowest is None else slowest
    above = min((rate for rate, kept in tried.items() if not kept and rate > from_there), default=None)
    kept_below = (rate for rate, kept in tried.items() if kept and rate < (above or math.inf))
    return max(kept_below, default=None), above


def _filtration(case: Case, keep: str | Sequence[str | Goal]) -> str:
    """Key of the device's net ultrafiltration; without one, an error that includes mistakes in goals."""
    rates = {
        one.key: getattr(one.section, ULTRAFILTRATION) or 0.0
        for one in case.instances()
        if ULTRAFILTRATION in one.device.section.fields()
    }
    key = next(iter(rates), None)
    if key is not None and case.setting(key, "flow_ml_min") == 0.0:
        message = f"{key}.flow_ml_min = 0: the pump stands still, so that nothing is removed; allowed: a flow"
        raise GoalError([message])
    others = [f"{one}.{ULTRAFILTRATION}" for one, rate in rates.items() if rate > 0.0 and one != key]
    if others:
        raise GoalError(
            [f"{' and '.join(others)}: removed beside [{key}], whose rate is planned; allowed: 0"]
        )
    if key is not None:
        return f"{key}.{ULTRAFILTRATION}"
    removing = " or ".join(
        f"[{key}]" for key, instance in devices().items() if ULTRAFILTRATION in instance.section.fields()
    )
    wrong = [f"the case has no device that removes fluid: add a section {removing}"]
    try:
        read_goals(keep, output_names(model_of(case).circuit))
    except GoalError as error:
        wrong += error.mistakes
    raise GoalError(wrong)


def fastest_rate(case: Case, key: str, slowest: float) -> float:
    """Highest rate allowed for the device, within 1 %; the slowest rate if that is too high already."""

    def allowed(rate: float) -> bool:
        try:
            apply_settings(case, [f"{key}={rate!r}"])
        except CaseError:
            return False
        return True

    low, high = slowest, 2.0 * slowest
    while allowed(high):
        low, high = high, 2.0 * high
    while high > 1.01 * low:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if allowed(middle) else (low, middle)
    return low


def removal_courses(
    case: Case, key: str, rates: Sequence[float], remove_ml: float, goals: Sequence[Goal], policy: str | None
) -> list[xr.Dataset]:
    """Courses that remove a volume at several rates, side by side."""
    minutes = [60.0 * remove_ml / rate for rate in rates]
    timelines = [
        Timeline(case_with_settings(case, {key: rate}, case), span * MINUTE)
        for rate, span in zip(rates, minutes, strict=True)
    ]
    every = [span / MOMENTS_PER_COURSE for span in minutes]

    return follow(
        timelines, every, [goal.output for goal in goals], policy, broken=lambda beat: _breaks(goals, beat)
    )


def _breaks(goals: Sequence[Goal], beat: Mapping[str, float]) -> bool:
    """Whether a beat violates a goal by more than steps and moments differ."""
    return any(goal.excess(beat[goal.output]) > ROUNDING * goal.scale for goal in goals)


def first_broken_goals(goals: Sequence[Goal], result: xr.Dataset) -> list[BrokenGoal]:
    """Goals violated at the first moment with a violation; an early end of the course counts as one."""
    minutes = result["time_min"].to_numpy()
    lost = BrokenGoal(str(result.attrs["message"]), math.nan, float(minutes[-1]) if len(minutes) else 0.0)
    for k, minute in enumerate(minutes.tolist()):
        if str(result["status"].values[k]) == Status.ONE_OF_MANY.word:
            return [BrokenGoal("the beat is one of many, which determines no goal,", math.nan, minute)]
        breaks = []
        for goal in goals:
            value = float(result[goal.output][k])
            if not math.isfinite(value):
                breaks.append(BrokenGoal(f"no value of {goal.output}", math.nan, minute))
            elif goal.excess(value) > 0.0:
                why = f" ({goal.because})" if goal.because else ""
                start = float(result[goal.output][0])
                breaks.append(BrokenGoal(f"{goal}{why}", value, minute, output(goal.output).unit, start))
        if breaks:
            return breaks
    return [] if result.attrs["converged"] else [lost]


def removal_result(
    name: str,
    remove_ml: float,
    goals: Sequence[Goal],
    broken: Mapping[float, Sequence[BrokenGoal]],
    harmful: float = math.inf,
) -> Removal:
    """Return the result for the rates tried.

    Args:
        name: id of the case.
        remove_ml: volume to remove [mL].
        goals: goals that must hold at all times.
        broken: goals that each rate [mL/h] violates.
        harmful: rate above which fewer patients survived [mL/h].
    """
    tried = _kept(broken)
    fastest, above = bracketing_rates(tried)
    limits = tuple(broken[above]) if above is not None else ()
    sentence = " and ".join(_break_sentence(limit) for limit in limits)
    rate = math.nan
    if fastest is None:
        assert above is not None
        until = above * min(limit.at_min for limit in limits) / 60.0
        text = f"{remove_ml:g} mL cannot be removed: at {above:.0f} mL/h, the slowest, {sentence}"
        text += f"; {until:.0f} mL are removed by then" if until else ""
    else:
        kept = [rate for rate, keeps in tried.items() if keeps and rate <= fastest]
        rate = max((one for one in kept if one <= harmful), default=min(kept))
        text = _rate_sentence(remove_ml, rate, fastest, harmful)
        text += f"; at {above:.0f} mL/h {sentence}" if above is not None else ", the fastest of the device"
        slower = [one for one, keeps in tried.items() if not keeps and one < rate]
        if slower:
            reason = " and ".join(map(_break_sentence, broken[max(slower)]))
            text += f"; of the slower rates, {max(slower):.0f} mL/h does not keep the goals: {reason}"
    return Removal(
        name, remove_ml, tuple(map(str, goals)), rate, remove_ml / rate, fastest is not None, limits, text,
        tried, fastest_ml_h=math.nan if fastest is None else fastest,
    )  # fmt: skip


def _rate_sentence(remove_ml: float, rate: float, fastest: float, harmful: float) -> str:
    """The rate found, and what the goals alone would allow where that harmed patients."""
    found, alone, least = (_hours(remove_ml / one) for one in (rate, fastest, harmful))
    if fastest <= harmful:
        return f"{remove_ml:g} mL can be removed at {fastest:.0f} mL/h, in {alone}"
    per_kg = f"{HARMFUL_ML_KG_H * rate / harmful:.3g} mL/kg/h"
    if rate <= harmful:
        text = f"{remove_ml:g} mL can be removed at {rate:.0f} mL/h ({per_kg}), in {found}"
        text += f"; {FEWER_SURVIVED_TEXT}"
    else:
        text = (
            f"{remove_ml:g} mL in {found} need {rate:.0f} mL/h ({per_kg}); "
            f"{FEWER_SURVIVED_TEXT}: allow {least} or more ({harmful:.0f} mL/h)"
        )
    return f"{text}; the goals alone would allow {fastest:.0f} mL/h, {alone}"


def _hours(hours: float) -> str:
    return f"{hours:.1f} h" if hours >= 1.0 else f"{hours:.2g} h"


def _break_sentence(limit: BrokenGoal) -> str:
    hours = f"{limit.at_min / 60.0:.1f} h"
    if math.isnan(limit.value):
        return f"{limit.goal} after {hours}"
    unit = f" {limit.unit}" * (limit.unit != "1")
    if not limit.at_min:
        return f"{limit.goal} is broken from the start ({limit.value:.4g}{unit})"
    start = "" if math.isnan(limit.at_start) else f", from {limit.at_start:.4g} at the start"
    return f"{limit.goal} breaks after {hours} ({limit.value:.4g}{unit}{start})"
