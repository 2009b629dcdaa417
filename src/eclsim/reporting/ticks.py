"""Ticks of logarithmic axes: a few plain numbers that do not overlap."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axis import Axis
from matplotlib.ticker import FuncFormatter, Locator, MaxNLocator, NullFormatter, NullLocator

_STEPS = (
    (1.0,),
    (1.0, 3.0),
    (1.0, 2.0, 5.0),
    (1.0, 1.5, 2.0, 3.0, 5.0, 7.0),
    tuple(np.arange(1.0, 10.0, 0.5).tolist()),
)
"""First digits of the numbers that ticks may have, the roundest first."""


class PlainLogLocator(Locator):
    """The roundest numbers of which enough fit on a logarithmic axis.

    Args:
        gap: smallest distance of two ticks, as a share of the axis.
        fewest: ticks that are wanted at least.
    """

    def __init__(self, gap: float, fewest: int = 2):
        self.gap, self.fewest = gap, fewest

    def __call__(self) -> Sequence[float]:
        """Ticks of the axis as it is."""
        assert isinstance(self.axis, Axis)
        low, high = sorted(self.axis.get_view_interval())
        return self.tick_values(low, high)

    def tick_values(self, vmin: float, vmax: float) -> Sequence[float]:
        """Ticks between two numbers above 0."""
        if not 0.0 < vmin < vmax:
            return []
        decades = 10.0 ** np.arange(np.floor(np.log10(vmin)), np.ceil(np.log10(vmax)) + 1.0)
        for digits in _STEPS:
            every = np.sort(np.outer(decades, digits).ravel())
            chosen = self._apart(every[(every >= vmin) & (every <= vmax)], vmin, vmax)
            if len(chosen) >= self.fewest:
                return chosen
        even = np.array(MaxNLocator(4).tick_values(vmin, vmax))
        return self._apart(even[(even >= vmin) & (even <= vmax)], vmin, vmax)

    def _apart(self, ticks: np.ndarray, low: float, high: float) -> list[float]:
        chosen: list[float] = []
        for tick in ticks.tolist():
            if not chosen or np.log(tick / chosen[-1]) >= self.gap * np.log(high / low):
                chosen.append(tick)
        return chosen


def plain_log_ticks(axis: Axis, gap: float = 0.2, *, shown: bool = True) -> None:
    """Put a few plain numbers on a logarithmic axis, or ticks alone."""
    axis.set_major_locator(PlainLogLocator(gap))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.4g}") if shown else NullFormatter())
