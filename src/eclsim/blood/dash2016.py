"""Saturations and contents after Dash, Korman and Bassingthwaighte 2016: a second, independent set.

Oxygen and carbon dioxide compete for haemoglobin in the water of the red cell. P50 depends on pH, PCO2, DPG
and temperature, and the Hill exponent on PO2.

Haemoglobin binds 1.398 mL/g here; `oxygen_capacity` has no effect. As in the authors' code the first constant
of carbonic acid does not depend on temperature: at 25 C bicarbonate is 16 % above that of the pH equation.

Source: Eur J Appl Physiol 116:97-113, doi 10.1007/s00421-015-3228-3, with the constants of the authors' code.
"""

from __future__ import annotations

import jax.numpy as jnp

from eclsim.blood.types import Array, Blood, HeldGases

P50 = 26.8
"""PO2 at half saturation under standard conditions [mmHg]."""
PLASMA_WATER, CELL_WATER = 0.94, 0.65
"""Share of water in plasma and in red cells [-]."""
DONNAN = 0.69
"""Ratio of the hydrogen ion concentrations in plasma and in red cells [-]."""
GRAMS_PER_MOLE = 64100.0
"""Molar mass of haemoglobin [g/mol]."""
HAEMOGLOBIN_IN_CELLS = 150.0 / 0.45
"""Haemoglobin in red cells [g/L]."""
ML_DL_PER_MOL_L = 2240.0
"""Conversion from mol/L to mL/dL of gas at 22.4 L/mol."""


def half_saturation(pco2: Array, cell_ph: Array, blood: Blood) -> Array:
    """PO2 at half saturation, P50 [mmHg]."""
    acid, carbon_dioxide = cell_ph - 7.24, pco2 - 40.0
    dpg, warm = 1e-3 * blood.dpg - 4.65e-3, blood.temperature - 37.0
    shifts = (
        1.2 * (-21.279 * acid + 8.872 * acid**2 - 1.47 * acid**3),
        1.7 * (0.0428 * carbon_dioxide + 3.64e-5 * carbon_dioxide**2),
        795.633533 * dpg - 19660.8947 * dpg**2,
        0.98 * (1.4945 * warm + 0.04335 * warm**2 + 7e-4 * warm**3),
    )
    value: Array = P50
    for shift in shifts:
        value = value * (1.0 + shift / P50)
    return value


def standard_pressure(po2: Array, pco2: Array, ph: Array, blood: Blood) -> Array:
    """PO2 [mmHg] that is as many times the standard `P50` as `po2` is of the blood's own."""
    return po2 * P50 / half_saturation(pco2, ph + jnp.log10(DONNAN), blood)


def _bound_ratio(po2: Array, standard: Array) -> Array:
    """Ratio of oxygenated to deoxygenated haemoglobin [-]."""
    return (standard / P50) ** (2.8 - 1.2 * 10.0 ** (-po2 / 29.2))


def saturation(po2: Array, pco2: Array, ph: Array, blood: Blood) -> Array:
    """Oxygen saturation of haemoglobin [-]; `ph` is that of plasma."""
    ratio = _bound_ratio(po2, standard_pressure(po2, pco2, ph, blood))
    return ratio / (1.0 + ratio)


def carbamino_saturation(ratio: Array, pco2: Array, ph: Array, blood: Blood) -> Array:
    """Share of the carbon dioxide binding sites of haemoglobin that are occupied [-].

    Args:
        ratio: ratio of oxygenated to deoxygenated haemoglobin [-].
        pco2: partial pressure of carbon dioxide [mmHg].
        ph: pH of plasma.
        blood: properties of the blood.
    """
    carbon_dioxide = _carbon_dioxide_solubility(blood) * pco2
    acid = 10.0**-ph / DONNAN
    free, oxygenated = 21.5 * (1.0 + 1e-6 / acid), 11.3 * (1.0 + 1e-6 / acid)
    free_sites, oxygenated_sites = 1.0 + acid / 2.4e-8, 1.0 + acid / 1.2e-8
    # Oxygen bound for each free amino group, from the ratio of all forms of haemoglobin.
    oxygen = ratio * (free * carbon_dioxide + free_sites)
    oxygen = oxygen / (oxygenated * carbon_dioxide + oxygenated_sites)
    affinity = (free + oxygenated * oxygen) / (free_sites + oxygenated_sites * oxygen)
    return affinity * carbon_dioxide / (1.0 + affinity * carbon_dioxide)


def held(po2: Array, pco2: Array, ph: Array, blood: Blood) -> HeldGases:
    """Saturation and contents of both gases: oxygen as four molecules per haemoglobin, and dissolved."""
    warm = blood.temperature - 37.0
    solubility = 1.46e-6 * (1.0 - 0.01 * warm + 4.234e-4 * warm**2)
    standard = standard_pressure(po2, pco2, ph, blood)
    ratio = _bound_ratio(po2, standard)
    saturated = ratio / (1.0 + ratio)
    oxygen = 4.0 * _haemoglobin(blood) * saturated + _water(blood) * solubility * po2
    carbamino = carbamino_saturation(ratio, pco2, ph, blood)
    carbon_dioxide = _carbon_dioxide_content(pco2, ph, carbamino, blood)
    return HeldGases(standard, saturated, ML_DL_PER_MOL_L * oxygen, carbon_dioxide)


def _carbon_dioxide_content(pco2: Array, ph: Array, carbamino: Array, blood: Blood) -> Array:
    """Content of carbon dioxide [mL/dL STPD]: dissolved, as bicarbonate, and bound to haemoglobin."""
    dissolved = _carbon_dioxide_solubility(blood) * pco2
    cells = _haematocrit(blood)
    bicarbonate = 10.0 ** (ph - 6.12) * dissolved
    space = (1.0 - cells) * PLASMA_WATER + cells * CELL_WATER * DONNAN
    bound = 4.0 * _haemoglobin(blood) * carbamino
    return ML_DL_PER_MOL_L * (_water(blood) * dissolved + space * bicarbonate + bound)


def _carbon_dioxide_solubility(blood: Blood) -> Array:
    warm = blood.temperature - 37.0
    return 32.66e-6 * (1.0 - 0.0186 * warm + 6.515e-4 * warm**2)


def _haematocrit(blood: Blood) -> Array:
    return 10.0 * blood.haemoglobin / HAEMOGLOBIN_IN_CELLS


def _haemoglobin(blood: Blood) -> Array:
    """Haemoglobin in blood [mol/L]."""
    return 10.0 * blood.haemoglobin / GRAMS_PER_MOLE


def _water(blood: Blood) -> Array:
    cells = _haematocrit(blood)
    return (1.0 - cells) * PLASMA_WATER + cells * CELL_WATER
