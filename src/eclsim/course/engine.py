"""Slow states of one or many patients over hours, each rate that of a steady beat.

The heart settles within a minute or two of any change, slow states change over many: their rates are taken at
the steady beat of the moment (averaging over the fast scale). Each member has steps and times of its own; all
members' beats of a stage are solved as one batch.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from eclsim.arguments import FiniteNumber, Kind, OneOf, check_fields, flag
from eclsim.circuit.assembly import assemble
from eclsim.circuit.network import Circuit
from eclsim.course.beats import BeatMarch, Moving, shift_ml
from eclsim.course.handover import (
    GASES_MOVE,
    LONGEST_RAMP,
    LONGEST_SPAN_S,
    NO_STEADY_BEAT,
    RECONNECTED,
    TO_THE_END_S,
    Ahead,
    Event,
    Goal,
    PassedOver,
    Span,
    farthest,
    follow_until_settled,
    lag_of,
    lungs_s,
    reason_of,
    shares_of,
)  # fmt: skip
from eclsim.course.laws import Laws
from eclsim.course.predictor import Predictor, anchor_at, point_of
from eclsim.course.rosenbrock import step
from eclsim.course.timeline import START, Timeline
from eclsim.course.watch import Watch
from eclsim.gas.network import GasStatus
from eclsim.orbit.equation import Anchor, OrbitOptions
from eclsim.orbit.execution import SIDE_BY_SIDE, Execution
from eclsim.orbit.steady import Batch
from eclsim.outputs.signals import output_names
from eclsim.outputs.steady_beat import SteadyBeat, steady_beat
from eclsim.slow import INFLOWS

SHORTEST_S = 5.0
"""Step below which a moment without a steady beat ends a course."""
FIRST_S, FIRST_SHARE = 20.0, 0.5
"""Shortest first step behind an event; share of the length at which the third derivative is felt."""
LONGEST_S = 3600.0
MANY = 16
"""From so many members on, the program for many side by side is worth its compilation."""
TRIES, SAME_MMHG = 4, 0.01
"""Of blood and its stores of carbon dioxide until both say the same arterial PCO2."""
SHIFT = 0.3
"""Of a state for its column of the Jacobian, of its scale."""


@dataclass(frozen=True, kw_only=True)
class CourseOptions:
    """How a course is computed.

    Args:
        tolerance: error of a slow state in a step, of its scale (`SlowState`).
        step_s: fixed length of steps [s]; left out, steps follow from the error.
        orbits: accuracy of the beats between which rates are taken.
        predictor: where a beat's search begins: "secant" (on from the last beat by a slope that starts as the
            derivative at the last event and learns from beat to beat), "derivative" (that alone), or "last".
        hand_over: whether the course is followed beat by beat where an event leaves the circulation no time
            to settle (`eclsim.course.handover`).
    """

    tolerance: float = 0.1
    step_s: float | None = None
    orbits: OrbitOptions = field(default_factory=lambda: OrbitOptions(1e-7, 1e-6))
    predictor: str = "secant"
    hand_over: bool = True

    def __post_init__(self) -> None:
        check_fields(
            self,
            tolerance=FiniteNumber(above=0.0),
            step_s=FiniteNumber(above=0.0, unit="s"),
            orbits=Kind(OrbitOptions, "eclsim.OrbitOptions(...)"),
            predictor=OneOf(("secant", "derivative", "last")),
            hand_over=flag,
        )


@dataclass
class History:
    """A member's slow states at the ends of its steps.

    Attributes:
        segments: which segment of its timeline each step belongs to.
        times: ends of steps [s], the first of a segment at its beginning.
        states: at these, each of shape (states,).
        rates: likewise, per second.
        points: of the steady beat there (`Predictor`); None where no law reads the beat.
        stopped: why it ended early; empty where it did not.
        beats: computed for it.
        solves: steady beats searched for.
        spans: that were followed beat by beat.
        passed_over: what would have been, had nothing been in the way.
    """

    segments: list[int] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    states: list[np.ndarray] = field(default_factory=list)
    rates: list[np.ndarray] = field(default_factory=list)
    points: list[np.ndarray | None] = field(default_factory=list)
    stopped: str = ""
    beats: int = 0
    solves: int = 0
    spans: list[Span] = field(default_factory=list)
    passed_over: list[PassedOver] = field(default_factory=list)


class Engine:
    """Marches members through their timelines.

    Args:
        timelines: of the members, with the same laws.
        laws: of the slow states.
        policy: blood volume policy.
        options: accuracy.
        execution: how batches are computed.
        watch: what ends a member's march early; None for nothing.

    Attributes:
        at_rest: gases of each member before events at minute 0, as far as they are in `GASES_MOVE`.
    """

    def __init__(
        self,
        timelines: Sequence[Timeline],
        laws: Laws,
        policy: str,
        options: CourseOptions,
        execution: Execution | None = None,
        watch: Watch | None = None,
    ):
        self.timelines, self.laws, self.policy = timelines, laws, policy
        self.options, self.watch = options, watch
        self.execution = execution or Execution(width=SIDE_BY_SIDE if len(timelines) >= MANY else 1)
        count, size = len(timelines), len(laws.states)
        self.circuits = canonical_circuits(timelines)
        self.segment = np.full(count, START)
        self.time = np.zeros(count)
        self.length = np.full(count, options.step_s or FIRST_S)
        self.states, self.slopes = np.zeros((size, count)), np.zeros((size, count))
        self.jacobian = np.zeros((count, size, size))
        further = _gases_read(self.circuits) if watch is None else watch.outputs
        self.reads = tuple(dict.fromkeys((*laws.reads, *further)))
        self.predictors = [Predictor(options.predictor) for _ in timelines]
        self.histories = [History() for _ in timelines]
        self.messages = [""] * count
        self.table = {key: np.zeros(count) for timeline in timelines for key in timeline.start[1]}
        self.inflow = {kind: np.zeros(count) for kind in INFLOWS}
        self.settling_s = [0.0] * count
        self.noted = [predictor.noted() for predictor in self.predictors]
        self.at_rest = [dict[str, float]() for _ in timelines]

    def march(self) -> list[History]:
        """From the start, the beat before events at minute 0, to the end of every member."""
        everyone = np.arange(len(self.timelines))
        for member in range(len(everyone)):
            self._settle(member)
        settings = self._settings(everyone, self.time)
        beat, solved = self._solve(everyone, settings, None)
        self.at_rest = [{n: p.read[n] for n in GASES_MOVE if n in p.read} for p in self.predictors]
        self.states[:] = self.laws.start(settings, beat)
        self.segment[:] = 0
        for member in range(len(everyone)):
            self._settle(member)
        running = self._enter(everyone[solved])
        self.settling_s = [predictor.settling_s for predictor in self.predictors]
        self._stop(everyone[~solved])
        while len(running := self._unbroken(running)):
            running = self._advance(running)
        return self.histories

    def _unbroken(self, who: np.ndarray) -> np.ndarray:
        """Those of some members whose march is not over by what is watched."""
        watch = self.watch
        over = [m for m in who if watch and watch.is_over(m, float(self.time[m]), self.noted[m].read)]
        for m in over:
            self.histories[m].stopped = Watch.reason
        return np.setdiff1d(who, over)

    def _advance(self, who: np.ndarray) -> np.ndarray:
        """One step of some members; those who go on."""
        ends = np.array([self.timelines[m].breaks[self.segment[m] + 1] for m in who])
        to_end = ends - self.time[who]
        planned = self.length[who]
        length = np.where(
            planned >= 0.999 * to_end, to_end, np.where(planned > 0.5 * to_end, 0.5 * to_end, planned)
        )

        def rates(time: np.ndarray, states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            return self._rates(who, time, states)

        result = step(
            rates, self.slopes[:, who], self.time[who], self.states[:, who], length, self.jacobian[who]
        )
        error = np.abs(result.error / self.laws.scales[:, None]).max(axis=0) / self.options.tolerance
        fine = result.done & np.isfinite(error)
        accepted = fine & ((error <= 1.0) | (self.options.step_s is not None) | (length <= SHORTEST_S))
        time = np.where(length == to_end, ends, self.time[who] + length)
        slopes = np.full_like(result.states, np.nan)
        if accepted.any():
            after, solved = self._rates(who[accepted], time[accepted], result.states[:, accepted])
            slopes[:, accepted] = after
            without = np.flatnonzero(accepted)[~solved]
            accepted[without], fine[without] = False, False
        hurried = self._hurried(who[accepted], length[accepted])
        accepted &= ~np.isin(who, list(hurried))
        self._adapt(who, length, error, fine, accepted)
        advanced = who[accepted]
        self.time[advanced], self.states[:, advanced] = time[accepted], result.states[:, accepted]
        self.slopes[:, advanced] = slopes[:, accepted]
        self._note(advanced)
        lost = who[~fine & ~(length > SHORTEST_S)]
        carried = self._carried_over(lost, hurried)
        lost = np.union1d(lost, list(hurried)).astype(int)
        self._stop(np.setdiff1d(lost, carried))
        over = advanced[self.time[advanced] >= ends[accepted]]
        self.segment[over] += 1
        further = np.array([m for m in over if self.segment[m] + 1 < len(self.timelines[m].breaks)], int)
        for member in further:
            self._settle(member)
        entered = self._enter(further)
        remain = np.setdiff1d(who, np.concatenate([over, lost]))
        return np.sort(np.concatenate([remain, entered, carried])).astype(int)

    def _may_leave_ramp(self, member: int) -> bool:
        """Whether a member is on a ramp, which may be followed beat by beat."""
        ramp_end = self.timelines[member].ramp_end(int(self.segment[member]))
        return self.options.hand_over and ramp_end > float(self.time[member])

    def _hurried(self, who: np.ndarray, length: np.ndarray) -> dict[int, Event]:
        """Those whose steady gases ran ahead of the blood in a step of a ramp, back at the beat before it."""
        events: dict[int, Event] = {}
        for m, of_step in zip(who, length, strict=True):
            if not self._may_leave_ramp(m):
                continue
            predictor, ahead = self.predictors[m], self._ahead(m, self._circuit(m))
            shares = shares_of(predictor.settling_s, self._lungs_s(m, float(of_step)), float(of_step))
            before = {name: self.noted[m].read[name] for name in ahead.gases}
            if farthest(before, ahead.gases, shares[1])[0] > 1.0:
                predictor.back_to(self.noted[m])
                here = self._ahead(m, self._circuit(m))
                events[int(m)] = Event(predictor.beat, here.gases, here.volumes, ahead, *shares)
        return events

    def _carried_over(self, lost: np.ndarray, hurried: Mapping[int, Event]) -> np.ndarray:
        """Those whose steady beat a ramp took away or too far, followed beat by beat until they are there."""
        carried: list[int] = []
        for m in lost:
            if not self._may_leave_ramp(m):
                continue
            here = self._ahead(m, self._circuit(m))
            event = Event(self.predictors[m].beat, here.gases, here.volumes, None, 1.0, 1.0)
            if self._followed(m, event, has_beat=False, of=int(self.segment[m])):
                carried.append(m)
        for m, event in hurried.items():
            if self._followed(m, event, has_beat=True, of=int(self.segment[m])):
                carried.append(m)
        return self._go_on(np.array(carried, dtype=int))

    def _adapt(
        self, who: np.ndarray, length: np.ndarray, error: np.ndarray, fine: np.ndarray, accepted: np.ndarray
    ) -> None:
        """Lengths of the next steps; a moment without a steady beat is approached by halves."""
        if self.options.step_s is not None:
            self.length[who] = np.where(accepted, self.options.step_s, 0.5 * length)
            return
        with np.errstate(divide="ignore", invalid="ignore"):
            factor = np.clip(0.85 * error ** (-1.0 / 3.0), 0.2, 4.0)
        factor = np.where(fine, np.where(np.isfinite(factor), factor, 4.0), 0.4)
        self.length[who] = np.clip(length * factor, SHORTEST_S, LONGEST_S)

    def _settle(self, member: int) -> None:
        """Put the settings of a member's segment into the tables."""
        timeline, segment = self.timelines[member], int(self.segment[member])
        for key, value in timeline.settings(segment, float(self.time[member])).items():
            self.table.setdefault(key, np.zeros(len(self.timelines)))[member] = value
        for kind, rate in timeline.inflows(segment).items():
            self.inflow[kind][member] = rate

    def _enter(self, who: np.ndarray) -> np.ndarray:
        """Begin a segment: rates and their Jacobian there; those who have a steady beat."""
        if not len(who):
            return who
        events = [self._event(m) for m in who] if self.options.hand_over else []
        self.slopes[:, who], solved = self._rates(who, self.time[who], self.states[:, who])
        events = events or [None] * len(who)
        without_beat = [
            m for m, event, has_beat in zip(who, events, solved, strict=True)
            if not (has_beat if event is None else self._followed(m, event, has_beat))
        ]  # fmt: skip
        self._stop(np.array(without_beat, dtype=int))
        return self._go_on(np.setdiff1d(who, without_beat))

    def _go_on(self, who: np.ndarray) -> np.ndarray:
        """Those who have a steady beat, with the Jacobian of their rates and a length of the next step."""
        if len(who):
            self._differentiate(who)
        self._note(who)
        if self.options.step_s is None:
            self.length[who] = self._first_lengths(who)
        return who

    def _first_lengths(self, who: np.ndarray) -> np.ndarray:
        """Lengths of first steps behind events, from the third derivative J^2 f of slow states y' = f."""
        jacobian, slopes = self.jacobian[who], self.slopes[:, who].T
        third = np.einsum("mij,mjk,mk->mi", jacobian, jacobian, slopes)
        size = np.abs(third / self.laws.scales).max(axis=1, initial=0.0)
        with np.errstate(divide="ignore"):
            length = FIRST_SHARE * np.cbrt(6.0 * self.options.tolerance / size)
        return np.clip(length, FIRST_S, LONGEST_S)

    def _event(self, member: int) -> Event | None:
        """What a member comes from as a segment begins; None where nothing happens at minute 0."""
        predictor, segment, time = (
            self.predictors[member],
            int(self.segment[member]),
            float(self.time[member]),
        )
        timeline = self.timelines[member]
        nothing = not segment and not timeline.begins_at_once
        if nothing or predictor.point is None or predictor.circuit is None:
            return None
        before, shares = self._ahead(member, predictor.circuit), (1.0, 1.0)
        reconnected = any(self._circuit(member) is not circuit for circuit in self.circuits[member])
        refusal, beat, ahead = RECONNECTED if reconnected else "", predictor.beat, None
        length = timeline.ramp_end(segment) - time
        lungs = self._lungs_s(member, length)
        if 0.0 < length <= max(LONGEST_RAMP * predictor.settling_s, min(lungs, LONGEST_SPAN_S)):
            who = np.array([member])
            solved = self._rates(who, np.array([time + length]), self.states[:, who])[1]
            ahead = self._ahead(member, self._circuit(member)) if solved[0] else None
            shares = shares_of(predictor.settling_s, lungs, length)
        return Event(beat, before.gases, before.volumes, ahead, *shares, refusal)

    def _lungs_s(self, member: int, length: float) -> float:
        """In which the gas of a member's lungs is renewed once so many seconds have passed [s]."""
        timeline, segment, time = self.timelines[member], int(self.segment[member]), float(self.time[member])
        return lungs_s(timeline.settings(segment, time), timeline.settings(segment, time + length))

    def _ahead(self, member: int, circuit: Circuit) -> Ahead:
        """What a member's last beat, which was of that circuit, has of blood and gases."""
        predictor = self.predictors[member]
        volumes = predictor.state[assemble(circuit).layout.volumes.where]
        names = (c.name for c in circuit.compartments)
        gases = {name: predictor.read[name] for name in GASES_MOVE if name in predictor.read}
        return Ahead(dict(zip(names, volumes.tolist(), strict=True)), gases)

    def _reason(self, member: int, event: Event) -> str:
        """Why the beats behind an event are followed, in words; empty where they need not be."""
        settling, rates = self.predictors[member].settling_s, self.slopes[:, member]
        now = event.ahead or self._ahead(member, self._circuit(member))
        shift = event.share * shift_ml(event.volumes, now.volumes)
        gases = farthest(event.gases, now.gases, event.gas_share)
        return reason_of(shift, lag_of(rates, settling, self.laws), gases, rates, settling, self.laws)

    def _followed(self, member: int, event: Event, has_beat: bool, of: int | None = None) -> bool:
        """Follow a member beat by beat where steady beats would pass over too much; whether it goes on.

        Args:
            member: which.
            event: what it comes from.
            has_beat: whether there is a steady beat now.
            of: segment of the steady beat that it comes from; left out, the one before.
        """
        settling = self.predictors[member].settling_s
        reason = self._reason(member, event) if has_beat else NO_STEADY_BEAT
        begin, timeline = float(self.time[member]), self.timelines[member]
        end = min(begin + (LONGEST_SPAN_S if has_beat else TO_THE_END_S), timeline.end - SHORTEST_S)
        if not reason or end <= begin:
            return has_beat
        if event.refusal:
            self.histories[member].passed_over.append(PassedOver(begin, reason, event.refusal))
            return has_beat
        self._note(np.array([member]))
        march = BeatMarch(timeline, self.policy, None)
        of = int(self.segment[member]) - 1 if of is None else of
        start = march.from_steady(begin, event.beat, self.states[:, member], of)
        span, at = follow_until_settled(
            march, start, lambda at: self._steady_at(member, at, march), settling, end, reason
        )
        self.histories[member].spans.append(span)
        has_beat = self._steady_at(member, at, march) is not None
        if march.stopped:
            self.messages[member] = march.stopped
        return has_beat and not march.stopped

    def _steady_at(self, member: int, at: Moving, march: BeatMarch) -> Goal | None:
        """The steady beat at what a march beat by beat has come to; the member goes on from there.

        How far the blood has followed the stores of carbon dioxide is what its arterial PCO2 says.
        """
        who, predictor = np.array([member]), self.predictors[member]
        breaks = self.timelines[member].breaks
        self.segment[member] = np.searchsorted(breaks, at.time + 1e-9, side="right") - 1
        self.time[member], self.states[:, member] = at.time, at.slow[:, 0]
        self._settle(member)
        for tries_left in reversed(range(TRIES if self.laws.blood else 1)):
            self.slopes[:, who], solved = self._rates(who, self.time[who], self.states[:, who])
            if not solved[0]:
                return None
            goal = march.steady(at.time, predictor.beat, self.states[:, member].copy())
            behind = march.behind_mmhg(at, goal) if tries_left else 0.0
            if abs(behind) < SAME_MMHG:
                break
            self.states[self.laws.blood, member] += behind
        return Goal(goal, lag_of(self.slopes[:, member], predictor.settling_s, self.laws))

    def _note(self, who: np.ndarray) -> None:
        for m in who:
            history = self.histories[m]
            history.segments.append(int(self.segment[m]))
            history.times.append(float(self.time[m]))
            history.states.append(self.states[:, m].copy())
            history.rates.append(self.slopes[:, m].copy())
            history.points.append(self.predictors[m].point)
            self.noted[m] = self.predictors[m].noted()

    def _stop(self, who: np.ndarray) -> None:
        for m in who:
            self.histories[m].stopped = self.messages[m]

    def _settings(self, who: np.ndarray, time: np.ndarray) -> dict[str, np.ndarray]:
        """Parameters of some members at a time in their segments, by key."""
        values = {key: column[who] for key, column in self.table.items()}
        for k, m in enumerate(who):
            for key, value in self.timelines[m].ramped(int(self.segment[m]), float(time[k])).items():
                values[key][k] = value
        return values

    def _rates(self, who: np.ndarray, time: np.ndarray, states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rates of some members, and which have a steady beat."""
        settings = self._settings(who, time)
        beat, solved = self._solve(who, self.laws.in_effect(states, settings), states, time)
        inflows = {kind: column[who] for kind, column in self.inflow.items()}
        rates = self.laws.rates(states, settings, beat, inflows)
        missing = self.laws.missing(states)
        for k in np.flatnonzero(missing.any(axis=0)):
            first = self.laws.states[int(np.argmax(missing[:, k]))]
            rates[:, k], solved[k] = np.nan, False
            self.messages[who[k]] = f"{first.name} is used up: more is taken or needed than there is"
        for k in np.flatnonzero(solved & ~np.isfinite(rates).all(axis=0)):
            solved[k] = False
            lacking = [name for name in self.laws.reads if not np.isfinite(beat[name][k])]
            self.messages[who[k]] = _without_rates(lacking)
        return rates, solved

    def _differentiate(self, who: np.ndarray) -> None:
        """Jacobians of the rates by differences, and slopes of the beats along the slow states."""
        size, scales = len(self.laws.states), self.laws.scales
        n = len(who)
        members = np.tile(who, size)
        columns = np.repeat(np.arange(size), n)
        states = self.states[:, members].copy()
        shift = SHIFT * scales[columns]
        states[columns, np.arange(len(members))] += shift
        settings = self._settings(members, self.time[members])
        inflows = {kind: column[members] for kind, column in self.inflow.items()}
        values = self.laws.in_effect(states, settings)
        beat = self._beat_of(members)
        if self.laws.reads:
            before = self.laws.in_effect(self.states[:, members], settings)
            moved = np.any([values[key] != before[key] for key in values], axis=0)
            chosen = np.flatnonzero(moved)
            if len(chosen):
                shifted = {key: column[chosen] for key, column in values.items()}
                outputs = self._shifted_beats(members[chosen], columns[chosen], shifted)
                for name in self.laws.reads:
                    beat[name][chosen] = np.where(
                        np.isfinite(outputs[name]), outputs[name], beat[name][chosen]
                    )
        rates = self.laws.rates(states, settings, beat, inflows)
        differences = (rates - self.slopes[:, members]) / shift
        self.jacobian[who] = np.nan_to_num(differences.reshape(size, size, n).transpose(2, 0, 1))

    def _beat_of(self, members: np.ndarray) -> dict[str, np.ndarray]:
        """What the laws read of the last beat of each."""
        return {name: np.array([self.predictors[m].read[name] for m in members]) for name in self.laws.reads}

    def _shifted_beats(
        self, members: np.ndarray, columns: np.ndarray, values: dict[str, np.ndarray]
    ) -> dict[str, np.ndarray]:
        """Beats with one slow state shifted; what is read of them. The predictors learn from them."""
        outputs = {name: np.full(len(members), np.nan) for name in self.laws.reads}
        for chosen in self._alike(members):
            predictors = [self.predictors[m] for m in members[chosen]]
            start = anchor_at([p.last for p in predictors], predictors)
            beat = self._beats(members[chosen], {k: v[chosen] for k, v in values.items()}, start)
            for name in self.laws.reads:
                outputs[name][chosen] = beat.output(name)
            for k, predictor in enumerate(predictors):
                if beat.converged[k]:
                    change = (point_of(beat, k) - predictor.last) / SHIFT
                    predictor.learn(int(columns[chosen[k]]), change)
        return outputs

    def _solve(
        self,
        who: np.ndarray,
        values: dict[str, np.ndarray],
        states: np.ndarray | None,
        time: np.ndarray | None = None,
    ) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """What the laws read of the beats of some members, and which have one."""
        solved = np.ones(len(who), dtype=bool)
        read = {name: np.full(len(who), np.nan) for name in self.laws.reads}
        if not self.laws.reads:
            return read, solved
        for chosen in self._alike(who):
            members = who[chosen]
            predictors = [self.predictors[m] for m in members]
            places = [self._place(m, c, states, time) for m, c in zip(members, chosen, strict=True)]
            circuits = [self._circuit(m) for m in members]
            begun = [p.begun(c) for p, c in zip(predictors, circuits, strict=True)]
            start = None
            if all(begun):
                start = anchor_at([p.guess(x) for p, x in zip(predictors, places, strict=True)], predictors)
            beat = self._beats(members, {key: column[chosen] for key, column in values.items()}, start)
            solved[chosen] = beat.converged & (beat.gas_status == GasStatus.STEADY)
            for name in self.laws.reads:
                read[name][chosen] = beat.output(name)
            for k, (predictor, place) in enumerate(zip(predictors, places, strict=True)):
                m = members[k]
                self.histories[m].beats += int(beat.orbits.beats[k])
                self.histories[m].solves += 1
                if solved[chosen[k]]:
                    predictor.put(beat, k, place, circuits[k])
                else:
                    self.messages[m] = beat.message(k)
        return read, solved

    def _place(
        self, member: int, column: int, states: np.ndarray | None, time: np.ndarray | None
    ) -> np.ndarray:
        """Where a member's beat is: slow states in their scales, and minutes of a ramp."""
        size = len(self.laws.states)
        place = np.zeros(size + 1)
        if states is not None:
            place[:size] = states[:, column] / self.laws.scales
        if time is not None and self.timelines[member].ramped(int(self.segment[member]), time[column]):
            place[size] = time[column] / 60.0
        return place

    def _circuit(self, member: int) -> Circuit:
        return self.circuits[member][self.segment[member]]

    def _alike(self, who: np.ndarray) -> list[np.ndarray]:
        """Positions of members that share a circuit and whether their search has a start."""
        groups: dict[tuple[int, bool], list[int]] = {}
        for k, m in enumerate(who):
            circuit = self._circuit(m)
            groups.setdefault((id(circuit), self.predictors[m].begun(circuit)), []).append(k)
        return [np.array(group) for group in groups.values()]

    def _beats(self, members: np.ndarray, values: dict[str, np.ndarray], start: Anchor | None) -> SteadyBeat:
        batch = Batch(self._circuit(members[0]), values, len(members), self.policy)
        all_read = self.options.hand_over or self.watch is not None or start is None
        reads = self.reads if all_read else self.laws.reads
        last_try = start is None or (self.length[members] <= SHORTEST_S).any()
        options = self.options.orbits if last_try else replace(self.options.orbits, newton_iterations=0)
        return steady_beat(batch, reads, options=options, start=start, execution=self.execution)


def _without_rates(lacking: Sequence[str]) -> str:
    """Why slow states have no rates although a steady beat was found."""
    if not lacking:
        return "what changes slowly has no finite rate"
    return f"the steady beat has no value of {', '.join(lacking)}, by which the course goes on"


def _gases_read(circuits: Sequence[Sequence[Circuit]]) -> list[str]:
    """Those of `GASES_MOVE` that all circuits have."""
    unique = {id(circuit): circuit for of_member in circuits for circuit in of_member}.values()
    shared = set(GASES_MOVE).intersection(*(output_names(circuit) for circuit in unique))
    return [name for name in GASES_MOVE if name in shared]


def canonical_circuits(timelines: Sequence[Timeline]) -> list[list[Circuit]]:
    """The circuit of each segment of each member, at last that of the `START`; equal ones are one object."""
    return [
        [timeline.circuit(k).canonical for k in (*range(len(timeline.breaks) - 1), START)]
        for timeline in timelines
    ]
