"""Where the search for a member's next steady beat begins: the last beats continued along the slow states."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eclsim.orbit.steady import inverse_jacobian

if TYPE_CHECKING:
    from eclsim.circuit.network import Circuit
    from eclsim.outputs.steady_beat import SteadyBeat

SMALLEST_MOVE = 1e-3
"""Move, in scales of the slow states, that a slope is learnt from."""


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
        state = beat.orbits.states[:, member]
        if not self.begun(circuit):
            self.circuit, self.inverse = circuit, inverse_jacobian(beat.orbits, member)
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
