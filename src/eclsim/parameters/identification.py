"""Start values and bounds of the parameters that are fitted to a patient (Thiel et al. 2025).

The seven parameters are those that the paper's global sensitivity analysis selected; the bounds
of its published code run from a tenth to ten times the start value.
"""

from __future__ import annotations

from types import MappingProxyType
from typing import NamedTuple


class Bounds(NamedTuple):
    """Start value, lower and upper bound of a fitted parameter, in the parameter's unit."""

    start: float
    lower: float
    upper: float


BOUNDS: MappingProxyType[str, Bounds] = MappingProxyType(
    {
        "Csart": Bounds(0.9, 0.09, 9.0),
        "Edla": Bounds(0.2125, 0.02125, 2.125),
        "Emaxlv": Bounds(1.8, 0.18, 18.0),
        "Emaxrv": Bounds(0.45, 0.045, 4.5),
        "Rmc": Bounds(0.5, 0.05, 5.0),
        "Rpmc": Bounds(0.05, 0.005, 0.5),
        "Rsvn": Bounds(0.01, 0.001, 0.1),
    }
)
