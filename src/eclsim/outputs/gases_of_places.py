"""Gases of the blood in every compartment of a beat, and what each exchanger exchanges."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import NamedTuple

import jax
import numpy as np

from eclsim.blood.gases import BloodGases, gases_with_contents
from eclsim.blood.types import Array
from eclsim.components.exchangers import BLOOD
from eclsim.gas.network import CONTENTS, gas_exchanges
from eclsim.outputs.measures import Measures

_BLOOD = ("haemoglobin", "base_excess", "temperature", "oxygen_capacity")
BLOCK = 16
"""Compartments are computed in multiples of so many, so that few programs serve all circuits."""


class PlaceGases(NamedTuple):
    """Gases of one beat.

    Attributes:
        places: By compartment, its blood: SO2 [-], PO2 and PCO2 [mmHg], pH, contents [mL/dL STPD].
        exchanged: By connection that exchanges gas, gained oxygen and carbon dioxide [mL/min STPD].
    """

    places: Mapping[str, BloodGases]
    exchanged: Mapping[str, tuple[float, float]]


def gases_of_places(measures: Measures, member: int = 0) -> PlaceGases:
    """Gases of a member of a batch whose gas state is steady.

    Args:
        measures: of the batch.
        member: which of its patients.
    """
    names = [c.name for c in measures.circuit.compartments]

    def of(number: object) -> float:
        return float(np.atleast_1d(np.asarray(number))[member])

    contents = np.ones((2, -(-len(names) // BLOCK) * BLOCK))
    contents *= np.array([[of(measures.gas(what, "mixed", names[0]))] for what in CONTENTS])
    for row, what in zip(contents, CONTENTS, strict=True):
        row[: len(names)] = [of(measures.gas(what, "mixed", name)) for name in names]
    result = _gases()(*contents, *(of(measures.parameter(name)) for name in BLOOD))
    table = np.stack([np.asarray(row) for row in result])
    places = {name: BloodGases(*table[:, k].tolist()) for k, name in enumerate(names)}
    exchanged = {
        e.at: (of(measures.gas("gained", "at", e.at)), of(measures.gas("gained_co2", "at", e.at)))
        for e in gas_exchanges(measures.circuit)
    }
    return PlaceGases(places, exchanged)


@lru_cache(maxsize=1)
def _gases() -> Callable[..., BloodGases]:
    """Gases from both contents and what describes the blood, compiled."""

    def compute(oxygen: Array, carbon_dioxide: Array, *blood: Array) -> BloodGases:
        described = dict(zip(_BLOOD, blood, strict=True))
        return gases_with_contents(oxygen=oxygen, carbon_dioxide=carbon_dioxide, **described)

    return jax.jit(compute)
