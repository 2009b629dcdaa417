"""The smallest settings that reach goals, by exact derivatives of the steady beat.

With settings x over their ranges, u = (x - low) / (high - low), what is minimised is

    sum of weight_k u_k + penalty * sum of the goals' misses,

the first setting weighing most. Every step solves the linear program of the beat to first order within a
trust region (sequential linear programming with an exact penalty, Fletcher and Sainz de la Maza 1989, doi
10.1007/BF01582292), and once more where bounds are curved (second-order correction). At a solution that as
many goals determine as there are settings it converges as fast as Newton's method. Where goals exclude each
other the same search ends at the smallest sum of misses, each in hundredths of its bound; what stands in the
way is found by leaving out the goals at their bounds, one by one. Bounds are kept unasked, for
no patient is beyond them or should be: veins do not fill below the pressure of their surroundings, no chamber
ejects more than it holds, no device carries blood backwards and no oxygenator less than its label says, and
no alarm of gases is raised that the case does not raise itself.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.optimize import linprog

from eclsim.gas.network import GasStatus
from eclsim.goals.goal import Goal, GoalError, Setting, is_of_gas, possible, read_goals, read_settings
from eclsim.orbit.model import CaseSource, Model, as_case, model_of
from eclsim.orbit.status import NoDerivativesError, Status
from eclsim.orbit.steady import Batch
from eclsim.outputs.alarms import sentences
from eclsim.outputs.registry import output
from eclsim.outputs.signals import output_names, parameters_read
from eclsim.outputs.steady_beat import SteadyBeat, steady_beat
from eclsim.simulation.target_flow import with_speed

if TYPE_CHECKING:
    from eclsim.outputs.alarms import Finding

PENALTY = 30.0
"""Of a miss by one scale of its goal (`Goal.scale`); a setting counts at most 1 over its whole range."""
LATER = 0.05
"""Weight of each further setting, of the weight of the one before."""
MET = 1e-4
"""Largest miss, in scales of the goal, of a goal that is reached."""
IDLE = 1e-6
"""Change of all goals, in scales, over the whole range of a setting that none of them depends on."""
SMALLEST_REGION = 1e-9
MOST_STEPS = 80
NO_BEAT = "no steady beat was found"
SCANNED = {1: 9, 2: 7, 3: 5}
"""Values of each setting that are tried first, by the number of settings; with more of them, three."""


ALARMING = ("alarm", "collapse")
"""Kinds of findings that an answer names in its first words."""
STARTS = 3
"""Places from which a search of several settings is begun."""


class ReachStatus(StrEnum):
    """How a search for settings ended."""

    REACHED = "reached"
    NOT_REACHED = "not_reached"
    NOT_CONVERGED = "not_converged"
    NO_STEADY_BEAT = "no_steady_beat"
    NO_STEADY_GASES = "no_steady_gases"


class GoalResult(NamedTuple):
    """One goal at the settings.

    Attributes:
        goal: what was asked for.
        value: what the output is, in its unit.
        met: whether it is reached.
        binding: whether it is at its bound, or missed: smaller settings would break it.
        slopes: d output / d setting, in the units of both, by setting.
    """

    goal: Goal
    value: float
    met: bool
    binding: bool
    slopes: Mapping[str, float]

    def as_object(self) -> dict[str, object]:
        """As plain data for JSON."""
        goal = self.goal
        return {
            "goal": str(goal), "output": goal.output, "low": goal.low, "high": goal.high,
            "value": self.value, "met": self.met, "binding": self.binding, "slopes": dict(self.slopes),
        }  # fmt: skip


@dataclass(frozen=True)
class Reached:
    """What `reach` found.

    Args:
        id: of the case.
        settings: what was turned, with the ranges.
        values: of each setting, in its unit; NaN where no steady beat was found at all.
        goals: how each goal stands there.
        stops: bounds at which the search stood though nobody asked for them, since no patient is beyond them.
        status: how the search ended; what has not converged is not the smallest setting.
        message: in words; where a goal is not reached, why.
        without: for each goal that stands in the way, the settings that reach all others (none: neither do);
            a goal whose own search did not converge is left out.
        outputs: all outputs of the beat, by name.
        findings: limits that it breaks and how its numbers are to be read.
        beats: solved on the way.
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

    @property
    def reached(self) -> bool:
        """Whether these are the smallest settings that meet all goals."""
        return self.status is ReachStatus.REACHED

    def as_object(self) -> dict[str, object]:
        """As plain data for JSON."""
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
            "without": {goal: None if at is None else dict(at) for goal, at in self.without.items()},
            "outputs": dict(self.outputs),
            "warnings": sentences(self.findings),
            "beats": self.beats,
        }  # fmt: skip


def reach(
    case: CaseSource,
    goals: str | Sequence[Goal],
    *,
    vary: str | Sequence[Setting] | None = None,
    volume_policy: str | None = None,
) -> Reached:
    """The smallest settings that reach goals, or which goals cannot be reached together and why.

    Args:
        case: path of a case file, what `read_case` returned, or a case.
        goals: such as "MAP > 65, drainage_pressure > -80, PaCO2 35..45".
        vary: what is turned, the dearest first: "ecmo.speed_rpm=2000..4000, ecmo.sweep_l_min"; left out, the
            speeds (and sweep) of the devices, over the ranges of their knobs on the page.
        volume_policy: blood volume policy; left out, the case's.

    Raises:
        GoalError: goals or settings that cannot be meant, with every mistake.
        CaseError: the file is no case.
    """
    known = with_speed(as_case(case), volume_policy)[0]
    model = model_of(known)
    names = output_names(model.circuit)
    wrong: list[str] = []
    parsed: tuple[Goal, ...] = ()
    settings: tuple[Setting, ...] = ()
    try:
        parsed = read_goals(goals, names)
    except GoalError as error:
        wrong += error.mistakes
    try:
        settings = read_settings(vary, known, parameters_read(model.circuit))
    except GoalError as error:
        wrong += error.mistakes
    if wrong:
        raise GoalError(wrong)
    whole = _Bedside(model, settings, volume_policy)
    own = whole.beat(whole.own[:, None], None)
    present = own.outputs() if own.determined[0] else {}
    unasked = possible(names, parsed, present, model.values)
    if vary is None:
        settings = _acting(whole, parsed, unasked)
    return _reached(_Bedside(model, settings, volume_policy), (*parsed, *unasked))


def _acting(bedside: _Bedside, goals: Sequence[Goal], unasked: Sequence[Goal]) -> tuple[Setting, ...]:
    """Those of the usual settings that a goal depends on; those of gases where it is one of gases.

    A sweep that no goal depends on would be turned to nothing, since the smallest settings are sought.

    Raises:
        GoalError: no goal depends on any.
    """
    outputs = [goal.output for goal in goals]
    now = bedside.point(bedside.own, outputs)
    if now is None and not isinstance(starts := _best_starts(bedside, (*goals, *unasked)), _Nowhere):
        points = (bedside.point(place, outputs) for place in starts)
        now = next((point for point in points if point is not None), None)
    if now is None:
        return bedside.settings
    scales = np.array([goal.scale for goal in goals])
    acts = np.atleast_1d((np.abs(now.slopes) > IDLE * scales[:, None]).any(axis=0))
    if not acts.all():
        acts |= _moves_somewhere(bedside, outputs, scales)
    turned = {one.name for one in bedside.settings}
    if not any(is_of_gas(goal.output) for goal in goals):
        turned &= set(bedside.model.circuit.parameter_names())  # what moves blood
    settings = zip(bedside.settings, acts, strict=True)
    chosen = tuple(one for one, does in settings if does and one.name in turned)
    if not chosen:
        there = ", ".join(one.name for one in bedside.settings)
        raise GoalError([f"{', '.join(outputs)}: not moved by {there}; name what may be turned (vary)"])
    return chosen


def _moves_somewhere(bedside: _Bedside, outputs: Sequence[str], scales: np.ndarray) -> np.ndarray:
    """Whether each setting moves an output anywhere in its range: a valve may open at low speed only."""
    _, values, _ = bedside.scan(outputs)
    count = len(bedside.settings)
    grid = values.reshape(len(outputs), *(bedside.axis_count,) * count) / scales.reshape(-1, *(1,) * count)
    # Places without a beat are NaN, and say nothing.
    spreads = (np.abs(np.diff(grid, axis=k + 1)) for k in range(count))
    return np.array([bool((spread > MET).any()) for spread in spreads])


class _Point(NamedTuple):
    """Goals' outputs at one place of the settings, and their slopes along the settings' ranges."""

    place: np.ndarray
    values: np.ndarray
    slopes: np.ndarray


class _Nowhere(NamedTuple):
    """There is nowhere to search from: how the search ended, and why."""

    status: ReachStatus
    message: str


class _End(NamedTuple):
    """Where a search ended, and why it did before it had converged (empty: it has)."""

    at: _Point
    unfinished: str


class _Bedside:
    """The patient, as a function of the settings."""

    def __init__(self, model: Model, settings: tuple[Setting, ...], policy: str | None):
        self.model, self.settings, self.policy = model, settings, policy
        self.low = np.array([setting.low for setting in settings])
        self.span = np.array([setting.high for setting in settings]) - self.low
        self.beats = 0
        self.lost = NO_BEAT  # why the last place that gave no point gave none

    @property
    def own(self) -> np.ndarray:
        """The place of the case's own settings, or the nearest in the ranges."""
        values = np.array([self.model.values[setting.name] for setting in self.settings])
        return np.clip((values - self.low) / self.span, 0.0, 1.0)

    def values_at(self, places: np.ndarray) -> dict[str, np.ndarray]:
        """Values of the settings at places of shape (settings, members)."""
        numbers = self.low[:, None] + self.span[:, None] * places
        return {setting.name: row for setting, row in zip(self.settings, numbers, strict=True)}

    def beat(self, places: np.ndarray, outputs: Sequence[str] | None) -> SteadyBeat:
        """Steady beats at places (settings, members)."""
        self.beats += places.shape[1]
        values = {**self.model.values, **self.values_at(places)}
        return steady_beat(Batch(self.model.circuit, values, places.shape[1], self._policy), outputs)

    @property
    def _policy(self) -> str:
        return self.policy or self.model.policy

    def point(self, place: np.ndarray, outputs: Sequence[str]) -> _Point | None:
        """Outputs and slopes at a place; None where there is no determined steady beat."""
        beat = self.beat(place[:, None], outputs)
        if not beat.determined[0]:
            self.lost = _lost(beat)
            return None
        try:
            linear = beat.linearise(outputs, [setting.name for setting in self.settings])
        except NoDerivativesError:
            return None
        result = _Point(place, linear.values, linear.slopes * self.span)
        return result if np.isfinite(result.values).all() and np.isfinite(result.slopes).all() else None

    @property
    def axis_count(self) -> int:
        """Values of each setting that a scan tries."""
        return SCANNED.get(len(self.settings), 3)

    def scan(self, outputs: Sequence[str]) -> tuple[np.ndarray, np.ndarray, SteadyBeat]:
        """Places all over the ranges (settings, members), the outputs there, and their beats."""
        axis = np.linspace(0.0, 1.0, self.axis_count)
        places = np.array(list(itertools.product(axis, repeat=len(self.settings)))).T
        beat = self.beat(places, outputs)
        values = np.where(beat.determined, np.stack([beat.output(name) for name in outputs]), np.nan)
        return places, values, beat


def _lost(beat: SteadyBeat) -> str:
    """Why a beat gives a search no numbers to go on from."""
    return "valves stay shut all beat, so that it is one of many" if beat.converged[0] else NO_BEAT


def _reached(bedside: _Bedside, goals: tuple[Goal, ...]) -> Reached:
    """Search, and where it ends short of a goal, ask what stands in the way."""
    starts = _best_starts(bedside, goals)
    if isinstance(starts, _Nowhere):
        nowhere = tuple(GoalResult(goal, np.nan, False, False, {}) for goal in goals if not goal.because)
        none, name = tuple(np.nan for _ in bedside.settings), bedside.model.name
        status, message = starts
        return Reached(name, bedside.settings, none, nowhere, status, message, beats=bedside.beats)
    ends = [(_search(bedside, goals, start), start) for start in starts]
    (end, unfinished), start = min(
        ends, key=lambda e: (bool(e[0].unfinished), _merit(goals, e[0].at.place, e[0].at.values))
    )
    numbers = {name: float(value[0]) for name, value in bedside.values_at(end.place[:, None]).items()}
    results = tuple(
        GoalResult(
            goal,
            float(value),
            goal.excess(value) <= MET * goal.scale,
            goal.at_bound(value),
            {s.name: float(d / span) for s, d, span in zip(bedside.settings, row, bedside.span, strict=True)},
        )
        for goal, value, row in zip(goals, end.values, end.slopes, strict=True)
    )
    status = ReachStatus.REACHED if all(result.met for result in results) else ReachStatus.NOT_REACHED
    status = ReachStatus.NOT_CONVERGED if unfinished else status
    without = _without(bedside, goals, results, start) if status is ReachStatus.NOT_REACHED else {}
    beat = bedside.beat(end.place[:, None], None)
    found = tuple(beat.findings())
    return Reached(
        bedside.model.name,
        bedside.settings,
        tuple(numbers.values()),
        tuple(result for result in results if not result.goal.because),
        status,
        _message(bedside.settings, numbers, results, without, unfinished)
        + beyond_alarms(one.quantity for one in found if one.kind in ALARMING),
        tuple(result for result in results if result.goal.because and result.binding),
        without,
        beat.outputs(),
        found,
        bedside.beats,
    )


def _without(
    bedside: _Bedside, goals: tuple[Goal, ...], results: Sequence[GoalResult], start: np.ndarray
) -> dict[str, Mapping[str, float] | None]:
    """For each goal that may stand in the way of a missed one: the settings that reach all but it, if any."""
    settings: dict[str, Mapping[str, float] | None] = {}
    unmet = sum(not result.met for result in results)
    binding = [result for result in results if result.binding and not result.goal.because]
    for left_out in [result.goal for result in binding if result.met or unmet > 1]:
        remaining = tuple(goal for goal in goals if goal is not left_out)
        end, unfinished = _search(bedside, remaining, start)
        met = all(g.excess(v) <= MET * g.scale for g, v in zip(remaining, end.values, strict=True))
        values = {name: float(value[0]) for name, value in bedside.values_at(end.place[:, None]).items()}
        if met or not unfinished:
            settings[str(left_out)] = values if met else None
    return settings


def _best_starts(bedside: _Bedside, goals: Sequence[Goal]) -> list[np.ndarray] | _Nowhere:
    """The best of places all over the ranges, or why no goal's output is known at any.

    With several settings three of them, each with another value of the last setting.
    """
    places, values, beat = bedside.scan([goal.output for goal in goals])
    merits = np.array([_merit(goals, u, v) for u, v in zip(places.T, values.T, strict=True)])
    known = np.isfinite(merits)
    if not known.any():
        steady = np.flatnonzero(beat.determined)
        if len(steady):
            reason = GasStatus(int(beat.gas_status[steady[0]])).message
            return _Nowhere(ReachStatus.NO_STEADY_GASES, f"nowhere in the ranges are there gases: {reason}")
        reason = f"no steady beat was found anywhere in the ranges: {beat.message(0)}"
        if beat.converged.any():
            one = int(np.flatnonzero(beat.converged)[0])
            reason = f"nowhere in the ranges is the steady beat determined: {beat.message(one)}"
        return _Nowhere(ReachStatus.NO_STEADY_BEAT, reason)
    order = [k for k in np.argsort(merits, kind="stable").tolist() if known[k]]
    if len(bedside.settings) == 1:
        return [places[:, order[0]]]
    first_of = {float(places[-1, k]): k for k in reversed(order)}
    return [places[:, k] for k in sorted(first_of.values(), key=order.index)[:STARTS]]


def _merit(goals: Sequence[Goal], place: np.ndarray, values: np.ndarray) -> float:
    """What is minimised; NaN where there are no outputs."""
    if not np.isfinite(values).all():
        return np.nan
    misses = [max(g.inside().excess(v), 0.0) / g.scale for g, v in zip(goals, values, strict=True)]
    return float(_weights(len(place)) @ place + PENALTY * sum(misses))


def _weights(count: int) -> np.ndarray:
    return LATER ** np.arange(count)


def _search(bedside: _Bedside, goals: Sequence[Goal], start: np.ndarray) -> _End:
    """Where the search ends."""
    outputs = [goal.output for goal in goals]

    def moved(at: _Point, move: np.ndarray) -> tuple[_Point | None, float]:
        """The place after a move, and its merit; None and NaN where there is no steady beat."""
        trial = bedside.point(np.clip(at.place + move, 0.0, 1.0), outputs)
        return trial, np.nan if trial is None else _merit(goals, trial.place, trial.values)

    now = bedside.point(start, outputs)
    if now is None:
        raise NoDerivativesError(Status.NOT_CONVERGED, "the steady beat at the best start has no derivatives")
    merit, region, trial = _merit(goals, now.place, now.values), 0.25, now
    move, expected = _linear_program(goals, now, region)
    for step in itertools.count():
        if merit - expected <= 1e-12:
            return _End(now, "")
        if region < SMALLEST_REGION:
            return _End(now, "" if trial is not None else f"beside these settings {bedside.lost}")
        if step == MOST_STEPS:
            break
        trial, trial_merit = moved(now, move)
        if trial is not None and merit - trial_merit <= 0.75 * (merit - expected):
            # Bounds that curve away are met by a second program with what the first one missed of them.
            residuals = trial.values - now.slopes @ (trial.place - now.place)
            second = _linear_program(goals, now._replace(values=residuals), region)[0]
            corrected, corrected_merit = moved(now, second)
            if corrected_merit < trial_merit:
                trial, trial_merit = corrected, corrected_merit
        ratio = (merit - trial_merit) / (merit - expected)
        if trial is not None and ratio > 0.05:
            now, merit = trial, trial_merit
            region = min(2.0 * region, 1.0) if ratio > 0.75 else region
        else:
            region = 0.25 * float(np.abs(move).max())
        move, expected = _linear_program(goals, now, region)
    return _End(now, f"the search was stopped after {MOST_STEPS} steps")


def _linear_program(goals: Sequence[Goal], at: _Point, region: float) -> tuple[np.ndarray, float]:
    """Best move within the region to first order, and the merit expected there."""
    count = len(at.place)
    rows, limits = [], []
    for goal, value, slopes in zip(goals, at.values, at.slopes, strict=True):
        inner = goal.inside()
        for bound, sign in ((inner.low, -1.0), (inner.high, 1.0)):
            if np.isfinite(bound):
                rows.append(sign * slopes / goal.scale)
                limits.append(sign * (bound - value) / goal.scale)
    moves = [(max(-region, -u), min(region, 1.0 - u)) for u in at.place]
    solved = linprog(
        np.concatenate([_weights(count), np.full(len(rows), PENALTY)]),
        A_ub=np.hstack([np.array(rows), -np.eye(len(rows))]),
        b_ub=np.array(limits),
        bounds=[*moves, *((0.0, None) for _ in rows)],
    )
    if not solved.success:
        raise RuntimeError(f"the linear program of a step towards the goals failed: {solved.message}")
    return solved.x[:count], float(_weights(count) @ at.place + solved.fun)


def _message(
    settings: Sequence[Setting],
    values: Mapping[str, float],
    results: Sequence[GoalResult],
    without: Mapping[str, Mapping[str, float] | None],
    unfinished: str,
) -> str:
    """The result in sentences."""
    where = " and ".join(f"{s.name} = {values[s.name]:.4g} {s.unit}".rstrip() for s in settings)
    if unfinished:
        unmet = ", ".join(str(result.goal) for result in results if not result.met)
        goals = f"not reached: {unmet}" if unmet else "all goals are reached"
        return f"not converged ({unfinished}): {goals} with {where}; smaller or better settings may exist"
    if all(result.met for result in results):
        stops = [_named(result.goal) for result in results if result.binding]
        least = (
            f"; smaller settings would break {' and '.join(stops)}" if stops else ", the lowest of the range"
        )
        return f"all goals are reached with {where}{least}"
    unmet = [r for r in results if not r.met]
    text = "; ".join(
        f"{_named(r.goal)} is not reached: the best is {r.value:.4g} {output(r.goal.output).unit}"
        for r in unmet
    )
    asked = sum(not result.goal.because for result in results)
    text += f" within the other goals, with {where}" if asked > 1 else f", with {where}"
    ends = [_at_end(s, values[s.name]) for s in settings]
    if any(ends):
        text += f" ({', '.join(filter(None, ends))})"
    held = [_named(r.goal) for r in results if r.goal.because and r.binding and r.met]
    if held:
        text += f"; it is limited by {' and '.join(held)}"
    for goal, others in without.items():
        if others is not None:
            numbers = " and ".join(f"{name} = {value:.4g}" for name, value in others.items())
            text += f"; without the goal {goal} all others are reached, with {numbers}"
    return text


def beyond_alarms(quantities: Iterable[str], where: str = "with the settings found") -> str:
    """That outputs break alarm limits at what was found; empty where none does.

    Args:
        quantities: outputs or waveforms whose alarm limits are broken.
        where: that is so, in words.
    """
    alarming = dict.fromkeys(quantities)
    if not alarming:
        return ""
    are, them = ("are", "them") if len(alarming) > 1 else ("is", "it")
    return f"; {where} {', '.join(alarming)} {are} beyond alarm limits: add a goal for {them}"


def _named(goal: Goal) -> str:
    """A goal, and why it holds if nobody asked for it."""
    return f"{goal} ({goal.because})" if goal.because else str(goal)


def _at_end(setting: Setting, value: float) -> str:
    """Whether a setting stands at an end of its range, in words."""
    span = setting.high - setting.low
    if value >= setting.high - 1e-6 * span:
        return f"{setting.name} at its highest"
    return f"{setting.name} at its lowest" if value <= setting.low + 1e-6 * span else ""
