"""How much blood a compartment holds at the start."""

from __future__ import annotations

import numpy as np

from eclsim.circuit.network import Compartment, StartPressure
from eclsim.components.base import Number, Storage, Values, value_of

LARGEST_VOLUME_ML = 2.0**17
"""Volume, filled or sucked out, up to which a pressure is looked for [mL]."""
HALVINGS = 60
"""From there down to the rounding of a volume."""


def start_volume(compartment: Compartment, values: Values) -> Number:
    """Stressed volume of a compartment at the start [mL], for each patient."""
    start, law = compartment.start, compartment.component
    if isinstance(start, StartPressure):
        pressure = value_of(values, start.pressure)
        if not law.constant_stiffness:
            return filled_to(law, pressure, values)
        at_rest, stiffness = law.pressure(0.0, 0.0, law.constants(values))
        return (pressure - at_rest) / stiffness
    volume = value_of(values, start.volume)
    return volume if start.fraction_of is None else volume * value_of(values, start.fraction_of)


def filled_to(component: Storage, pressure: Number, values: Values) -> Number:
    """Stressed volume [mL] at which a relaxed compartment of any curve has a pressure.

    Args:
        component: its pressure rises with its volume.
        pressure: mmHg, a number or one for each patient; complex for derivatives by a complex step.
        values: parameters that the component reads, likewise.

    Returns:
        One volume for each patient; NaN where no volume has that pressure.
    """
    own = {name: np.asarray(values[name]) for name in component.parameter_names()}
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
    # One step of Newton's method carries the derivative of a complex step.
    at, stiffness = component.pressure(volume, 0.0, component.constants(own))
    with np.errstate(divide="ignore", invalid="ignore"):
        return volume - (np.asarray(at) - pressure) / np.real(np.asarray(stiffness))
