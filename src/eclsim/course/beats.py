"""A course beat by beat, for events of seconds to minutes: a clamp, a pump stop, a bolus.

No steady state is assumed. Every beat starts from the end of the previous one, reflexes respond through their
filters, gases are transported by the blood (`eclsim.course.gases`), and blood given or lost enters or leaves
the systemic veins at each beat. Slow states change at the rates of the beat (an explicit step of one beat's
length).
"""

from __future__ import annotations

import time as clock
from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import groupby
from typing import NamedTuple

import numpy as np
import xarray as xr

from eclsim.arguments import FiniteNumber, number_of
from eclsim.beat.grid import needed_resolution
from eclsim.beat.heartbeat import HEART_RATE, BeatProgram, beat_program
from eclsim.beat.recording import all_signals
from eclsim.circuit.assembly import assemble
from eclsim.circuit.network import Circuit
from eclsim.course.alarms import alarms, alarms_text, not_survived
from eclsim.course.gases import GasDynamics, Gases
from eclsim.course.laws import Laws, laws_of, message_without_rates
from eclsim.course.result import (
    IMPOSSIBLE,
    attributes_of,
    balance_of,
    impossible_among,
    labelled_course,
    mark_read_with_care,
    remarks_on_measurements,
)
from eclsim.course.timeline import MINUTE, START, Timeline, refuse_reconnection
from eclsim.devices.description import GASES
from eclsim.gas.network import Quantity
from eclsim.inputs.mistakes import CaseError, Mistake, as_names
from eclsim.orbit.iteration import compiled_search
from eclsim.orbit.model import CaseSource, as_case
from eclsim.orbit.status import Status
from eclsim.orbit.steady import Batch
from eclsim.outputs.alarms import Finding, findings
from eclsim.outputs.gas import artery_of, of_moving_blood
from eclsim.outputs.measures import Measures, in_two_columns, whole_beat
from eclsim.outputs.registry import computed, output
from eclsim.outputs.regulation import FACTORS, LOCAL_OUTPUTS
from eclsim.outputs.signals import needed_parameters, needed_signals, output_names, watched_waveforms
from eclsim.outputs.steady_beat import status_outputs, steady_beat
from eclsim.parameters.regulation import UNSTRESSED, local_resistance
from eclsim.simulation.target_flow import with_speed
from eclsim.slow import ALL_GIVEN

LONGEST_MIN = 120.0
MOST_SHOWN_BEATS = 1200
"""Largest number of beats shown, besides those after events, unless an interval is given."""
EVERY_BEAT_AFTER_EVENT_S = 15.0
"""Time after an event during which every beat is shown [s]."""
PARAMETERS_IN_EFFECT = (*FACTORS.values(), HEART_RATE, UNSTRESSED)
LAGGED_PARAMETERS = {name: local_resistance(bed) for bed, name in LOCAL_OUTPUTS.items()}
"""Parameters that hold the effective value of outputs which follow the gases with a lag."""
REPEATED_SHARE, LONGEST_REPEAT_S, LARGEST_REPEATED_SHIFT_ML = 0.05, 10.0, 0.1
"""While only gases still change, one beat is repeated for at most this share of the time since an event
and this number of seconds, if compartments gain and lose less in total during the beat [mL]."""
SETTLED_ML = 1.0
"""The circulation has settled if less blood than this separates it from the steady beat [mL]."""


def course_beats(
    case: CaseSource,
    *,
    minutes: float = 10.0,
    every_min: float | None = None,
    outputs: Sequence[str] | None = None,
    volume_policy: str | None = None,
) -> xr.Dataset:
    """Simulate a case beat by beat from its steady beat at minute 0, with its events.

    Args:
        case: path of a case file, what `read_case` returned, or a case.
        minutes: duration [min].
        every_min: interval between beats shown [min]; None shows every beat or about 1,200 of them. The beats
            just before and after an event are always shown.
        outputs: names of outputs, as in the registry; None for all that the circuit has.
        volume_policy: blood volume policy; None takes that of the case.

    Returns:
        Dataset as of `eclsim.course`; each moment is the beat that begins then, whether settled or not.

    Raises:
        CaseError: The file is no case, or an event is after the end or reconnects the circuit.
    """
    if (minutes := number_of("minutes", minutes)) > LONGEST_MIN:
        raise CaseError([Mistake("minutes", "too long", f"{minutes:g}", f"up to {LONGEST_MIN:g} min")])
    if every_min is not None:
        FiniteNumber(above=0.0, unit="min")("every_min", every_min)
    outputs = None if outputs is None else as_names(outputs, "outputs")
    return beat_by_beat_course(case, minutes, volume_policy, every_min=every_min, outputs=outputs).result


def beat_by_beat_course(
    case: CaseSource,
    minutes: float,
    policy: str | None = None,
    *,
    every_min: float | None = None,
    outputs: Sequence[str] | None = None,
) -> BeatByBeatCourse:
    """Return a beat-by-beat course from which beats can be recorded again; see `course_beats`."""
    began = clock.perf_counter()
    timeline = Timeline(with_speed(as_case(case), policy)[0], minutes * MINUTE)
    marching = BeatMarch(timeline, policy or timeline.case.volume_policy, outputs)
    every = None if every_min is None else every_min * MINUTE
    shown = ShownBeats(every, events=timeline.moments_of_events)
    marching.follow(marching.begin(), timeline.end, shown)
    beats = shown.beats
    measured, beat_findings = marching.measured(beats)
    result = marching.dataset(beats, measured, beat_findings)
    result.attrs["seconds"] = clock.perf_counter() - began
    return BeatByBeatCourse(
        result, marching, [beat._replace(series=beat.series[:0]) for beat in beats], measured, beat_findings
    )


class TransientBeat(NamedTuple):
    """One beat of a course, settled or not.

    Attributes:
        circuit: circuit of the beat.
        values: parameters of the circuit.
        period: duration of the beat [s].
        signals: names of the waveforms.
        waves: waveforms, shape (points, signals), at `phases`.
        phases: phases of the recorded points.
        means: means of the waveforms over the beat, shape (signals,).
        outputs: outputs by name.
        findings: limits that the beat violates, and cautions about its numbers.
    """

    circuit: Circuit
    values: Mapping[str, float]
    period: float
    signals: tuple[str, ...]
    waves: np.ndarray
    phases: np.ndarray
    means: np.ndarray
    outputs: Mapping[str, float]
    findings: Sequence[Finding]


class BeatByBeatCourse(NamedTuple):
    """A beat-by-beat course with the data to record its beats again.

    Attributes:
        result: dataset as of `course_beats`.
        marching: simulation that produced it.
        beats: beats shown, without their signals.
        measured: outputs of these beats by name.
        findings: findings about each of these beats.
    """

    result: xr.Dataset
    marching: BeatMarch
    beats: Sequence[RecordedBeat]
    measured: Mapping[str, np.ndarray]
    findings: Sequence[Sequence[Finding]]

    def at(self, minute: float) -> TransientBeat:
        """Record again the last shown beat that begins at or before a minute."""
        times = [beat.time for beat in self.beats]
        k = max(int(np.searchsorted(times, minute * MINUTE + 1e-6, side="right")) - 1, 0)
        outputs = {name: float(column[k]) for name, column in self.measured.items()}
        return self.marching.recorded_again(self.beats[k], outputs, self.findings[k])


class RecordedBeat(NamedTuple):
    """A recorded beat: initial state, signals, parameters, values in effect, slow states, final gases.

    Signals begin with the point before the beat. `lowest` holds the smallest value of each signal that is
    recorded only to detect collapse.
    """

    time: float
    state: np.ndarray
    series: np.ndarray
    lowest: np.ndarray
    values: Mapping[str, float]
    in_effect: Mapping[str, float]
    slow: np.ndarray
    gases: Mapping[Quantity, float] | None


class SteadyState(NamedTuple):
    """The state of a steady beat.

    Attributes:
        state: state of the circuit.
        coupled: parameters solved for together with the gases of the beat, by key.
    """

    state: np.ndarray
    coupled: Mapping[str, float]


class MarchState(NamedTuple):
    """State of the simulation between two beats.

    Attributes:
        time: time [s].
        state: state of the circuit.
        slow: slow states, shape (states, 1).
        before: parameters of the last beat, by key.
        last: signals at the end of the last beat.
        gases: gases of the blood; None if the circuit has none.
    """

    time: float
    state: np.ndarray
    slow: np.ndarray
    before: Mapping[str, float]
    last: np.ndarray
    gases: Gases | None


class ShownBeats:
    """Selection of the beats that are shown: at a fixed interval, or as many as allowed.

    The last beat that begins before an event and the first one after it are always shown, so that no curve
    changes ahead of the event. The largest number does not include beats before and soon after events:
    changes are fast there, and alarms are judged from the beats that are shown.

    Args:
        every: interval [s]; None for as many beats as allowed.
        most: largest number of beats.
        events: times of events [s].
    """

    def __init__(
        self, every: float | None, most: int = MOST_SHOWN_BEATS, events: Sequence[float] | np.ndarray = ()
    ):
        self.every, self.most, self.events = every, most, np.asarray(events, dtype=float)
        self._next, self._stride, self._count = 0.0, 1, 0
        self._spread, self._around_events = list[RecordedBeat](), dict[float, RecordedBeat]()
        self._last: RecordedBeat | None = None

    @property
    def beats(self) -> list[RecordedBeat]:
        """Beats shown, in order of time."""
        by_time = {beat.time: beat for beat in self._spread} | self._around_events
        return [by_time[time] for time in sorted(by_time)]

    @property
    def with_last(self) -> list[RecordedBeat]:
        """Beats shown and, if not among them, the last beat."""
        shown = self.beats
        return shown if self._last is None or shown[-1] is self._last else [*shown, self._last]

    def add_if_due(self, time: float, beat: RecordedBeat) -> None:
        """Add a beat if it is to be shown."""
        before, self._last = self._last, beat
        since = time - self.events
        begun = since > -1e-9
        if before is not None and bool((begun & (before.time - self.events <= -1e-9)).any()):
            self._around_events |= {before.time: before, beat.time: beat}
        if self.every is None and bool((begun & (since < EVERY_BEAT_AFTER_EVENT_S)).any()):
            self._around_events[beat.time] = beat
            return
        due = self._count % self._stride == 0 if self.every is None else time >= self._next - 1e-9
        self._count += 1
        if not due:
            return
        self._spread.append(beat)
        self._next += self.every or 0.0
        if self.every is None and len(self._spread) > self.most:
            self._spread, self._stride = self._spread[::2], 2 * self._stride


def volumes_of(circuit: Circuit, state: np.ndarray) -> dict[str, float]:
    """Volumes of the compartments in a state [mL]."""
    names, volumes = (c.name for c in circuit.compartments), state[assemble(circuit).layout.volumes.where]
    return dict(zip(names, volumes.tolist(), strict=True))


def shift_ml(before: Mapping[str, float], after: Mapping[str, float]) -> float:
    """Volume shifted between compartments from one distribution to another: the larger of gain and loss [mL].

    Compartments that are in only one of the two distributions are ignored.
    """
    change = np.array([after[name] - before[name] for name in before if name in after])
    return float(max(change.clip(min=0.0).sum(), -change.clip(max=0.0).sum()))


class BeatMarch:
    """Simulates one patient beat after beat."""

    def __init__(self, timeline: Timeline, policy: str, outputs: Sequence[str] | None):
        self.timeline, self.policy = timeline, policy
        self.circuit, start = timeline.start
        refuse_reconnection(timeline)
        self.steady_laws = Laws(laws_of(self.circuit, start))
        self.laws = self.steady_laws.beat_by_beat()
        self.assembly = assemble(self.circuit)
        self.names = tuple(output_names(self.circuit) if outputs is None else outputs)
        self.reads, exchanging = self.laws.reads, GASES in self.circuit.content_names()
        flows = tuple("Q" + c.name for c in self.circuit.connections) if exchanging else ()
        self.judged = tuple(dict.fromkeys((*self.names, *status_outputs(self.circuit))))
        self.signals = needed_signals(self.circuit, tuple(dict.fromkeys((*self.judged, *self.reads))), flows)
        self.watched = watched_waveforms(self.circuit)
        self.stopped = ""
        self.in_time = GasDynamics(self.circuit, self.signals, start) if exchanging else None

    def begin(self) -> MarchState:
        """Return the state of the steady beat at the start."""
        settings = _columns(self.timeline.start[1])
        batch = Batch(self.circuit, settings, 1, self.policy)
        beat = steady_beat(batch, self.laws.reads)
        if not beat.converged[0] or beat.gas_status[0]:
            message = f"no steady state to start from: {beat.message()}"
            raise CaseError([Mistake("", message)])
        read = {name: beat.output(name) for name in self.laws.reads}
        slow, state = self.laws.start(settings, read), beat.orbits.states[:, 0]
        coupled = {name: float(np.asarray(beat.batch.values[name])[0]) for name in beat.coupled}
        return self.from_steady(0.0, SteadyState(state, coupled), slow[:, 0], START)

    def from_steady(self, time: float, beat: SteadyState, slow: np.ndarray, segment: int) -> MarchState:
        """Return the state of a steady beat at a time [s] in a segment of the timeline."""
        settings = _columns({**self.timeline.settings(segment, time), **beat.coupled})
        before = _numbers(self.steady_laws.in_effect(slow[:, None], settings))
        program = self._program(before)
        recorded, gases = _recorded_beat(program, self.signals, beat.state, before)[1], None
        if self.in_time is not None:
            gases = self.in_time.begin(whole_beat(recorded), program.grid.phases, before)
        return MarchState(time, beat.state, slow[:, None], before, recorded[-1], gases)

    def distance(self, at: MarchState, goal: MarchState) -> float:
        """Distance from the steady state, relative to what counts as settled."""
        now, then = (volumes_of(self.circuit, moment.state) for moment in (at, goal))
        shift = shift_ml(now, then) / SETTLED_ML
        if self.in_time is None or at.gases is None or goal.gases is None:
            return shift
        return max(shift, self.in_time.distance(at.gases, goal.gases))

    def alveolar_mmhg(self, at: MarchState) -> np.ndarray:
        """PO2 of the gas in each lung [mmHg]; empty if gases are not followed."""
        gases, in_time = at.gases, self.in_time
        return np.zeros(0) if in_time is None or gases is None else in_time.alveolar_mmhg(gases)

    def pco2_lag_mmhg(self, at: MarchState, goal: MarchState) -> float:
        """Arterial PCO2 minus that of the steady state [mmHg]; 0 if gases are not followed."""
        if at.gases is None or goal.gases is None:
            return 0.0
        place = Quantity("PCO2", "in", artery_of(self.circuit))
        return at.gases.state[place] - goal.gases.state[place]

    def follow(self, at: MarchState, until: float, shown: ShownBeats, every_beat: bool = True) -> MarchState:
        """Simulate beats from a state up to the last one that begins before a given time.

        Args:
            at: initial state.
            until: time [s].
            shown: selection to which the beats are added.
            every_beat: if False, one beat represents several while only gases still change.
        """
        segment, program, settings = -1, None, dict[str, np.ndarray]()
        while at.time < until - 1e-9 and not self.stopped:
            now = self.timeline.segment_at(at.time)
            if now != segment or program is None:
                segment = now
                settings = _columns(self.timeline.settings(segment, at.time))
                program = self._program(self._values(at, settings))
            ramped = self.timeline.ramped(segment, at.time)
            for key, value in ramped.items():
                settings[key] = np.array([value])
            alike = 0.0 if every_beat or ramped else self._repeat_duration_s(at, segment, until)
            at = self._beat(at, settings, program, shown, alike)
        return at

    def _repeat_duration_s(self, at: MarchState, segment: int, until: float) -> float:
        """Time for which one beat may be repeated [s]: a share of the time since the last event."""
        breaks = self.timeline.breaks
        if self.in_time is None or self.in_time.answers:
            return 0.0
        return min(
            REPEATED_SHARE * (at.time - breaks[segment]),
            LONGEST_REPEAT_S,
            breaks[segment + 1] - at.time,
            until - at.time,
        )

    def _beat(
        self,
        at: MarchState,
        settings: dict[str, np.ndarray],
        program: BeatProgram,
        shown: ShownBeats,
        repeat_s: float,
    ) -> MarchState:
        """Simulate one beat, or repetitions of it for some seconds; the run stops at non-finite values."""
        values = self._values(at, settings)
        state = at.state + self._blood_given(at.before, values)
        effective = self.assembly.in_effect(values, state)
        period = 60.0 / float(effective[HEART_RATE])
        after, everything = _recorded_beat(program, (*self.signals, *self.watched), state, values)
        recorded, watched = np.split(everything, [len(self.signals)], axis=1)
        if not np.isfinite(after).all():
            self.stopped = Status.NOT_FINITE.message
            return at
        series = np.concatenate([at.last[None], recorded])
        in_effect = {
            key: float(np.asarray(effective[key])) for key in PARAMETERS_IN_EFFECT if key in effective
        }
        lowest, gases, gas_state, alike = watched.min(axis=0), at.gases, None, 1
        if self.in_time is not None and gases is not None:
            where = self.assembly.layout.volumes.where
            ends = state[where], after[where]
            if np.abs(ends[1] - ends[0]).sum() < LARGEST_REPEATED_SHIFT_ML:
                alike = max(1, int(repeat_s / period))
            gases = self.in_time.after(gases, series, program.grid.phases, values, ends, alike * period)
            self.stopped, gas_state = self.in_time.reason_without_gases(gases), gases.state
            if self.stopped:
                return at
        beat = RecordedBeat(
            at.time, state, series, lowest, values, in_effect, at.slow[:, 0].copy(), gas_state
        )
        duration = alike * period
        end = at.time + duration
        read = self._measured(self.reads, [beat], program)
        inflows = {kind: np.array([ml / duration]) for kind, ml in self._amounts(at.time, end).items()}
        slow = at.slow + duration * self.laws.rates(at.slow, settings, read, inflows)
        if not np.isfinite(slow).all():
            self.stopped = message_without_rates([n for n in self.laws.reads if not np.isfinite(read[n][0])])
            return at
        if alike > 1:  # the last repetition is shown, since the gases are those at its end
            beat = beat._replace(time=end - period, slow=(slow - (slow - at.slow) / alike)[:, 0])
        shown.add_if_due(beat.time, beat)
        return MarchState(end, after, slow, values, recorded[-1], gases)

    def _values(self, at: MarchState, settings: Mapping[str, np.ndarray]) -> dict[str, float]:
        """Parameters of the beat that begins in a state."""
        values = _numbers(self.laws.in_effect(at.slow, settings))
        if self.in_time is None or at.gases is None:
            return values
        return values | self.in_time.in_effect(at.gases, values)

    def on_ramp(self, time: float) -> bool:
        """Whether a setting is changing on a ramp at a time [s]."""
        return self.timeline.ramp_end(self.timeline.segment_at(time)) > time

    def _program(self, values: Mapping[str, float]) -> BeatProgram:
        level = needed_resolution(self.assembly, values)
        return beat_program(self.circuit, int(np.asarray(level).flat[0]))

    def _blood_given(self, before: Mapping[str, float], now: Mapping[str, float]) -> np.ndarray:
        """Blood added to the circuit since the last beat, as a change of its state.

        A setting that changes the volume in the circulation at the start also counts, as for steady beats.
        """
        change = np.zeros(self.assembly.layout.size)
        started = self.assembly.start_changes(before, now)
        change[self.assembly.layout.volumes.where] = started
        return change

    def _amounts(self, begin: float, end: float) -> dict[str, float]:
        """Volumes given between two times [s], by kind [mL]."""
        amounts = {str(kind): 0.0 for kind in ALL_GIVEN}
        for gift in self.timeline.constant_inflows:
            shared = max(0.0, min(end, gift.end) - max(begin, gift.begin))
            for kind, rate in gift.rates.items():
                amounts[kind] += rate * shared
        return amounts

    def _measured(
        self, names: Sequence[str], beats: Sequence[RecordedBeat], program: BeatProgram
    ) -> dict[str, np.ndarray]:
        """Outputs of recorded beats, shape (beats,) each."""
        series, alone = np.stack([beat.series for beat in beats], axis=-1), len(beats) == 1
        values, in_effect = [beat.values for beat in beats], [beat.in_effect for beat in beats]
        states = [beat.gases for beat in beats if beat.gases is not None]
        gases = {q: np.array([state[q] for state in states]) for q in states[0]} if states else None
        read = needed_parameters(self.circuit, names)
        parameters = {n: np.array([of_beat.get(n, np.nan) for of_beat in values]) for n in read}
        if alone:
            series = in_two_columns(series)
            parameters = {n: column.repeat(2) for n, column in parameters.items()}
            gases = gases and {quantity: column.repeat(2) for quantity, column in gases.items()}
        waves = dict(zip(self.signals, series.transpose(1, 0, 2), strict=True))
        measures = Measures(waves, program.grid.phases, self.circuit, parameters, gases, len(beats))
        if alone and any(output(name).all_flows for name in names):
            measures.measure_one_way([c.name for c in self.circuit.connections], self.signals, series)
        result: dict[str, np.ndarray] = {}
        for name in names:
            column = self._lagged_output(name, values, in_effect)
            if column is None:
                column = np.asarray(computed(name, measures))[: len(values)]
            result[name] = column
        return result

    def _lagged_output(
        self, name: str, values: Sequence[Mapping[str, float]], in_effect: Sequence[Mapping[str, float]]
    ) -> np.ndarray | None:
        """Lagged effects of reflex and drugs during beats; None for other outputs."""
        if name == "heart_rate":
            return np.array([of_beat[HEART_RATE] for of_beat in in_effect])
        if name == "unstressed_volume":
            return np.array([of_beat[UNSTRESSED] for of_beat in in_effect])
        if name in LAGGED_PARAMETERS:
            return np.array([of_beat[LAGGED_PARAMETERS[name]] for of_beat in values])
        key = FACTORS.get(name)
        if key is None:
            return None
        return np.array([a.get(key, v[key]) / v[key] for v, a in zip(values, in_effect, strict=True)])

    def recorded_again(
        self, beat: RecordedBeat, outputs: Mapping[str, float], beat_findings: Sequence[Finding]
    ) -> TransientBeat:
        """Simulate a beat again and record all its waveforms."""
        program, signals = self._program(beat.values), all_signals(self.assembly)
        names, phases = needed_signals(self.circuit, (), signals), program.grid.phases
        _, series = _recorded_beat(program, names, beat.state, beat.values)
        points = np.concatenate([series[:1], series])[..., None]
        waves = {name: points[:, k] for k, name in enumerate(names)}
        measures = Measures(waves, phases, self.circuit, {})
        means = np.concatenate([measures.mean(name) for name in signals])
        columns, period = [names.index(name) for name in signals], 60.0 / beat.in_effect[HEART_RATE]
        recorded = series[:, columns], phases[1:], means
        return TransientBeat(self.circuit, beat.values, period, signals, *recorded, outputs, beat_findings)

    def measured(self, beats: Sequence[RecordedBeat]) -> tuple[dict[str, np.ndarray], list[list[Finding]]]:
        """Outputs of beats by name, shape (beats,), and the findings of each."""
        columns: dict[str, list[np.ndarray]] = {name: [] for name in self.judged}
        for points, group in groupby(beats, key=lambda beat: len(beat.series)):
            members = list(group)
            program = self._program(members[0].values)
            assert points == program.grid.n_steps + 1
            for name, column in self._measured(self.judged, members, program).items():
                columns[name].append(column)
        outputs = {name: np.concatenate(parts) for name, parts in columns.items()}
        beat_findings = []
        for k, beat in enumerate(beats):
            now = {name: float(column[k]) for name, column in outputs.items()}
            ranges = {n: (low, np.nan) for n, low in zip(self.watched, beat.lowest.tolist(), strict=True)}
            beat_findings.append(
                findings(now, ranges, self.circuit.with_chosen_sites(beat.values), beat.values)
            )
        read = of_moving_blood(outputs)
        return {name: read[name] for name in self.names}, beat_findings

    def dataset(
        self,
        beats: Sequence[RecordedBeat],
        outputs: Mapping[str, np.ndarray],
        beat_findings: Sequence[Sequence[Finding]],
    ) -> xr.Dataset:
        """Return the beats as a labelled dataset."""
        time = np.array([beat.time for beat in beats])
        states = np.stack([beat.slow for beat in beats], axis=-1)
        in_effect = {key: np.array([beat.values[key] for beat in beats]) for key in beats[0].values}
        derived = self.laws.derived_quantities(states, in_effect)
        result = labelled_course(time, outputs, self.laws, states, derived)
        minute, by_beat = time / MINUTE, np.ones(len(beats), dtype=bool)
        arrest = not_survived(minute, outputs)
        result[IMPOSSIBLE] = impossible_among(beat_findings, arrest, minute)
        mark_read_with_care(result, beat_findings)
        broken = [*arrest, *alarms(beat_findings, outputs, minute, by_beat)]
        warnings = [self.stopped] * bool(self.stopped) + [alarm.labelled for alarm in broken]
        balance = balance_of(self.laws, states, in_effect)
        remarks = remarks_on_measurements(self.timeline, outputs)
        about = attributes_of(self.timeline, self.policy, self.stopped, balance, warnings, remarks=remarks)
        about |= {"alarms": alarms_text(broken), "settling_s": 0.0, "beat_by_beat": 1}
        return result.assign_attrs(about, steps=len(beats))


def _recorded_beat(
    program: BeatProgram, signals: tuple[str, ...], state: np.ndarray, values: Mapping[str, float]
) -> tuple[np.ndarray, np.ndarray]:
    """State at the end of a beat, and its signals, shape (points, signals)."""
    packed = np.array([values[name] for name in program.names])
    after, recorded = compiled_search(program, 1).beat(state, packed)
    return after, recorded.take(_columns_of(program.signals, signals), axis=1)


@lru_cache(maxsize=64)
def _columns_of(names: tuple[str, ...], wanted: tuple[str, ...]) -> list[int]:
    return [names.index(name) for name in wanted]


def _numbers(values: Mapping[str, np.ndarray]) -> dict[str, float]:
    return {key: float(column[0]) for key, column in values.items()}


def _columns(values: Mapping[str, float]) -> dict[str, np.ndarray]:
    return {key: np.array([value], dtype=float) for key, value in values.items()}
