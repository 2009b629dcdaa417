"""Settings of a case over time: events as moments at which something changes, and ramps between them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from eclsim.cases.case import Case
from eclsim.cases.events import LONGEST_MIN, Event
from eclsim.cases.quantities import section_and_key
from eclsim.cases.reading import read_mapping
from eclsim.cases.sections import Fluid, Solutes
from eclsim.cases.settings import put_in
from eclsim.circuit.network import Circuit
from eclsim.circuit.volumes import start_volume
from eclsim.inputs.mistakes import CaseError, Mistake
from eclsim.orbit.model import circuit_of, refuse_faulty_laws, values_of
from eclsim.parameters import dialysed_drug as keys
from eclsim.parameters.fluid import SOLUTES_FOLLOWED
from eclsim.parameters.regulation import (
    DRUG_DOSES,
    DRUGS,
    EXTRA_VOLUME,
    HEART_RATE_RESPONSE,
    REGULATION,
    UNSTRESSED,
)
from eclsim.slow import ALL_GIVEN, DOSE, kind_and_unit

MINUTE, HOUR = 60.0, 3600.0
BEFORE_S = 1.0
"""A moment this long before a sudden change shows the state before it [s]."""
START = -1
"""Index of the segment before events at minute 0."""
_RESPONSE = (REGULATION, HEART_RATE_RESPONSE.rpartition(".")[2])
SENSITIVITIES = tuple(f"{drug}_sensitivity" for drug in DRUG_DOSES)


@dataclass(frozen=True)
class Change:
    """Parameters that an event changes.

    Args:
        begin: start [s].
        end: end of the ramp [s]; equal to `begin` for a sudden change.
        before: values of the changed parameters before the event, by key.
        after: values after the event, by key.
        circuit: circuit of the parameters from `begin` on.
    """

    begin: float
    end: float
    before: Mapping[str, float]
    after: Mapping[str, float]
    circuit: Circuit

    def share(self, time: float) -> float:
        """Share of the change that is done at a time [s], which may be rounded, within a segment."""
        if self.end <= self.begin or time >= self.end - 1e-9:
            return 1.0
        return max(time - self.begin, 0.0) / (self.end - self.begin)


@dataclass(frozen=True)
class ConstantInflow:
    """Fluid or another substance given or lost at a constant rate.

    Args:
        begin: start [s].
        end: end [s].
        rates: rates by the names of `ALL_GIVEN` [mL/s, mg/s].
    """

    begin: float
    end: float
    rates: Mapping[str, float]


@dataclass(frozen=True)
class Timeline:
    """Settings of a case from minute 0 to the end; they are smooth between `breaks`.

    Args:
        case: case at minute 0, with a given pump flow converted to a speed.
        end: end of the course [s].
        overrides: parameters that replace those of the case, by key, until an event sets them.
    """

    case: Case
    end: float
    overrides: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not 0.0 < self.end <= LONGEST_MIN * MINUTE:
            allowed = f"a length above 0 min, up to {LONGEST_MIN:g} min (31 days)"
            raise CaseError([Mistake("minutes", "", f"{self.end / MINUTE:g}", allowed)])
        late = [
            Mistake(f"events[{n}].at_min", f"after the end of the course at {self.end / MINUTE:g} min",
                    f"{event.at_min:g}", f"below {self.end / MINUTE:g}, or a longer course")
            for n, event in enumerate(self.case.events, start=1) if event.at_min * MINUTE >= self.end
        ]  # fmt: skip
        if late:
            raise CaseError(late)

    @cached_property
    def start_case(self) -> Case:
        """The case with what a course needs: blood volume that can be changed, and stores of carbon dioxide.

        Fluids, drugs and clamps that start with an event are 0, and the response of the heart rate is whole.
        """
        case = self.case.model_copy(update={"events": ()})
        added = {"fluid": case.fluid or Fluid(), "solutes": case.solutes or (Solutes() if case.gas else None)}
        case = case.model_copy(update=added)
        paths = [section_and_key(key) for event in self.case.events for key in event.set]
        started = [p for p in paths if p and (p[1].endswith(("_ml_h", "_clamp")) or p[0] == DRUGS)]
        first = {p: 0.0 for p in started if case.setting(*p) is None and p[1] not in SENSITIVITIES}
        if _RESPONSE in paths and (case.regulation or DRUGS in {p[0] for p in first} or case.drugs):
            first |= {_RESPONSE: 1.0} if case.setting(*_RESPONSE) is None else {}
        return _with_values(case, first) if first else case

    def values_of(self, case: Case, overrides: Mapping[str, float]) -> dict[str, float]:
        """Parameters of a case with overrides; for a case without solutes, only their stores."""
        unfollowed = {} if self.case.solutes else {SOLUTES_FOLLOWED: 0.0}
        return {**values_of(case), **unfollowed, **overrides}

    @cached_property
    def start(self) -> tuple[Circuit, dict[str, float]]:
        """Circuit and parameters at minute 0, without the effect of events at minute 0."""
        circuit, values = circuit_of(self.start_case), self.values_of(self.start_case, self.overrides)
        refuse_faulty_laws(circuit, values)
        return circuit, values

    @cached_property
    def changes(self) -> tuple[Change, ...]:
        """Changes by events, in order."""
        now, (circuit, values) = self.start_case, self.start
        changes, overrides = list[Change](), dict(self.overrides)
        for n, event in enumerate(self.case.events, start=1):
            if not event.set:
                continue
            now = case_with_settings(now, event.set, self.start_case)
            overrides = {key: value for key, value in overrides.items() if key not in _parameters(event.set)}
            after, connected = self.values_of(now, overrides), circuit_of(now)
            after[UNSTRESSED] += _adjusted_volume(connected, after, *self.start)
            if connected != circuit:
                _refuse_ramp(event, n)
                circuit = connected
            refuse_faulty_laws(circuit, after, f"events[{n}]: ")
            keys = [key for key, value in after.items() if not _is_unchanged(values.get(key), value)]
            before = {key: values.get(key, 0.0) for key in keys}
            begin = event.at_min * MINUTE
            changes.append(
                Change(
                    begin, begin + event.ramp_min * MINUTE, before, {key: after[key] for key in keys}, circuit
                )
            )
            _refuse_overlap(changes, n)
            values = after
        return tuple(changes)

    @cached_property
    def constant_inflows(self) -> tuple[ConstantInflow, ...]:
        """Constant inflows and losses by events, and the repeated doses of a drug."""
        by_events = tuple(
            ConstantInflow(event.at_min * MINUTE, (event.at_min + event.over_min) * MINUTE,
                 {kind: amount / (event.over_min * MINUTE) for kind, amount in event.give.items()})
            for event in self.case.events if event.give
        )  # fmt: skip
        return by_events + tuple(self._doses())

    def _doses(self) -> Iterator[ConstantInflow]:
        """Repeated doses of [dialysed_drug], each as set when it begins."""
        if self.case.dialysed_drug is None:
            return
        interval = self.start[1][keys.EVERY] * HOUR
        for begin in np.arange(0.0, self.end, interval).tolist():
            now = dict(self.start[1])
            for change in self.changes:
                now |= _interpolated(change, begin) if change.begin <= begin else {}
            lasts = now[keys.OVER] * MINUTE
            if now[keys.DOSE] > 0.0:
                yield ConstantInflow(begin, begin + lasts, {DOSE: now[keys.DOSE] / lasts})

    def cut_short(self) -> list[str]:
        """Descriptions of what continues beyond the end of the course."""
        cut, end = list[str](), self.end / MINUTE
        for event in self.case.events:
            what = []
            if event.give and event.at_min + event.over_min > end + 1e-9:
                share = (end - event.at_min) / event.over_min
                for name, amount in event.give.items():
                    kind, unit = kind_and_unit(name)
                    what.append(f"{share * amount:.0f} of {amount:g} {unit} {kind}")
            if event.set and event.at_min + event.ramp_min > end + 1e-9:
                share = (end - event.at_min) / event.ramp_min
                what += [f"{100.0 * share:.0f} % of the ramp of {key}" for key in event.set]
            if what:
                begun = f"what begins at minute {event.at_min:g} continues past the end of the course"
                cut.append(f"{begun} at {end:g} min, which covers only {', '.join(what)}")
        return cut

    @cached_property
    def breaks(self) -> np.ndarray:
        """Times at which anything begins or ends [s], including the start and the end of the course."""
        moments = [
            0.0,
            self.end,
            *(t for event in (*self.changes, *self.constant_inflows) for t in (event.begin, event.end)),
        ]
        return np.unique([t for t in moments if t <= self.end])

    @property
    def moments_of_events(self) -> np.ndarray:
        """Times of the breaks at which an event begins or ends [s]."""
        return self.breaks[0 if self.has_event_at_start else 1 : -1]

    def segment_at(self, time: float) -> int:
        """The segment that contains or begins at a time [s]."""
        return int(np.searchsorted(self.breaks, time + 1e-9, side="right")) - 1

    def circuit(self, segment: int) -> Circuit:
        """The circuit between two breaks, or at the `START`."""
        begun = self._begun(segment)
        return begun[-1].circuit if begun else self.start[0]

    def settings(self, segment: int, time: float) -> dict[str, float]:
        """Parameters at a time [s] within the segment from break `segment` to the next, both included."""
        values = dict(self.start[1])
        for change in self._begun(segment):
            values |= _interpolated(change, time)
        return values

    def ramped(self, segment: int, time: float) -> dict[str, float]:
        """Values of the parameters on a ramp within a segment, at a time [s]."""
        moving = [c for c in self._begun(segment) if c.end > self.breaks[segment]]
        return {key: value for change in moving for key, value in _interpolated(change, time).items()}

    def ramp_end(self, segment: int) -> float:
        """End of the first ramp that is active in a segment [s]; start of the segment if there is none."""
        begin = float(self.breaks[segment])
        return min((c.end for c in self._begun(segment) if c.end > begin), default=begin)

    def inflows(self, segment: int) -> dict[str, float]:
        """Rates of what is given in a segment [mL/s, mg/s], by kind."""
        rates = {str(kind): 0.0 for kind in ALL_GIVEN}
        for gift in self.constant_inflows:
            if segment != START and gift.begin <= self.breaks[segment] < gift.end:
                for kind, rate in gift.rates.items():
                    rates[kind] += rate
        return rates

    @cached_property
    def has_event_at_start(self) -> bool:
        """Whether anything happens at minute 0."""
        return any(event.begin == 0.0 for event in (*self.changes, *self.constant_inflows))

    def _begun(self, segment: int) -> list[Change]:
        if segment == START:
            return []
        return [change for change in self.changes if change.begin <= self.breaks[segment]]


def _adjusted_volume(
    circuit: Circuit, values: Mapping[str, float], start: Circuit, own: Mapping[str, float]
) -> float:
    """Additional volume [mL] that filling the patient's vessels to their pressures needs after a change.

    A case fills its vessels to a given pressure. In a course they keep their volume, so more compliant
    vessels have a lower pressure: the additional volume that filling would need becomes unstressed.
    """
    mine = {c.name: c for c in start.compartments if c.group == "patient"}
    same = [c for c in circuit.compartments if c == mine.get(c.name)]
    doors = {key: own[key] for key in (EXTRA_VOLUME, UNSTRESSED)}
    return float(sum(start_volume(c, {**values, **doors}) - start_volume(c, own) for c in same))


def _is_unchanged(before: float | None, after: float) -> bool:
    """Whether a parameter is unchanged; one that is solved for with the gases is NaN before and after."""
    return before == after or (before is not None and math.isnan(before) and math.isnan(after))


def _parameters(settings: Mapping[str, object]) -> set[str]:
    """Keys of the parameters that correspond to settings of a case."""
    paths = [path for key in settings if (path := section_and_key(key)) is not None]
    return {name for section, name in paths} | {f"{section}.{name}" for section, name in paths}


def _interpolated(change: Change, time: float) -> dict[str, float]:
    share = change.share(time)
    if share == 1.0:
        return dict(change.after)
    return {k: change.before[k] + share * (v - change.before[k]) for k, v in change.after.items()}


def case_with_settings(case: Case, settings: Mapping[str, object], start: Case) -> Case:
    """Return the case with new settings; open set points of reflexes keep the values at the start."""
    paths = {path: value for key, value in settings.items() if (path := section_and_key(key)) is not None}
    return _with_values(case, paths).model_copy(update={"as_written": start.as_written or start})


def _with_values(case: Case, values: Mapping[tuple[str, str], object]) -> Case:
    merged, remarks = put_in(case.as_mapping(), values)
    changed = read_mapping(merged, refused=remarks.mistakes).case
    return changed.model_copy(update={"as_written": case.as_written, "fit_mark": case.fit_mark})


def _refuse_ramp(event: Event, number: int) -> None:
    """Raise an error for a ramp that connects or disconnects something; only numbers can change on a ramp."""
    if event.ramp_min:
        message = "connects or disconnects part of the model, which cannot be done gradually"
        allowed = "an event without ramp_min that connects it, then one that ramps its numbers"
        key = f"events[{number}].ramp_min"
        raise CaseError([Mistake(key, message, f"{event.ramp_min:g}", allowed)])


def _refuse_overlap(changes: list[Change], event: int) -> None:
    """Raise an error for overlapping ramps of a parameter, which two keys may refer to."""
    *earlier, last = changes
    shared = [
        key for change in earlier if change.end > last.begin for key in last.after if key in change.after
    ]
    if shared:
        message = f"changes {shared[0]} while an earlier event is still changing it"
        raise CaseError([Mistake(f"events[{event}].at_min", message, allowed="one change at a time")])


def canonical_circuits(timelines: Sequence[Timeline]) -> list[list[Circuit]]:
    """Circuits of each segment of each member, that of `START` last; equal circuits are one object."""
    return [
        [timeline.circuit(k).canonical for k in (*range(len(timeline.breaks) - 1), START)]
        for timeline in timelines
    ]


def refuse_reconnection(timeline: Timeline) -> None:
    """Raise an error for events that connect the circuit differently, not possible beat by beat.

    Raises:
        CaseError: There are such events.
    """
    circuits: list[Circuit] = [timeline.circuit(k) for k in range(len(timeline.breaks) - 1)]
    if any(circuit is not timeline.start[0] and circuit != timeline.start[0] for circuit in circuits):
        message = "an event connects the circuit in another way, which a beat-by-beat course cannot follow"
        raise CaseError([Mistake("events", message, allowed="leave --beats out")])
