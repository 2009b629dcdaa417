"""pH of blood from its base excess, by the equations of Henderson-Hasselbalch and van Slyke.

    0.0307 PCO2 10^(pH - 6.1) = 24.5 + (BE + 0.2 Hb (1 - S)) / (1 - 0.0143 Hb) - (9.5 + 1.63 Hb)(pH - 7.4)

BE is that of fully oxygenated blood, which is the same in arteries, veins and after an oxygenator.
Haemoglobin that releases oxygen binds hydrogen ions (Haldane effect), hence the plus sign; the usual form
with a minus sign applies to the base excess at the actual saturation.

Source: Siggaard-Andersen 1977 (doi 10.3109/00365517709098927). Solubility and pK of carbon dioxide change
    with temperature as in Douglas 1988, and neutral pH by 0.0147 per degree (Rosenthal 1948), so that log10
    of the PCO2 of blood in a closed system falls by about 0.02 per degree of cooling.
"""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp

from eclsim.blood.types import NEUTRAL_PH_SLOPE, Array, Blood

ITERATIONS = 10
"""Number of Newton iterations; six suffice for PCO2 between 1 and 300 mmHg."""


CLOSED_PCO2_SLOPE = 0.019
"""Rise of log10 of the PCO2 of blood in a closed system for each degree (Bradley, Stupfel and Severinghaus
1956, doi 10.1152/jappl.1956.9.2.201). The equations above give 0.0175 to 0.02 from 40 down to 30 C."""


def carbon_dioxide_solubility(temperature: Array = 37.0) -> Array:
    """Solubility of carbon dioxide in plasma [mmol/L/mmHg] (Douglas 1988)."""
    cold = 37.0 - temperature
    return 0.0307 + 0.00057 * cold + 0.00002 * cold**2


def bicarbonate(pco2: Array, ph: Array, temperature: Array = 37.0) -> Array:
    """Bicarbonate in plasma [mmol/L] (Henderson-Hasselbalch)."""
    dissolved = carbon_dioxide_solubility(temperature) * pco2
    return dissolved * 10.0 ** (ph - 6.1 - 0.00472 * (37.0 - temperature))


def excess_of(pco2: Array, ph: Array, saturation: Array, blood: Blood) -> Array:
    """Bicarbonate minus the bicarbonate in balance with the buffers [mmol/L]; zero at equilibrium."""
    neutral = 7.4 + NEUTRAL_PH_SLOPE * (37.0 - blood.temperature)
    base = blood.base_excess + 0.2 * blood.haemoglobin * (1.0 - saturation)
    left = base / (1.0 - 0.0143 * blood.haemoglobin)
    buffered = (9.5 + 1.63 * blood.haemoglobin) * (ph - neutral)
    return bicarbonate(pco2, ph, blood.temperature) - 24.5 - left + buffered


def base_excess_of(pco2: Array, ph: Array, saturation: Array, blood: Blood) -> Array:
    """Base excess of fully oxygenated blood [mmol/L] at which blood of a saturation has a pH."""
    without = excess_of(pco2, ph, saturation, blood._replace(base_excess=0.0))
    return without * (1.0 - 0.0143 * blood.haemoglobin)


def ph_of(pco2: Array, blood: Blood, saturation_at: Callable[[Array], Array]) -> Array:
    """The pH at which both equations agree.

    Args:
        pco2: partial pressure of carbon dioxide [mmHg].
        blood: base excess, haemoglobin and temperature of the blood.
        saturation_at: oxygen saturation [-] as a function of pH.
    """

    def excess(ph: Array) -> Array:
        return excess_of(pco2, ph, saturation_at(ph), blood)

    def improved(ph: Array) -> Array:
        value, slope = jax.jvp(excess, (ph,), (jnp.ones_like(ph),))
        return ph - value / slope

    start = jnp.full(jnp.shape(excess(7.4)), 7.4)
    solution = jax.lax.fori_loop(0, ITERATIONS, lambda _, ph: improved(ph), jax.lax.stop_gradient(start))
    # One more step from the solution gives its exact derivative without that of the iterations.
    value, slope = (
        excess(jax.lax.stop_gradient(solution)),
        jax.jvp(excess, (solution,), (jnp.ones_like(solution),))[1],
    )
    return jax.lax.stop_gradient(solution) - value / jax.lax.stop_gradient(slope)
