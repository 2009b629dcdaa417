"""Start of the search for a member's next steady beat, extrapolated from earlier beats."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from eclsim.beat.heartbeat import HEART_RATE
from eclsim.circuit.network import Circuit
from eclsim.course.beats import SteadyState
from eclsim.course.trapped import KnownBlood, Parts, isolated_parts
from eclsim.orbit.equation import Anchor
from eclsim.orbit.steady import inverse_jacobian
from eclsim.outputs.coupling import CoupledAnchor
from eclsim.outputs.steady_beat import SteadyBeat

SETTLING_TIME_CONSTANTS = 3.0
"""Number of time constants in which the circulation settles: 5 % of the deviation remain."""
SLOWEST_MODE = 1.0 - 1e-6
"""Modes above this would take more than a week to settle: what a beat keeps, up to rounding."""
SMALLEST_MOVE = 1e-3
"""Smallest move, in scales of the slow states, from which a slope is learnt."""


def settling_time(beat: SteadyBeat, member: int, inverse: np.ndarray) -> float:
    """Time in which a circulation follows a sudden change [s], from the slowest mode of its beat.

    `inverse` is the inverse Jacobian of y - beat(y). The Jacobian has the eigenvalues 1 - m, where m is the
    factor by which a disturbance shrinks in every beat. What a beat keeps to rounding never settles: blood
    volume, and blood behind valves that hardly open.
    """
    modes = np.abs(1.0 - np.linalg.eigvals(np.linalg.pinv(inverse)))
    slowest = float(modes[modes < SLOWEST_MODE].max(initial=0.0))
    period = 60.0 / float(np.asarray(beat.values_in_effect(member)[HEART_RATE]))
    return float(SETTLING_TIME_CONSTANTS * period / -np.log(slowest)) if slowest > 0.0 else period


class PredictorSnapshot(NamedTuple):
    """A previous beat of a predictor: point, place and outputs; where its blood is, if that is known."""

    point: np.ndarray | None
    place: np.ndarray
    read: dict[str, float]
    blood: KnownBlood | None = None


class Predictor:
    """A member's last beat and its slope with respect to the slow states.

    A point is the state of a beat followed by the logarithms of the quantities solved for with its gases.

    Args:
        kind: "last", "derivative" or "secant"; see `CourseOptions`.
    """

    def __init__(self, kind: str):
        self.kind = kind
        self.circuit: Circuit | None = None
        self.point: np.ndarray | None = None
        self.coupled: tuple[str, ...] = ()
        self.read: dict[str, float] = {}
        self.inverse = self.place = np.zeros(0)
        self.slope = self.response = np.zeros((0, 0))
        self.settling_s = 0.0
        self.isolated: Parts = ()
        self.blood: KnownBlood | None = None

    @property
    def last(self) -> np.ndarray:
        """The point of the last beat."""
        assert self.point is not None
        return self.point

    @property
    def state(self) -> np.ndarray:
        """State of the last beat at phase 0."""
        return self.last[: len(self.last) - len(self.coupled)]

    @property
    def beat(self) -> SteadyState:
        """The last beat as state and coupled parameters."""
        coupled = np.exp(self.last[len(self.state) :]).tolist()
        return SteadyState(self.state, dict(zip(self.coupled, coupled, strict=True)))

    @property
    def holding(self) -> dict[Parts, np.ndarray]:
        """The inverse Jacobian by the isolated parts whose volumes it holds; none if blood passes."""
        return {self.isolated: self.inverse} if self.isolated else {}

    def has_beat_of(self, circuit: Circuit) -> bool:
        """Whether the last beat is one of the given circuit."""
        return self.point is not None and self.circuit is circuit

    def predict(self, place: np.ndarray) -> np.ndarray:
        """Return the extrapolated point at a place."""
        return self.last if self.kind == "last" else self.last + self.slope @ (place - self.place)

    def put(self, beat: SteadyBeat, member: int, place: np.ndarray, circuit: Circuit) -> None:
        """Store a beat and update the slope from it."""
        point, isolated = point_of(beat, member), isolated_parts(beat, member)
        state = beat.orbits.states[:, member]
        self.blood = KnownBlood(circuit, state, isolated) if beat.determined[member] else None
        if not self.has_beat_of(circuit) or beat.coupled != self.coupled or isolated != self.isolated:
            self.circuit, self.isolated = circuit, isolated
            self.inverse = inverse_jacobian(beat.orbits, member, isolated)
            self.settling_s = settling_time(beat, member, self.inverse)
            self.slope = np.zeros((len(point), len(place)))
        elif self.kind == "secant":
            move = place - self.place
            size = float(move @ move)
            if size > SMALLEST_MOVE**2:
                self.slope = self.slope + np.outer(point - self.predict(place), move / size)
        self.point, self.place, self.coupled = point, place, beat.coupled
        self.read = {name: float(beat.output(name)[member]) for name in beat.names}
        if beat.response is not None:
            self.response = beat.response[member]

    def snapshot(self) -> PredictorSnapshot:
        """Return the last beat, so that it can be restored."""
        return PredictorSnapshot(self.point, self.place, self.read, self.blood)

    def restore(self, snapshot: PredictorSnapshot) -> None:
        """Restore an earlier beat of the same circuit as the last one."""
        self.point, self.place, self.read, self.blood = snapshot

    def learn(self, column: int, change: np.ndarray) -> None:
        """Set the derivative with respect to one slow state from a difference."""
        self.slope = self.slope.copy()
        self.slope[:, column] = change


def point_of(beat: SteadyBeat, member: int) -> np.ndarray:
    """State of a beat followed by the logarithms of the quantities solved for with its gases."""
    answers = [np.log(np.asarray(beat.batch.values[name])[member]) for name in beat.coupled]
    return np.concatenate([beat.orbits.states[:, member], answers])


def anchor_at(points: Sequence[np.ndarray], predictors: Sequence[Predictor]) -> Anchor | None:
    """Start of searches from a point of each member; None if the points are not of one kind."""
    names = predictors[0].coupled
    if (
        len({(len(point), len(p.inverse), p.coupled) for point, p in zip(points, predictors, strict=True)})
        > 1
    ):
        return None
    states, places = np.split(np.stack(points, axis=-1), [len(points[0]) - len(names)])
    inverse = np.stack([p.inverse for p in predictors], axis=-1)
    if len(states) != len(inverse):
        return None
    if not names:
        return Anchor(states, inverse)
    return CoupledAnchor(states, inverse, names, places, np.stack([p.response for p in predictors]))
