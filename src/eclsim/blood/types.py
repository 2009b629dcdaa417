"""What describes blood apart from its gases."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias, TypedDict

import jax
import numpy as np

Array: TypeAlias = float | np.ndarray | jax.Array

NEUTRAL_PH_SLOPE = 0.0147
"""Rise of pH for each degree that closed blood is cooled [1/C] (Rosenthal 1948)."""


class Given(TypedDict, total=False):
    """What may be said of blood apart from its gases; `Blood` has the rest."""

    haemoglobin: Array
    base_excess: Array
    temperature: Array
    oxygen_capacity: Array
    dpg: Array


class Blood(NamedTuple):
    """Blood apart from its gases; numbers or arrays of a common shape.

    Attributes:
        haemoglobin: [g/dL].
        base_excess: of fully oxygenated blood [mmol/L]; metabolism and lung do not change it.
        temperature: [C].
        oxygen_capacity: oxygen that a gram of haemoglobin binds [mL/g]; 1.34 to 1.39 are in use.
        dpg: 2,3-diphosphoglycerate in the red cells [mmol/L]; only the law of Dash 2016 uses it.
    """

    haemoglobin: Array = 15.0
    base_excess: Array = 0.0
    temperature: Array = 37.0
    oxygen_capacity: Array = 1.34
    dpg: Array = 4.65
