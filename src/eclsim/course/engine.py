"""Slow states of one or many patients over hours, with the rates of the steady beat.

The heart settles within a minute or two of any change, while slow states change over many minutes. Their
rates are therefore evaluated at the steady beat of the moment (averaging over the fast scale). Each member
has its own steps and times; the beats of all members in a stage are solved as one batch.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from eclsim.arguments import FiniteNumber, Kind, OneOf, check_fields, flag
from eclsim.circuit.network import Circuit
from eclsim.course.beats import BeatMarch, MarchState, shift_ml, volumes_of
from eclsim.course.handover import (
    LARGEST_GAS_CHANGE,
    LONGEST_FAST_RAMP,
    LONGEST_SPAN_S,
    LONGEST_SPAN_WITHOUT_BEAT_S,
    NO_STEADY_BEAT,
    RECONNECTED,
    BloodState,
    EarlyStop,
    History,
    SkippedTransient,
    StateBeforeEvent,
    SteadyTarget,
    follow_until_settled,
    lag_shares,
    largest_gas_change,
    lung_gas_renewal_s,
    reason_to_follow,
    slow_state_lag,
    watched_gases,
)  # fmt: skip
from eclsim.course.laws import Laws, message_without_rates
from eclsim.course.predictor import Predictor, anchor_at, point_of
from eclsim.course.rosenbrock import step
from eclsim.course.timeline import START, Timeline, canonical_circuits
from eclsim.course.trapped import KnownBlood, with_blood_of
from eclsim.gas.network import GasStatus
from eclsim.orbit.equation import Anchor, OrbitOptions, by_broyden_only
from eclsim.orbit.execution import SIDE_BY_SIDE, Execution
from eclsim.orbit.steady import Batch
from eclsim.outputs.signals import output_names
from eclsim.outputs.steady_beat import SteadyBeat, steady_beat
from eclsim.slow import ALL_GIVEN

SHORTEST_STEP_S = 5.0
"""A moment without a steady beat ends a course if the step is shorter than this [s]."""
SHORTEST_FIRST_STEP_S, FIRST_STEP_SHARE = 20.0, 0.5
"""Shortest first step after an event [s]; share of the length at which the third derivative matters."""
OLDEST_JACOBIAN = 10
"""Steps after which a Jacobian is renewed if they are short; otherwise it serves until the next event."""
LONGEST_STEP_S = 3600.0
FEWEST_SIDE_BY_SIDE = 16
"""From this number of members on, compiling the program for many members side by side pays off."""
PCO2_ITERATIONS, PCO2_TOLERANCE_MMHG = 4, 0.01
"""Limits of the iteration of blood and CO2 stores to the same arterial PCO2: iterations, mmHg."""
DIFFERENCE_STEP = 0.3
"""Step of a state for its column of the Jacobian, relative to the state's scale."""


@dataclass(frozen=True, kw_only=True)
class CourseOptions:
    """Numerical options of a course.

    Args:
        tolerance: allowed error of a slow state in a step, relative to its scale (`SlowState`).
        step_s: fixed length of steps [s]; None for steps that follow from the error.
        orbits: accuracy of the steady beats.
        predictor: start of the search for a beat: "secant" (extrapolated from the last beat with a slope that
            is the derivative at the last event and is updated with each beat), "derivative" (that derivative
            alone) or "last" (the last beat).
        hand_over: whether the course is followed beat by beat after events that leave the circulation no time
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


class Engine:
    """Advances members along their timelines.

    Args:
        timelines: timelines of the members, which have the same laws.
        laws: laws of the slow states.
        policy: blood volume policy.
        options: numerical options.
        execution: how batches are computed.
        early_stop: condition for an early end of a member's course; None for none.

    Attributes:
        at_rest: gases of each member before events at minute 0, as far as they are in `LARGEST_GAS_CHANGE`.
    """

    def __init__(
        self,
        timelines: Sequence[Timeline],
        laws: Laws,
        policy: str,
        options: CourseOptions,
        execution: Execution | None = None,
        early_stop: EarlyStop | None = None,
    ):
        self.timelines, self.laws, self.policy = timelines, laws, policy
        self.options, self.early_stop = options, early_stop
        width = SIDE_BY_SIDE if len(timelines) >= FEWEST_SIDE_BY_SIDE else 1
        self.execution = execution or Execution(width=width)
        count, size = len(timelines), len(laws.states)
        self.circuits = canonical_circuits(timelines)
        self.segment = np.full(count, START)
        self.time = np.zeros(count)
        self.length = np.full(count, options.step_s or SHORTEST_FIRST_STEP_S)
        self.states, self.slopes = np.zeros((size, count)), np.zeros((size, count))
        self.jacobian = np.zeros((count, size, size))
        further = _gases_read(self.circuits) if early_stop is None else early_stop.outputs
        self.reads = tuple(dict.fromkeys((*laws.reads, *further)))
        self.predictors = [Predictor(options.predictor) for _ in timelines]
        self.histories = [History() for _ in timelines]
        self.jacobian_age = np.zeros(count, dtype=int)
        self.messages = [""] * count
        self.table = {key: np.zeros(count) for timeline in timelines for key in timeline.start[1]}
        self.inflow = {kind: np.zeros(count) for kind in ALL_GIVEN}
        self.settling_s = [0.0] * count
        self.snapshots = [predictor.snapshot() for predictor in self.predictors]
        self.at_rest = [dict[str, float]() for _ in timelines]

    def march(self) -> list[History]:
        """Compute all members from the beat before events at minute 0 to their ends."""
        everyone = np.arange(len(self.timelines))
        for member in range(len(everyone)):
            self._load_settings(member)
        settings = self._settings(everyone, self.time)
        beat, solved = self._solve(everyone, settings, None)
        self.snapshots = [predictor.snapshot() for predictor in self.predictors]
        self.at_rest = [watched_gases(predictor.read) for predictor in self.predictors]
        self.states[:] = self.laws.start(settings, beat)
        self.segment[:] = 0
        for member in range(len(everyone)):
            self._load_settings(member)
        running = self._begin_segment(everyone[solved])
        self.settling_s = [predictor.settling_s for predictor in self.predictors]
        self._stop(everyone[~solved])
        while len(running := self._not_stopped(running)):
            running = self._advance(running)
        return self.histories

    def _not_stopped(self, active: np.ndarray) -> np.ndarray:
        """Return the members whose course does not end by the early stop."""
        stop, time = self.early_stop, self.time
        over = [m for m in active if stop and stop.is_over(m, float(time[m]), self.snapshots[m].read)]
        for m in over:
            self.histories[m].stopped = EarlyStop.reason
        return np.setdiff1d(active, over)

    def _advance(self, active: np.ndarray) -> np.ndarray:
        """Advance some members by one step and return those that continue."""
        ends = np.array([self.timelines[m].breaks[self.segment[m] + 1] for m in active])
        to_end = ends - self.time[active]
        planned = self.length[active]
        length = np.where(
            planned >= 0.999 * to_end, to_end, np.where(planned > 0.5 * to_end, 0.5 * to_end, planned)
        )

        def rates(time: np.ndarray, states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            return self._rates(active, time, states)

        here = self.slopes[:, active], self.time[active], self.states[:, active]
        result = step(rates, *here, length, self.jacobian[active])
        error = np.abs(result.error / self.laws.scales[:, None]).max(axis=0) / self.options.tolerance
        fine = result.done & np.isfinite(error)
        accepted = fine & ((error <= 1.0) | (self.options.step_s is not None) | (length <= SHORTEST_STEP_S))
        time = np.where(length == to_end, ends, self.time[active] + length)
        slopes = np.full_like(result.states, np.nan)
        if accepted.any():
            after, solved = self._rates(active[accepted], time[accepted], result.states[:, accepted])
            slopes[:, accepted] = after
            without = np.flatnonzero(accepted)[~solved]
            accepted[without], fine[without] = False, False
        ahead_of_blood = self._ahead_of_blood(active[accepted], length[accepted])
        accepted &= ~np.isin(active, list(ahead_of_blood))
        self._adapt(active, length, error, fine, accepted)
        advanced = active[accepted]
        self.time[advanced], self.states[:, advanced] = time[accepted], result.states[:, accepted]
        self.slopes[:, advanced] = slopes[:, accepted]
        self._append_history(advanced)
        lost = active[~fine & ~(length > SHORTEST_STEP_S)]
        carried = self._leave_ramp(lost, ahead_of_blood)
        lost = np.union1d(lost, list(ahead_of_blood)).astype(int)
        self._stop(np.setdiff1d(lost, carried))
        over = advanced[self.time[advanced] >= ends[accepted]]
        self.segment[over] += 1
        further = np.array([m for m in over if self.segment[m] + 1 < len(self.timelines[m].breaks)], int)
        for member in further:
            self._load_settings(member)
        entered = self._begin_segment(further)
        remain = np.setdiff1d(active, np.concatenate([over, lost]))
        self._renew_jacobians(remain)
        return np.sort(np.concatenate([remain, entered, carried])).astype(int)

    def _renew_jacobians(self, active: np.ndarray) -> None:
        """Compute Jacobians anew where errors have kept steps short: as plasma runs out, rates grow stiff.

        With the Jacobian of the event, short steps would be accepted whose states swing ever wider.
        """
        if self.options.step_s is not None:
            return
        self.jacobian_age[active] += 1
        short = self.length[active] < SHORTEST_FIRST_STEP_S
        outdated = active[short & (self.jacobian_age[active] >= OLDEST_JACOBIAN)]
        if len(outdated):
            self._differentiate(outdated)

    def _may_leave_ramp(self, member: int) -> bool:
        """Whether a member is on a ramp that may be followed beat by beat."""
        ramp_end = self.timelines[member].ramp_end(int(self.segment[member]))
        return self.options.hand_over and ramp_end > float(self.time[member])

    def _ahead_of_blood(self, active: np.ndarray, length: np.ndarray) -> dict[int, StateBeforeEvent]:
        """Members whose steady gases outran the blood in a step of a ramp; they return to the last beat."""
        events: dict[int, StateBeforeEvent] = {}
        for m, of_step in zip(active, length, strict=True):
            if not self._may_leave_ramp(m):
                continue
            predictor, ahead = self.predictors[m], self._blood_state(m)
            lungs = self._lung_gas_renewal_s(m, float(of_step))
            shares = lag_shares(predictor.settling_s, lungs, float(of_step))
            before = {name: self.snapshots[m].read[name] for name in ahead.gases}
            if largest_gas_change(before, ahead.gases, shares[1])[0] > 1.0:
                predictor.restore(self.snapshots[m])
                events[int(m)] = StateBeforeEvent(predictor.beat, self._blood_state(m), ahead, *shares)
        return events

    def _leave_ramp(self, lost: np.ndarray, ahead_of_blood: Mapping[int, StateBeforeEvent]) -> np.ndarray:
        """Follow beat by beat the members that a ramp left without a steady beat or changed too fast."""
        carried: list[int] = []
        for m in lost:
            if not self._may_leave_ramp(m):
                continue
            event = StateBeforeEvent(self.predictors[m].beat, self._blood_state(m))
            if self._follow_if_needed(m, event, has_beat=False, of=int(self.segment[m])):
                carried.append(m)
        for m, event in ahead_of_blood.items():
            if self._follow_if_needed(m, event, has_beat=True, of=int(self.segment[m])):
                carried.append(m)
        return self._resume(np.array(carried, dtype=int))

    def _adapt(
        self,
        active: np.ndarray,
        length: np.ndarray,
        error: np.ndarray,
        fine: np.ndarray,
        accepted: np.ndarray,
    ) -> None:
        """Set the lengths of the next steps; shorter ones approach a moment without a steady beat."""
        if self.options.step_s is not None:
            self.length[active] = np.where(accepted, self.options.step_s, 0.5 * length)
            return
        with np.errstate(divide="ignore", invalid="ignore"):
            factor = np.clip(0.85 * error ** (-1.0 / 3.0), 0.2, 4.0)
        factor = np.where(fine, np.where(np.isfinite(factor), factor, 4.0), 0.4)
        self.length[active] = np.clip(length * factor, SHORTEST_STEP_S, LONGEST_STEP_S)

    def _load_settings(self, member: int) -> None:
        """Copy the settings of a member's segment into the tables."""
        timeline, segment = self.timelines[member], int(self.segment[member])
        for key, value in timeline.settings(segment, float(self.time[member])).items():
            self.table.setdefault(key, np.zeros(len(self.timelines)))[member] = value
        for kind, rate in timeline.inflows(segment).items():
            self.inflow[kind][member] = rate

    def _begin_segment(self, active: np.ndarray) -> np.ndarray:
        """Begin a segment, with rates and their Jacobian; returns the members that can continue."""
        if not len(active):
            return active
        events = [self._state_before_event(m) for m in active] if self.options.hand_over else []
        self.slopes[:, active], solved = self._rates(active, self.time[active], self.states[:, active])
        events = events or [None] * len(active)
        without_beat = [
            m for m, event, has_beat in zip(active, events, solved, strict=True)
            if not (has_beat if event is None else self._follow_if_needed(m, event, has_beat))
        ]  # fmt: skip
        self._stop(np.array(without_beat, dtype=int))
        return self._resume(np.setdiff1d(active, without_beat))

    def _resume(self, active: np.ndarray) -> np.ndarray:
        """Compute the Jacobian of the rates and the next step length for members that have a steady beat."""
        if len(active):
            self._differentiate(active)
        self._append_history(active)
        if self.options.step_s is None:
            self.length[active] = self._first_lengths(active)
        return active

    def _first_lengths(self, active: np.ndarray) -> np.ndarray:
        """Lengths of first steps after events, from the third derivative J^2 f of slow states y' = f."""
        jacobian, slopes = self.jacobian[active], self.slopes[:, active].T
        third = np.einsum("mij,mjk,mk->mi", jacobian, jacobian, slopes)
        size = np.abs(third / self.laws.scales).max(axis=1, initial=0.0)
        with np.errstate(divide="ignore"):
            length = FIRST_STEP_SHARE * np.cbrt(6.0 * self.options.tolerance / size)
        return np.clip(length, SHORTEST_FIRST_STEP_S, LONGEST_STEP_S)

    def _state_before_event(self, member: int) -> StateBeforeEvent | None:
        """A member's state before a segment begins; None if nothing happens at minute 0."""
        predictor, timeline = self.predictors[member], self.timelines[member]
        segment, time = int(self.segment[member]), float(self.time[member])
        nothing = not segment and not timeline.has_event_at_start
        if nothing or predictor.point is None:
            return None
        before, shares = self._blood_state(member), (1.0, 1.0)
        reconnected = any(self._circuit(member) is not circuit for circuit in self.circuits[member])
        refusal, beat, ahead = RECONNECTED if reconnected else "", predictor.beat, None
        length = timeline.ramp_end(segment) - time
        lungs = self._lung_gas_renewal_s(member, length)
        if 0.0 < length <= max(LONGEST_FAST_RAMP * predictor.settling_s, min(lungs, LONGEST_SPAN_S)):
            active = np.array([member])
            solved = self._rates(active, np.array([time + length]), self.states[:, active])[1]
            ahead = self._blood_state(member) if solved[0] else None
            shares = lag_shares(predictor.settling_s, lungs, length)
        return StateBeforeEvent(beat, before, ahead, *shares, refusal)

    def _lung_gas_renewal_s(self, member: int, length: float) -> float:
        """Time in which a member's lung gas is renewed after a given number of seconds [s]."""
        timeline, segment, time = self.timelines[member], int(self.segment[member]), float(self.time[member])
        return lung_gas_renewal_s(timeline.settings(segment, time), timeline.settings(segment, time + length))

    def _blood_state(self, member: int) -> BloodState:
        """Blood volumes and gases of a member's last beat."""
        predictor = self.predictors[member]
        assert predictor.circuit is not None
        return BloodState(volumes_of(predictor.circuit, predictor.state), watched_gases(predictor.read))

    def _reason(self, member: int, event: StateBeforeEvent) -> str:
        """Reason to follow the beats after an event, in words; empty if there is none."""
        settling, rates = self.predictors[member].settling_s, self.slopes[:, member]
        now = event.ramp_end_state or self._blood_state(member)
        shift = event.share * shift_ml(event.blood.volumes, now.volumes)
        gases = largest_gas_change(event.blood.gases, now.gases, event.gas_share)
        return reason_to_follow(shift, gases, rates, settling, self.laws)

    def _follow_if_needed(
        self, member: int, event: StateBeforeEvent, has_beat: bool, of: int | None = None
    ) -> bool:
        """Follow a member beat by beat if steady beats would skip too much; returns whether it continues.

        Args:
            member: index of the member.
            event: state before the event.
            has_beat: whether there is a steady beat after the event.
            of: segment of the steady beat before the event; None for the previous one.
        """
        settling = self.predictors[member].settling_s
        reason = self._reason(member, event) if has_beat else NO_STEADY_BEAT
        begin, timeline = float(self.time[member]), self.timelines[member]
        longest = LONGEST_SPAN_S if has_beat else LONGEST_SPAN_WITHOUT_BEAT_S
        end = min(begin + longest, timeline.end - SHORTEST_STEP_S)
        if not reason or end <= begin:
            return has_beat
        if event.refusal:
            self.histories[member].skipped_transients.append(SkippedTransient(begin, reason, event.refusal))
            return has_beat
        self._append_history(np.array([member]))
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

    def _steady_at(self, member: int, at: MarchState, march: BeatMarch) -> SteadyTarget | None:
        """Compute the steady beat for the state of a beat-by-beat simulation; the member continues from it.

        The arterial PCO2 tells how far the blood has followed the stores of carbon dioxide.
        """
        active, predictor = np.array([member]), self.predictors[member]
        self.segment[member] = segment = self.timelines[member].segment_at(at.time)
        self.time[member], self.states[:, member] = at.time, at.slow[:, 0]
        self._load_settings(member)
        if self.snapshots[member].blood is not None:
            blood = KnownBlood(self._circuit(member), at.state)
            self.snapshots[member] = self.snapshots[member]._replace(blood=blood)
        for tries_left in reversed(range(PCO2_ITERATIONS if self.laws.blood else 1)):
            self.slopes[:, active], solved = self._rates(active, self.time[active], self.states[:, active])
            if not solved[0]:
                return None
            goal = march.from_steady(at.time, predictor.beat, self.states[:, member].copy(), segment)
            behind = march.pco2_lag_mmhg(at, goal) if tries_left else 0.0
            if abs(behind) < PCO2_TOLERANCE_MMHG:
                break
            self.states[self.laws.blood, member] += behind
        return SteadyTarget(goal, slow_state_lag(self.slopes[:, member], predictor.settling_s, self.laws))

    def _append_history(self, active: np.ndarray) -> None:
        for m in active:
            history = self.histories[m]
            history.segments.append(int(self.segment[m]))
            history.times.append(float(self.time[m]))
            history.states.append(self.states[:, m].copy())
            history.rates.append(self.slopes[:, m].copy())
            history.points.append(self.predictors[m].point)
            history.blood.append(self.predictors[m].blood)
            self.snapshots[m] = self.predictors[m].snapshot()

    def _stop(self, active: np.ndarray) -> None:
        for m in active:
            self.histories[m].stopped = self.messages[m]

    def _settings(self, active: np.ndarray, time: np.ndarray) -> dict[str, np.ndarray]:
        """Parameters of some members at times within their segments [s], by key."""
        values = {key: column[active] for key, column in self.table.items()}
        for k, m in enumerate(active):
            for key, value in self.timelines[m].ramped(int(self.segment[m]), float(time[k])).items():
                values[key][k] = value
        return values

    def _rates(
        self, active: np.ndarray, time: np.ndarray, states: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Rates of some members, and whether each has a steady beat."""
        settings = self._settings(active, time)
        beat, solved = self._solve(active, self.laws.in_effect(states, settings), states, time)
        inflows = {kind: column[active] for kind, column in self.inflow.items()}
        rates = self.laws.rates(states, settings, beat, inflows)
        missing = self.laws.negative_amounts(states)
        for k in np.flatnonzero(missing.any(axis=0)):
            first = self.laws.states[int(np.argmax(missing[:, k]))]
            rates[:, k], solved[k] = np.nan, False
            self.messages[active[k]] = f"{first.words} is used up: more is taken or needed than there is"
        for k in np.flatnonzero(solved & ~np.isfinite(rates).all(axis=0)):
            solved[k] = False
            lacking = [name for name in self.laws.reads if not np.isfinite(beat[name][k])]
            self.messages[active[k]] = message_without_rates(lacking)
        return rates, solved

    def _differentiate(self, active: np.ndarray) -> None:
        """Compute Jacobians of the rates by finite differences, and slopes of beats along the slow states."""
        size, scales = len(self.laws.states), self.laws.scales
        self.jacobian_age[active] = 0
        n = len(active)
        members = np.tile(active, size)
        columns = np.repeat(np.arange(size), n)
        states = self.states[:, members].copy()
        shift = DIFFERENCE_STEP * scales[columns]
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
        self.jacobian[active] = np.nan_to_num(differences.reshape(size, size, n).transpose(2, 0, 1))

    def _beat_of(self, members: np.ndarray) -> dict[str, np.ndarray]:
        """Outputs of each member's last beat that the laws need."""
        return {name: np.array([self.predictors[m].read[name] for m in members]) for name in self.laws.reads}

    def _shifted_beats(
        self, members: np.ndarray, columns: np.ndarray, values: dict[str, np.ndarray]
    ) -> dict[str, np.ndarray]:
        """Outputs of beats with one slow state shifted, from which the predictors learn slopes."""
        outputs = {name: np.full(len(members), np.nan) for name in self.laws.reads}
        for chosen in self._groups_by_circuit(members):
            predictors = [self.predictors[m] for m in members[chosen]]
            start = anchor_at([p.last for p in predictors], predictors)
            beat = self._beats(members[chosen], {k: v[chosen] for k, v in values.items()}, start)
            for name in self.laws.reads:
                outputs[name][chosen] = beat.output(name)
            for k, predictor in enumerate(predictors):
                if beat.converged[k]:
                    change = (point_of(beat, k) - predictor.last) / DIFFERENCE_STEP
                    predictor.learn(int(columns[chosen[k]]), change)
        return outputs

    def _solve(
        self,
        active: np.ndarray,
        values: dict[str, np.ndarray],
        states: np.ndarray | None,
        time: np.ndarray | None = None,
    ) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """Solve the beats of some members; returns outputs that laws need, and whether each has a beat."""
        solved = np.ones(len(active), dtype=bool)
        read = {name: np.full(len(active), np.nan) for name in self.laws.reads}
        if not self.laws.reads:
            return read, solved
        for chosen in self._groups_by_circuit(active):
            members = active[chosen]
            predictors = [self.predictors[m] for m in members]
            places = [self._place(m, c, states, time) for m, c in zip(members, chosen, strict=True)]
            circuits = [self._circuit(m) for m in members]
            have_beats = [p.has_beat_of(c) for p, c in zip(predictors, circuits, strict=True)]
            start = None
            if all(have_beats):
                start = anchor_at([p.predict(x) for p, x in zip(predictors, places, strict=True)], predictors)
            whole = len(chosen) == len(active)
            own = values if whole else {key: column[chosen] for key, column in values.items()}
            together = self._beats(members, own, start)
            for k, (predictor, place) in enumerate(zip(predictors, places, strict=True)):
                m = members[k]
                beat, at = self._with_known_blood(together, k, m)
                solved[chosen[k]] = beat.converged[at] and beat.gas_status[at] == GasStatus.STEADY
                for name in self.laws.reads:
                    read[name][chosen[k]] = beat.output(name)[at]
                self.histories[m].beats += int(together.orbits.beats[k])
                self.histories[m].solves += 1
                if solved[chosen[k]]:
                    predictor.put(beat, at, place, circuits[k])
                else:
                    self.messages[m] = beat.message(at)
        return read, solved

    def _with_known_blood(self, beat: SteadyBeat, place: int, member: int) -> tuple[SteadyBeat, int]:
        """A member's beat; where valves stay shut, with the blood behind them from its last known beat."""
        if beat.determined[place] or not beat.converged[place]:
            return beat, place

        def solve(batch: Batch, start: Anchor) -> SteadyBeat:
            alone = replace(self.execution, width=1)
            return steady_beat(batch, beat.names, options=self.options.orbits, start=start, execution=alone)

        blood, inverses = self.snapshots[member].blood, self.predictors[member].holding
        return with_blood_of(beat, place, blood, solve, inverses) or (beat, place)

    def _place(
        self, member: int, column: int, states: np.ndarray | None, time: np.ndarray | None
    ) -> np.ndarray:
        """Coordinates of a member's beat: slow states in units of their scales, and minutes of a ramp."""
        size = len(self.laws.states)
        place = np.zeros(size + 1)
        if states is not None:
            place[:size] = states[:, column] / self.laws.scales
        if time is not None and self.timelines[member].ramped(int(self.segment[member]), time[column]):
            place[size] = time[column] / 60.0
        return place

    def _circuit(self, member: int) -> Circuit:
        return self.circuits[member][self.segment[member]]

    def _groups_by_circuit(self, active: np.ndarray) -> list[np.ndarray]:
        """Positions of members grouped by circuit and by whether a start for their search is known."""
        groups: dict[tuple[int, bool], list[int]] = {}
        for k, m in enumerate(active):
            circuit = self._circuit(m)
            groups.setdefault((id(circuit), self.predictors[m].has_beat_of(circuit)), []).append(k)
        return [np.array(group) for group in groups.values()]

    def _beats(self, members: np.ndarray, values: dict[str, np.ndarray], start: Anchor | None) -> SteadyBeat:
        batch = Batch(self._circuit(members[0]), values, len(members), self.policy)
        all_read = self.options.hand_over or self.early_stop is not None or start is None
        reads = self.reads if all_read else self.laws.reads
        last_try = start is None or (self.length[members] <= SHORTEST_STEP_S).any()
        options = self.options.orbits if last_try else by_broyden_only(self.options.orbits)
        return steady_beat(batch, reads, options=options, start=start, execution=self.execution)


def _gases_read(circuits: Sequence[Sequence[Circuit]]) -> list[str]:
    """Gases of `LARGEST_GAS_CHANGE` that all circuits have."""
    unique = {id(circuit): circuit for of_member in circuits for circuit in of_member}.values()
    shared = set(LARGEST_GAS_CHANGE).intersection(*(output_names(circuit) for circuit in unique))
    return [name for name in LARGEST_GAS_CHANGE if name in shared]
