"""Numbers that carry their derivatives: every output is differentiated by the formula that computes it."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Dual:
    """A number and its first-order dependence on named quantities.

    Args:
        value: the number.
        slopes: d value / d quantity, for each quantity that it depends on.
    """

    value: float
    slopes: Mapping[Hashable, float] = field(default_factory=dict)

    def _joined(self, other: Any, mine: float, theirs: float, value: float) -> Dual:
        slopes = {k: mine * v for k, v in self.slopes.items()}
        for k, v in other.slopes.items():
            slopes[k] = slopes.get(k, 0.0) + theirs * v
        return Dual(value, slopes)

    def __add__(self, other: Any) -> Dual:
        o = _dual(other)
        return self._joined(o, 1.0, 1.0, self.value + o.value)

    __radd__ = __add__

    def __neg__(self) -> Dual:
        return self * -1.0

    def __sub__(self, other: Any) -> Dual:
        return self + (-_dual(other))

    def __rsub__(self, other: Any) -> Dual:
        return _dual(other) - self

    def __mul__(self, other: Any) -> Dual:
        o = _dual(other)
        return self._joined(o, o.value, self.value, self.value * o.value)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Dual:
        o = _dual(other)
        return self._joined(o, 1.0 / o.value, -self.value / o.value**2, self.value / o.value)

    def __rtruediv__(self, other: Any) -> Dual:
        return _dual(other) / self

    def __pow__(self, power: int) -> Dual:
        return self._joined(Dual(0.0), power * self.value ** (power - 1), 0.0, self.value**power)


def _dual(x: Any) -> Dual:
    return x if isinstance(x, Dual) else Dual(float(x))
