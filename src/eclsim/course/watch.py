"""What ends a march before its end: a steady beat that is not to be, as where a goal is broken."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence


class Watch:
    """Tells when a member's march is over: behind the first moment that is shown with a broken beat.

    Args:
        outputs: that are read of each step's beat.
        broken: whether a beat with these values is not to be.
        every: between moments that are shown [s], of each member.
    """

    reason = "a goal is broken"

    def __init__(
        self, outputs: Sequence[str], broken: Callable[[Mapping[str, float]], bool], every: Sequence[float]
    ):
        self.outputs, self.broken, self.every = tuple(outputs), broken, every
        self._since = [math.inf] * len(every)

    def is_over(self, member: int, time: float, beat: Mapping[str, float]) -> bool:
        """Whether a member's march is over at a time [s], at the end of a step with this beat."""
        if not beat or not self.broken(beat):  # nothing is read where no law reads a beat
            self._since[member] = math.inf
            return False
        since = self._since[member] = min(self._since[member], time)
        return math.ceil(since / self.every[member] - 1e-9) * self.every[member] <= time + 1e-6
