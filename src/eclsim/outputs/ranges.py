"""Values outside the ranges that a case file may give, and values that no blood or gas can have.

Case files refuse them. From Python a study may vary a number further, as laws can be extrapolated; its
results then say so.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from eclsim.cases.quantities import numeric_field, quantity
from eclsim.circuit.network import Circuit
from eclsim.components.vessels import Cannula
from eclsim.devices.cannulae import CANNULAE
from eclsim.devices.dialysed_blood import OF_PATIENT, USUAL_FLUID
from eclsim.devices.registry import cached_by_devices
from eclsim.orbit.model import UnknownValueError
from eclsim.orbit.steady import Batch
from eclsim.parameters.regulation import SOLVED_FOR

SLACK = 0.01
"""Part of a bound by which a derivative by differences may leave a range."""
SLACK_AT_ZERO = 1e-3
"""The same at a bound of 0, as a part of the typical value."""


class Range(NamedTuple):
    """Allowed range of a number, in its unit.

    Attributes:
        low: lower bound.
        high: upper bound.
        unit: unit of all of these.
        typical: a typical value.
        least: smallest value above 0, where 0 is allowed and no device can be set to less.
        own: value outside the range that selects the patient's own; else None.
    """

    low: float
    high: float
    unit: str
    typical: float = 0.0
    least: float = 0.0
    own: float | None = None

    def excludes(self, values: np.ndarray) -> np.ndarray:
        """Whether each value lies outside."""
        outside = ~(
            (self.low - self._slack(self.low) <= values) & (values <= self.high + self._slack(self.high))
        )
        outside |= (self._slack(0.0) < values) & (values < self.least - self._slack(self.least))
        return outside & (values != self.own) if self.own is not None else outside

    def _slack(self, bound: float) -> float:
        return SLACK * abs(bound) if bound else SLACK_AT_ZERO * abs(self.typical)

    def text(self, name: str, value: float) -> str:
        """A value with the range."""
        unit = "" if self.unit == "1" else f" {self.unit}"
        smallest = f"0, or {self.least:g}" if self.least else f"{self.low:g}"
        return f"{name} = {value:g}{unit} ({smallest} to {self.high:g})"


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
    least = field.least if (field := numeric_field(name)) is not None else 0.0
    own = OF_PATIENT.get(_key(name))
    return Range(known.minimum, known.maximum, known.unit, known.value, least, own)


def _key(name: str) -> str:
    """Key of a parameter in its section, as "haematocrit_in" of "crrt.haematocrit_in"."""
    return name.rpartition(".")[2]


def refuse_taken_from_patient(parameters: Iterable[str], values: Mapping[str, float]) -> None:
    """Raise an error for a parameter that cannot be varied, as its value selects that of the patient's blood.

    Args:
        parameters: names of parameters of a circuit.
        values: values of one patient by parameter.

    Raises:
        UnknownValueError: Says how to set it.
    """
    for name in parameters:
        if name in values and values[name] == OF_PATIENT.get(_key(name)):
            usual = f"e.g. {USUAL_FLUID[_key(name)]:g}, to vary it"
            raise UnknownValueError(f"{name} = {values[name]:g} follows the patient's blood: set it, {usual}")


def taken_from_patient(values: Mapping[str, npt.ArrayLike], count: int) -> list[list[str]]:
    """For each of `count` members a sentence on each value that selects that of the patient's blood.

    Args:
        values: numbers, or one for each member, by parameter.
        count: number of members.
    """
    taken: list[list[str]] = [[] for _ in range(count)]
    for name, given in values.items():
        own = OF_PATIENT.get(_key(name))
        if own is None:
            continue
        sentence = f"{name} = {own:g} is no number to compute with: that of the blood itself is taken"
        for member in np.flatnonzero(np.broadcast_to(np.asarray(given, float), (count,)) == own):
            taken[member].append(sentence)
    return taken


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
        outside = allowed.excludes(numbers)
        if name in SOLVED_FOR:  # NaN, not given
            outside &= np.isfinite(numbers)
        for member in np.flatnonzero(outside).tolist():
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
