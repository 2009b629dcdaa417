"""Arterial baroreflex of Ursino 1998 (Am J Physiol 275:H1733, doi 10.1152/ajpheart.1998.275.5.H1733).

    carotid firing      f_cs = (f_min + f_max e^x) / (1 + e^x),  x = (P - P_n) / k_a
    sympathetic firing  f_es = f_es,inf + (f_es,0 - f_es,inf) e^(-k_es f_cs)
    vagal firing        f_ev = (f_ev,0 + f_ev,inf e^y) / (1 + e^y),  y = (f_cs - f_cs,0) / k_ev
    sympathetic effect  G ln(f_es - f_es,min + 1) above the threshold f_es,min, else 0
    vagal effect        G f_ev

The numbers are from two repositories that reimplement the model, not from the article itself. The published
baroreceptor also responds to the rate of change of pressure, whose mean over a beat is zero. Here its input
is the mean pressure, so that the effect of pulsatility on the firing is omitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType

import jax.numpy as jnp
import numpy as np

from eclsim.circuit.network import HEART_RATE, mean_of
from eclsim.components.base import Number
from eclsim.regulation.reflex import Effector, Pathway, ReflexModel

SET_POINT_MMHG = 92.0
SLOPE_MMHG = 11.758
LEAST_FIRING, MOST_FIRING = 2.52, 47.78
SYMPATHETIC_AT_HIGH_PRESSURE, SYMPATHETIC_AT_LOW_PRESSURE, SYMPATHETIC_RATE = 2.10, 16.11, 0.0675
THRESHOLD = 2.66
VAGAL_AT_LOW_PRESSURE, VAGAL_AT_HIGH_PRESSURE, VAGAL_MIDDLE, VAGAL_SLOPE = 3.2, 6.3, 25.0, 7.06
"""Firing in spikes per second; pressures in mmHg."""


def carotid_firing(deviation: Number, xp: ModuleType = jnp) -> Number:
    """Firing of the carotid sinus nerve [1/s] at a deviation of pressure from the set point [mmHg].

    `xp` is the array module, here and below: with NumPy, single numbers need no compilation.
    """
    rise = xp.exp(deviation / SLOPE_MMHG)
    return (LEAST_FIRING + MOST_FIRING * rise) / (1.0 + rise)


def sympathetic_firing(carotid: Number, xp: ModuleType = jnp) -> Number:
    """Firing of sympathetic fibres [1/s]."""
    span = SYMPATHETIC_AT_LOW_PRESSURE - SYMPATHETIC_AT_HIGH_PRESSURE
    return SYMPATHETIC_AT_HIGH_PRESSURE + span * xp.exp(-SYMPATHETIC_RATE * carotid)


def vagal_firing(carotid: Number, xp: ModuleType = jnp) -> Number:
    """Firing of vagal fibres [1/s]."""
    rise = xp.exp((carotid - VAGAL_MIDDLE) / VAGAL_SLOPE)
    return (VAGAL_AT_LOW_PRESSURE + VAGAL_AT_HIGH_PRESSURE * rise) / (1.0 + rise)


def sympathetic_effect(deviation: Number, xp: ModuleType = jnp) -> Number:
    """Factor of the gains of sympathetic effectors [-]."""
    firing = sympathetic_firing(carotid_firing(deviation, xp), xp)
    return xp.log(xp.maximum(firing - THRESHOLD + 1.0, 1.0))


def _drives(deviations: Sequence[Number]) -> list[Number]:
    (deviation,) = deviations
    sympathetic = sympathetic_effect(deviation) - sympathetic_effect(0.0)
    vagal = vagal_firing(carotid_firing(deviation)) - vagal_firing(carotid_firing(0.0))
    return [sympathetic, sympathetic, sympathetic, sympathetic, vagal]


_AT_REST = float(sympathetic_effect(0.0, np))
_VAGAL_AT_REST = float(vagal_firing(carotid_firing(0.0, np), np))
PATHWAYS = (
    Pathway("contractility", 2.0 + 8.0, 1.0),
    Pathway("resistance", 2.0 + 6.0, 1.0),
    Pathway("veins", 5.0 + 20.0, 1.0),
    Pathway("sinus_sympathetic", 2.0 + 2.0, 1.0),
    Pathway("sinus_vagal", 0.2 + 1.5, 1.0),
)
"""Pathways, with the sum of delay and time constant of each [s]."""


def _sympathetic(pathway: str, theta: float, gain: float) -> tuple[float, tuple[float, ...]]:
    """Value at the set point and gains of all pathways of an effector theta + gain * effect."""
    return theta + gain * _AT_REST, tuple(gain if p.name == pathway else 0.0 for p in PATHWAYS)


def _effector(parameter: str, *beds: tuple[float, tuple[float, ...]], inverse: bool = False) -> Effector:
    return Effector(parameter, tuple(b[0] for b in beds), tuple(b[1] for b in beds), inverse)


_PERIOD = 0.58 - 0.13 * _AT_REST + 0.09 * _VAGAL_AT_REST
"""Heart period at the set point [s]."""
URSINO_1998 = ReflexModel(
    name="ursino1998",
    source="Ursino 1998, Am J Physiol 275:H1733",
    reads=(mean_of("Pao"),),
    pathways=PATHWAYS,
    drives=_drives,
    effectors=(
        _effector("Emaxlv", _sympathetic("contractility", 2.392, 0.475)),
        _effector("Emaxrv", _sympathetic("contractility", 1.412, 0.282)),
        # Splanchnic and other organs; the brain's and the lungs' vessels are not regulated by it.
        _effector("Rmc", _sympathetic("resistance", 2.49, 0.695), _sympathetic("resistance", 0.78, 0.53)),
        _effector(HEART_RATE, (_PERIOD, (0.0, 0.0, 0.0, -0.13, 0.09)), inverse=True),
    ),
    venous_gains_ml=(0.0, 0.0, -265.4 - 132.5, 0.0, 0.0),
    blood_volume_ml=5300.0,
)
