"""When the chambers contract: activation (0 at rest, 1 at peak) over the phase t / T of the beat."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Activation:
    """Timing of a contraction. `break_points` are the phases where a derivative jumps."""

    def at(self, phase: Any, xp: Any) -> Any:
        """Activation at phases of 0 to 1; xp is the array module (numpy or jax.numpy)."""
        raise NotImplementedError

    @property
    def break_points(self) -> tuple[float, ...]:
        """Phases of 0 to 1 where a stepper should put a step boundary."""
        return ()


@dataclass(frozen=True)
class AtrialBump(Activation):
    """a(phase) = (1 - cos(2 pi s)) / 2 for s = (phase - start) / length in 0..1, else 0.

    Defaults are the timing of the published code of Thiel et al. The bump may run into the next beat
    (Shi et al. 2009: start 0.92, length 0.09).
    """

    start: float = 0.90
    length: float = 0.09

    def at(self, phase: Any, xp: Any) -> Any:
        """Activation at phases of 0 to 1."""
        s = ((phase - self.start) % 1.0) / self.length
        return xp.where(s < 1.0, 0.5 * (1.0 - xp.cos(2.0 * xp.pi * s)), 0.0)

    @property
    def break_points(self) -> tuple[float, ...]:
        """Start and end of the bump."""
        return (self.start % 1.0, (self.start + self.length) % 1.0)


@dataclass(frozen=True)
class VentricularSystole(Activation):
    """Rises as (1 - cos) / 2 until `peak`, falls as (1 + cos) / 2 until `end`, then 0.

    Source: Korakianitis and Shi 2006, doi 10.1016/j.jbiomech.2005.05.016; times as in Thiel et al.
    """

    peak: float = 0.30
    end: float = 0.45

    def at(self, phase: Any, xp: Any) -> Any:
        """Activation at phases of 0 to 1."""
        rise = 0.5 * (1.0 - xp.cos(xp.pi * phase / self.peak))
        fall = 0.5 * (1.0 + xp.cos(xp.pi * (phase - self.peak) / (self.end - self.peak)))
        return xp.where(phase <= self.peak, rise, xp.where(phase <= self.end, fall, 0.0))

    @property
    def break_points(self) -> tuple[float, ...]:
        """Peak and end of systole."""
        return (self.peak, self.end)
