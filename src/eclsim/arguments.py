"""Checks of the arguments of functions and of the fields of settings.

A value of the wrong type raises `TypeError` and a value that is not allowed raises `ValueError`; the message
says what is allowed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from numbers import Integral, Real
from typing import Any

from eclsim.spelling import spelling_hint

_DIGITS = 40
"""Digits of the longest integer that a message repeats."""


def check_fields(settings: object, **checks: Callable[[str, Any], object]) -> None:
    """Check the fields of frozen settings and store the checked values (3 for NumPy's own 3).

    Args:
        settings: frozen dataclass to check; its fields are replaced in place.
        checks: check of each field, by field name; a field whose default is None may be None.
    """
    for name, check in checks.items():
        value = getattr(settings, name)
        if value is not None or getattr(type(settings), name, ...) is not None:
            object.__setattr__(settings, name, check(name, value))


@dataclass(frozen=True)
class WholeNumber:
    """Check for a whole number.

    Args:
        least: smallest number allowed; None for a number whose bounds the caller checks.
        most: largest number allowed; None for no upper bound.
    """

    least: int | None = 0
    most: int | None = None

    def __call__(self, name: str, value: Any) -> int:
        """Return the number as an `int`."""
        allowed = f"{self.least} or more" if self.most is None else f"{self.least} to {self.most}"
        allowed = "one such as 1 or 2" if self.least is None else allowed
        if isinstance(value, bool) or not isinstance(value, Integral):
            raise TypeError(f"{name} = {written(value)}: not a whole number; allowed: {allowed}")
        number = int(value)
        if (self.least is not None and number < self.least) or (self.most is not None and number > self.most):
            raise ValueError(f"{name} = {number}; allowed: {allowed}")
        return number


@dataclass(frozen=True)
class FiniteNumber:
    """Check for a number that is neither infinite nor NaN.

    Args:
        above: exclusive lower bound; -inf for none.
        least: inclusive lower bound; -inf for none.
        most: inclusive upper bound; inf for none.
        unit: unit of the number, for messages.
    """

    above: float = -math.inf
    least: float = -math.inf
    most: float = math.inf
    unit: str = ""

    def __call__(self, name: str, value: Any) -> float:
        """Return the number as a `float`."""
        bounds = [f"above {self.above:g}"] if self.above > -math.inf else []
        bounds += [f"from {self.least:g}"] if self.least > -math.inf else []
        bounds += [f"up to {self.most:g}"] if self.most < math.inf else []
        allowed = " ".join((*(bounds or ["a number"]), *((self.unit,) if self.unit else ())))
        if isinstance(value, bool) or not isinstance(value, Real):
            raise TypeError(f"{name} = {written(value)}: not a number; allowed: {allowed}")
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not (math.isfinite(number) and number > self.above and self.least <= number <= self.most):
            raise ValueError(f"{name} = {written(value)}; allowed: {allowed}")
        return number


@dataclass(frozen=True)
class OneOf:
    """Check for one of several names."""

    names: Sequence[str]

    def __call__(self, name: str, value: Any) -> str:
        """Return the name."""
        if not isinstance(value, str) or value not in self.names:
            hint = spelling_hint(value, self.names) if isinstance(value, str) else ""
            raise ValueError(f"{name} = {written(value)}; allowed: {', '.join(self.names)}{hint}")
        return value


@dataclass(frozen=True)
class Kind:
    """Check for an instance of a class.

    Args:
        of: the class, or several of which any will do.
        allowed: description of the allowed values for messages; empty for the name of the class.
    """

    of: type | tuple[type, ...]
    allowed: str = ""

    def __call__(self, name: str, value: Any) -> Any:
        """Return the object."""
        if not isinstance(value, self.of):
            kinds = self.of if isinstance(self.of, tuple) else (self.of,)
            allowed = self.allowed or " or ".join(article(kind.__name__) for kind in kinds)
            raise TypeError(f"{name} = {written(value)}; allowed: {allowed}")
        return value


def number_of(name: str, value: Any) -> float:
    """Convert a number of any library to `float`; NaN and infinity are left for the caller to judge.

    Raises:
        TypeError: The value is not one number: a truth value, a masked entry, an array of several.
        ValueError: An integer or fraction is larger than the largest `float`.
    """
    if is_traced(value):
        raise TypeError(f"{name}: {TRACED}")
    shape = getattr(value, "shape", ()) if hasattr(value, "__float__") else None
    masked = hasattr(value, "filled") and bool(value.mask.any())
    if not (is_truth_value(value) or masked) and (isinstance(value, Real) or shape in ((), (1,))):
        only: Any = value
        try:
            return float(only[0] if shape == (1,) else only)
        except OverflowError:
            raise ValueError(f"{name} = {written(value)}: too large; allowed: up to 1.8e308") from None
        except (TypeError, ValueError):
            pass
    raise TypeError(f"{name} = {written(value)}: not a number; allowed: one number")


TRACED = (
    "jax.jit and jax.grad cannot pass through eclsim's searches; eclsim.derivatives gives exact derivatives"
)
"""Message for a number that JAX traces."""


def is_traced(value: object) -> bool:
    """Whether a value is one that JAX traces in place of a number, as within `jax.jit` and `jax.grad`."""
    return type(value).__name__.endswith("Tracer")


def is_truth_value(value: object) -> bool:
    """Whether a value is True or False, of Python, NumPy or JAX."""
    return isinstance(value, bool) or getattr(getattr(value, "dtype", None), "kind", "") == "b"


def flag(name: str, value: Any) -> bool:
    """Check for a Boolean, of Python or NumPy; texts and numbers are refused."""
    if isinstance(value, bool) or type(value).__name__ in ("bool", "bool_"):
        return bool(value)
    raise TypeError(f"{name} = {written(value)}; allowed: True or False")


def written(value: object) -> str:
    """Format a value for a message: numbers and texts as written, any other value as the name of its type."""
    if value is None or isinstance(value, bool):
        return str(value)
    if isinstance(value, str):
        return f'"{value[:60]}"' if value.isprintable() else "a text that cannot be printed"
    if isinstance(value, Integral):
        return str(int(value)) if abs(int(value)) < 10**_DIGITS else f"a number of over {_DIGITS} digits"
    if isinstance(value, Real):
        with suppress(OverflowError):
            return f"{float(value):.12g}"
    return article(type(value).__name__)


def article(kind: str) -> str:
    """Return the name of a type with its indefinite article."""
    return f"{'an' if kind[:1].lower() in 'aeio' else 'a'} {kind}"
