"""What functions and settings are called with: of the right kind and size, else a sentence that says what is.

A value of another kind is a `TypeError`, one that is not allowed a `ValueError`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from numbers import Integral, Real
from typing import Any

from eclsim.spelling import spelling_hint


def check_fields(settings: object, **checks: Callable[[str, Any], object]) -> None:
    """Check the fields of frozen settings, and put down what they stand for (3 for NumPy's own 3).

    Args:
        settings: to be checked.
        checks: by field; None passes where it is the field's default.
    """
    for name, check in checks.items():
        value = getattr(settings, name)
        if value is not None or getattr(type(settings), name, ...) is not None:
            object.__setattr__(settings, name, check(name, value))


@dataclass(frozen=True)
class WholeNumber:
    """A whole number.

    Args:
        least: smallest that is allowed; None where who reads it says so.
        most: largest.
    """

    least: int | None = 0
    most: int | None = None

    def __call__(self, name: str, value: Any) -> int:
        """The number as an `int`."""
        allowed = f"{self.least} or more" if self.most is None else f"{self.least} to {self.most}"
        allowed = "one such as 1 or 2" if self.least is None else allowed
        if isinstance(value, bool) or not isinstance(value, Integral):
            raise TypeError(f"{name} = {written(value)}: no whole number; allowed: {allowed}")
        number = int(value)
        if (self.least is not None and number < self.least) or (self.most is not None and number > self.most):
            raise ValueError(f"{name} = {number}; allowed: {allowed}")
        return number


@dataclass(frozen=True)
class FiniteNumber:
    """A number that is neither infinite nor NaN.

    Args:
        above: what it is larger than; infinite for no such bound.
        least: smallest that is allowed.
        most: largest.
        unit: of the number.
    """

    above: float = -math.inf
    least: float = -math.inf
    most: float = math.inf
    unit: str = ""

    def __call__(self, name: str, value: Any) -> float:
        """The number as a `float`."""
        bounds = [f"above {self.above:g}"] if self.above > -math.inf else []
        bounds += [f"from {self.least:g}"] if self.least > -math.inf else []
        bounds += [f"up to {self.most:g}"] if self.most < math.inf else []
        allowed = " ".join((*(bounds or ["a number"]), *((self.unit,) if self.unit else ())))
        if isinstance(value, bool) or not isinstance(value, Real):
            raise TypeError(f"{name} = {written(value)}: no number; allowed: {allowed}")
        number = float(value)
        if not (math.isfinite(number) and number > self.above and self.least <= number <= self.most):
            raise ValueError(f"{name} = {written(value)}; allowed: {allowed}")
        return number


@dataclass(frozen=True)
class OneOf:
    """One of some names."""

    names: Sequence[str]

    def __call__(self, name: str, value: Any) -> str:
        """The name."""
        if not isinstance(value, str) or value not in self.names:
            hint = spelling_hint(value, self.names) if isinstance(value, str) else ""
            raise ValueError(f"{name} = {written(value)}; allowed: {', '.join(self.names)}{hint}")
        return value


@dataclass(frozen=True)
class Kind:
    """An object of a class.

    Args:
        of: the class.
        allowed: what to write; left out, the name of the class.
    """

    of: type | tuple[type, ...]
    allowed: str = ""

    def __call__(self, name: str, value: Any) -> Any:
        """The object."""
        if not isinstance(value, self.of):
            kinds = self.of if isinstance(self.of, tuple) else (self.of,)
            allowed = self.allowed or " or ".join(article(kind.__name__) for kind in kinds)
            raise TypeError(f"{name} = {written(value)}; allowed: {allowed}")
        return value


def number_of(name: str, value: Any) -> float:
    """A number of any library as a `float`; NaN and infinite ones are judged by who reads them."""
    if isinstance(value, Real) and not isinstance(value, bool):
        return float(value)
    shape = getattr(value, "shape", ()) if hasattr(value, "__float__") else None
    if shape in ((), (1,)) and not isinstance(value, bool):
        try:
            return float(value if shape == () else value[0])
        except (TypeError, ValueError):
            pass
    raise TypeError(f"{name} = {written(value)}: no number; allowed: one number")


def flag(name: str, value: Any) -> bool:
    """True or False, no text that could mean either."""
    if isinstance(value, bool) or type(value).__name__ in ("bool", "bool_"):
        return bool(value)
    raise TypeError(f"{name} = {written(value)}; allowed: True or False")


def written(value: object) -> str:
    """A value in a message: a number or a text as it is written, anything else by its kind."""
    if value is None or isinstance(value, bool):
        return str(value)
    if isinstance(value, str):
        return f'"{value[:60]}"' if value.isprintable() else "a text that cannot be printed"
    if isinstance(value, Integral):
        return str(int(value))
    if isinstance(value, Real):
        return f"{float(value):.12g}"
    return article(type(value).__name__)


def article(kind: str) -> str:
    """A kind with its article."""
    return f"{'an' if kind[:1].lower() in 'aeio' else 'a'} {kind}"
