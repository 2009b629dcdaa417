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

    def excludes(self, values: np.ndarray) -> np.ndarray:
        """Whether each value lies outside."""
        margin = SLACK * (self.high - self.low)
        return ~((self.low - margin <= values) & (values <= self.high + margin))

    def text(self, name: str, value: float) -> str:
        """A value with the range."""
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
        if (allowed := allowed_range(circuit, name)) is None:
            continue
        numbers = np.broadcast_to(np.asarray(given, float), (count,))
        for member in np.flatnonzero(allowed.excludes(numbers)).tolist():
            beyond[member].append(allowed.text(name, float(numbers[member])))
    before = (
        "outside the range of case files, where laws are extrapolated and numbers may be those of no patient "
        "or device"
    )
    return [[f"{before}: {', '.join(found)}"] if found else [] for found in beyond]


class _Possible(NamedTuple):
    """Values that a parameter of gases can have."""

    name: str
    high: float

    def excludes(self, values: npt.ArrayLike) -> np.ndarray:
        """Whether each value is none of them."""
        numbers = np.asarray(values)
        return (numbers < -SLACK) | (numbers > self.high + SLACK)

    @property
    def allowed(self) -> str:
        """These values in words."""
        return f"0 to {self.high:g}" if np.isfinite(self.high) else "0 or more"


@cached_by_devices(256)
def _possible(circuit: Circuit) -> tuple[_Possible, ...]:
    """What follows from the meaning of the parameters: most are never below 0, and shares never above 1."""
    known = {name: one for name in circuit.content_names() if (one := quantity(name)) is not None}
    return tuple(
        _Possible(name, 1.0 if one.unit == "1" and one.maximum <= 1.0 else np.inf)
        for name, one in known.items()
        if one.minimum >= 0.0
    )


def impossible_contents(batch: Batch) -> np.ndarray:
    """Whether a parameter of gases of each member is one that none can have, shape (members,)."""
    result = np.zeros(batch.count, dtype=bool)
    for one in _possible(batch.circuit):
        if one.name in batch.values:
            result |= one.excludes(batch.values[one.name])
    return result


def reasons_of_contents(circuit: Circuit, values: Mapping[str, float]) -> Iterator[str]:
    """Sentences on the parameters of gases of one member that none can have."""
    for one in _possible(circuit):
        if one.name in values and one.excludes(values[one.name]):
            yield f"{one.name} = {values[one.name]:g}: allowed: {one.allowed}"
