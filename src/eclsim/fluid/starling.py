r"""Exchange of fluid and protein across the capillary wall, and return by lymph.

    filtration = LpS [(Pc - Pi) - sigma (pi_p - pi_i)]          (Starling; Kedem and Katchalsky)
    protein    = (1 - sigma) filtration (c_p + c_i)/2 + PS f((dPc - dPi) / P0) (c_p - c_i)
    lymph      = m L0 f(k dPi), k = (dL/dPi) / L0; it carries interstitial fluid with its protein
    f(x)       = 1 + x above 0, e^x below

d is the change since the start; m is 1 unless the lymphatics themselves pump more or less than at the start.
f has one slope at 0: lymph and the leak rise in proportion to pressure and fade without ever standing still.
The leak follows the hydrostatic pressure across the wall, as 75 to 90 % of the albumin that leaves crosses
large pores, with the water (Rippe and Haraldsson 1987, Acta Physiol Scand 131:411, abstract), and they hold
back no protein whose oncotic pressure could oppose it.

Oncotic pressure: Landis and Pappenheimer 1963. Pi depends on the interstitial volume along a curve that is
steep below the normal volume and flat in oedema. At the start filtration equals lymph, and PS is such that
protein leaks out at the rate at which lymph returns it: whatever the patient's pressures are, nothing moves
until something changes.

What crosses the wall may first enter a share of the interstitium next to the capillaries. pi_i and c_i above
are then those of this share, whose protein is diluted by filtration and concentrated by reabsorption,

    d(protein near)/dt = protein - J_far,   J_far = q (c_near e^Pe - c_far)/(e^Pe - 1),   Pe = q / mixing

with q the flow of water from it to the rest of the interstitium (filtration minus the swelling of the share).
Lymph leaves from the rest. Volumes are in mL, concentrations in g/dL, flows in mL/min, protein in g/min.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

DEHYDRATED_PER_MMHG = 0.0607
"""Share of the normal interstitial volume lost per mmHg fall of Pi, 510 of 8400 mL; human model of Xie et
al. 1995 (Bull Math Biol 57), not verified."""
OEDEMA_MMHG = 2.6
"""Rise of Pi [mmHg] from the normal volume to its plateau in oedema; the same model, not verified."""
LYMPH_PER_MMHG = 0.36
"""Relative rise of lymph flow per mmHg of Pi: 43 of 120 mL/h; the same model, not verified."""
LARGE_PORES_MMHG = 20.0
"""Hydrostatic pressure P0 [mmHg] across the capillary wall at rest, without which nothing passes large pores:
17.3 inside, -3 outside; textbook, not verified. No row of the validation changes its verdict at 10 to 20."""
EXCLUDED_SHARE = 0.25
"""Share of the normal interstitial volume that excludes protein; the same model, not verified."""
CAPILLARY_SHARE = 0.15
"""Share of the arteriovenous pressure drop downstream of mid-capillary; textbook, not verified."""

MIXING_ML_MIN = 0.5
"""Exchange of protein [mL/min] between pericapillary and distant water without flow; so small that convection
dominates (0.2 to 2 mL/min change no row of the validation by more than 0.3 of its unit)."""

ALBUMIN_EQUIVALENT = 1.19
"""Plasma protein [g] with the oncotic effect of 1 g of albumin (smaller molecules): 5 g/dL of albumin have
2.8 c + 0.18 c^2 + 0.012 c^3 = 20.0 mmHg (Landis and Pappenheimer 1963), as does plasma at 5.94 g/dL. Added to
plasma with equal parts of albumin and globulin, a gram of albumin counts 1.18 to 1.19 times."""


class Spaces(NamedTuple):
    """Plasma and interstitium.

    Attributes:
        plasma: volume [mL].
        interstitium: volume [mL].
        plasma_protein: protein in plasma [g].
        interstitial_protein: protein in the interstitium [g].
        normal: interstitial volume without oedema [mL].
        pericapillary_protein: protein in the pericapillary share [g]; None if the interstitium is undivided.
        pericapillary_share: pericapillary share of the interstitium [-]; 1 if the interstitium is undivided.
    """

    plasma: np.ndarray
    interstitium: np.ndarray
    plasma_protein: np.ndarray
    interstitial_protein: np.ndarray
    normal: np.ndarray
    pericapillary_protein: np.ndarray | None = None
    pericapillary_share: np.ndarray | float = 1.0

    @property
    def concentrations(self) -> tuple[np.ndarray, np.ndarray]:
        """Protein concentrations of plasma and of the accessible interstitium [g/dL]."""
        return (
            100.0 * self.plasma_protein / np.maximum(self.plasma, 1.0),
            100.0 * self.interstitial_protein / self._accessible_volume,
        )

    @property
    def pericapillary_and_distant(self) -> tuple[np.ndarray, np.ndarray]:
        """Protein concentrations of the pericapillary share and of the rest of the interstitium [g/dL]."""
        _, mean = self.concentrations
        if self.pericapillary_protein is None:
            return mean, mean
        apart, share = self.pericapillary_share < 1.0, np.minimum(self.pericapillary_share, 1.0 - 1e-9)
        distant = (
            100.0
            * (self.interstitial_protein - self.pericapillary_protein)
            / ((1.0 - share) * self._accessible_volume)
        )
        pericapillary = 100.0 * self.pericapillary_protein / (share * self._accessible_volume)
        return np.where(apart, pericapillary, mean), np.where(apart, distant, mean)

    @property
    def _accessible_volume(self) -> np.ndarray:
        """Volume of the interstitium that protein can enter [mL]."""
        return np.maximum(self.interstitium - EXCLUDED_SHARE * self.normal, 1.0)


class Wall(NamedTuple):
    """The capillary wall and the lymphatics.

    Attributes:
        filtration: filtration coefficient LpS [mL/min/mmHg].
        reflection: reflection coefficient sigma [-].
        lymph: lymph flow at the start [mL/min].
        pump: pumping of the lymphatics relative to the start, at the same interstitial pressure [-].
    """

    filtration: np.ndarray
    reflection: np.ndarray
    lymph: np.ndarray
    pump: np.ndarray | float = 1.0


class Forces(NamedTuple):
    """Starling forces across the wall, as changes since the start [mmHg].

    Attributes:
        capillary: capillary pressure.
        interstitial: interstitial pressure.
        plasma_oncotic: oncotic pressure of the plasma.
        interstitial_oncotic: oncotic pressure of the interstitium next to the capillaries.
    """

    capillary: np.ndarray
    interstitial: np.ndarray
    plasma_oncotic: np.ndarray
    interstitial_oncotic: np.ndarray


class Exchange(NamedTuple):
    """Rates of exchange, from plasma to interstitium.

    Attributes:
        fluid: filtration minus lymph flow [mL/min].
        protein: protein filtered minus protein in lymph [g/min].
        pericapillary_protein: gain of the pericapillary share [g/min].
    """

    fluid: np.ndarray
    protein: np.ndarray
    pericapillary_protein: np.ndarray


def oncotic_pressure(protein: np.ndarray) -> np.ndarray:
    """Oncotic pressure [mmHg] of protein [g/dL] (Landis and Pappenheimer 1963)."""
    return protein * (2.1 + protein * (0.16 + 0.009 * protein))


def interstitial_pressure(volume: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Pressure of the interstitium [mmHg], 0 at the normal volume."""
    linear = (volume / normal - 1.0) / DEHYDRATED_PER_MMHG
    over = np.maximum(linear, 0.0) / OEDEMA_MMHG
    return np.minimum(linear, 0.0) - OEDEMA_MMHG * np.expm1(-over)


def capillary_pressure(
    arterial: np.ndarray, venous: np.ndarray, tone: np.ndarray, venules: np.ndarray | float = 1.0
) -> np.ndarray:
    """Mean capillary pressure [mmHg].

    Args:
        arterial: mean arterial pressure [mmHg].
        venous: mean venous pressure [mmHg].
        tone: resistance of arterioles relative to the start.
        venules: resistance of venules relative to the start.
    """
    behind = CAPILLARY_SHARE * venules
    share = behind / ((1.0 - CAPILLARY_SHARE) * tone + behind)
    return venous + share * (arterial - venous)


def forces(now: Spaces, rest: Spaces, pressure_rise: np.ndarray) -> Forces:
    """Starling forces as changes since the start; arguments as of `exchange`."""
    interstitial_rise = interstitial_pressure(now.interstitium, now.normal) - interstitial_pressure(
        rest.interstitium, rest.normal
    )
    (inside, _), (inside_0, outside_0) = now.concentrations, rest.concentrations
    pericapillary, _ = now.pericapillary_and_distant
    return Forces(
        pressure_rise,
        interstitial_rise,
        oncotic_pressure(inside) - oncotic_pressure(inside_0),
        oncotic_pressure(pericapillary) - oncotic_pressure(outside_0),
    )


def exchange(now: Spaces, rest: Spaces, pressure_rise: np.ndarray, wall: Wall) -> Exchange:
    """Rates of exchange across the wall now.

    Args:
        now: present volumes and protein.
        rest: volumes and protein at the start, in balance.
        pressure_rise: rise of capillary pressure since the start [mmHg].
        wall: constants of the capillary wall.
    """
    (inside, _), (inside_0, outside_0) = now.concentrations, rest.concentrations
    pericapillary, distant = now.pericapillary_and_distant
    _, interstitial_rise, plasma_oncotic_rise, interstitial_oncotic_rise = forces(now, rest, pressure_rise)
    held = plasma_oncotic_rise - interstitial_oncotic_rise
    filtered = wall.lymph + wall.filtration * (pressure_rise - interstitial_rise - wall.reflection * held)
    lymph = wall.pump * wall.lymph * relative_flow(LYMPH_PER_MMHG * interstitial_rise)
    dragged, dragged_0 = (
        0.005 * (1.0 - wall.reflection) * flow * (a + b)
        for flow, a, b in ((filtered, inside, pericapillary), (wall.lymph, inside_0, outside_0))
    )
    permeability = (0.01 * wall.lymph * outside_0 - dragged_0) / (inside_0 - outside_0)  # g/min for 1 g/dL
    pressed = relative_flow((pressure_rise - interstitial_rise) / LARGE_PORES_MMHG)
    crossed = dragged + permeability * pressed * (inside - pericapillary)
    passed = filtered - now.pericapillary_share * (filtered - lymph)
    onward = 0.01 * MIXING_ML_MIN * convected_and_mixed(passed / MIXING_ML_MIN, pericapillary, distant)
    return Exchange(filtered - lymph, crossed - 0.01 * lymph * distant, crossed - onward)


def relative_flow(rise: np.ndarray) -> np.ndarray:
    """Flow relative to rest: 1 + rise, and where pressure falls e^rise, which never stops or turns back."""
    return np.maximum(rise, 0.0) + np.exp(np.minimum(rise, 0.0))


def convected_and_mixed(peclet: np.ndarray, upstream: np.ndarray, downstream: np.ndarray) -> np.ndarray:
    """Flux by convection and mixing between two concentrations, relative to mixing alone, in steady flow."""

    def weight(x: np.ndarray) -> np.ndarray:
        small = np.abs(x) < 1e-3
        safe = np.where(small, 1.0, np.minimum(x, 500.0))
        return np.where(small, 1.0 - x / 2.0 + x * x / 12.0, safe / np.expm1(safe))

    return weight(-peclet) * upstream - weight(peclet) * downstream
