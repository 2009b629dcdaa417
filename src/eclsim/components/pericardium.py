"""The pericardium: one pressure on all four chambers, from what they hold together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import jax.numpy as jnp

from eclsim.components.base import Enclosure, Key, Number, Values, value_of

LARGEST_EXPONENT = 30.0
"""Beyond it the curve goes on as a straight line: far outside of any patient, trial steps stay finite."""


class PericardiumConstants(NamedTuple):
    """Pressure scale [mmHg], volume without pressure and volume scale [mL]."""

    pressure: Number
    volume: Number
    scale: Number


@dataclass(frozen=True)
class Pericardium(Enclosure[PericardiumConstants]):
    """P = K (exp((V - V0) / phi) - 1), added to the pressure of every chamber in it.

    Args:
        scale_pressure: K [mmHg].
        volume: V0, volume of all that is in it at which there is no pressure [mL].
        scale_volume: phi [mL].

    Source: Smith et al. 2004, doi 10.1016/j.medengphy.2003.10.001, there for the two ventricles.
    """

    scale_pressure: Key
    volume: Key
    scale_volume: Key
    not_negative: ClassVar = ("scale_pressure",)
    above_zero: ClassVar = ("scale_volume",)

    def constants(self, values: Values) -> PericardiumConstants:
        """The three coefficients."""
        keys = (self.scale_pressure, self.volume, self.scale_volume)
        return PericardiumConstants(*(value_of(values, key) for key in keys))

    def pressure(self, volume: Number, constants: PericardiumConstants) -> tuple[Number, Number]:
        """Pressure [mmHg] and stiffness [mmHg/mL]."""
        relative = (volume - constants.volume) / constants.scale
        grown = constants.pressure * jnp.exp(jnp.minimum(relative, LARGEST_EXPONENT))
        beyond = jnp.maximum(relative - LARGEST_EXPONENT, 0.0)
        return grown * (1.0 + beyond) - constants.pressure, grown / constants.scale
