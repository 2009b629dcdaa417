"""Hypoxic pulmonary vasoconstriction in courses: resistance of the lung follows the oxygen that it sees.

    stimulus  P_S = P_v^0.41 P_A^0.59  of mixed venous and alveolar PO2 [mmHg]
    share of the largest answer  s = P_S^-2.616 / (6.683e-5 + P_S^-2.616)
    resistance relative to that without hypoxia  r = 1 + 2.15 s

Marshall 1994 (10.1016/0034-5687(94)90129-5), dogs, at constant flow. Blood that passes no ventilated
alveolus (the shunt) sees the mixed venous PO2 alone; both ways lie side by side. In six healthy men at an
end-tidal PO2 of 50 instead of 100 mmHg resistance rose by 44 % in half an hour and by 137 % in two
(Dorrington 1997, Am J Physiol 273:H1126): the slow part of the answer is not here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eclsim.components.exchangers import BTPS_TO_STPD, DRY_MMHG
from eclsim.parameters.regulation import HYPOXIA, REGULATION
from eclsim.slow.law import Named, Shown, SlowLaw, SlowState

VENOUS, ALVEOLAR = 0.41, 0.59
EXPONENT, HALF, LARGEST = -2.616, 6.683e-5, 3.15
LAG_S = 300.0
"""Time constant of the rapid part [s]: minutes; not verified."""
LEAST_MMHG = 1.0


def relative_resistance(venous: np.ndarray, alveolar: np.ndarray) -> np.ndarray:
    """Resistance relative to that without hypoxia, from mixed venous and alveolar PO2 [mmHg]."""
    stimulus = np.maximum(venous, LEAST_MMHG) ** VENOUS * np.maximum(alveolar, LEAST_MMHG) ** ALVEOLAR
    return 1.0 + (LARGEST - 1.0) / (1.0 + HALF * stimulus**-EXPONENT)


def alveolar_po2(settings: Named, beat: Named) -> np.ndarray:
    """PO2 of ventilated alveoli [mmHg], by the balance of the gases that they exchange."""
    gas = 1000.0 * BTPS_TO_STPD * settings["gas.alveolar_ventilation_l_min"]
    expired = gas - beat["VO2_lung"] + beat["VCO2_lung"]
    oxygen = gas * settings["gas.fio2"] - beat["VO2_lung"]
    return np.where(gas > 0.0, DRY_MMHG * oxygen / np.where(gas > 0.0, expired, 1.0), beat["PvO2"])


@dataclass(frozen=True)
class HypoxicVasoconstriction(SlowLaw):
    """Logarithm of the lung's resistance relative to that at the start, where the patient's own holds."""

    factor: str = f"{REGULATION}.hypoxic_resistance_log"
    at_start: str = f"{REGULATION}.hypoxic_resistance_log_at_start"

    @property
    def states(self) -> tuple[SlowState, ...]:
        """The logarithm now, and what it is counted from."""
        return SlowState(self.factor, "1", 0.1), SlowState(self.at_start, "1", 0.1)

    @property
    def reads(self) -> tuple[str, ...]:
        """Mixed venous PO2, and what the lung exchanges."""
        return "PvO2", "VO2_lung", "VCO2_lung"

    def wanted(self, settings: Named, beat: Named) -> np.ndarray:
        """The logarithm that the oxygen now would bring about."""
        venous, shunt = beat["PvO2"], settings["gas.shunt_fraction"]
        ventilated = relative_resistance(venous, alveolar_po2(settings, beat))
        joint = (1.0 - shunt) / ventilated + shunt / relative_resistance(venous, venous)
        return -np.asarray(settings[HYPOXIA]) * np.log(joint)

    def start(self, settings: Named, beat: Named) -> Named:
        """Long since in effect."""
        return dict.fromkeys((self.factor, self.at_start), self.wanted(settings, beat))

    def in_effect(self, states: Named, settings: Named) -> Named:
        """The patient's resistance times the change since the start."""
        return {"Rpmc": settings["Rpmc"] * self._change(states)}

    def shown(self, states: Named, in_effect: Named) -> tuple[Shown, ...]:
        """The factor."""
        words = "resistance of the lung relative to that at the start, by hypoxia"
        return (Shown("hypoxic_resistance_factor", "1", words, self._change(states)),)

    def _change(self, states: Named) -> np.ndarray:
        return np.exp(states[self.factor] - states[self.at_start])

    def rates(self, states: Named, settings: Named, beat: Named, inflows: Named) -> Named:
        """Towards what the oxygen now would bring about."""
        wanted = self.wanted(settings, beat)
        return {self.factor: (wanted - states[self.factor]) / LAG_S, self.at_start: np.zeros_like(wanted)}
