"""A course of hours: slow states between events, and the steady beat at many moments."""

from __future__ import annotations

import json
import time as clock
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from eclsim.arguments import FiniteNumber, number_of
from eclsim.course.alarms import (
    alarms,
    alarms_text,
    clock_time,
    findings_of_derived_quantities,
    not_survived,
)
from eclsim.course.engine import FEWEST_SIDE_BY_SIDE, SHORTEST_STEP_S, CourseOptions, Engine
from eclsim.course.fluid_remarks import remarks_on_protein
from eclsim.course.handover import (
    BLOOD_RENEWAL_S,
    LARGEST_LAG,
    EarlyStop,
    History,
    largest_gas_change,
    watched_gases,
)
from eclsim.course.laws import Laws, laws_of
from eclsim.course.moments import ROUNDED_S, AtMoment, Moments, beats_at, in_effect_at, moments_of
from eclsim.course.result import (
    IMPOSSIBLE,
    MOST_SPANS,
    TIME,
    attributes_of,
    balance_of,
    impossible_among,
    labelled_course,
    mark_read_with_care,
    remarks_on_measurements,
    undetermined_in_words,
)
from eclsim.course.timeline import BEFORE_S, MINUTE, Timeline
from eclsim.devices.description import Finding
from eclsim.inputs.mistakes import CaseError, Mistake, as_names, as_settings
from eclsim.orbit.execution import Execution
from eclsim.orbit.model import CaseSource, as_case
from eclsim.orbit.status import Status
from eclsim.outputs.results import as_columns, variable
from eclsim.outputs.signals import refuse_missing
from eclsim.simulation.target_flow import with_speed
from eclsim.spelling import did_you_mean

MINUTES_PER_DAY = 1440.0
SHOWN_MOMENTS = 144
"""Approximate number of moments shown unless an interval is given."""
_INTERVALS_MIN = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 60.0, 120.0)
MOST_MOMENTS = 20_000


def course(
    case: CaseSource,
    *,
    minutes: float = MINUTES_PER_DAY,
    every_min: float | None = None,
    outputs: Sequence[str] | None = None,
    volume_policy: str | None = None,
    options: CourseOptions | None = None,
    execution: Execution | None = None,
) -> xr.Dataset:
    """Simulate a case over hours: its events, slow states, and the steady beat at each moment.

    Args:
        case: path of a case file, what `read_case` returned, or a case; with its `[[events]]`.
        minutes: duration [min].
        every_min: interval between moments shown [min]; None gives about 144 moments. Every event has its own
            moment, and a sudden one another moment a second before it.
        outputs: names of outputs, as in the registry; None for all that the circuit has.
        volume_policy: blood volume policy; None takes that of the case.
        options: numerical options.
        execution: how batches are computed.

    Returns:
        Dataset over `time_min`: outputs and slow states with units, the `status` of each moment, and whether
        its beat is `impossible` (a chamber without blood). Attributes: `id`, `converged` (1: the course
        reached its end), `message` (why it stopped), `balance` and `events` (JSON), `warnings` (one sentence
        each, with the time), those of them that are `approximations` or `cautions` (about infused fluid),
        `settling_s` (time in which the circulation follows a sudden change), `steps`, `beats`, `seconds`. A
        course ends at a moment without a steady beat; earlier moments are kept.

    Raises:
        CaseError: The file is no case, or an event is after the end.
        FlowNotReachedError: The case gives a pump flow that no speed can reach.
    """
    (result,) = course_many(
        [case], minutes=minutes, every_min=every_min, outputs=outputs, volume_policy=volume_policy,
        options=options, execution=execution,
    )  # fmt: skip
    return result


def course_many(
    cases: Sequence[CaseSource] | CaseSource,
    changes: Mapping[str, Sequence[float] | np.ndarray] | None = None,
    *,
    minutes: float = MINUTES_PER_DAY,
    every_min: float | None = None,
    outputs: Sequence[str] | None = None,
    volume_policy: str | None = None,
    options: CourseOptions | None = None,
    execution: Execution | None = None,
    with_alarms: bool = True,
) -> list[xr.Dataset]:
    """Simulate courses of several patients, or of variants of one case, side by side.

    Args:
        cases: several cases, or one case for all variants.
        changes: an array (members,) for each varied parameter, such as draws of a posterior.
        minutes: see `course`.
        every_min: see `course`.
        outputs: see `course`.
        volume_policy: see `course`.
        options: see `course`.
        execution: see `course`.
        with_alarms: whether limits are checked, which takes longer than the beats of a large batch.

    Returns:
        One Dataset for each member, as of `course`; `seconds` is the time of all.

    Raises:
        CaseError: As for `course`, or the case has no such parameter to change.
        FlowNotReachedError: As for `course`.
    """
    began, minutes = clock.perf_counter(), number_of("minutes", minutes)
    options = None if options is None else as_settings(options, CourseOptions, "options")
    outputs = None if outputs is None else as_names(outputs, "outputs")
    listed = list(cases) if isinstance(cases, Sequence) and not isinstance(cases, str) else [cases]
    columns = {key: np.atleast_1d(values) for key, values in as_columns(changes or {}).items()}
    sizes = {len(column) for column in columns.values()}
    if len(sizes) > 1 or (sizes and len(listed) > 1):
        raise ValueError("changes need a single case and arrays of the same length")
    count = sizes.pop() if sizes else len(listed)
    solved = [with_speed(as_case(source), volume_policy)[0] for source in listed]
    timelines = [
        Timeline(solved[k % len(solved)], minutes * MINUTE, {key: c[k] for key, c in columns.items()})
        for k in range(count)
    ]
    if columns and timelines:
        refuse_unknown(replace(timelines[0], overrides={}), columns)
    every = [checked_interval_min(every_min, minutes)] * count
    options = options or CourseOptions(hand_over=count < FEWEST_SIDE_BY_SIDE)
    results = follow(timelines, every, outputs, volume_policy, options, execution, with_alarms)
    seconds = clock.perf_counter() - began
    return [result.assign_attrs(seconds=seconds) for result in results]


def refuse_unknown(timeline: Timeline, names: Iterable[str]) -> None:
    """Raise an error for parameters that cannot differ between the members of a course."""
    known = timeline.start[1]
    message = "the course of this case has no such parameter"
    wrong = [Mistake(n, message, suggestion=did_you_mean(n, known)) for n in names if n not in known]
    if wrong:
        raise CaseError(wrong)


def follow(
    timelines: Sequence[Timeline],
    every_min: Sequence[float],
    outputs: Sequence[str] | None,
    volume_policy: str | None = None,
    options: CourseOptions | None = None,
    execution: Execution | None = None,
    with_alarms: bool = False,
    broken: Callable[[Mapping[str, float]], bool] | None = None,
) -> list[xr.Dataset]:
    """Simulate courses along timelines, each with its own interval between moments; see `course_many`.

    A course ends after the first moment whose steady beat is `broken`, judged by the named outputs.
    """
    results: dict[int, xr.Dataset] = {}
    for members in _groups(timelines, volume_policy).values():
        of_group, every = [timelines[m] for m in members], [every_min[m] * MINUTE for m in members]
        early_stop = None if broken is None else EarlyStop(outputs or (), broken, every)
        engine, moments = _marched_group(
            of_group, every, outputs, volume_policy, options, execution, with_alarms, early_stop
        )
        results |= {m: _labelled(moments, k, engine, with_alarms) for k, m in enumerate(members)}
    return [results[m] for m in range(len(timelines))]


def _marched_group(
    timelines: Sequence[Timeline],
    every_s: Sequence[float],
    outputs: Sequence[str] | None,
    policy: str | None,
    options: CourseOptions | None,
    execution: Execution | None,
    with_alarms: bool,
    early_stop: EarlyStop | None = None,
) -> tuple[Engine, Moments]:
    """Compute members of one circuit and policy to the end; return the engine and the moments shown."""
    policy = policy or timelines[0].case.volume_policy
    laws = Laws(laws_of(*timelines[0].start))
    engine = Engine(timelines, laws, policy, options or CourseOptions(hand_over=False), execution, early_stop)
    refuse_missing(outputs or (), *(circuit for of_member in engine.circuits for circuit in of_member))
    moments = moments_of(engine, engine.march(), every_s)
    beats_at(moments, engine, outputs, with_alarms, execution)
    return engine, moments


class SteadyBeatCourse(NamedTuple):
    """A course with the data from which its beats can be computed again.

    Attributes:
        result: dataset as of `course`.
        engine: engine that computed it.
        moments: moments shown.
    """

    result: xr.Dataset
    engine: Engine
    moments: Moments

    def at(self, minute: float) -> AtMoment:
        """What determines the beat at a minute, at the latest that of the last moment."""
        time = min(minute, float(self.result["time_min"][-1])) * MINUTE
        return in_effect_at(self.engine, self.moments, 0, time)


def steady_beat_course(case: CaseSource, minutes: float, policy: str | None = None) -> SteadyBeatCourse:
    """Return a course with all outputs, from which beats can be computed again.

    Args:
        case: see `course`.
        minutes: duration [min].
        policy: blood volume policy; None takes that of the case.

    Raises:
        CaseError: An event is after the end.
    """
    began = clock.perf_counter()
    timeline = Timeline(with_speed(as_case(case), policy)[0], minutes * MINUTE)
    every = default_interval_min(minutes) * MINUTE
    engine, moments = _marched_group([timeline], [every], None, policy, None, None, True)
    result = _labelled(moments, 0, engine, True)
    result.attrs["seconds"] = clock.perf_counter() - began
    return SteadyBeatCourse(result, engine, moments)


def checked_interval_min(every_min: float | None, minutes: float) -> float:
    """Return the checked interval between moments [min]; None gives the default.

    Raises:
        CaseError: There would be more moments than can be shown.
    """
    if every_min is None:
        return default_interval_min(minutes)
    every = FiniteNumber(above=0.0, unit="min")("every_min", every_min)
    if minutes / every > MOST_MOMENTS:
        message = f"{minutes / every:.0f} moments"
        raise CaseError([Mistake("every_min", message, f"{every:g}", f"up to {MOST_MOMENTS} moments")])
    return every


def default_interval_min(minutes: float) -> float:
    """Interval for a course that shows about `SHOWN_MOMENTS` moments [min]."""
    return next((e for e in _INTERVALS_MIN if minutes / e <= 1.01 * SHOWN_MOMENTS), minutes / SHOWN_MOMENTS)


def _groups(timelines: Sequence[Timeline], policy: str | None) -> dict[Any, list[int]]:
    """Members grouped by laws and policy, i.e. by circuit at the start."""
    groups: dict[Any, list[int]] = {}
    for k, timeline in enumerate(timelines):
        groups.setdefault((timeline.start[0], policy or timeline.case.volume_policy), []).append(k)
    return groups


def _labelled(moments: Moments, member: int, engine: Engine, with_alarms: bool) -> xr.Dataset:
    """Return a member's course as a labelled dataset."""
    places = moments.of(member)
    history, laws = engine.histories[member], engine.laws
    time, states = moments.time[places], moments.states[:, places]
    in_effect = {key: column[places] for key, column in moments.in_effect.items()}
    outputs = {name: moments.values[name][places] for name in moments.names}
    shown = laws.derived_quantities(states, in_effect)
    result = labelled_course(time, outputs, laws, states, shown)
    moment_findings: list[list[Finding]] = []
    minute, settling = time / MINUTE, engine.settling_s[member]
    arrest = not_survived(minute, outputs) if with_alarms else []
    if with_alarms:
        outputs |= {quantity.name: quantity.values for quantity in shown}
        of_shown = findings_of_derived_quantities(shown, len(places))
        moment_findings = [[*moments.findings[k], *of_shown[i]] for i, k in enumerate(places)]
        result[IMPOSSIBLE] = impossible_among(moment_findings, arrest, minute)
        mark_read_with_care(result, moment_findings)
    result["beat_by_beat"] = variable(TIME, moments.by_beat[places].astype(int))
    words = [Status(int(s)).word for s in moments.status[places]]
    result["status"] = variable(TIME, np.array(words, dtype=str))
    broken = [*arrest, *alarms(moment_findings, outputs, minute, moments.by_beat[places], shown)]
    message = _early_end_text(moments.stopped[member], minute)
    ahead = _skipped_transients_text(history) + _fast_slow_states(history, laws, settling)
    ahead += _unsettled_spans(history)
    ahead += filter(None, [undetermined_in_words(minute, moments.status[places] == Status.ONE_OF_MANY)])
    ahead += _sudden_gas_change(time, outputs, engine, member, moments.by_beat[places])
    sentences = [message] * bool(message) + [alarm.labelled for alarm in broken]
    balance = balance_of(laws, states, in_effect)
    remarks = remarks_on_protein(minute, dict(zip(laws.names, states, strict=True)))
    remarks += remarks_on_measurements(engine.timelines[member], outputs)
    attributes = attributes_of(
        engine.timelines[member], engine.policy, message, balance, sentences, ahead, remarks
    )
    return result.assign_attrs(
        attributes,
        alarms=alarms_text(broken),
        settling_s=settling,
        beat_by_beat=0,
        spans=json.dumps([span.as_object() for span in history.spans]),
        steps=len(history.times),
        beats=history.beats,
        solves=history.solves,
    )


def _early_end_text(stopped: str, minute: np.ndarray) -> str:
    """Reason and time of an early end; empty if the course reached its end."""
    if not stopped:
        return ""
    return f"stopped at {clock_time(minute[-1])}: {stopped}" if len(minute) else f"not begun: {stopped}"


def _skipped_transients_text(history: History) -> list[str]:
    """Sentences on sudden changes that could not be followed beat by beat, with the reason."""
    if not history.skipped_transients:
        return []
    times = ", ".join(clock_time(event.time / MINUTE) for event in history.skipped_transients[:MOST_SPANS])
    more = len(history.skipped_transients) - MOST_SPANS
    times += f" and at {more} more" if more > 0 else ""
    first = history.skipped_transients[0]
    return [
        f"not followed beat by beat at {times}, although {first.reason}, because {first.refusal}: steady "
        "beats change at once, but a patient needs seconds to minutes"
    ]


def _unsettled_spans(history: History) -> list[str]:
    """Sentences on beat-by-beat spans that ended before the patient had settled."""
    return [
        f"the patient was followed beat by beat from {clock_time(span.begin / MINUTE)} to "
        f"{clock_time(span.end / MINUTE)} and had not settled then: from there steady beats run ahead"
        for span in history.spans
        if not (span.settled or history.stopped) and span.end < history.times[-1] - SHORTEST_STEP_S
    ]


def _sudden_gas_change(
    time: np.ndarray, outputs: Mapping[str, np.ndarray], engine: Engine, member: int, by_beat: np.ndarray
) -> list[str]:
    """A warning about the first event at which steady beats change gases faster than blood is renewed.

    Ramps are compared with the time in which blood is renewed. Where beats may be followed one by one, this
    comparison was made before.
    """
    timeline, settling = engine.timelines[member], max(engine.settling_s[member], BLOOD_RENEWAL_S)
    gases = {n: values for n, values in watched_gases(outputs).items() if np.isfinite(values).all()}
    for change in timeline.changes:
        ramp = change.end > change.begin
        if ramp and engine.options.hand_over:
            continue
        passed = settling if ramp else BEFORE_S
        during = (time >= change.begin - ROUNDED_S) & (time <= change.end + ROUNDED_S)
        for k in np.flatnonzero(during & ~by_beat):
            before = {n: float(np.interp(time[k] - passed, time, column)) for n, column in gases.items()}
            if not ramp and change.begin == 0.0:
                before = engine.at_rest[member]
            now = {n: float(column[k]) for n, column in gases.items()}
            distance, words = largest_gas_change(before, now, 1.0)
            if distance > 1.0:
                within = f"within {settling:.0f} s" if ramp else "at once"
                return [
                    f"at {clock_time(time[k] / MINUTE)} steady beats run ahead: {words} {within}, which "
                    "takes a minute or more; follow these minutes beat by beat"
                ]
    return []


def _fast_slow_states(history: History, laws: Laws, settling: float) -> list[str]:
    """Warnings where slow states change while the circulation still settles: steady beats are too early."""
    lags = [np.abs(rates) * settling / laws.scales for rates in history.rates]
    steady = [k for k, t in enumerate(history.times) if not any(s.begin <= t < s.end for s in history.spans)]
    over = [k for k in steady if lags[k].max(initial=0.0) > LARGEST_LAG]
    if not over:
        return []
    worst = max(over, key=lambda k: lags[k].max())
    state = laws.states[int(lags[worst].argmax())]
    amount = lags[worst].max() * state.scale
    return [
        f"from {clock_time(history.times[over[0]] / MINUTE)} {state.words} changes by {amount:.0f} "
        f"{state.unit} in the {settling:.0f} s in which the circulation settles: steady beats run ahead "
        "of the patient; follow these minutes beat by beat"
    ]
