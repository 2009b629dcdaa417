"""Severinghaus' oxygen dissociation curve with Kelman's shifts, and Douglas' content of carbon dioxide.

Both are smooth and monotone in the partial pressures, as a solver requires.

Sources: Severinghaus 1979 (doi 10.1152/jappl.1979.46.3.599); Kelman 1966 (doi 10.1152/jappl.1966.21.4.1375);
Douglas, Jones and Reed 1988 (doi 10.1152/jappl.1988.65.1.473).
"""

from __future__ import annotations

import jax.numpy as jnp

from eclsim.blood.acid_base import carbon_dioxide_solubility
from eclsim.blood.types import NEUTRAL_PH_SLOPE, Array, Blood, HeldGases

OXYGEN_SOLUBILITY = 0.0031
"""Solubility of oxygen in blood at 37 C [mL/dL/mmHg]."""
DOUGLAS_PH = 7.6
"""pH at 37 C above which the red cell factor is extrapolated: the fitted factor has a pole at pH 8.142."""
DOUGLAS_REST = 1.165
"""Largest further rise of the extrapolated term 1 / (8.142 - pH); keeps red cells' content positive."""


def standard_pressure(po2: Array, pco2: Array, ph: Array, blood: Blood) -> Array:
    """PO2 [mmHg] with the same saturation at pH 7.4, PCO2 40 mmHg and 37 C (Kelman 1966)."""
    shift = 0.024 * (37.0 - blood.temperature) + 0.40 * (ph - 7.4) + 0.06 * jnp.log10(40.0 / pco2)
    return po2 * 10.0**shift


def severinghaus(pressure: Array) -> Array:
    """Saturation [-] at a PO2 [mmHg] under standard conditions; error of the curve below 0.0055."""
    cubic = pressure**3 + 150.0 * pressure
    return cubic / (cubic + 23400.0)


def severinghaus_pressure(saturation: Array) -> Array:
    """PO2 [mmHg] at a saturation under standard conditions: the real root of the cubic."""
    free = 23400.0 * saturation / (1.0 - saturation)
    # P^3 + 150 P = free, solved by P = 2 sqrt(50) sinh(t), since 4 sinh^3 + 3 sinh = sinh 3t.
    return 2.0 * jnp.sqrt(50.0) * jnp.sinh(jnp.arcsinh(free / (2.0 * 50.0**1.5)) / 3.0)


def mean_slope(first: Array, second: Array) -> Array:
    """Mean slope [1/mmHg] of the curve between two PO2 [mmHg] under standard conditions, or at one."""
    quadratic = first**2 + first * second + second**2 + 150.0
    below, above = (at**3 + 150.0 * at + 23400.0 for at in (first, second))
    return 23400.0 * quadratic / (below * above)


def saturation(po2: Array, pco2: Array, ph: Array, blood: Blood) -> Array:
    """Oxygen saturation of haemoglobin [-]."""
    return severinghaus(standard_pressure(po2, pco2, ph, blood))


def held(po2: Array, pco2: Array, ph: Array, blood: Blood) -> HeldGases:
    """Saturation and contents of both gases."""
    standard = standard_pressure(po2, pco2, ph, blood)
    saturated = severinghaus(standard)
    oxygen = blood.oxygen_capacity * blood.haemoglobin * saturated + OXYGEN_SOLUBILITY * po2
    return HeldGases(standard, saturated, oxygen, carbon_dioxide_content(pco2, ph, saturated, blood))


def carbon_dioxide_content(pco2: Array, ph: Array, saturated: Array, blood: Blood) -> Array:
    """Content of carbon dioxide [mL/dL STPD]: that of plasma times a factor for the red cells."""
    temperature = blood.temperature
    cold = 37.0 - temperature
    pk = 6.086 + 0.042 * (7.4 - ph) + (38.0 - temperature) * (0.00472 + 0.00139 * (7.4 - ph))
    plasma = 2.226 * carbon_dioxide_solubility(temperature) * pco2 * (1.0 + 10.0 ** (ph - pk))
    at_37 = ph - NEUTRAL_PH_SLOPE * cold  # the distribution between plasma and cells follows neutral pH
    cells = 0.0289 * blood.haemoglobin / (3.352 - 0.456 * saturated) * _term_of_ph(at_37)
    return plasma * (1.0 - cells)


def _term_of_ph(ph: Array) -> Array:
    """1 / (8.142 - pH) as fitted up to `DOUGLAS_PH`, then continued with the same slope to a limit."""
    last = 8.142 - DOUGLAS_PH
    beyond = jnp.maximum(ph - DOUGLAS_PH, 0.0)
    continued = 1.0 / last - DOUGLAS_REST * jnp.expm1(-beyond / (last**2 * DOUGLAS_REST))
    return jnp.where(ph > DOUGLAS_PH, continued, 1.0 / (8.142 - jnp.minimum(ph, DOUGLAS_PH)))
