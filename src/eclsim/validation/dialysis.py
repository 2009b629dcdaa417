"""The hemofilter compared with measurements: clearances, and removal of carbon dioxide by dialysis."""

from __future__ import annotations

import jax.numpy as jnp

from eclsim.blood.acid_base import carbon_dioxide_solubility
from eclsim.blood.gases import gases
from eclsim.components.dialysis import (
    CARBON_DIOXIDE_ML_PER_MMOL,
    UREA_RED_CELL_WATER,
    Fluids,
    Solute,
    clearance,
)
from eclsim.paper.comparison import Check, Explanation, Row, within
from eclsim.validation.reference_cases import compared, root

TROYANOV = "Troyanov et al. 2003 (Nephrol Dial Transplant), AN69 filter M-100, abstract"
MAY = "May et al. 2017 (10.1186/s40635-017-0132-7), scaled from the bench, abstract"
DELDOT = "DelDot et al. 2004 (10.1111/j.1365-2125.2004.02143.x), 10 patients, abstract"
ROBERTS = "Roberts et al. 2015 (10.1186/s13054-015-0818-8), 24 patients, abstract"
BILGRAMI = "Bilgrami et al. 2010 (PMC2897321), 10 patients, median and quartiles, abstract"
VANCOMYCIN_SIEVING, MEROPENEM_UNBOUND = 0.7, 0.98
"""Sieving of vancomycin (0.7 +- 0.1, DelDot 2004), and unbound share of meropenem (usual; not verified)."""
RENAL_WEIGHT_KG, RENAL_BLOOD_ML_MIN = 80.0, 180.0
"""Assumed weight and blood flow of Roberts 2015; half of the fluid is assumed to be dialysate and half to be
given behind the filter; the abstract states none of them."""
HAEMATOCRIT, BLOOD_ML_MIN = 0.30, 150.0
"""Haematocrit in intensive care and usual blood flow of that time, if a source does not state them."""
SOLUTES = {"urea": Solute(UREA_RED_CELL_WATER, 1.0, 300.0), "creatinine": Solute(0.0, 1.0, 230.0)}
MAY_DIALYSATE, MAY_POINTS = 540.0, ((248.0, 50.0), (421.0, 50.0), (421.0, 100.0))
"""Flow of dialysate [mL/min]; flow of blood and its PCO2 [mL/min, mmHg]."""
RED_CELL_WATER = 0.72
BATHS_MMOL_L = (-5.0, -1.0)
"""Base excess of blood at 50 and 100 mmHg at which both tests hold if dissolved gas crosses [mmol/L]."""


def dialysis_check() -> Check:
    """Compare clearances by filtration, dilution, and carbon dioxide removal on benches and in patients.

    Two constants are fitted to one number each, the area products of the bench's dialyzer for carbon dioxide
    and of patients' dialyzers for vancomycin; all other numbers are tests.
    """
    return compared("dialysis", (*_filtration(), *antibiotics(), *respiratory_dialysis()))


def _filtration() -> list[Row]:
    """Rows for the ratio of effluent to plasma concentration, and the loss by dilution before the filter."""
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


def antibiotics() -> list[Row]:
    """Rows for clearances of vancomycin [mL/min] and meropenem [L/h] by CRRT."""

    def vancomycin(blood: float, area_product: float, dialysate: float, after: float) -> float:
        return _drug_cleared(blood, VANCOMYCIN_SIEVING, area_product, dialysate=dialysate, after=after)

    fitted = root(lambda x: vancomycin(200.0, x, 1.0, 2.0) - 30.0, 5.0, 1000.0)
    half = {dose: 0.5e-3 * dose * RENAL_WEIGHT_KG for dose in (25.0, 40.0)}
    got = {dose: vancomycin(RENAL_BLOOD_ML_MIN, fitted, flow, flow) for dose, flow in half.items()}
    before, after, both = (
        0.06 * _drug_cleared(250.0, MEROPENEM_UNBOUND, 200.0, before=share * 4.4, after=(1.0 - share) * 4.4)
        for share in (1.0, 0.0, 0.5)
    )
    label = "meropenem cleared by 4.4 L/h of filtrate, blood 250 mL/min"
    unknown = Explanation(
        f"the abstract does not say where the fluid is given: {after:.1f} L/h all behind, {before:.1f} all "
        "before the filter, half before as measured",
        (within(label, 3.5, both, 0.4, "L/h"),),
        undecided=True,
    )
    return [
        within(
            "vancomycin cleared, 1 L/h of dialysate and 2 L/h of filtrate (fit)", 30.0,
            vancomycin(200.0, fitted, 1.0, 2.0), 6.7, "mL/min", source=DELDOT,
        ),
        *(
            within(f"vancomycin cleared, {dose:g} mL/kg/h (test)", value, got[dose], 0.15 * value, "mL/min",
                   source=ROBERTS)
            for dose, value in ((25.0, 22.0), (40.0, 28.0))
        ),
        within(label, 3.5, after, 0.4, "L/h", source=BILGRAMI, explanation=unknown),
    ]  # fmt: skip


def _drug_cleared(
    blood: float, sieving: float, area_product: float, *,
    dialysate: float = 0.0, before: float = 0.0, after: float = 0.0,
) -> float:  # fmt: skip
    """Clearance of a drug [mL/min] relative to plasma, with fluids in L/h."""
    fluids = _fluids(*(1000.0 / 60.0 * flow for flow in (dialysate, before, after)))
    plasma = jnp.asarray(blood * (1.0 - HAEMATOCRIT))
    return float(clearance(plasma, fluids, Solute(0.0, sieving, area_product)))


def _fluids(dialysate: float = 0.0, before: float = 0.0, after: float = 0.0) -> Fluids:
    return Fluids(*map(jnp.asarray, (dialysate, before, after, 0.0)))


def respiratory_dialysis() -> list[Row]:
    """Rows for carbon dioxide removal by dialysate without bicarbonate [mL/min]."""
    plain = _dialysed(crosses=False)
    gas, baths = _dialysed(crosses=True), _dialysed(crosses=True, base_excess=BATHS_MMOL_L)
    names = [f"CO2 removed, blood {b:.0f} mL/min, PCO2 {p:.0f} mmHg" for b, p in MAY_POINTS]
    measured = ((62.6, 4.8), (77.7, 3.0), (117.8, 3.8))
    as_gas = (
        "carbon dioxide that crosses as gas, faster than bicarbonate, is not distinguished here; when it "
        "crosses as fast as water brings it, "
    )
    reasons = (
        None,
        Explanation(
            f"{as_gas}the removal is within the spread",
            (within(names[1], 77.7, gas[1], 3.0, "mL/min"),),
        ),
        Explanation(
            f"{as_gas}{gas[2]:.0f} mL/min are removed. The abstract states neither base excess and "
            "haemoglobin of the two baths nor the flow at which so much was removed; with a base excess of "
            f"{BATHS_MMOL_L[0]:g} mmol/L at 50 and {BATHS_MMOL_L[1]:g} at 100 mmHg both rows hold",
            tuple(within(names[k], measured[k][0], baths[k], measured[k][1], "mL/min") for k in (1, 2)),
            undecided=True,
        ),
    )
    return [
        within(
            f"{name} ({'test' if reason else 'fit'})", *(value, got, spread), "mL/min",
            source=MAY, explanation=reason,
        )
        for name, (value, spread), got, reason in zip(names, measured, plain, reasons, strict=True)
    ]  # fmt: skip


def _dialysed(crosses: bool, base_excess: tuple[float, float] = (0.0, 0.0)) -> list[float]:
    """Removal at the three points [mL/min], with the bicarbonate constant fitted to the first.

    Args:
        crosses: whether dissolved carbon dioxide crosses as fast as the water of the whole blood carries it.
        base_excess: base excess of blood at 50 and at 100 mmHg [mmol/L].
    """

    def removal(point: tuple[float, float], area_product: float) -> float:
        blood, pco2 = point
        bath = gases(po2=60.0, pco2=pco2, haemoglobin=10.0, base_excess=base_excess[0 if pco2 < 100.0 else 1])
        water = Solute(0.0, 1.0, area_product).water_flow(jnp.asarray(blood), jnp.asarray(HAEMATOCRIT))
        cleared = clearance(water, _fluids(MAY_DIALYSATE), Solute(0.0, 1.0, area_product))
        free = Solute(RED_CELL_WATER, 1.0, 1.0).water_flow(jnp.asarray(blood), jnp.asarray(HAEMATOCRIT))
        dissolved = (free if crosses else cleared) * carbon_dioxide_solubility() * pco2
        return 1e-3 * CARBON_DIOXIDE_ML_PER_MMOL * float(cleared * bath.bicarbonate + dissolved)

    fitted = root(lambda x: removal(MAY_POINTS[0], x) - 62.6, 5.0, 1000.0)
    return [removal(point, fitted) for point in MAY_POINTS]
