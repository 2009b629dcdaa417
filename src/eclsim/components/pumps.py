"""Blood pumps: rotary pumps given by their characteristic curve, roller pumps by their flow."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

import jax.numpy as jnp

from eclsim.components.base import Key, Number, Path, Renaming, Values, names_in, renamed, value_of
from eclsim.units import ML_S_PER_L_MIN, convert, quantity_of, units_of

CURVE = ("a", "R1", "R2", "Rrec", "kinf")
PERIPHERY = ("L", "Rper", "Lper")
SMALLEST_DISCRIMINANT = 1e-12


class PumpCurve(NamedTuple):
    """Constants of a rotary pump at its speed, in mmHg and mL/s."""

    shut_off: Number
    slope: Number
    curvature: Number
    recirculation: Number
    kink: Number
    graft: Number
    inertance: Number


@dataclass(frozen=True)
class RotaryPump(Path[PumpCurve]):
    """Centrifugal or axial pump, with or without the inertia and resistance of its graft.

        source o---( P )-->--[ Rper ]---( L + Lper )---o target

        H(Q) = a w^2 - R1 w Q - R2 Q^2 + [Q < kinf w] Rrec (Q - kinf w)^2     w in rpm, Q in L/min, H in mmHg
        (L + Lper) dQ/dt = dp + H(Q) - Rper Q |Q|     with periphery, else H(Q) = -dp at every moment

    H(Q) is a parabola on each side of kinf w and decreases with Q, so the flow under a load is the root of a
    quadratic equation.

    Args:
        speed: w [rpm].
        prefix: prefix of the parameter names: prefix + a, R1, R2, Rrec, kinf (and L, Rper, Lper).
        periphery: whether it has an inlet and an outflow graft, as an LVAD does.

    Units of the constants: a mmHg/rpm^2, R1 mmHg/(rpm L/min), R2, Rrec, Rper mmHg/(L/min)^2,
    kinf (L/min)/rpm, L, Lper mmHg s^2/L.  Source: Boes et al. 2019 (equation); Thiel et al. (constants).
    """

    speed: Key
    prefix: str
    periphery: bool = False
    not_negative: ClassVar = ("speed",)

    @property
    def inertial(self) -> bool:
        """Whether the flow is a state: true with periphery."""
        return self.periphery

    def parameter_names(self) -> tuple[str, ...]:
        """Names of the speed and of the constants of the curve."""
        names = CURVE + (PERIPHERY if self.periphery else ())
        return names_in(self.speed) + tuple(self.prefix + name for name in names)

    def renamed(self, parameter: Renaming) -> RotaryPump:
        """The same pump with its parameters renamed."""
        prefix = parameter(self.prefix + CURVE[0]).removesuffix(CURVE[0])
        return replace(self, speed=renamed(self.speed, parameter), prefix=prefix)

    def constants(self, values: Values) -> PumpCurve:
        """The curve at the pump's speed."""
        per = ML_S_PER_L_MIN
        speed = value_of(values, self.speed)
        a, r1, r2, rrec, kinf = (values[self.prefix + name] for name in CURVE)
        graft, inertia = 0.0, 0.0
        if self.periphery:
            graft = values[self.prefix + "Rper"] / per**2
            inertia = (values[self.prefix + "L"] + values[self.prefix + "Lper"]) / 1000.0
        curve = a * speed**2, r1 * speed / per, r2 / per**2, rrec / per**2, kinf * speed * per
        return PumpCurve(*curve, graft, inertia)

    def inertance(self, constants: PumpCurve) -> Number:
        """L + Lper [mmHg s^2/mL]."""
        return constants.inertance

    def head(self, flow: Number, constants: PumpCurve) -> Number:
        """Head H [mmHg] of the bare pump at a flow [mL/s]."""
        shut_off, slope, curvature, recirculation, kink, _, _ = constants
        below = jnp.minimum(flow - kink, 0.0)
        return shut_off - slope * flow - curvature * flow**2 + recirculation * below**2

    def pressure_drop(self, flow: Number, constants: PumpCurve) -> Number:
        """Pressure drop of the graft minus the head [mmHg]; negative when the pump raises the pressure."""
        return constants.graft * flow * jnp.abs(flow) - self.head(flow, constants)

    def flow(self, pressure_difference: Number, load: Number, constants: PumpCurve) -> Number:
        """Root of load Q + Rper Q |Q| - H(Q) = dp [mL/s]; signs at Q = kink and 0 select the branch."""
        shut_off, slope, curvature, recirculation, kink, graft, _ = constants
        linear = load + slope
        push = pressure_difference + shut_off
        above = push >= (linear + (curvature + graft) * kink) * kink
        low_push = push + recirculation * kink**2
        low_linear = linear + 2.0 * recirculation * kink
        signed_graft = jnp.where(low_push >= 0.0, graft, -graft)
        quadratic = jnp.where(above, curvature + graft, curvature - recirculation + signed_graft)
        middle = jnp.where(above, linear, low_linear)
        drive = jnp.where(above, push, low_push)
        discriminant = jnp.maximum(middle**2 + 4.0 * quadratic * drive, SMALLEST_DISCRIMINANT)
        return 2.0 * drive / (middle + jnp.sqrt(discriminant))


@dataclass(frozen=True)
class RollerPump(Path[Number]):
    """Pump with a prescribed flow, independent of the pressures.

        source o---( O )-->---o target      Q given

    Args:
        rate: the flow, in `unit`.
        unit: any unit of a flow, such as "mL/min" (CRRT) or "L/min" (ECMO).

    Raises:
        ValueError: `unit` is no unit of a flow.
    """

    rate: Key
    unit: str = "ml/min"
    given_flow: ClassVar = True

    def __post_init__(self) -> None:
        if quantity_of(self.unit) != "flow":
            allowed = ", ".join(units_of("flow"))
            raise ValueError(f"roller pump: unit '{self.unit}' is not a unit of flow; allowed: {allowed}")

    def constants(self, values: Values) -> Number:
        """Flow [mL/s]."""
        return value_of(values, self.rate) * convert(1.0, self.unit, "mL/s")

    def pressure_drop(self, flow: Number, constants: Number) -> Number:
        """NaN: the pump builds up whatever pressure its flow requires."""
        return jnp.nan * flow

    def flow(self, pressure_difference: Number, load: Number, constants: Number) -> Number:
        """The given flow [mL/s]."""
        return constants + 0.0 * pressure_difference
