"""The law of the hemofilter against measurements on the bench and in patients.

One constant is fitted, the area product of the bench's dialyzer for carbon dioxide, to its first number; the
others are tests.
"""

from __future__ import annotations

import math

import jax.numpy as jnp

from eclsim.blood.acid_base import carbon_dioxide_solubility
from eclsim.blood.gases import gases
from eclsim.components.dialysis import (
    CARBON_DIOXIDE_ML_PER_MMOL,
    UREA_RED_CELL_WATER,
    Fluids,
    Solute,
    clearance,
    removed,
)
from eclsim.paper.comparison import Check, Explanation, Row, within

TROYANOV = "Troyanov et al. 2003 (Nephrol Dial Transplant), AN69 filter M-100, abstract"
MAY = "May et al. 2017 (10.1186/s40635-017-0132-7), scaled from the bench, abstract"
HAEMATOCRIT, BLOOD_ML_MIN = 0.30, 150.0
"""Where a source does not state them: of patients in intensive care, and the usual flow of that time."""
SOLUTES = {"urea": Solute(UREA_RED_CELL_WATER, 1.0, 300.0), "creatinine": Solute(0.0, 1.0, 230.0)}
MAY_DIALYSATE, MAY_BLOOD = 540.0, (248.0, 421.0)
UNKNOWN_BLOOD = Explanation(
    "base excess and haemoglobin of the bench's blood are not in the abstract; 0 mmol/L and 10 g/dL taken. "
    "Carbon dioxide that crosses as gas, faster than bicarbonate, is not told apart; it counts most at a "
    "high pressure"
)


def dialysis_check() -> Check:
    """Clearances by filtration, dilution, and carbon dioxide removed by dialysis."""
    rows = (*_filtration(), *respiratory_dialysis())
    bar = "spreads of the measurements; compared, not required"
    return Check("dialysis", "Hemofilter against measurements", bar, rows, required=False)


def _filtration() -> list[Row]:
    """Effluent over plasma, and what dilution before the filter costs."""
    rows = []
    for name, solute in SOLUTES.items():
        water = solute.water_flow(jnp.asarray(BLOOD_ML_MIN), jnp.asarray(HAEMATOCRIT))
        for flow_l_h in (1.0, 4.5):
            filtered = flow_l_h * 1000.0 / 60.0
            ratio = float(clearance(water, _fluids(after=filtered), solute)) / filtered
            label = f"{name}, {flow_l_h} L/h behind the filter: effluent over plasma (sets sieving)"
            rows.append(within(label, 1.0, ratio, 0.05, source=TROYANOV))
        lost = 100.0 * (1.0 - float(clearance(water, _fluids(before=75.0), solute)) / 75.0)
        label = f"{name}, 4.5 L/h before the filter: clearance lost"
        rows.append(within(label, 40.0, lost, 5.0, "%", source=TROYANOV))
    return rows


def _fluids(dialysate: float = 0.0, before: float = 0.0, after: float = 0.0) -> Fluids:
    return Fluids(*map(jnp.asarray, (dialysate, before, after, 0.0)))


def respiratory_dialysis() -> list[Row]:
    """Carbon dioxide that dialysate without bicarbonate removes [mL/min]."""

    def plasma(pco2: float) -> float:
        found = gases(po2=60.0, pco2=pco2, haemoglobin=10.0)
        return float(found.bicarbonate + carbon_dioxide_solubility() * pco2)

    def water(blood: float) -> float:
        return float(Solute(0.0, 1.0, 1.0).water_flow(jnp.asarray(blood), jnp.asarray(HAEMATOCRIT)))

    def removal(blood: float, pco2: float, area_product: float) -> float:
        cleared = clearance(jnp.asarray(water(blood)), _fluids(MAY_DIALYSATE), Solute(0.0, 1.0, area_product))
        return CARBON_DIOXIDE_ML_PER_MMOL * float(removed(cleared, jnp.asarray(plasma(pco2)), *jnp.zeros(2)))

    low, high = MAY_BLOOD
    inlet, cleared = water(low), 1e3 * 62.6 / CARBON_DIOXIDE_ML_PER_MMOL / plasma(50.0)
    share = inlet / MAY_DIALYSATE  # the counter-current formula, solved for KoA
    fitted = inlet / (1.0 - share) * math.log((inlet - cleared * share) / (inlet - cleared))
    points = (
        ("fit", low, 50.0, 62.6, 4.8),
        ("test", high, 50.0, 77.7, 3.0),
        ("test", high, 100.0, 117.8, 3.8),
    )
    return [
        within(
            f"CO2 removed, blood {blood:.0f} mL/min, PCO2 {pco2:.0f} mmHg ({use})", expected,
            removal(blood, pco2, fitted), spread, "mL/min", source=MAY,
            explanation=None if use == "fit" else UNKNOWN_BLOOD,
        )
        for use, blood, pco2, expected, spread in points
    ]  # fmt: skip
