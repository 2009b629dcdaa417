"""How much blood a relaxed compartment holds at a pressure, where its curve is no straight line."""

from __future__ import annotations

from typing import Any

import numpy as np

from eclsim.components.base import Storage, Values

LARGEST_VOLUME_ML = 2.0**17
"""Volume, filled or sucked out, up to which a pressure is looked for [mL]."""
HALVINGS = 60
"""From there down to the rounding of a volume."""


def filled_to(component: Storage, pressure: Any, values: Values) -> Any:
    """Stressed volume [mL] at which a relaxed compartment has a pressure.

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
