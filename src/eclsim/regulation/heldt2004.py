"""Arterial baroreflex and cardiopulmonary reflex of Heldt 2004 (doctoral thesis, MIT), tables 3.1 to 3.3.

    arterial         e = 18 arctan((P - 91) / 18)            P mean arterial pressure [mmHg]
    cardiopulmonary  e = 5 arctan((P_ra - 5) / 5)            P_ra transmural right atrial pressure [mmHg]
    effector         theta + gain * e

A rise of either pressure withdraws tone: resistance falls and veins widen. Gains of resistance are those of
each bed, in PRU (mmHg s/mL) per mmHg. Values at rest (resistances, end-systolic compliances, heart rate,
blood volume) were read in jCVSim, a public program of the same model family, whose gains are those of an
earlier version; the sign of the cardiopulmonary gain of resistance is that of this program.
"""

from __future__ import annotations

from collections.abc import Sequence

import jax.numpy as jnp

from eclsim.circuit.network import HEART_RATE, mean_of
from eclsim.components.base import Number
from eclsim.regulation.reflex import Effector, Pathway, ReflexModel

ARTERIAL_SCALE, VENOUS_SCALE = 18.0, 5.0
"""Pressure over which each reflex saturates [mmHg]."""
RESISTANCES = (4.9, 4.1, 3.0, 4.5)
"""Upper body, kidneys, splanchnic organs, legs [mmHg s/mL]."""
PER_ARTERIAL, PER_VENOUS = -0.05, -0.05
"""Gains of each resistance [mmHg s/mL per mmHg]."""
COMPLIANCES = {"Emaxlv": (0.40, 0.007), "Emaxrv": (1.30, 0.022)}
"""End-systolic compliance at rest [mL/mmHg], and its arterial gain [mL/mmHg^2]."""
PERIOD, PER_BRANCH = 60.0 / 70.0, 0.011
"""Heart period at rest [s], and gain of the sympathetic and of the vagal branch [s/mmHg]."""
VEINS = (31.0, 100.0)
"""Arterial and cardiopulmonary gain of venous unstressed volume [mL/mmHg]."""

PATHWAYS = (
    # Mean delays of triangular responses (onset, peak, end), [s].
    Pathway("contractility", (2.5 + 3.5 + 15.0) / 3.0, 10.0),
    Pathway("resistance_arterial", (2.5 + 4.5 + 30.0) / 3.0, 10.0),
    Pathway("resistance_cardiopulmonary", (2.5 + 4.5 + 30.0) / 3.0, 3.0),
    Pathway("veins_arterial", (5.0 + 7.0 + 40.0) / 3.0, 10.0),
    Pathway("veins_cardiopulmonary", (5.0 + 7.0 + 40.0) / 3.0, 3.0),
    Pathway("sinus_sympathetic", (2.5 + 3.5 + 15.0) / 3.0, 10.0),
    Pathway("sinus_vagal", (0.59 + 0.70 + 1.0) / 3.0, 10.0),
)


def arterial_error(deviation: Number) -> Number:
    """Effective deviation of arterial pressure [mmHg]."""
    return ARTERIAL_SCALE * jnp.arctan(deviation / ARTERIAL_SCALE)


def venous_error(deviation: Number) -> Number:
    """Effective deviation of right atrial pressure [mmHg]."""
    return VENOUS_SCALE * jnp.arctan(deviation / VENOUS_SCALE)


def _drives(deviations: Sequence[Number]) -> list[Number]:
    arterial, venous = arterial_error(deviations[0]), venous_error(deviations[1])
    return [arterial, arterial, venous, arterial, venous, arterial, arterial]


_RESISTANCE = (0.0, PER_ARTERIAL, PER_VENOUS, 0.0, 0.0, 0.0, 0.0)
HELDT_2004 = ReflexModel(
    name="heldt2004",
    source="Heldt 2004, doctoral thesis, MIT",
    reads=(mean_of("Pao"), mean_of("Pra")),
    published_set_points=(91.0, 5.0),
    pathways=PATHWAYS,
    drives=_drives,
    effectors=(
        *(
            Effector(name, (rest,), ((gain, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),), inverse=True)
            for name, (rest, gain) in COMPLIANCES.items()
        ),
        Effector("Rmc", RESISTANCES, (_RESISTANCE,) * len(RESISTANCES)),
        Effector(HEART_RATE, (PERIOD,), ((0.0, 0.0, 0.0, 0.0, 0.0, PER_BRANCH, PER_BRANCH),), inverse=True),
    ),
    venous_gains_ml=(0.0, 0.0, 0.0, VEINS[0], VEINS[1], 0.0, 0.0),
    blood_volume_ml=5150.0,
)
