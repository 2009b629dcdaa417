"""Properties of blood other than its gases, and what it holds."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias, TypedDict

import jax
import numpy as np
import numpy.typing as npt

Array: TypeAlias = float | np.ndarray | jax.Array
Values: TypeAlias = npt.ArrayLike | jax.Array
"""What users may give: a number, a list or an array."""

NEUTRAL_PH_SLOPE = 0.0147
"""Rise of pH per degree of cooling of blood in a closed system [1/C] (Rosenthal 1948)."""


class Given(TypedDict, total=False):
    """Optional properties of blood other than its gases; `Blood` describes them and has the defaults."""

    haemoglobin: Values
    base_excess: Values
    temperature: Values
    oxygen_capacity: Values
    dpg: Values


class Blood(NamedTuple):
    """Properties of blood other than its gases; numbers or arrays of a common shape.

    Attributes:
        haemoglobin: haemoglobin concentration [g/dL].
        base_excess: base excess of fully oxygenated blood [mmol/L]; gas exchange does not change it.
        temperature: temperature [C].
        oxygen_capacity: oxygen that haemoglobin binds [mL/g]; values of 1.34 to 1.39 are in use.
        dpg: 2,3-diphosphoglycerate in the red cells [mmol/L]; only the law of Dash 2016 uses it.
    """

    haemoglobin: Array = 15.0
    base_excess: Array = 0.0
    temperature: Array = 37.0
    oxygen_capacity: Array = 1.34
    dpg: Array = 4.65


class HeldGases(NamedTuple):
    """What blood holds at given partial pressures and pH.

    Attributes:
        standard_pressure: PO2 with the same saturation under standard conditions [mmHg].
        saturation: oxygen saturation of haemoglobin [-].
        oxygen: content of oxygen, bound and dissolved [mL/dL STPD].
        carbon_dioxide: content of carbon dioxide [mL/dL STPD].
    """

    standard_pressure: Array
    saturation: Array
    oxygen: Array
    carbon_dioxide: Array
