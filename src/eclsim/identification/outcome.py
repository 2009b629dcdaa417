"""How a refinement can end."""

from __future__ import annotations

from enum import IntEnum


class Ending(IntEnum):
    """Why a refinement ended."""

    SETTLED = 0
    OUT_OF_ITERATIONS = 1
    NO_STEADY_BEAT = 2
