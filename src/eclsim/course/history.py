"""Steps of one patient's course: slow states at their ends, what happened on the way, and an early end."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np

    from eclsim.course.handover import SkippedTransient, Span


@dataclass
class History:
    """A member's slow states at the ends of its steps.

    Attributes:
        segments: index of the timeline segment of each step.
        times: ends of the steps [s]; the first of a segment is its beginning.
        states: slow states at these times, each of shape (states,).
        rates: rates of change at these times, per second, each of shape (states,).
        points: points of the steady beats at these times (`Predictor`); None if no law needs the beat.
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
