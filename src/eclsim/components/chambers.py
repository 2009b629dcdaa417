"""Heart chambers: time-varying elastance.

         activation(phase)
               |
filling  o-->-( V )-->-o  ejection
               |
             P(V, phase)
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import jax.numpy as jnp

from eclsim.components.activation import Activation, AtrialBump, VentricularSystole
from eclsim.components.base import Key, Storage, Values, names_in, value_of

LARGEST_EXPONENT = 30.0
"""Cap of kappa * V: far beyond any patient (alpha e^30 = 5e11 mmHg), it keeps trial steps finite."""


@dataclass(frozen=True)
class Atrium(Storage):
    """Linear elastance that swings between rest and peak.

    P = E V,  E = diastolic + (systolic - diastolic) * a(phase).

    Args:
        diastolic: elastance at rest [mmHg/mL] (`Edla`, `Edra`).
        systolic: elastance at peak [mmHg/mL] (`Emaxla`, `Emaxra`).
        timing: activation curve.

    Source: Thiel et al., Table S-1; Shi et al. 2009.
    """

    diastolic: Key
    systolic: Key
    timing: Activation = field(default_factory=AtrialBump)

    @property
    def activation(self) -> Activation:
        """Timing of the contraction."""
        return self.timing

    @property
    def not_negative(self) -> tuple[Key, ...]:
        """Both elastances."""
        return (self.diastolic, self.systolic)

    def parameter_names(self) -> tuple[str, ...]:
        """Both elastances."""
        return names_in(self.diastolic) + names_in(self.systolic)

    def constants(self, values: Values) -> Any:
        """Elastance at rest and its swing [mmHg/mL]."""
        rest = value_of(values, self.diastolic)
        return rest, value_of(values, self.systolic) - rest

    def pressure(self, volume: Any, activation: Any, constants: Any) -> tuple[Any, Any]:
        """Pressure [mmHg] and elastance [mmHg/mL]."""
        rest, swing = constants
        elastance = rest + swing * activation
        return elastance * volume, elastance


@dataclass(frozen=True)
class Ventricle(Storage):
    """Linear at peak systole, exponential at rest.

    P = v Emax V + (1 - v) (alpha exp(kappa V) + beta),  v = v(phase).

    Args:
        systolic: peak elastance [mmHg/mL] (`Emaxlv`, `Emaxrv`).
        alpha: scale of the passive curve [mmHg].
        kappa: steepness of the passive curve [1/mL].
        beta: offset of the passive curve [mmHg].
        timing: activation curve.

    Source: Thiel et al., section 2.2 and Table S-1.
    """

    systolic: Key
    alpha: Key
    kappa: Key
    beta: Key
    timing: Activation = field(default_factory=VentricularSystole)

    @property
    def activation(self) -> Activation:
        """Timing of the contraction."""
        return self.timing

    @property
    def not_negative(self) -> tuple[Key, ...]:
        """Peak elastance, scale and steepness of the passive curve."""
        return (self.systolic, self.alpha, self.kappa)

    def parameter_names(self) -> tuple[str, ...]:
        """Peak elastance and the three coefficients of the passive curve."""
        return sum((names_in(k) for k in (self.systolic, self.alpha, self.kappa, self.beta)), ())

    def constants(self, values: Values) -> Any:
        """The four coefficients."""
        return tuple(value_of(values, k) for k in (self.systolic, self.alpha, self.kappa, self.beta))

    def pressure(self, volume: Any, activation: Any, constants: Any) -> tuple[Any, Any]:
        """Pressure [mmHg] and stiffness [mmHg/mL]."""
        systolic, alpha, kappa, beta = constants
        rest = 1.0 - activation
        passive = rest * alpha * jnp.exp(jnp.minimum(kappa * volume, LARGEST_EXPONENT))
        active = activation * systolic
        return active * volume + passive + rest * beta, active + kappa * passive


@dataclass(frozen=True)
class LinearChamber(Storage):
    """Linear elastance about a rest volume and a rest pressure.

    P = p0 + E (V - v0),  E = minimum + (maximum - minimum) * activation(phase).

    Args:
        minimum: elastance at rest [mmHg/mL].
        maximum: elastance at peak [mmHg/mL].
        rest_volume: v0 [mL].
        rest_pressure: p0 [mmHg].
        timing: activation curve.

    Source: Korakianitis and Shi 2006; Shi et al. 2009.
    """

    minimum: Key
    maximum: Key
    rest_volume: Key
    rest_pressure: Key
    timing: Activation

    @property
    def activation(self) -> Activation:
        """Timing of the contraction."""
        return self.timing

    @property
    def not_negative(self) -> tuple[Key, ...]:
        """Both elastances."""
        return (self.minimum, self.maximum)

    def parameter_names(self) -> tuple[str, ...]:
        """Both elastances, rest volume and rest pressure."""
        keys = (self.minimum, self.maximum, self.rest_volume, self.rest_pressure)
        return sum((names_in(k) for k in keys), ())

    def constants(self, values: Values) -> Any:
        """Elastance at rest, its swing, rest volume, rest pressure."""
        low = value_of(values, self.minimum)
        swing = value_of(values, self.maximum) - low
        return low, swing, value_of(values, self.rest_volume), value_of(values, self.rest_pressure)

    def pressure(self, volume: Any, activation: Any, constants: Any) -> tuple[Any, Any]:
        """Pressure [mmHg] and elastance [mmHg/mL]."""
        low, swing, rest_volume, rest_pressure = constants
        elastance = low + swing * activation
        return rest_pressure + elastance * (volume - rest_volume), elastance
