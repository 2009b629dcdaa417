"""Arterial baroreflex and cardiopulmonary reflex of Heldt: versions of his thesis and of the program CVSim.

    arterial         e = 18 arctan((P - P_n) / 18)           P mean arterial pressure [mmHg]
    cardiopulmonary  e = 5 arctan((P_ra - P_ra,n) / 5)       P_ra transmural right atrial pressure [mmHg]
    effector         theta + gain * e

A rise of either pressure reduces tone: resistance falls and venous unstressed volume rises. Gains of
resistance are per bed, in PRU (mmHg s/mL) per mmHg. Values at rest (resistances, end-systolic compliances,
heart rate, blood volume) are those of CVSim in both versions.

`heldt2004`: gains of the doctoral thesis (MIT), tables 3.1 to 3.3; the sign of the cardiopulmonary gain of
resistance is that of the program. `heldt2010`: gains of CVSim 1.0 with 21 compartments (Heldt, Mukkamala,
Moody and Mark 2010, Open Pacing Electrophysiol Ther J 3:45), read in the program and in a translation of it.
Their set points, P_n = 91 and P_ra,n = 5 and 8 mmHg, are not used: each patient has their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp

from eclsim.circuit.network import HEART_RATE, mean_of
from eclsim.components.base import Number
from eclsim.regulation.reflex import Effector, Pathway, ReflexModel

ARTERIAL_SCALE, VENOUS_SCALE = 18.0, 5.0
"""Pressure scale over which each reflex saturates [mmHg]."""
RESISTANCES = (4.9, 4.1, 3.0, 4.5)
"""Resistances of upper body, kidneys, splanchnic organs and legs [mmHg s/mL]."""
COMPLIANCES = {"Emaxlv": 0.40, "Emaxrv": 1.30}
"""End-systolic compliance at rest [mL/mmHg] of the ventricle with each elastance."""
PERIOD = 60.0 / 70.0
"""Heart period at rest [s]."""


class Gains(NamedTuple):
    """Gains of a version, per mmHg of effective deviation.

    Attributes:
        resistance: gains of each bed's resistance, arterial and cardiopulmonary [mmHg s/mL].
        compliance: gains of end-systolic compliance, left and right ventricle [mL/mmHg].
        least_compliance: lower limits of the compliances, as shares of those at rest.
        least_resistance: lower limit of each bed's resistance, as a share of that at rest.
        period: gains of the heart period, sympathetic and vagal branch [s].
        veins: gains of venous unstressed volume, arterial and cardiopulmonary [mL].
        lags: onset, peak and end of the triangular responses [s] of contractility and sympathetic period,
            resistance (arterial, cardiopulmonary) and veins (likewise).
    """

    resistance: tuple[float, float]
    compliance: tuple[float, float]
    least_compliance: tuple[float, float]
    least_resistance: float
    period: tuple[float, float]
    veins: tuple[float, float]
    lags: tuple[tuple[float, float, float], ...]


THESIS = Gains(
    (-0.05, -0.05), (0.007, 0.022), (0.0, 0.0), 0.0, (0.011, 0.011), (31.0, 100.0),
    ((2.5, 3.5, 15.0), (2.5, 4.5, 30.0), (2.5, 4.5, 30.0), (5.0, 7.0, 40.0), (5.0, 7.0, 40.0)),
)  # fmt: skip
CVSIM = Gains(
    (-0.13, -0.3), (0.014, 0.021), (0.3 / 0.40, 0.01 / 1.30), 0.2, (0.012, 0.009),
    (5.3 + 1.3 + 13.3 + 6.7, 13.5 + 2.7 + 64.0 + 30.0),
    ((2.5, 3.5, 15.0), (2.5, 3.5, 30.0), (2.5, 5.5, 35.0), (5.0, 10.0, 42.0), (5.0, 9.0, 40.0)),
)  # fmt: skip
"""The lower limit of resistance is not published; without it resistances are negative at high pressure."""
VAGAL = (0.59, 0.70, 1.0)
"""Onset, peak and end of the vagal branch of the period [s]."""


def _drives(deviations: Sequence[Number]) -> list[Number]:
    arterial, venous = (
        scale * jnp.arctan(deviation / scale)
        for deviation, scale in zip(deviations, (ARTERIAL_SCALE, VENOUS_SCALE), strict=True)
    )
    return [arterial, arterial, venous, arterial, venous, arterial, arterial]


def _pathways(gains: Gains) -> tuple[Pathway, ...]:
    names = ("contractility", "resistance_arterial", "resistance_cardiopulmonary", "veins_arterial",
             "veins_cardiopulmonary", "sinus_sympathetic", "sinus_vagal")  # fmt: skip
    return tuple(
        Pathway(name, sum(times) / 3.0, 3.0 if name.endswith("cardiopulmonary") else 10.0)
        for name, times in zip(names, (*gains.lags, gains.lags[0], VAGAL), strict=True)
    )


def _model(name: str, source: str, gains: Gains) -> ReflexModel:
    contractile = zip(COMPLIANCES.items(), gains.compliance, gains.least_compliance, strict=True)
    resistance = (0.0, *gains.resistance, 0.0, 0.0, 0.0, 0.0)
    return ReflexModel(
        name=name,
        source=source,
        reads=(mean_of("Pao"), mean_of("Pra")),
        pathways=_pathways(gains),
        drives=_drives,
        effectors=(
            *(
                Effector(
                    key, (reference,), ((gain, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),), inverse=True, least=least
                )
                for (key, reference), gain, least in contractile
            ),
            Effector("Rmc", RESISTANCES, (resistance,) * len(RESISTANCES), least=gains.least_resistance),
            Effector(HEART_RATE, (PERIOD,), ((0.0, 0.0, 0.0, 0.0, 0.0, *gains.period),), inverse=True),
        ),
        venous_gains_ml=(0.0, 0.0, 0.0, *gains.veins, 0.0, 0.0),
        blood_volume_ml=5150.0,
    )


HELDT_2004 = _model("heldt2004", "Heldt 2004, doctoral thesis, MIT", THESIS)
HELDT_2010 = _model("heldt2010", "CVSim 1.0, 21 compartments (Heldt et al. 2010)", CVSIM)
