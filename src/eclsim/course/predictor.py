"""Where the search for a member's next steady beat begins: the last beats continued along the slow states."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eclsim.beat.heartbeat import HEART_RATE
from eclsim.orbit.steady import inverse_jacobian

if TYPE_CHECKING:
    from eclsim.circuit.network import Circuit
    from eclsim.outputs.steady_beat import SteadyBeat

SETTLED = 3.0
"""Time constants in which the circulation settles: 5 % are left."""
SMALLEST_MOVE = 1e-3
"""Move, in scales of the slow states, that a slope is learnt from."""


def settling_time(beat: SteadyBeat, member: int, inverse: np.ndarray) -> float:
    """Seconds in which a circulation follows a sudden change, from the slowest mode of its beat.

    The Jacobian of y - beat(y), of which the inverse is given, has the eigenvalues 1 - m, where a disturbance
    shrinks by m in every beat.
    """
    modes = np.abs(1.0 - np.linalg.eigvals(np.linalg.pinv(inverse)))
    slowest = float(modes[modes < 1.0].max(initial=0.0))
    period = 60.0 / float(np.asarray(beat.values_in_effect(member)[HEART_RATE]))
    return float(SETTLED * period / -np.log(slowest)) if slowest > 0.0 else period


class Predictor:
    """A member's last beat and its slope along the slow states.

    Args:
        kind: "last", "derivative" or "secant", see `CourseOptions`.
    """

    def __init__(self, kind: str):
        self.kind = kind
        self.circuit: Circuit | None = None
        self.orbit: np.ndarray | None = None
        self.read: dict[str, float] = {}
        self.inverse = self.place = np.zeros(0)
        self.slope = np.zeros((0, 0))
        self.settling_s, self.coupled = 0.0, False

    @property
    def known(self) -> np.ndarray:
        """State of the last beat at phase 0."""
        assert self.orbit is not None
        return self.orbit

    def begun(self, circuit: Circuit) -> bool:
        """Whether a beat of that circuit was put."""
        return self.orbit is not None and self.circuit is circuit

    def guess(self, place: np.ndarray) -> np.ndarray:
        """State of the beat at a place."""
        return self.known if self.kind == "last" else self.known + self.slope @ (place - self.place)

    def put(self, beat: SteadyBeat, member: int, place: np.ndarray, circuit: Circuit) -> None:
        """Keep a beat, and learn a slope from it."""
        state, self.coupled = beat.orbits.states[:, member], bool(beat.coupled)
        if not self.begun(circuit):
            self.circuit, self.inverse = circuit, inverse_jacobian(beat.orbits, member)
            self.settling_s = settling_time(beat, member, self.inverse)
            self.slope = np.zeros((len(state), len(place)))
        elif self.kind == "secant":
            move = place - self.place
            size = float(move @ move)
            if size > SMALLEST_MOVE**2:
                self.slope = self.slope + np.outer(state - self.guess(place), move / size)
        self.orbit, self.place = state.copy(), place
        self.read = {name: float(beat.output(name)[member]) for name in beat.names}

    def learn(self, column: int, size: int, change: np.ndarray) -> None:
        """The derivative along one slow state, by a difference."""
        self.slope = self.slope.copy()
        self.slope[:, column] = change
