"""Values outside the ranges that a case file may give, and values that no blood or gas can have.

Case files refuse them. From Python a study may vary a number further, as laws can be extrapolated; its
results then say so.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from eclsim.cases.quantities import quantity
from eclsim.circuit.network import Circuit
from eclsim.components.vessels import Cannula
from eclsim.devices.cannulae import CANNULAE
from eclsim.devices.registry import cached_by_devices
from eclsim.orbit.steady import Batch

SLACK = 0.01
"""Part of the width of a range by which a derivative by differences may leave it."""


class Range(NamedTuple):
    """Allowed range of a number, in its unit."""

    low: float
    high: float
    unit: str

    def broken_by(self, name: str, value: float) -> str:
        """Value with the range; empty for a value within it."""
        margin = SLACK * (self.high - self.low)
        if self.low - margin <= value <= self.high + margin:
            return ""
        unit = "" if self.unit == "1" else f" {self.unit}"
        return f"{name} = {value:g}{unit} ({self.low:g} to {self.high:g})"


@cached_by_devices(1024)
def allowed_range(circuit: Circuit, name: str) -> Range | None:
    """Range of a number that a case file may give; None for a number that no case file has.

    A cannula has the sizes of its maker.
    """
    if (known := quantity(name)) is None:
        return None
    for connection in circuit.connections:
        law = connection.component
        if isinstance(law, Cannula) and law.french == name:
            sizes = [c.sizes_fr for c in CANNULAE.values() if c.coefficients == law.coefficients]
            if sizes:
                return Range(min(map(min, sizes)), max(map(max, sizes)), known.unit)
    return Range(known.minimum, known.maximum, known.unit)


def out_of_range(circuit: Circuit, values: Mapping[str, npt.ArrayLike], count: int) -> list[list[str]]:
    """For each of `count` members a sentence on the values outside the ranges of case files, or none.

    Args:
        circuit: the circuit.
        values: numbers, or one for each member, by parameter.
        count: number of members.
    """
    beyond: list[list[str]] = [[] for _ in range(count)]
    for name, given in values.items():
        allowed = allowed_range(circuit, name)
        if allowed is None:
            continue
        for found, value in zip(beyond, np.broadcast_to(np.asarray(given, float), (count,)), strict=True):
            if reason := allowed.broken_by(name, float(value)):
                found.append(reason)
    before = (
        "outside the range of case files, where laws are extrapolated and numbers may be those of no patient "
        "or device"
    )
    return [[f"{before}: {', '.join(found)}"] if found else [] for found in beyond]


class _Contents(NamedTuple):
    """Smallest and largest values that parameters of gases can have."""

    name: str
    low: float
    high: float


@cached_by_devices(256)
def _contents(circuit: Circuit) -> tuple[_Contents, ...]:
    """Bounds that follow from what a parameter is: 0 for what is never below it, and 1 for a share."""
    known = {name: one for name in circuit.content_names() if (one := quantity(name)) is not None}
    return tuple(
        _Contents(name, 0.0, 1.0 if one.unit == "1" and one.maximum <= 1.0 else np.inf)
        for name, one in known.items()
        if one.minimum >= 0.0
    )


def impossible_contents(batch: Batch) -> np.ndarray:
    """Whether a parameter of gases of each member is one that none can have, shape (members,)."""
    result = np.zeros(batch.count, dtype=bool)
    for name, low, high in _contents(batch.circuit):
        if name in batch.values:
            value = np.asarray(batch.values[name])
            result |= (value < low - SLACK) | (value > high + SLACK)
    return result


def reasons_of_contents(circuit: Circuit, values: Mapping[str, npt.ArrayLike]) -> Iterator[str]:
    """Sentences on the parameters of gases of one member that none can have."""
    for name, low, high in _contents(circuit):
        if name in values and not low - SLACK <= float(np.asarray(values[name])) <= high + SLACK:
            allowed = f"{low:g} to {high:g}" if np.isfinite(high) else f"{low:g} or more"
            yield f"{name} = {float(np.asarray(values[name])):g}: allowed: {allowed}"
