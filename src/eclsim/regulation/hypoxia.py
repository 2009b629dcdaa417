"""Hypoxic pulmonary vasoconstriction: resistance of the lung as a function of its PO2.

    stimulus  P_S = P_v^0.41 P_A^0.59  of mixed venous and alveolar PO2 [mmHg]
    share of the largest response  s = P_S^-2.616 / (6.683e-5 + P_S^-2.616)
    resistance relative to that without hypoxia  r = 1 + 2.15 s

Marshall 1994 (10.1016/0034-5687(94)90129-5), dogs, at constant flow. Blood that passes no ventilated alveolus
(the shunt) is exposed to the mixed venous PO2 only; both paths are in parallel. In six healthy men at an
end-tidal PO2 of 50 instead of 100 mmHg, resistance rose by 44 % in half an hour and by 137 % in two hours
(Dorrington 1997, Am J Physiol 273:H1126): the slow part of the response is not modelled.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jax import Array

from eclsim.components.base import Number
from eclsim.components.exchangers import TEMPERATURE, dry_gas_pressure, stpd_of_btps
from eclsim.parameters.regulation import LUNG_RESISTANCE, REGULATION
from eclsim.slow import Named, SlowLaw, SlowState

VENOUS, ALVEOLAR = 0.41, 0.59
EXPONENT, HALF_EFFECT, LARGEST = -2.616, 6.683e-5, 3.15
LAG_S = 300.0
"""Time constant of the rapid part of the response [s]: minutes; not verified."""
LEAST_MMHG = 1.0
LUNG_SETTINGS = ("gas.alveolar_ventilation_l_min", "gas.fio2", "gas.shunt_fraction", TEMPERATURE)
WANTED_RESISTANCE = "hypoxic_resistance_wanted"
"""Name of the output of the relative resistance that the present PO2 leads to in the steady state."""


def relative_resistance(venous: Number, alveolar: Number) -> Number:
    """Resistance relative to that without hypoxia, from mixed venous and alveolar PO2 [mmHg]."""
    stimulus = jnp.maximum(venous, LEAST_MMHG) ** VENOUS * jnp.maximum(alveolar, LEAST_MMHG) ** ALVEOLAR
    return 1.0 + (LARGEST - 1.0) / (1.0 + HALF_EFFECT * stimulus**-EXPONENT)


def alveolar_po2(venous: Number, uptake: Number, gained_co2: Number, settings: Sequence[Number]) -> Number:
    """PO2 of ventilated alveoli [mmHg], from the balance of the gases exchanged.

    Args:
        venous: mixed venous PO2 [mmHg], which is that of alveoli without ventilation.
        uptake: oxygen that blood gains [mL/min].
        gained_co2: carbon dioxide that blood gains, negative [mL/min].
        settings: values of `LUNG_SETTINGS`.
    """
    dry, gas = dry_gas_pressure(settings[3]), 1000.0 * stpd_of_btps(settings[3]) * settings[0]
    expired = jnp.where(gas > 0.0, gas - uptake - gained_co2, 1.0)
    return jnp.where(gas > 0.0, dry * (gas * settings[1] - uptake) / expired, venous)


def lung_resistance(venous: Number, uptake: Number, gained_co2: Number, settings: Sequence[Number]) -> Number:
    """Resistance of ventilated lung and shunt in parallel, relative to that without hypoxia."""
    shunt = settings[2]
    ventilated = relative_resistance(venous, alveolar_po2(venous, uptake, gained_co2, settings))
    return 1.0 / ((1.0 - shunt) / ventilated + shunt / relative_resistance(venous, venous))


def lung_law(n: Array) -> Array:
    """Resistance factor from mixed venous PO2, both gases gained, `LUNG_SETTINGS`, strength, rest."""
    now = lung_resistance(n[0], n[1], n[2], (n[3], n[4], n[5], n[6]))
    return jnp.stack([jnp.exp(n[7] * jnp.log(now / n[8]))])


@dataclass(frozen=True)
class HypoxicVasoconstriction(SlowLaw):
    """Slow law of hypoxic vasoconstriction; its state is the logarithm of the lung's resistance factor."""

    factor: str = f"{REGULATION}.hypoxic_resistance_log"

    @property
    def states(self) -> tuple[SlowState, ...]:
        """The logarithm of the factor."""
        return (SlowState(self.factor, "1", "logarithm of the lung's resistance by hypoxia", 0.1),)

    @property
    def reads(self) -> tuple[str, ...]:
        """Output of the relative resistance that the present PO2 leads to."""
        return (WANTED_RESISTANCE,)

    def start(self, settings: Named, beat: Named) -> Named:
        """Start in the steady state."""
        return {self.factor: np.log(beat[WANTED_RESISTANCE])}

    def in_effect(self, states: Named, settings: Named) -> Named:
        """The factor, which is then not solved for with the beat."""
        return {LUNG_RESISTANCE: np.exp(states[self.factor])}

    def rates(self, states: Named, settings: Named, beat: Named, inflows: Named) -> Named:
        """Rate towards the value that the present PO2 leads to; zero if that is not known."""
        target = np.asarray(beat[WANTED_RESISTANCE])
        known = target > 0.0
        return {
            self.factor: np.where(known, np.log(np.where(known, target, 1.0)) - states[self.factor], 0.0)
            / LAG_S
        }
