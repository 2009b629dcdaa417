"""The smallest settings that reach goals, by exact derivatives of the steady beat.

With settings x over their ranges, u = (x - low) / (high - low), what is minimised is

    sum of weight_k u_k + penalty * sum of the goals' misses,

where the first setting has the largest weight. Every step solves the linear program of the beat to first
order within a trust region (sequential linear programming with an exact penalty, Fletcher and Sainz de la
Maza 1989, doi 10.1007/BF01582292), and again where bounds are curved (second-order corrections). At a
solution that as many goals determine as there are settings it converges as fast as Newton's method. Where
goals exclude each other the same search ends at the smallest sum of misses, each in hundredths of its bound;
what stands in the way is found by leaving out the goals at their bounds, one by one. Some goals hold though
nobody states them (implicit goals), since no patient can or should break them: veins do not fill below the
pressure of their surroundings, no chamber ejects more than it holds, no device carries blood backwards and no
oxygenator less than its label says, and no alarm of gases is raised that the case does not raise itself.
Where sweep or ventilation may change, arterial PCO2 and pH also stay within their warning limits. Implicit
goals of a flow or of gases that no varied setting can keep are left out: the answer names them where they are
broken.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import linprog

from eclsim.beat.grid import resolution_for_derivatives
from eclsim.circuit.assembly import assemble
from eclsim.gas.network import GasStatus
from eclsim.goals.goal import (
    MET_TOLERANCE,
    VENTILATED,
    Goal,
    GoalError,
    Setting,
    implicit_goals,
    is_kept_by_settings,
    read_goals,
    read_settings,
    requires_gases,
    varies_ventilation,
)
from eclsim.goals.result import (
    ALARM_KINDS,
    GoalResult,
    Reached,
    ReachStatus,
    broken_alarms_text,
    broken_goals,
    gravest,
    kept_by_default,
    led_by_narrow_lines,
    message_of,
    scan_gaps_text,
)
from eclsim.orbit.model import CaseSource, Model, as_case, model_of
from eclsim.orbit.status import NoDerivativesError
from eclsim.orbit.steady import Batch
from eclsim.outputs.signals import output_names, parameters_read
from eclsim.outputs.steady_beat import SteadyBeat, steady_beat
from eclsim.simulation.target_flow import with_speed

PENALTY = 30.0
"""Weight of a miss by one scale of its goal (`Goal.scale`); a setting counts at most 1 over its range."""
WEIGHT_RATIO = 0.05
"""Ratio of the weight of each further setting to that of the one before."""
SMALLEST_EFFECT = 1e-6
"""A setting has no effect if its whole range changes all goals by less than this, in their scales."""
SMALLEST_REGION = 1e-9
MOST_STEPS = 80
NO_BEAT = "no steady beat was found"
SCAN_VALUES = {1: 9, 2: 7, 3: 5}
"""Number of values of each setting tried first, by the number of settings; three for more settings."""

STARTS = 3
"""Largest number of starts of a search with several settings."""


def reach(
    case: CaseSource,
    goals: str | Sequence[str | Goal],
    *,
    vary: str | Sequence[Setting] | None = None,
    volume_policy: str | None = None,
) -> Reached:
    """Find the smallest settings that reach goals, or which goals cannot be reached together and why.

    Args:
        case: path of a case file, what `read_case` returned, or a case.
        goals: goals such as "MAP > 65, drainage_pressure > -80, PaCO2 35..45".
        vary: settings that may be varied, the costliest first: "ecmo.speed_rpm=2000..4000, ecmo.sweep_l_min";
            None for the speeds (and sweep) of the devices, over the ranges of their controls on the page.
        volume_policy: blood volume policy; None takes that of the case.

    Raises:
        GoalError: Goals or settings are not possible; the message names every mistake.
        CaseError: The file is no case.
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
    whole = _PatientModel(model, settings, volume_policy)
    own_place = whole.beat(whole.own_place[:, None], None)
    present = own_place.outputs() if own_place.determined[0] else {}
    implicit = implicit_goals(names, parsed, present, model.values, settings)
    if vary is None:
        settings = _settings_with_effect(whole, parsed, implicit)
        implicit = implicit_goals(names, parsed, present, model.values, settings)
    held = [goal for goal in implicit if is_kept_by_settings(goal, settings)]
    giving_way = [goal for goal in implicit if goal.gives_way]
    result = _search_from_starts(_PatientModel(model, settings, volume_policy), (*parsed, *held), giving_way)
    unvaried = {k: v for k, v in model.values.items() if k not in {one.name for one in settings}}
    return led_by_narrow_lines(result, (one.device.narrowed(one, unvaried) for one in known.instances()))


def _settings_with_effect(
    patient: _PatientModel, goals: Sequence[Goal], implicit: Sequence[Goal]
) -> tuple[Setting, ...]:
    """The default settings that affect a goal; settings of gases only if a goal concerns gases.

    Since the smallest settings are sought, a sweep that no goal depends on would be set to its minimum.

    Raises:
        GoalError: No goal depends on any setting.
    """
    outputs = [goal.output for goal in goals]
    now = patient.point(patient.own_place, outputs)
    if now is None and not isinstance(starts := _Scan.of(patient, (*goals, *implicit)).starts(), _NoStart):
        points = (patient.point(place, outputs) for place in starts)
        now = next((point for point in points if point is not None), None)
    if now is None:
        return patient.settings
    scales = np.array([goal.scale for goal in goals])
    acts = np.atleast_1d((np.abs(now.slopes) > SMALLEST_EFFECT * scales[:, None]).any(axis=0))
    if not acts.all():
        acts |= _has_effect_in_range(patient, outputs, scales)
    turned = {one.name for one in patient.settings}
    if not any(requires_gases(goal.output) for goal in goals):
        turned &= set(patient.model.circuit.parameter_names())  # what moves blood
    settings = zip(patient.settings, acts, strict=True)
    chosen = tuple(one for one, does in settings if does and one.name in turned)
    if not chosen:
        there = ", ".join(one.name for one in patient.settings)
        raise GoalError([f"{', '.join(outputs)}: not affected by {there}; name settings to vary (vary)"])
    return chosen


def _has_effect_in_range(patient: _PatientModel, outputs: Sequence[str], scales: np.ndarray) -> np.ndarray:
    """Whether each setting changes an output anywhere in its range; a valve may open at low speed only."""
    _, values, _ = patient.scan(outputs)
    count = len(patient.settings)
    grid = values.reshape(len(outputs), *(patient.axis_count,) * count) / scales.reshape(-1, *(1,) * count)
    # Places without a beat are NaN, and say nothing.
    spreads = (np.abs(np.diff(grid, axis=k + 1)) for k in range(count))
    return np.array([bool((spread > MET_TOLERANCE).any()) for spread in spreads])


class _Point(NamedTuple):
    """Outputs of the goals at one point of the settings, and their slopes over the settings' ranges."""

    place: np.ndarray
    values: np.ndarray
    slopes: np.ndarray


class _NoStart(NamedTuple):
    """Status and message if there is no point to start a search from."""

    status: ReachStatus
    message: str


class _SearchEnd(NamedTuple):
    """Point where a search ended, and the reason if it had not converged (else empty)."""

    at: _Point
    unfinished: str


class _PatientModel:
    """The patient as a function of the settings."""

    def __init__(self, model: Model, settings: tuple[Setting, ...], policy: str | None):
        self.model, self.settings, self.policy = model, settings, policy
        self.low = np.array([setting.low for setting in settings])
        self.span = np.array([setting.high for setting in settings]) - self.low
        self.beats = 0
        self.no_point_reason = NO_BEAT  # at the last place without a point

    @property
    def own_place(self) -> np.ndarray:
        """The case's own settings, or the nearest ones within the ranges, as coordinates u."""
        values = np.array([self.model.values[setting.name] for setting in self.settings])
        return np.clip((values - self.low) / self.span, 0.0, 1.0)

    def values_at(self, places: np.ndarray) -> dict[str, np.ndarray]:
        """Values of the settings at coordinates u of shape (settings, members)."""
        numbers = self.low[:, None] + self.span[:, None] * places
        return {setting.name: row for setting, row in zip(self.settings, numbers, strict=True)}

    def numbers_at(self, place: np.ndarray) -> dict[str, float]:
        """Values of the settings at one point."""
        return {name: float(row[0]) for name, row in self.values_at(place[:, None]).items()}

    def beat(
        self, places: np.ndarray, outputs: Sequence[str] | None, resolution: int | None = None
    ) -> SteadyBeat:
        """Steady beats at coordinates u of shape (settings, members)."""
        self.beats += places.shape[1]
        values = {**self.model.values, **self.values_at(places)}
        batch = Batch(self.model.circuit, values, places.shape[1], self.policy or self.model.policy)
        return steady_beat(batch, outputs, resolution=resolution)

    def _linearised(
        self, beat: SteadyBeat, place: np.ndarray, outputs: Sequence[str]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Outputs at a point and their slopes; these on a finer grid if a setting is a phase of the beat."""
        names, assembly = [setting.name for setting in self.settings], assemble(self.model.circuit)
        values = {**self.model.values, **self.numbers_at(place)}
        finer = resolution_for_derivatives(assembly, values, names)
        if finer is None:
            linear = beat.linearise(outputs, names)
            return linear.values, linear.slopes
        own = np.array([float(beat.output(name)[0]) for name in outputs])
        return own, self.beat(place[:, None], outputs, finer).linearise(outputs, names).slopes

    def point(self, place: np.ndarray, outputs: Sequence[str]) -> _Point | None:
        """Outputs and slopes at a point; None without a determined steady beat or without derivatives."""
        beat = self.beat(place[:, None], outputs)
        if not beat.determined[0]:
            shut = "valves stay shut throughout the beat, so that it is one of many"
            self.no_point_reason = shut if beat.converged[0] else NO_BEAT
            return None
        try:
            values, slopes = self._linearised(beat, place, outputs)
        except NoDerivativesError:
            return None
        result = _Point(place, values, slopes * self.span)
        return result if np.isfinite(result.values).all() and np.isfinite(result.slopes).all() else None

    @property
    def axis_count(self) -> int:
        """Number of values of each setting in a scan."""
        return SCAN_VALUES.get(len(self.settings), 3)

    def scan(self, outputs: Sequence[str]) -> tuple[np.ndarray, np.ndarray, SteadyBeat]:
        """Points throughout the ranges (settings, members), outputs at these, and their beats."""
        axis = np.linspace(0.0, 1.0, self.axis_count)
        places = np.array(list(itertools.product(axis, repeat=len(self.settings)))).T
        beat = self.beat(places, outputs)
        values = np.where(beat.determined, np.stack([beat.output(name) for name in outputs]), np.nan)
        return places, values, beat


def _search_from_starts(
    patient: _PatientModel, goals: tuple[Goal, ...], giving_way: Sequence[Goal]
) -> Reached:
    """Search from the starts and, if a goal is missed, find the goals that prevent it."""
    scan = _Scan.of(patient, goals)
    goals, starts = scan.goals, _points(patient, scan.goals, scan.starts())
    tried, without_beat = len(scan.beat.status), int((~scan.beat.determined).sum())
    if isinstance(starts, _NoStart):
        nowhere = tuple(GoalResult(goal, np.nan, False, False, {}) for goal in goals if not goal.because)
        none, name = tuple(np.nan for _ in patient.settings), patient.model.name
        return Reached(
            name, patient.settings, none, nowhere, *starts, beats=patient.beats, tried=tried,
            without_beat=without_beat, doubts=patient.model.doubts,
        )  # fmt: skip
    ends = [(_search(patient, goals, start), start) for start in starts]
    (end, unfinished), start = min(
        ends, key=lambda e: (bool(e[0].unfinished), _merit(goals, e[0].at.place, e[0].at.values))
    )
    numbers = patient.numbers_at(end.place)
    names, slopes = [setting.name for setting in patient.settings], (end.slopes / patient.span).tolist()
    results = tuple(
        GoalResult(
            goal, float(value), goal.is_met(value), goal.at_bound(value), dict(zip(names, row, strict=True))
        )
        for goal, value, row in zip(goals, end.values, slopes, strict=True)
    )
    status = ReachStatus.REACHED if all(result.met for result in results) else ReachStatus.NOT_REACHED
    status, without = (ReachStatus.NOT_CONVERGED if unfinished else status), {}
    if status is ReachStatus.NOT_REACHED:
        without = _settings_without_each_goal(patient, goals, results, start)
    beat = patient.beat(end.place[:, None], None)
    findings, outputs = tuple(beat.findings()), beat.outputs()
    alarms = tuple(gravest(broken_goals(outputs, [goal for goal in giving_way if goal not in goals])))
    asked = tuple(result for result in results if not result.goal.because)
    named = {alarm.goal.output for alarm in alarms}
    broken = (f.quantity for f in findings if f.kind in ALARM_KINDS and f.quantity not in named)
    message = (
        message_of(patient.settings, numbers, results, without, unfinished)
        + ("" if status is ReachStatus.REACHED else scan_gaps_text(tried, without_beat))
        + "".join(f"; {alarm.sentence}" for alarm in alarms)
        + broken_alarms_text(
            broken, "with the settings found", {result.goal.output: result.met for result in asked}
        )
    )
    return Reached(
        patient.model.name, patient.settings, tuple(numbers.values()), asked, status, message,
        tuple(result for result in results if result.goal.because and result.binding), without, outputs,
        findings, patient.beats, alarms, tried, without_beat, patient.model.doubts,
        kept_by_default(results, VENTILATED) if varies_ventilation(patient.settings) else (),
    )  # fmt: skip


def _settings_without_each_goal(
    patient: _PatientModel, goals: tuple[Goal, ...], results: Sequence[GoalResult], start: _Point
) -> dict[str, Mapping[str, float] | None]:
    """For each goal that may prevent another one: the settings that reach all others, or None."""
    settings: dict[str, Mapping[str, float] | None] = {}
    unmet = sum(not result.met for result in results)
    binding = [result for result in results if result.binding and not result.goal.because]
    for left_out in [result.goal for result in binding if result.met or unmet > 1]:
        rows = [k for k, goal in enumerate(goals) if goal is not left_out]
        remaining = tuple(goals[k] for k in rows)
        begin = start._replace(values=start.values[rows], slopes=start.slopes[rows])
        end, unfinished = _search(patient, remaining, begin)
        met = all(goal.is_met(value) for goal, value in zip(remaining, end.values, strict=True))
        if met or not unfinished:
            settings[str(left_out)] = patient.numbers_at(end.place) if met else None
    return settings


class _Scan(NamedTuple):
    """Points throughout the ranges (settings, points), with the goals' outputs at these (goals, points)."""

    goals: tuple[Goal, ...]
    places: np.ndarray
    values: np.ndarray
    beat: SteadyBeat

    @classmethod
    def of(cls, patient: _PatientModel, goals: Sequence[Goal]) -> _Scan:
        """Scan the ranges; goals that give way and are kept nowhere are dropped."""
        places, values, beat = patient.scan([goal.output for goal in goals])
        rows = []
        for k, goal in enumerate(goals):
            known = values[k, np.isfinite(values[k])].tolist()
            if not (goal.gives_way and known) or any(goal.excess(value) <= 0.0 for value in known):
                rows.append(k)
        return cls(tuple(goals[k] for k in rows), places, values[rows], beat)

    def starts(self) -> list[np.ndarray] | _NoStart:
        """The best of the points, or the reason why the outputs of the goals are unknown at all of them.

        With several settings, up to `STARTS` points, each with another value of the last setting.
        """
        beat, places = self.beat, self.places
        merits = np.array([_merit(self.goals, u, v) for u, v in zip(places.T, self.values.T, strict=True)])
        known = np.isfinite(merits)
        if not known.any():
            steady = np.flatnonzero(beat.determined)
            if len(steady):
                reason = GasStatus(int(beat.gas_status[steady[0]])).message
                return _NoStart(
                    ReachStatus.NO_STEADY_GASES, f"the gases are not steady anywhere in the ranges: {reason}"
                )
            reason = f"no steady beat was found anywhere in the ranges: {beat.message(0)}"
            if beat.converged.any():
                one = int(np.flatnonzero(beat.converged)[0])
                reason = f"the steady beat is not determined anywhere in the ranges: {beat.message(one)}"
            return _NoStart(ReachStatus.NO_STEADY_BEAT, reason)
        order = [k for k in np.argsort(merits, kind="stable").tolist() if known[k]]
        if len(places) == 1:
            return [places[:, order[0]]]
        first_of = {float(places[-1, k]): k for k in reversed(order)}
        return [places[:, k] for k in sorted(first_of.values(), key=order.index)[:STARTS]]


def _points(
    patient: _PatientModel, goals: Sequence[Goal], starts: list[np.ndarray] | _NoStart
) -> list[_Point] | _NoStart:
    """Outputs and slopes at those starts that have them."""
    if isinstance(starts, _NoStart):
        return starts
    points = (patient.point(start, [goal.output for goal in goals]) for start in starts)
    known = [point for point in points if point is not None]
    reason = (
        "the steady beats at the best of the points tried first lack the derivatives that the search needs"
    )
    return known or _NoStart(ReachStatus.NOT_CONVERGED, reason)


def _merit(goals: Sequence[Goal], place: np.ndarray, values: np.ndarray) -> float:
    """Objective of the search; NaN without outputs."""
    if not np.isfinite(values).all():
        return np.nan
    misses = [max(g.inside().excess(v), 0.0) / g.scale for g, v in zip(goals, values, strict=True)]
    return float(_weights(len(place)) @ place + PENALTY * sum(misses))


def _weights(count: int) -> np.ndarray:
    return WEIGHT_RATIO ** np.arange(count)


def _search(patient: _PatientModel, goals: Sequence[Goal], now: _Point) -> _SearchEnd:
    """Search from a point and return where the search ended."""
    merit, region, trial = _merit(goals, now.place, now.values), 0.25, now
    move, expected = _linear_program(goals, now, region)
    for step in itertools.count():
        if merit - expected <= 1e-12:
            return _SearchEnd(now, "")
        if region < SMALLEST_REGION:
            return _SearchEnd(
                now, "" if trial is not None else f"next to these settings, {patient.no_point_reason}"
            )
        if step == MOST_STEPS:
            break
        trial, trial_merit = _moved(patient, goals, now, move)
        if trial is not None:
            target = merit - 0.75 * (merit - expected)
            trial, trial_merit = _corrected(patient, goals, now, trial, trial_merit, target, region)
        ratio = (merit - trial_merit) / (merit - expected)
        if trial is not None and ratio > 0.05:
            now, merit = trial, trial_merit
            region = min(2.0 * region, 1.0) if ratio > 0.75 else region
        else:
            region = 0.25 * float(np.abs(move).max())
        move, expected = _linear_program(goals, now, region)
    return _SearchEnd(now, f"the search was stopped after {MOST_STEPS} steps")


def _moved(
    patient: _PatientModel, goals: Sequence[Goal], at: _Point, move: np.ndarray
) -> tuple[_Point | None, float]:
    """The place after a move, and its merit; None and NaN where there is no steady beat."""
    trial = patient.point(np.clip(at.place + move, 0.0, 1.0), [goal.output for goal in goals])
    return trial, np.nan if trial is None else _merit(goals, trial.place, trial.values)


def _corrected(
    patient: _PatientModel, goals: Sequence[Goal], now: _Point, trial: _Point, merit: float, target: float,
    region: float,
) -> tuple[_Point, float]:  # fmt: skip
    """A trial brought back to bounds that curve away from it, and its merit.

    Each program has what the last one missed of the bounds. One program leaves a miss that outweighs a small
    gain, and the search creeps along a curved bound in steps that never grow, so they go on until the merit
    is at the target, or falls by less than a tenth of what is still lacking.
    """
    while merit >= target:
        residuals = trial.values - now.slopes @ (trial.place - now.place)
        move, _ = _linear_program(goals, now._replace(values=residuals), region)
        corrected, corrected_merit = _moved(patient, goals, now, move)
        if corrected is None or not corrected_merit < merit:
            break
        lacking, gained = merit - target, merit - corrected_merit
        trial, merit = corrected, corrected_merit
        if gained <= 0.1 * lacking:
            break
    return trial, merit


def _linear_program(goals: Sequence[Goal], at: _Point, region: float) -> tuple[np.ndarray, float]:
    """Best first-order move within the trust region, and the merit expected there."""
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
