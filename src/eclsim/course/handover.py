"""Where an event leaves the circulation no time to settle, a course goes on beat by beat until it has.

Steady beats see a sudden change as done at once. What they pass over is how much blood the circulation has to
move for it, how far the gases of that blood have to go, or how much slow states change meanwhile; where that
is felt, the beats in between are followed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eclsim.course.beats import BeatMarch, MarchState, RecordedBeat, ShownBeats, SteadyState
from eclsim.course.timeline import MINUTE
from eclsim.outputs.registry import output
from eclsim.parameters.gas import LUNG_VOLUME

if TYPE_CHECKING:
    from eclsim.course.laws import Laws

LARGEST_LAG = 4.0
"""Scales by which slow states may change while the circulation settles."""
LARGEST_SHIFT_ML = 40.0
"""Blood that compartments may have to shift at once: as `LARGEST_LAG` lets plasma change meanwhile."""
LARGEST_GAS_CHANGE = {"SaO2": 3.0, "SaO2_lower": 3.0, "PaCO2": 3.0, "PaCO2_lower": 3.0, "SvO2": 5.0}
"""Change of the blood's gases [%, mmHg] that may come at once; blood is renewed in a minute or more."""
SETTLING_RATIO = 0.8
"""Distance from the steady beat over that one time constant before; above it, beats come no closer."""
GAS_TIME_CONSTANT_S = 120.0
"""Time constant of the gases of the blood, which settle within minutes."""
ALVEOLAR_MMHG = 2.0
"""Change of the alveoli's PO2 in that time by which lungs still fill or empty. Blood that lives on the oxygen
in lungs without ventilation comes no closer to the steady beat for minutes, and then all at once."""
LONGEST_SPAN_S = 1800.0
"""Longest span that is followed beat by beat; after it the course goes on in steady beats."""
LONGEST_SPAN_WITHOUT_BEAT_S = 600.0
"""The same without a steady beat to settle to, as of a patient without any oxygen; there a course ends."""
BLOOD_RENEWAL_S = 60.0
"""Time in which blood is renewed: gases settle no sooner, even where the circulation does."""
VENTILATION = "gas.alveolar_ventilation_l_min"
LONGEST_FAST_RAMP = 10.0
"""Length of a ramp, in settling times, up to which it may be too fast for steady beats."""
RECONNECTED = "an event connects the circuit in another way"
"""Why a patient is not followed beat by beat."""
NO_STEADY_BEAT = "no steady beat is ahead"
BEATS_PER_SPAN = 60
"""Beats of a span that are shown, about."""


class BloodState(NamedTuple):
    """How a steady beat distributes the blood, and the gases of that.

    Attributes:
        volumes: by compartment [mL].
        gases: as far as they are in `LARGEST_GAS_CHANGE`, by name.
    """

    volumes: Mapping[str, float]
    gases: Mapping[str, float]


class StateBeforeEvent(NamedTuple):
    """A patient's state as an event begins or ends.

    Attributes:
        beat: the steady beat before.
        gases: of that beat, as far as they are in `LARGEST_GAS_CHANGE`, by name.
        volumes: of that beat, by compartment [mL].
        ramp_end_state: the steady beat at the end of a ramp; None without one.
        share: of the ramp that is done while the circulation settles.
        gas_share: of the ramp that is done while blood is renewed, too.
        refusal: why this patient is not followed beat by beat, in words; empty where nothing is in the way.
    """

    beat: SteadyState
    gases: Mapping[str, float]
    volumes: Mapping[str, float]
    ramp_end_state: BloodState | None
    share: float
    gas_share: float
    refusal: str = ""


class SkippedTransient(NamedTuple):
    """A transient that steady beats skipped, as no beat could be followed.

    Attributes:
        time: [s].
        reason: what changed too fast, in words.
        refusal: why it is not followed, in words.
    """

    time: float
    reason: str
    refusal: str


@dataclass
class Span:
    """Part of a course that is followed beat by beat.

    Attributes:
        begin: [s].
        end: [s].
        reason: why, in words.
        march: that followed it.
        beats: that are shown.
        settled: whether its end is the steady beat, or as close as beats come.
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
    """Shares of a change over so many seconds by which the circulation and the gases lag behind it."""
    return min(1.0, settling_s / length_s), min(
        1.0, max(settling_s, BLOOD_RENEWAL_S, lung_gas_renewal_s) / length_s
    )


def lung_gas_renewal_s(before: Mapping[str, float], after: Mapping[str, float]) -> float:
    """Time in which ventilation renews the gas of the lungs [s]; infinite where a change ends ventilation.

    Args:
        before: parameters before the change.
        after: behind it.
    """
    if VENTILATION not in after or not (before[VENTILATION] or after[VENTILATION]):
        return 0.0
    litres_min = after[VENTILATION]
    return MINUTE * 1e-3 * after[LUNG_VOLUME] / litres_min if litres_min else np.inf


def slow_state_lag(rates: np.ndarray, settling_s: float, laws: Laws) -> float:
    """Largest change of slow states while the circulation settles, in their scales."""
    return float((np.abs(rates) * settling_s / laws.scales).max(initial=0.0))


def largest_gas_change(
    before: Mapping[str, float], after: Mapping[str, float], share: float
) -> tuple[float, str]:
    """Largest share of `LARGEST_GAS_CHANGE` by which gases change at once, and the change in words."""
    moves = {name: share * (after[name] - before[name]) for name in before.keys() & after.keys()}
    name = max(sorted(moves), key=lambda name: abs(moves[name]) / LARGEST_GAS_CHANGE[name], default="")
    if not name:
        return 0.0, ""
    unit = output(name).unit
    change = f"{name} goes from {before[name]:.0f} to {before[name] + moves[name]:.0f} {unit} with the blood"
    return abs(moves[name]) / LARGEST_GAS_CHANGE[name], change


def reason_to_follow(
    shift: float, lag: float, gases: tuple[float, str], rates: np.ndarray, settling_s: float, laws: Laws
) -> str:
    """Why beats are followed, in words; empty where they need not be."""
    if max(shift / LARGEST_SHIFT_ML, lag / LARGEST_LAG, gases[0]) <= 1.0:
        return ""
    if gases[0] > max(shift / LARGEST_SHIFT_ML, lag / LARGEST_LAG):
        return gases[1]
    if shift / LARGEST_SHIFT_ML >= lag / LARGEST_LAG:
        return f"the circulation shifts {shift:.0f} mL"
    place = int((np.abs(rates) / laws.scales).argmax())
    state = laws.states[place]
    amount = abs(float(rates[place])) * settling_s
    return f"{state.name} changes by {amount:.0f} {state.unit} in the {settling_s:.0f} s of settling"


class SteadyTarget(NamedTuple):
    """The steady beat that a march beat by beat approaches.

    Attributes:
        moment: its state, with the slow states that the course goes on with.
        lag: slow states' largest change while the circulation settles, in their scales.
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
    """Beats from an event on until they are close to the steady one, or come no closer.

    Args:
        march: of the patient.
        start: the steady beat before the event, at the moment of the event.
        steady: the steady beat at slow states and settings of a moment; None where there is none.
        settling_s: three time constants of the circulation.
        end: [s], where the span ends at the latest, by its length or the course's.
        reason: why these beats are followed.
    """
    shown, at, until = (
        ShownBeats(None, BEATS_PER_SPAN, march.timeline.moments_of_events),
        start,
        start.time + settling_s,
    )
    pause = patience = settling_s / 3.0
    if start.gases is not None:
        pause, patience = max(pause, GAS_TIME_CONSTANT_S / 4.0), max(patience, GAS_TIME_CONSTANT_S)
    distances: list[tuple[float, float, np.ndarray]] = []
    while True:
        events = march.timeline.breaks
        at, before_this = march.follow(at, min(until, end), shown, every_beat=False), at.time
        until = at.time + pause
        if ((events > before_this) & (events <= at.time)).any():
            distances.clear()  # they are from a steady beat that an event has changed
        if march.stopped or at.time >= end - settling_s / 3.0:
            at = march.follow(at, end, shown, every_beat=False)
            return Span(start.time, at.time, reason, march, shown.with_last, False), at
        if march.on_ramp(at.time):
            distances.clear()  # on a ramp the steady beat itself moves
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
    """Whether beats come no closer to the steady one, and the gas in the lungs stays.

    Args:
        before: a time constant ago: when, how far from the steady beat, and PO2 of the lungs [mmHg].
        left: how far from it now.
        lungs: PO2 now [mmHg].
    """
    _, farther, held = before
    return left > SETTLING_RATIO * farther and bool((np.abs(lungs - held) <= ALVEOLAR_MMHG).all())
