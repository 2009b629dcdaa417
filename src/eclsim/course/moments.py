"""The moments of a course that are shown: slow states between steps, and their steady beats as a batch."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from eclsim.circuit.network import Circuit
from eclsim.course.engine import SHORTEST_STEP_S, Engine
from eclsim.course.handover import History, Span
from eclsim.course.predictor import anchor_at
from eclsim.course.rosenbrock import between
from eclsim.course.timeline import BEFORE_S
from eclsim.course.trapped import KnownBlood, isolated_parts, with_blood_of
from eclsim.devices.description import Finding
from eclsim.orbit.equation import Anchor, OrbitOptions
from eclsim.orbit.execution import Execution
from eclsim.orbit.status import Status
from eclsim.orbit.steady import Batch
from eclsim.outputs.gas import of_moving_blood
from eclsim.outputs.signals import output_names
from eclsim.outputs.steady_beat import SteadyBeat, steady_beat

MOMENTS_PER_BATCH = 2048
"""Largest number of moments whose beats are solved as one batch."""
SOLVED = (int(Status.CONVERGED), int(Status.ONE_OF_MANY))
QUICK_SEARCH = OrbitOptions(newton_iterations=0)
"""Options of the first search for all moments; those not solved are solved one after the other."""


DECIMALS, ROUNDED_S = 6, 1e-6
"""Decimals to which times of moments [s] are rounded, and allowance for this rounding [s]."""


@dataclass
class Moments:
    """Moments of several members in one sequence.

    Attributes:
        member: index of the member of each moment.
        segment: segment of the member's timeline.
        time: time [s].
        states: slow states, shape (states, moments).
        in_effect: parameters, by key.
        values: outputs by name; filled in by `beats_at`, like the attributes below.
        status: how the search for each beat ended, a `Status`.
        findings: findings about each beat.
        blood: where the blood is in each beat (of a point: between the steps), None where it is not known.
        by_beat: whether each is a beat of a span that was followed beat by beat.
        stopped: by member, the reason for an early end of its course; empty if there was none.
    """

    member: np.ndarray
    segment: np.ndarray
    time: np.ndarray
    states: np.ndarray
    in_effect: dict[str, np.ndarray]
    points: list[np.ndarray | None]
    values: dict[str, np.ndarray] = field(default_factory=dict)
    status: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=int))
    findings: list[list[Finding]] = field(default_factory=list)
    blood: list[KnownBlood | None] = field(default_factory=list)
    by_beat: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    stopped: list[str] = field(default_factory=list)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the outputs."""
        return tuple(self.values)

    def of(self, member: int) -> np.ndarray:
        """Indices of a member's moments up to the end of its course, in order of time."""
        places = np.flatnonzero(self.member == member)
        places = places[np.argsort(self.time[places], kind="stable")]
        return places[np.isin(self.status[places], SOLVED)] if len(self.status) else places

    def values_in_effect(self, place: int) -> dict[str, float]:
        """Parameters at a moment, by key."""
        return {key: float(column[place]) for key, column in self.in_effect.items()}


def moments_of(engine: Engine, histories: Sequence[History], every: Sequence[float]) -> Moments:
    """Return the moments of all members, at the interval `every` [s] of each and at every event."""
    rows = [
        _moments_of(engine, m, history, _moment_times(engine, m, history, every[m]))
        for m, history in enumerate(histories)
    ]
    return _joined(engine, rows)


class AtMoment(NamedTuple):
    """What determines the beat of a moment.

    Attributes:
        circuit: the circuit.
        values: its parameters.
        blood: where the blood is, or was shortly before; None if the course does not determine it.
    """

    circuit: Circuit
    values: dict[str, float]
    blood: KnownBlood | None


def in_effect_at(engine: Engine, moments: Moments, member: int, time: float) -> AtMoment:
    """Circuit, parameters and known blood of a member at any time [s] that it has passed."""
    row = _moments_of(engine, member, engine.histories[member], np.array([time]))
    moment, before = _joined(engine, [row]), [k for k in moments.of(member) if moments.time[k] <= time]
    blood = moment.blood[0] or (moments.blood[before[-1]] if before else None)
    return AtMoment(engine.circuits[member][moment.segment[0]], moment.values_in_effect(0), blood)


def _moment_times(engine: Engine, member: int, history: History, every: float) -> np.ndarray:
    """Times [s] of a member's moments."""
    timeline = engine.timelines[member]
    if not history.times:
        return np.zeros(0)
    end = history.times[-1]
    regular = np.arange(0.0, end + 1e-9, every)
    breaks = timeline.breaks[timeline.breaks <= end]
    sudden = [c.begin - BEFORE_S for c in timeline.changes if c.end == c.begin and 0.0 < c.begin <= end]
    spans = history.spans
    behind = [span.end for span in spans if span.end <= end]
    moments = np.unique(np.round(np.concatenate([regular, breaks, sudden, [end], behind]), DECIMALS))
    within = [(moments >= span.begin) & (moments < span.end - ROUNDED_S) for span in spans]
    return moments[~np.any(within, axis=0)] if spans else moments


class _Row(NamedTuple):
    """Member, segment, time, slow states, start points and known blood of one member's moments."""

    member: np.ndarray
    segment: np.ndarray
    time: np.ndarray
    states: np.ndarray
    points: list[np.ndarray | None]
    blood: list[KnownBlood | None]


def _moments_of(engine: Engine, member: int, history: History, time: np.ndarray) -> _Row:
    """The moments of one member at given times [s]."""
    segments, states, points = [], np.zeros((len(engine.laws.states), len(time))), list[np.ndarray | None]()
    blood = list[KnownBlood | None]()
    for k, now in enumerate(time):
        right = max(bisect_right(history.times, now + ROUNDED_S) - 1, 0)
        left, ahead = right, min(right + 1, len(history.times) - 1)
        segments.append(history.segments[left])
        ends = history.times[left], history.times[ahead]
        if ends[1] > ends[0]:
            pair = (history.states[left], history.states[ahead])
            slopes = (history.rates[left], history.rates[ahead])
            states[:, k] = between(np.array([now]), ends, pair, slopes)[:, 0]
        else:
            states[:, k] = history.states[left]
        points.append(_point(history, left, ahead, now))
        blood.append(_known_blood(history, left, ahead))
    return _Row(np.full(len(time), member), np.array(segments, dtype=int), time, states, points, blood)


def _known_blood(history: History, left: int, ahead: int) -> KnownBlood | None:
    """Where the blood is between two steps; None if it is not known at the first."""
    first, second = history.blood[left], history.blood[ahead]
    if first is None or second is None or first.isolated != second.isolated:
        return first
    return first._replace(later=second.state)


def _point(history: History, left: int, ahead: int, now: float) -> np.ndarray | None:
    """Interpolate the point of the beat between two steps, if both ends have one."""
    a, b = history.points[left], history.points[ahead]
    begin, end = history.times[left], history.times[ahead]
    if a is None or b is None or len(a) != len(b) or end <= begin:
        return a
    return a + (now - begin) / (end - begin) * (b - a)


def _joined(engine: Engine, rows: Sequence[_Row]) -> Moments:
    member, segment, time = (np.concatenate(parts) for parts in zip(*(row[:3] for row in rows), strict=True))
    states = np.concatenate([row.states for row in rows], axis=1)
    settings = [
        engine.timelines[m].settings(int(s), float(t)) for m, s, t in zip(member, segment, time, strict=True)
    ]
    keys = dict.fromkeys((*engine.table, *(key for of_moment in settings for key in of_moment)))
    columns = {key: np.array([of_moment.get(key, 0.0) for of_moment in settings]) for key in keys}
    points = [point for row in rows for point in row.points]
    blood = [known for row in rows for known in row.blood]
    in_effect = engine.laws.in_effect(states, columns)
    return Moments(member, segment, time, states, in_effect, points, blood=blood)


def beats_at(
    moments: Moments,
    engine: Engine,
    outputs: Sequence[str] | None,
    with_findings: bool,
    execution: Execution | None,
) -> None:
    """Compute the beat of every moment; a member's course ends where no steady beat is found."""
    count, members = len(moments.time), len(engine.timelines)
    moments.status = np.full(count, int(Status.NOT_CONVERGED))
    moments.findings = [[] for _ in range(count)]
    moments.stopped = [history.stopped for history in engine.histories]
    measure = _MomentSolver(moments, engine, outputs, with_findings, execution or engine.execution)
    groups: dict[int, list[int]] = {}
    for k in range(count):
        groups.setdefault(id(engine.circuits[moments.member[k]][moments.segment[k]]), []).append(k)
    for group in groups.values():
        for k in range(0, len(group), MOMENTS_PER_BATCH):
            chosen = np.array(group[k : k + MOMENTS_PER_BATCH])
            measure.solve(chosen, QUICK_SEARCH, _start(moments, engine, chosen))
    for member in range(members):
        measure.finish(member)
    moments.by_beat = np.zeros(len(moments.time), dtype=bool)
    for member, history in enumerate(engine.histories):
        for span in history.spans:
            _add_span(moments, engine, member, span, with_findings)


def _add_span(moments: Moments, engine: Engine, member: int, span: Span, with_findings: bool) -> None:
    """Insert the beats of a span after the moments of steady beats, up to the end of the course."""
    places, history, stopped = moments.of(member), engine.histories[member], moments.stopped[member]
    within = stopped == history.stopped and history.times[-1] <= span.begin
    last = moments.time[places[-1]] if len(places) and stopped and not within else np.inf
    beats = [beat for beat in span.beats if beat.time <= last]
    if not beats:
        return
    count, (columns, beat_findings) = len(beats), span.march.measured(beats)
    segments = [engine.timelines[member].segment_at(beat.time) for beat in beats]
    moments.member = np.concatenate([moments.member, np.full(count, member)])
    moments.segment = np.concatenate([moments.segment, segments])
    moments.time = np.concatenate([moments.time, [beat.time for beat in beats]])
    moments.states = np.concatenate([moments.states, np.stack([beat.slow for beat in beats], -1)], axis=1)
    moments.status = np.concatenate([moments.status, np.full(count, int(Status.CONVERGED))])
    moments.by_beat = np.concatenate([moments.by_beat, np.ones(count, dtype=bool)])
    moments.points += [None] * count
    moments.blood += [None] * count
    for key, column in moments.in_effect.items():
        added = np.array([beat.values.get(key, 0.0) for beat in beats])
        moments.in_effect[key] = np.concatenate([column, added])
    for name, column in moments.values.items():
        added = columns.get(name, np.full(count, np.nan))
        moments.values[name] = np.concatenate([column, added])
    moments.findings += beat_findings if with_findings else [[] for _ in beats]
    if not span.settled and history.times[-1] - span.end <= SHORTEST_STEP_S:
        _use_last_beats_at_end(moments, places[moments.time[places] > span.end - ROUNDED_S])


def _use_last_beats_at_end(moments: Moments, last: np.ndarray) -> None:
    """Replace the last moments by the last beat if a course ends before it has settled."""
    moments.by_beat[last] = True
    for column in moments.values.values():
        column[last] = column[-1]
    for place in last:
        moments.findings[place] = moments.findings[-1]


@dataclass(frozen=True)
class _MomentSolver:
    """Computes the beats of moments and stores their outputs."""

    moments: Moments
    engine: Engine
    outputs: Sequence[str] | None
    with_findings: bool
    execution: Execution

    def solve(
        self, chosen: np.ndarray, options: OrbitOptions | None, start: Mapping[str, float] | Anchor | None
    ) -> bool:
        """Solve the beats of moments that share a circuit; returns whether the first one was found."""
        moments, engine = self.moments, self.engine
        circuit = engine.circuits[moments.member[chosen[0]]][moments.segment[chosen[0]]]
        values = {key: column[chosen] for key, column in moments.in_effect.items()}
        has = output_names(circuit)
        beat = steady_beat(
            Batch(circuit, values, len(chosen), engine.policy),
            has if self.outputs is None else [name for name in self.outputs if name in has],
            waveforms=None if self.with_findings else (),
            options=options,
            start=start,
            execution=self.execution,
        )
        moments.status[chosen] = beat.status
        for name, computed in of_moving_blood({n: beat.output(n) for n in beat.names}).items():
            column = moments.values.setdefault(name, np.full(len(moments.time), np.nan))
            column[chosen] = computed
        for k, place in enumerate(chosen.tolist()):
            if not beat.converged[k]:
                engine.messages[moments.member[place]] = beat.message(k)
                continue
            found, at = self._with_known_blood(beat, k, place)
            if found is not beat:
                for name, value in of_moving_blood(found.outputs(at)).items():
                    if name in moments.values:
                        moments.values[name][place] = value
            self._store(place, found, at)
        return bool(beat.converged[0])

    def _with_known_blood(self, beat: SteadyBeat, place: int, moment: int) -> tuple[SteadyBeat, int]:
        """A moment's beat; where valves stay shut, with the blood behind them as it was before."""
        if beat.determined[place]:
            return beat, place
        known, member = self.moments.blood, self.moments.member
        before = known[moment]
        if before is None and moment and member[moment - 1] == member[moment]:
            before = known[moment - 1]

        def solve(batch: Batch, start: Anchor) -> SteadyBeat:
            signals, alone = None if self.with_findings else (), replace(self.execution, width=1)
            return steady_beat(batch, beat.names, waveforms=signals, start=start, execution=alone)

        inverses = self.engine.predictors[int(member[moment])].holding
        return with_blood_of(beat, place, before, solve, inverses) or (beat, place)

    def _store(self, moment: int, beat: SteadyBeat, place: int) -> None:
        """Store how a moment's beat was found, and remove numbers that are not determined."""
        moments = self.moments
        for name in beat.undetermined_outputs(place):
            if name in moments.values:
                moments.values[name][moment] = np.nan
        moments.status[moment] = beat.status[place]
        circuit = self.engine.circuits[moments.member[moment]][moments.segment[moment]]
        state = beat.orbits.states[:, place]
        known = KnownBlood(circuit, state, isolated_parts(beat, place)) if beat.determined[place] else None
        moments.blood[moment] = known
        if self.with_findings:
            moments.findings[moment] = beat.determined_findings(place)

    def finish(self, member: int) -> None:
        """Search beats not found at once from the previous moment; without a beat the course ends.

        The last moment with a steady beat is then found by bisection.
        """
        moments = self.moments
        places = np.flatnonzero(moments.member == member)
        for k, place in enumerate(places):
            if moments.status[place] in SOLVED:
                continue
            before = None if k == 0 else moments.values_in_effect(places[k - 1])
            if self.solve(np.array([place]), None, before):
                continue
            moments.stopped[member] = moments.stopped[member] or self.engine.messages[member]
            moments.status[places[k:]] = int(Status.NOT_CONVERGED)
            if k:
                self._move_last_moment(member, int(places[k - 1]), int(place))
            return

    def _move_last_moment(self, member: int, good: int, bad: int) -> None:
        """Replace the first moment without a steady beat by the last one that has a steady beat."""
        moments, history = self.moments, self.engine.histories[member]
        low, high = float(moments.time[good]), float(moments.time[bad])
        before = moments.values_in_effect(good)
        while high - low > 2.0 * SHORTEST_STEP_S:
            middle = 0.5 * (low + high)
            trial = _joined(self.engine, [_moments_of(self.engine, member, history, np.array([middle]))])
            trial.status, trial.findings = np.zeros(1, dtype=int), [[]]
            if not replace(self, moments=trial).solve(np.zeros(1, dtype=int), None, before):
                high, moments.stopped[member] = middle, self.engine.messages[member]
                continue
            low, before = middle, trial.values_in_effect(0)
            _replace_moment(moments, bad, trial)


def _start(moments: Moments, engine: Engine, chosen: np.ndarray) -> Anchor | None:
    """Start points for the searches of some moments; None if any is unknown."""
    points = [point for k in chosen if (point := moments.points[k]) is not None]
    if len(points) < len(chosen):
        return None
    return anchor_at(points, [engine.predictors[moments.member[k]] for k in chosen])


def _replace_moment(moments: Moments, place: int, other: Moments) -> None:
    """Replace a moment that has no beat by another."""
    moments.time[place], moments.segment[place] = other.time[0], other.segment[0]
    moments.states[:, place], moments.status[place] = other.states[:, 0], other.status[0]
    moments.findings[place], moments.blood[place] = other.findings[0], other.blood[0]
    for key, column in moments.in_effect.items():
        column[place] = other.in_effect[key][0]
    for name, column in moments.values.items():
        column[place] = other.values[name][0] if name in other.values else np.nan
