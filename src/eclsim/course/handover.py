"""Beat-by-beat simulation after events that leave the circulation no time to settle.

In steady beats, a sudden change takes effect at once. They skip the time in which the circulation shifts
blood and the gases of that blood change, and changes of slow states during that time. Where these are
considerable, the beats in between are simulated.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, TypeVar

import numpy as np

from eclsim.course.beats import BeatMarch, MarchState, RecordedBeat, ShownBeats, SteadyState
from eclsim.course.laws import Laws
from eclsim.course.timeline import MINUTE
from eclsim.course.trapped import KnownBlood
from eclsim.outputs.registry import output
from eclsim.parameters.gas import LUNG_VOLUME

Value = TypeVar("Value")
LARGEST_LAG = 4.0
"""Largest change of slow states while the circulation settles, in units of their scales."""
LARGEST_SHIFT_ML = 40.0
"""Largest volume shifted at once between compartments [mL]; like the plasma change at `LARGEST_LAG`."""
LARGEST_GAS_CHANGE = {"SaO2": 3.0, "SaO2_lower": 3.0, "PaCO2": 3.0, "PaCO2_lower": 3.0, "SvO2": 5.0}
"""Largest sudden change of gases [%, mmHg]; blood is renewed in a minute or more."""
SETTLING_RATIO = 0.8
"""Beats no longer approach the steady beat above this ratio of its distance to that a time constant ago."""
GAS_TIME_CONSTANT_S = 120.0
"""Time constant of the gases of the blood, which settle within minutes [s]."""
ALVEOLAR_MMHG = 2.0
"""Change of alveolar PO2 in that time above which the lungs still fill or empty [mmHg]. With oxygen from
unventilated lungs, blood stays away from the steady beat for minutes, then approaches it suddenly."""
LONGEST_SPAN_S = 1800.0
"""Longest span that is followed beat by beat [s]; after it the course continues in steady beats."""
LONGEST_SPAN_WITHOUT_BEAT_S = 600.0
"""Longest span without a steady beat to settle to, as without any oxygen [s]; the course ends there."""
BLOOD_RENEWAL_S = 60.0
"""Time in which blood is renewed [s]: gases do not settle sooner, even if the circulation does."""
VENTILATION = "gas.alveolar_ventilation_l_min"
LONGEST_FAST_RAMP = 10.0
"""A ramp up to this length, in settling times, may be too fast for steady beats."""
RECONNECTED = "an event connects the circuit in another way"
"""Reason why a patient is not followed beat by beat."""
NO_STEADY_BEAT = "no steady beat is ahead"
BEATS_PER_SPAN = 60
"""Approximate number of beats of a span that are shown."""


class BloodState(NamedTuple):
    """Distribution of the blood in a steady beat, and its gases.

    Attributes:
        volumes: blood volumes by compartment [mL].
        gases: gases by name, as far as they are in `LARGEST_GAS_CHANGE`.
    """

    volumes: Mapping[str, float]
    gases: Mapping[str, float]


class StateBeforeEvent(NamedTuple):
    """State of a patient before an event begins or ends.

    Attributes:
        beat: steady beat before the event.
        blood: blood volumes and gases of that beat.
        ramp_end_state: steady beat at the end of a ramp; None without a ramp.
        share: share of the ramp that is done while the circulation settles.
        gas_share: share of the ramp that is done while blood is renewed, too.
        refusal: reason why this patient cannot be followed beat by beat, in words; empty if there is none.
    """

    beat: SteadyState
    blood: BloodState
    ramp_end_state: BloodState | None = None
    share: float = 1.0
    gas_share: float = 1.0
    refusal: str = ""


class SkippedTransient(NamedTuple):
    """A transient that steady beats skipped because it could not be followed beat by beat.

    Attributes:
        time: time [s].
        reason: quantity that changed too fast, in words.
        refusal: reason why it is not followed, in words.
    """

    time: float
    reason: str
    refusal: str


@dataclass
class Span:
    """Part of a course that is followed beat by beat.

    Attributes:
        begin: start [s].
        end: end [s].
        reason: reason for following beats, in words.
        march: simulation of the beats.
        beats: beats that are shown.
        settled: whether the span ends at the steady beat, or as close as beats come.
    """

    begin: float
    end: float
    reason: str
    march: BeatMarch
    beats: list[RecordedBeat] = field(default_factory=list)
    settled: bool = True

    def as_object(self) -> dict[str, float | str]:
        """Plain data for JSON."""
        return {"from_min": self.begin / MINUTE, "until_min": self.end / MINUTE, "reason": self.reason}


def lag_shares(settling_s: float, lung_gas_renewal_s: float, length_s: float) -> tuple[float, float]:
    """Shares of a change over a number of seconds by which circulation and gases lag behind it."""
    return min(1.0, settling_s / length_s), min(
        1.0, max(settling_s, BLOOD_RENEWAL_S, lung_gas_renewal_s) / length_s
    )


def lung_gas_renewal_s(before: Mapping[str, float], after: Mapping[str, float]) -> float:
    """Time in which ventilation renews the gas of the lungs [s]; infinite if ventilation ends.

    Args:
        before: parameters before the change.
        after: parameters after the change.
    """
    if VENTILATION not in after or not (before[VENTILATION] or after[VENTILATION]):
        return 0.0
    litres_min = after[VENTILATION]
    return MINUTE * 1e-3 * after[LUNG_VOLUME] / litres_min if litres_min else np.inf


def slow_state_lag(rates: np.ndarray, settling_s: float, laws: Laws) -> float:
    """Largest change of slow states while the circulation settles, in units of their scales."""
    return float((np.abs(rates) * settling_s / laws.scales).max(initial=0.0))


def watched_gases(outputs: Mapping[str, Value]) -> dict[str, Value]:
    """Those of the outputs that are in `LARGEST_GAS_CHANGE`."""
    return {name: outputs[name] for name in LARGEST_GAS_CHANGE if name in outputs}


def largest_gas_change(
    before: Mapping[str, float], after: Mapping[str, float], share: float
) -> tuple[float, str]:
    """Largest sudden change of gases, relative to `LARGEST_GAS_CHANGE`, and the change in words."""
    moves = {name: share * (after[name] - before[name]) for name in before.keys() & after.keys()}
    name = max(sorted(moves), key=lambda name: abs(moves[name]) / LARGEST_GAS_CHANGE[name], default="")
    if not name:
        return 0.0, ""
    unit = output(name).unit
    after_move = f"{before[name] + moves[name]:.0f} {unit} as the blood is renewed"
    change = f"{name} goes from {before[name]:.0f} to {after_move}"
    return abs(moves[name]) / LARGEST_GAS_CHANGE[name], change


def reason_to_follow(
    shift: float, gases: tuple[float, str], rates: np.ndarray, settling_s: float, laws: Laws
) -> str:
    """Reason to follow beats, in words; empty if there is none."""
    shifted = shift / LARGEST_SHIFT_ML
    lagging = slow_state_lag(rates, settling_s, laws) / LARGEST_LAG
    if max(shifted, lagging, gases[0]) <= 1.0:
        return ""
    if gases[0] > max(shifted, lagging):
        return gases[1]
    if shifted >= lagging:
        return f"the circulation shifts {shift:.0f} mL"
    place = int((np.abs(rates) / laws.scales).argmax())
    state = laws.states[place]
    amount = abs(float(rates[place])) * settling_s
    return f"{state.words} changes by {amount:.0f} {state.unit} in the {settling_s:.0f} s of settling"


class SteadyTarget(NamedTuple):
    """The steady beat that a beat-by-beat simulation approaches.

    Attributes:
        moment: its state, with the slow states with which the course continues.
        lag: largest change of slow states while the circulation settles, in units of their scales.
    """

    moment: MarchState
    lag: float


def follow_until_settled(
    march: BeatMarch,
    start: MarchState,
    steady: Callable[[MarchState], SteadyTarget | None],
    settling_s: float,
    end: float,
    reason: str,
) -> tuple[Span, MarchState]:
    """Simulate beats from an event until they are close to the steady beat or no longer approach it.

    Args:
        march: beat-by-beat simulation of the patient.
        start: steady beat before the event, at the time of the event.
        steady: returns the steady beat at the slow states and settings of a moment; None without one.
        settling_s: three time constants of the circulation.
        end: latest end [s], given by the longest span or the end of the course.
        reason: reason for following these beats.
    """
    shown = ShownBeats(None, BEATS_PER_SPAN, march.timeline.moments_of_events)
    at, until = start, start.time + settling_s
    pause = patience = settling_s / 3.0
    if start.gases is not None:
        pause, patience = max(pause, GAS_TIME_CONSTANT_S / 4.0), max(patience, GAS_TIME_CONSTANT_S)
    distances: list[tuple[float, float, np.ndarray]] = []
    while True:
        events = march.timeline.breaks
        at, before_this = march.follow(at, min(until, end), shown, every_beat=False), at.time
        until = at.time + pause
        if ((events > before_this) & (events <= at.time)).any():
            distances.clear()  # they refer to a steady beat that an event has changed
        if march.stopped or at.time >= end - settling_s / 3.0:
            at = march.follow(at, end, shown, every_beat=False)
            return Span(start.time, at.time, reason, march, shown.with_last, False), at
        if march.on_ramp(at.time):
            distances.clear()  # on a ramp the steady beat itself changes
            if at.time - start.time < patience:
                continue
        goal = steady(at)
        now = np.inf if goal is None or goal.lag > LARGEST_LAG else march.distance(at, goal.moment)
        lungs = march.alveolar_mmhg(at)
        before = [point for point in distances if point[0] <= at.time - 0.9 * patience]
        if now <= 1.0 or (np.isfinite(now) and before and _at_rest(before[-1], now, lungs)):
            break
        distances.append((at.time, now, lungs))
    return Span(start.time, at.time, reason, march, shown.beats), at


def _at_rest(before: tuple[float, float, np.ndarray], left: float, lungs: np.ndarray) -> bool:
    """Whether beats no longer approach the steady beat and the gas in the lungs is constant.

    Args:
        before: values a time constant ago: time [s], distance from the steady beat, PO2 of the lungs [mmHg].
        left: present distance from the steady beat.
        lungs: present PO2 of the lungs [mmHg].
    """
    _, farther, held = before
    return left > SETTLING_RATIO * farther and bool((np.abs(lungs - held) <= ALVEOLAR_MMHG).all())


# --- one patient's steps --------------------------------------------------------------------------


@dataclass
class History:
    """A member's slow states at the ends of its steps.

    Attributes:
        segments: index of the timeline segment of each step.
        times: ends of the steps [s]; the first of a segment is its beginning.
        states: slow states at these times, each of shape (states,).
        rates: rates of change at these times, per second, each of shape (states,).
        points: points of the steady beats at these times (`Predictor`); None if no law needs the beat.
        blood: where the blood is in these beats; None where it is not known.
        stopped: reason for an early end; empty if there was none.
        beats: number of beats computed.
        solves: number of searches for a steady beat.
        spans: spans that were followed beat by beat.
        skipped_transients: transients that should have been followed beat by beat but could not be.
    """

    segments: list[int] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    states: list[np.ndarray] = field(default_factory=list)
    rates: list[np.ndarray] = field(default_factory=list)
    points: list[np.ndarray | None] = field(default_factory=list)
    blood: list[KnownBlood | None] = field(default_factory=list)
    stopped: str = ""
    beats: int = 0
    solves: int = 0
    spans: list[Span] = field(default_factory=list)
    skipped_transients: list[SkippedTransient] = field(default_factory=list)


class EarlyStop:
    """Ends a member's course after the first shown moment whose beat meets a condition.

    Args:
        outputs: outputs of each step's beat that the condition needs.
        broken: condition: whether a beat with these values breaks a goal.
        every: interval between moments shown for each member [s].
    """

    reason = "a goal is broken"

    def __init__(
        self, outputs: Sequence[str], broken: Callable[[Mapping[str, float]], bool], every: Sequence[float]
    ):
        self.outputs, self.broken, self.every = tuple(outputs), broken, every
        self._since = [math.inf] * len(every)

    def is_over(self, member: int, time: float, beat: Mapping[str, float]) -> bool:
        """Whether a member's course ends at a time [s], the end of a step with this beat."""
        if not beat or not self.broken(beat):  # empty if no law needs outputs of a beat
            self._since[member] = math.inf
            return False
        since = self._since[member] = min(self._since[member], time)
        return math.ceil(since / self.every[member] - 1e-9) * self.every[member] <= time + 1e-6
