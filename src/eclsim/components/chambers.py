"""Heart chambers: time-varying elastance, driven by an activation (0 at rest, 1 at peak) over the beat.

         activation(phase)
               |
filling  o-->-( V )-->-o  ejection
               |
             P(V, phase)
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from types import ModuleType
from typing import ClassVar, NamedTuple

import jax.numpy as jnp

from eclsim.components.base import (
    Activation,
    Constants,
    Enclosure,
    Key,
    Number,
    Storage,
    Values,
    names_in,
    value_of,
)

LARGEST_EXPONENT = 30.0
"""Upper limit of exponents, far above any patient's (alpha e^30 = 5e11 mmHg); keeps trial steps finite."""
NOTABLE_MMHG = 1.0
"""Passive pressure, beyond its offset, from which a ventricle can be too weak for the blood in it [mmHg]."""


@dataclass(frozen=True)
class AtrialBump(Activation):
    """a(phase) = (1 - cos(2 pi s)) / 2 for s = (phase - start) / length in 0..1, else 0.

    Defaults are the timing of the published code of Thiel et al. The bump may run into the next beat
    (Shi et al. 2009: start 0.92, length 0.09).
    """

    start: float = 0.90
    length: float = 0.09

    def at(self, phase: Number, xp: ModuleType) -> Number:
        """Activation at phases of 0 to 1."""
        s = ((phase - self.start) % 1.0) / self.length
        return xp.where(s < 1.0, 0.5 * (1.0 - xp.cos(2.0 * xp.pi * s)), 0.0)

    @property
    def break_points(self) -> tuple[float, ...]:
        """Start and end of the bump."""
        return (self.start % 1.0, (self.start + self.length) % 1.0)


@dataclass(frozen=True)
class VentricularSystole(Activation):
    """Activation that rises as (1 - cos) / 2 until `peak`, falls as (1 + cos) / 2 until `end`, else 0.

    Source: Korakianitis and Shi 2006, doi 10.1016/j.jbiomech.2005.05.016; times as in Thiel et al.
    """

    peak: float = 0.30
    end: float = 0.45

    def at(self, phase: Number, xp: ModuleType) -> Number:
        """Activation at phases of 0 to 1."""
        rise = 0.5 * (1.0 - xp.cos(xp.pi * phase / self.peak))
        fall = 0.5 * (1.0 + xp.cos(xp.pi * (phase - self.peak) / (self.end - self.peak)))
        return xp.where(phase <= self.peak, rise, xp.where(phase <= self.end, fall, 0.0))

    @property
    def break_points(self) -> tuple[float, ...]:
        """Peak and end of systole."""
        return (self.peak, self.end)


@dataclass(frozen=True)
class PhaseAsActivation(Activation):
    """The phase itself, for a law whose times are parameters; its pressure must agree at phases 0 and 1."""

    def at(self, phase: Number, xp: ModuleType) -> Number:
        """The phase."""
        return xp.asarray(phase)


class Chamber(Storage[Constants]):
    """A compartment that contracts."""

    timing: Activation

    @property
    def activation(self) -> Activation:
        """Timing of the contraction."""
        return self.timing


class ElastanceSwing(NamedTuple):
    """Constants of an atrium: elastance at rest and its increase to the peak [mmHg/mL]."""

    rest: Number
    swing: Number


@dataclass(frozen=True)
class Atrium(Chamber[ElastanceSwing]):
    """Atrium with a linear elastance that varies between rest and peak.

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
    not_negative: ClassVar = ("diastolic", "systolic")

    def constants(self, values: Values) -> ElastanceSwing:
        """Elastance at rest and its increase to the peak."""
        rest = value_of(values, self.diastolic)
        return ElastanceSwing(rest, value_of(values, self.systolic) - rest)

    def pressure(
        self, volume: Number, activation: Number, constants: ElastanceSwing
    ) -> tuple[Number, Number]:
        """Pressure [mmHg] and elastance [mmHg/mL]."""
        elastance = constants.rest + constants.swing * activation
        return elastance * volume, elastance


class VentricleConstants(NamedTuple):
    """Constants of a ventricle, named as the arguments of `Ventricle`."""

    systolic: Number
    alpha: Number
    kappa: Number
    beta: Number


@dataclass(frozen=True)
class Ventricle(Chamber[VentricleConstants]):
    """Ventricle with a linear pressure-volume relation at peak systole and an exponential one at rest.

    P = v Emax V + (1 - v) (alpha exp(kappa V) + beta),  v = v(phase).

    Where Emax V is below the pressure at rest, the ventricle softens as it contracts (`softens`).

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
    not_negative: ClassVar = ("systolic", "alpha", "kappa")

    def constants(self, values: Values) -> VentricleConstants:
        """The four coefficients."""
        keys = (self.systolic, self.alpha, self.kappa, self.beta)
        return VentricleConstants(*(value_of(values, key) for key in keys))

    def softens(self, volume: float, values: Values) -> bool:
        """Whether the line of peak systole lies below the exponential of the passive curve at a volume [mL].

        The offset beta and exponentials below `NOTABLE_MMHG` are left out: they exceed the line in a
        ventricle that is all but empty, too.
        """
        systolic, alpha, kappa, _ = map(float, self.constants(values))
        resting = alpha * math.exp(min(kappa * volume, LARGEST_EXPONENT))
        return volume > 0.0 and max(NOTABLE_MMHG, systolic * volume) < resting

    def pressure(
        self, volume: Number, activation: Number, constants: VentricleConstants
    ) -> tuple[Number, Number]:
        """Pressure [mmHg] and stiffness [mmHg/mL]."""
        systolic, alpha, kappa, beta = constants
        rest = 1.0 - activation
        passive = rest * alpha * jnp.exp(jnp.minimum(kappa * volume, LARGEST_EXPONENT))
        active = activation * systolic
        return active * volume + passive + rest * beta, active + kappa * passive


class LinearChamberConstants(NamedTuple):
    """Elastance at rest and its increase to the peak [mmHg/mL], rest volume [mL], rest pressure [mmHg]."""

    rest: Number
    swing: Number
    rest_volume: Number
    rest_pressure: Number


@dataclass(frozen=True)
class LinearChamber(Chamber[LinearChamberConstants]):
    """Chamber with a linear elastance about a rest volume and a rest pressure.

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
    not_negative: ClassVar = ("minimum", "maximum")

    def constants(self, values: Values) -> LinearChamberConstants:
        """Elastance at rest, its increase to the peak, rest volume and rest pressure."""
        low = value_of(values, self.minimum)
        swing = value_of(values, self.maximum) - low
        rest = value_of(values, self.rest_volume), value_of(values, self.rest_pressure)
        return LinearChamberConstants(low, swing, *rest)

    def pressure(
        self, volume: Number, activation: Number, constants: LinearChamberConstants
    ) -> tuple[Number, Number]:
        """Pressure [mmHg] and elastance [mmHg/mL]."""
        elastance = constants.rest + constants.swing * activation
        return constants.rest_pressure + elastance * (volume - constants.rest_volume), elastance


# --- a balloon in the aorta ---------------------------------------------------------------------------


class BalloonConstants(NamedTuple):
    """Volume of the gas [mL], phase at which inflation begins."""

    volume: Number
    inflation: Number


@dataclass(frozen=True)
class Balloon(Chamber[BalloonConstants]):
    """Gas-filled balloon in a vessel, as a rigid compartment whose volume is minus the inflated gas volume.

    P = stiffness (V + u Vb),  u(phase) rises as (1 - cos) / 2 from `inflation` on and falls likewise until 1.

    V is 0 when the balloon is empty and -Vb when it is full. The displaced blood is then in the vessels, so
    the sum over all compartments does not change.

    Args:
        gas: Vb, volume of the gas [mL].
        inflation: phase at which inflation begins.
        ramp: duration of inflation, and of deflation, as a share of the beat.
        stiffness: stiffness [mmHg/mL], high enough for V to follow -u Vb.
    """

    gas: Key
    inflation: Key
    ramp: float = 0.08
    stiffness: float = 1e6
    timing: Activation = field(default_factory=PhaseAsActivation)
    constant_stiffness: ClassVar = True
    not_negative: ClassVar = ("gas",)

    def constants(self, values: Values) -> BalloonConstants:
        """Volume of the gas and phase of inflation."""
        return BalloonConstants(value_of(values, self.gas), value_of(values, self.inflation))

    def driven(self, values: Values) -> tuple[Number, float]:
        """Phase and duration of inflation, which may fall in diastole."""
        return value_of(values, self.inflation), self.ramp

    def switching_times(self) -> tuple[str, ...]:
        """The phase of inflation."""
        return names_in(self.inflation)

    def pressure(
        self, volume: Number, activation: Number, constants: BalloonConstants
    ) -> tuple[Number, Number]:
        """Pressure [mmHg] and stiffness [mmHg/mL]; the activation is the phase."""

        def risen(begin: Number) -> Number:
            share = jnp.clip((activation - begin) / self.ramp, 0.0, 1.0)
            return 0.5 * (1.0 - jnp.cos(jnp.pi * share))

        full = risen(constants.inflation) - risen(1.0 - self.ramp)
        pressure = self.stiffness * (volume + full * constants.volume)
        return pressure, jnp.full_like(pressure, self.stiffness)


# --- the pericardium --------------------------------------------------------------------------------


class PericardiumConstants(NamedTuple):
    """Pressure scale [mmHg], volume at zero pressure and volume scale [mL]."""

    pressure: Number
    volume: Number
    scale: Number


@dataclass(frozen=True)
class Pericardium(Enclosure[PericardiumConstants]):
    """Exponential pericardium: P = K (exp((V - V0) / phi) - 1), added to the pressure of every chamber in it.

    Args:
        scale_pressure: K [mmHg].
        volume: V0, total volume of the enclosed chambers at zero pressure [mL].
        scale_volume: phi [mL].

    Source: Smith et al. 2004, doi 10.1016/j.medengphy.2003.10.001, where it encloses the two ventricles.
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
