"""Early end of a course at a steady beat that meets a condition, such as a broken goal."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence


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
