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

from eclsim.course.beats import BeatMarch, KeptBeat, Moving, ShownBeats, Steady
from eclsim.course.timeline import MINUTE
from eclsim.outputs.registry import output
from eclsim.parameters.gas import LUNG_VOLUME

if TYPE_CHECKING:
    from eclsim.course.laws import Laws

LAG = 4.0
"""Scales by which slow states may change while the circulation settles."""
SHIFTED_ML = 40.0
"""Blood that compartments may have to shift at once: as much as `LAG` lets plasma change in that time."""
GASES_MOVE = {"SaO2": 3.0, "SaO2_lower": 3.0, "PaCO2": 3.0, "PaCO2_lower": 3.0, "SvO2": 5.0}
"""Change of the blood's gases [%, mmHg] that may come at once; blood is renewed in a minute or more."""
STILL = 0.8
"""Of what was left a time constant ago: with more left, nothing is coming to rest any more."""
GASES_S = 120.0
"""The same time where gases are followed, which settle within minutes."""
ALVEOLAR_MMHG = 2.0
"""Change of the alveoli's PO2 in that time by which lungs still fill or empty. Blood that lives on the oxygen
in lungs without ventilation comes no closer to the steady beat for minutes, and then all at once."""
LONGEST_SPAN_S = 1800.0
"""Longest span that is followed beat by beat; behind it steady beats go on."""
TO_THE_END_S = 600.0
"""The same where no steady beat is ahead, as for a patient without any oxygen; there a course ends."""
BLOOD_S = 60.0
"""In which blood is renewed; where the circulation settles sooner, its gases do not."""
VENTILATION = "gas.alveolar_ventilation_l_min"
LONGEST_RAMP = 10.0
"""Settling times within which a ramp may be too fast."""
RECONNECTED = "an event connects the circuit in another way"
"""Why a patient is not followed beat by beat."""
NO_STEADY_BEAT = "no steady beat is ahead"
KEPT = 60
"""Beats of a span that are shown, about."""


class Ahead(NamedTuple):
    """Where a steady beat has the blood and its gases.

    Attributes:
        volumes: by compartment [mL].
        gases: as far as they are in `GASES_MOVE`, by name.
    """

    volumes: Mapping[str, float]
    gases: Mapping[str, float]


class Event(NamedTuple):
    """What a patient comes from as something begins or ends.

    Attributes:
        beat: the steady beat before.
        gases: of that beat, as far as they are in `GASES_MOVE`, by name.
        volumes: of that beat, by compartment [mL].
        ahead: the steady beat at the end of a ramp; None without one.
        share: of the ramp that is done while the circulation settles.
        gas_share: of the ramp that is done while blood is renewed, too.
        refusal: why this patient is not followed beat by beat, in words; empty where nothing is in the way.
    """

    beat: Steady
    gases: Mapping[str, float]
    volumes: Mapping[str, float]
    ahead: Ahead | None
    share: float
    gas_share: float
    refusal: str = ""


class PassedOver(NamedTuple):
    """What steady beats passed over, as no beat could be followed.

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
    beats: list[KeptBeat] = field(default_factory=list)
    settled: bool = True

    def as_object(self) -> dict[str, float | str]:
        """As plain data for JSON."""
        return {"from_min": self.begin / MINUTE, "until_min": self.end / MINUTE, "reason": self.reason}


def shares_of(settling_s: float, lungs_s: float, length_s: float) -> tuple[float, float]:
    """Of a change along so many seconds, what circulation and gases are behind by."""
    return min(1.0, settling_s / length_s), min(1.0, max(settling_s, BLOOD_S, lungs_s) / length_s)


def lungs_s(before: Mapping[str, float], after: Mapping[str, float]) -> float:
    """In which ventilation renews the gas of the lungs [s], without end where a change ends it.

    Args:
        before: parameters before the change.
        after: behind it.
    """
    if VENTILATION not in after or not (before[VENTILATION] or after[VENTILATION]):
        return 0.0
    litres_min = after[VENTILATION]
    return MINUTE * 1e-3 * after[LUNG_VOLUME] / litres_min if litres_min else np.inf


def lag_of(rates: np.ndarray, settling_s: float, laws: Laws) -> float:
    """Largest change of slow states while the circulation settles, in their scales."""
    return float((np.abs(rates) * settling_s / laws.scales).max(initial=0.0))


def farthest(before: Mapping[str, float], after: Mapping[str, float], share: float) -> tuple[float, str]:
    """Largest share of `GASES_MOVE` by which gases change at once, and the change in words."""
    moves = {name: share * (after[name] - before[name]) for name in before.keys() & after.keys()}
    name = max(sorted(moves), key=lambda name: abs(moves[name]) / GASES_MOVE[name], default="")
    if not name:
        return 0.0, ""
    unit = output(name).unit
    change = f"{name} goes from {before[name]:.0f} to {before[name] + moves[name]:.0f} {unit} with the blood"
    return abs(moves[name]) / GASES_MOVE[name], change


def reason_of(
    shift: float, lag: float, gases: tuple[float, str], rates: np.ndarray, settling_s: float, laws: Laws
) -> str:
    """Why beats are followed, in words; empty where they need not be."""
    if max(shift / SHIFTED_ML, lag / LAG, gases[0]) <= 1.0:
        return ""
    if gases[0] > max(shift / SHIFTED_ML, lag / LAG):
        return gases[1]
    if shift / SHIFTED_ML >= lag / LAG:
        return f"the circulation shifts {shift:.0f} mL"
    place = int((np.abs(rates) / laws.scales).argmax())
    state = laws.states[place]
    amount = abs(float(rates[place])) * settling_s
    return f"{state.name} changes by {amount:.0f} {state.unit} in the {settling_s:.0f} s of settling"


class Goal(NamedTuple):
    """The steady beat that beats in a row come to.

    Attributes:
        moment: of it, with the slow states that the course goes on with.
        lag: slow states' largest change while the circulation settles, in their scales.
    """

    moment: Moving
    lag: float


def follow_until_settled(
    march: BeatMarch,
    start: Moving,
    steady: Callable[[Moving], Goal | None],
    settling_s: float,
    end: float,
    reason: str,
) -> tuple[Span, Moving]:
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
        ShownBeats(None, KEPT, march.timeline.moments_of_events),
        start,
        start.time + settling_s,
    )
    pause = patience = settling_s / 3.0
    if start.gases is not None:
        pause, patience = max(pause, GASES_S / 4.0), max(patience, GASES_S)
    looks: list[tuple[float, float, np.ndarray]] = []
    while True:
        events = march.timeline.breaks
        at, before_this = march.follow(at, min(until, end), shown, every_beat=False), at.time
        until = at.time + pause
        if ((events > before_this) & (events <= at.time)).any():
            looks.clear()  # how far it was to the beat that is no longer ahead
        if march.stopped or at.time >= end - settling_s / 3.0:
            at = march.follow(at, end, shown, every_beat=False)
            return Span(start.time, at.time, reason, march, shown.to_the_last, False), at
        if march.on_ramp(at.time):
            looks.clear()  # beats that come no closer to what still moves are not at rest
            if at.time - start.time < patience:
                continue
        goal = steady(at)
        now = np.inf if goal is None or goal.lag > LAG else march.apart(at, goal.moment)
        lungs = march.alveolar_mmhg(at)
        before = [look for look in looks if look[0] <= at.time - 0.9 * patience]
        if now <= 1.0 or (np.isfinite(now) and before and _at_rest(before[-1], now, lungs)):
            break
        looks.append((at.time, now, lungs))
    return Span(start.time, at.time, reason, march, shown.beats), at


def _at_rest(before: tuple[float, float, np.ndarray], left: float, lungs: np.ndarray) -> bool:
    """Whether beats come no closer to the steady one, and the gas in the lungs stays.

    Args:
        before: a time constant ago: when, how far from the steady beat, and PO2 of the lungs [mmHg].
        left: how far from it now.
        lungs: PO2 now [mmHg].
    """
    _, farther, held = before
    return left > STILL * farther and bool((np.abs(lungs - held) <= ALVEOLAR_MMHG).all())
