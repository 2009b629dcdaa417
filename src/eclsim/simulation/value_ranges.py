"""Pump speeds written as 1000:5000:250, as a list, or both."""

from __future__ import annotations

import math

LARGEST_COUNT = 1001


class SpeedError(ValueError):
    """Speeds that cannot be read; says what is allowed."""


def parse_speeds(text: str) -> tuple[float, ...]:
    """Speeds [rpm] in ascending order, each once.

    Args:
        text: `first:last:step`, both ends included, or single speeds, with commas between.

    Raises:
        SpeedError: If any of it is no speed.
    """
    speeds: set[float] = set()
    for part in text.split(","):
        numbers = [_number(word, text) for word in part.split(":")]
        if len(numbers) == 1:
            speeds.add(numbers[0])
        elif len(numbers) == 3:
            first, last, step = numbers
            speeds.update(_steps(first, last, step, text))
        else:
            raise SpeedError(_said(text))
    if len(speeds) > LARGEST_COUNT:
        raise SpeedError(f"'{text[:60]}': {len(speeds)} speeds; allowed: up to {LARGEST_COUNT}")
    return tuple(sorted(speeds))


def _steps(first: float, last: float, step: float, text: str) -> list[float]:
    count = (last - first) / step
    if count < 0.0 or count > LARGEST_COUNT:
        raise SpeedError(_said(text))
    return [first + k * step for k in range(math.floor(count + 1e-9) + 1)]


def _number(word: str, text: str) -> float:
    try:
        number = float(word)
    except ValueError:
        raise SpeedError(_said(text)) from None
    if not math.isfinite(number) or number <= 0.0:
        raise SpeedError(_said(text))
    return number


def _said(text: str) -> str:
    allowed = "first:last:step or single speeds [rpm] above 0, such as 1000:5000:250,3425"
    return f"'{text[:60]}' are no speeds; allowed: {allowed}"
