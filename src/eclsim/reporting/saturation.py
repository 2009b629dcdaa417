"""Colours of oxygen saturation, for the report and the page.

The scale runs from dark blue to light red, much like the lower part of matplotlib's plasma. Lightness
increases throughout, also with colour vision deficiency and in grey print. The steps narrow towards 100 %,
where clinicians distinguish values.
"""

from __future__ import annotations

from itertools import pairwise

COLOUR_STOPS = (
    (40.0, "#0D0887"), (60.0, "#3E1CA8"), (75.0, "#6E2AB2"), (88.0, "#AE4C92"), (95.0, "#DA6068"),
    (100.0, "#F58C46"),
)  # fmt: skip
"""Oxygen saturation [%] and its colour; interpolated between entries and constant beyond them."""
DARK_LETTERS = "#111111"
LIGHT_LETTERS = "#FFFFFF"


def colour_of(saturation: float) -> str:
    """Return the colour of a saturation [%]."""
    red, green, blue = _interpolated(saturation)
    return f"#{red:02X}{green:02X}{blue:02X}"


def text_colour_on(saturation: float) -> str:
    """Return a text colour readable on the colour of a saturation [%], with a contrast of at least 4.5."""
    bright = sum(
        weight * _linear(part) for weight, part in zip(_WEIGHTS, _interpolated(saturation), strict=True)
    )
    return LIGHT_LETTERS if 1.05 / (bright + 0.05) >= 4.5 else DARK_LETTERS


_RGB_STOPS = [(at, tuple(int(colour[k : k + 2], 16) for k in (1, 3, 5))) for at, colour in COLOUR_STOPS]
_SPANS = list(pairwise(_RGB_STOPS))
_WEIGHTS = (0.2126, 0.7152, 0.0722)


def _interpolated(saturation: float) -> tuple[int, int, int]:
    at = min(max(saturation, COLOUR_STOPS[0][0]), COLOUR_STOPS[-1][0])
    (low, first), (high, second) = next(pair for pair in _SPANS if at <= pair[1][0])
    share = (at - low) / (high - low)
    red, green, blue = (round(a + share * (b - a)) for a, b in zip(first, second, strict=True))
    return red, green, blue


def _linear(part: int) -> float:
    share = part / 255.0
    return share / 12.92 if share <= 0.04045 else ((share + 0.055) / 1.055) ** 2.4
