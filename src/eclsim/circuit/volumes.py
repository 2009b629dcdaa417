"""Blood volume of a compartment: stressed volume at the start, unstressed volume and total volume."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from eclsim.circuit.network import BLOOD_VOLUME, Circuit, Compartment, StartPressure
from eclsim.components.base import Number, Storage, Values, value_of
from eclsim.components.vessels import TubeVolume

LARGEST_VOLUME_ML = 2.0**17
"""Largest absolute volume in the search for the volume at a given pressure [mL]."""
HALVINGS = 60
"""Number of bisections from that volume down to the rounding error of a volume."""


def start_volume(compartment: Compartment, values: Values) -> Number:
    """Stressed volume of a compartment at the start [mL], for each patient."""
    start, law = compartment.start, compartment.component
    if isinstance(start, StartPressure):
        pressure = value_of(values, start.pressure)
        if not law.constant_stiffness:
            return filled_to(law, pressure, values)
        at_rest, stiffness = law.pressure(0.0, 0.0, law.constants(values))
        filled = (pressure - at_rest) / stiffness
        if start.given == start.unstressed == 0.0:
            return filled
        return filled + value_of(values, start.given) - value_of(values, start.unstressed)
    volume = value_of(values, start.volume)
    return volume if start.fraction_of is None else volume * value_of(values, start.fraction_of)


def unstressed_volume(circuit: Circuit, name: str, values: Values) -> Number:
    """Volume [mL] of a vessel of the patient at zero pressure: its share of all blood minus its start volume.

    Zero for chambers and extracorporeal compartments, for which the stressed volume is the whole volume.
    """
    compartment = circuit.compartment(name)
    if compartment.total_fraction is None or not isinstance(compartment.start, StartPressure):
        return 0.0
    total = value_of(values, compartment.total_fraction) * values[BLOOD_VOLUME]
    law = compartment.component
    if not law.constant_stiffness:
        return total - filled_to(law, value_of(values, compartment.start.pressure), values)
    with np.errstate(divide="ignore"):
        own = law.constants({n: np.asarray(values[n], dtype=float) for n in law.parameter_names()})
    return total - value_of(values, compartment.start.pressure) / law.pressure(0.0, 0.0, own)[1]


def total_volumes(circuit: Circuit, values: Values, stressed: Sequence[Number]) -> list[Number]:
    """Total blood volume of each compartment [mL]: stressed, unstressed and rest volume.

    Args:
        circuit: the circuit.
        values: values of its parameters (`parameter_names` and `content_names`).
        stressed: stressed volume of each compartment [mL].
    """
    return [
        volume + unstressed_volume(circuit, c.name, values) + rest_volume(c, values)
        for c, volume in zip(circuit.compartments, stressed, strict=True)
    ]


def rest_volume(compartment: Compartment, values: Values) -> Number:
    """Volume [mL] that a compartment holds in addition to the stressed volume, independent of pressure."""
    rest = compartment.rest_volume
    return rest.volume(values) if isinstance(rest, TubeVolume) else value_of(values, rest)


def filled_to(component: Storage, pressure: Number, values: Values) -> Number:
    """Stressed volume [mL] at which a relaxed compartment with any pressure-volume curve has a pressure.

    Args:
        component: law of the compartment; its pressure must rise with its volume.
        pressure: pressure [mmHg], a number or one per patient; complex for derivatives by a complex step.
        values: parameters that the component reads, numbers or arrays likewise.

    Returns:
        One volume for each patient; NaN where no volume has that pressure.
    """
    given = [
        np.asarray(number) for number in (pressure, *map(values.__getitem__, component.parameter_names()))
    ]
    return _filled_to(
        component, tuple((number.dtype.str, number.shape, number.tobytes()) for number in given)
    )


@lru_cache(maxsize=256)
def _filled_to(component: Storage, given: tuple[tuple[str, tuple[int, ...], bytes], ...]) -> Number:
    """Cached `filled_to` of serialised pressure and parameters; a course repeats the same calls."""
    pressure, *numbers = (np.frombuffer(b, dtype).reshape(shape) for dtype, shape, b in given)
    own = dict(zip(component.parameter_names(), numbers, strict=True))
    constants = component.constants({name: np.real(value) for name, value in own.items()})
    wanted = np.real(pressure)

    def excess(volume: np.ndarray) -> np.ndarray:
        return np.asarray(component.pressure(volume, 0.0, constants)[0]) - wanted

    shape = np.broadcast_shapes(np.shape(wanted), *(value.shape for value in own.values()))
    low, high = np.full(shape, -LARGEST_VOLUME_ML), np.full(shape, LARGEST_VOLUME_ML)
    with np.errstate(over="ignore", invalid="ignore"):
        reached = (excess(low) <= 0.0) & (excess(high) >= 0.0)
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            above = excess(middle) > 0.0
            low, high = np.where(above, low, middle), np.where(above, middle, high)
    volume = np.where(reached, 0.5 * (low + high), np.nan)
    # One Newton step adds the derivative by a complex step.
    at, stiffness = component.pressure(volume, 0.0, component.constants(own))
    with np.errstate(divide="ignore", invalid="ignore"):
        return volume - (np.asarray(at) - pressure) / np.real(np.asarray(stiffness))
