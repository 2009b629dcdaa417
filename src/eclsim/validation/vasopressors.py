"""Plasma that leaves for the tissues on noradrenaline, compared with patients.

Nothing was fitted, and the spreads were set before eclsim's numbers were known. Doses are those at which the
simulated patients have the pressure or resistance of the measured ones when the plasma has settled. The
experiment is venules that follow the drug (`fluid.venular_tone` of 1).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import lru_cache

import xarray as xr

from eclsim.cases.reading import read_mapping
from eclsim.course.course import course
from eclsim.outputs.results import simulate
from eclsim.paper.comparison import Check, Row, within
from eclsim.validation.reference_cases import compared, root

NYGREN = (
    "Nygren 2010 (10.1111/j.1399-6576.2010.02244.x), 21 patients in vasodilatory shock, haematocrit at a "
    "mean pressure of 60, 75 and 90 mmHg, abstract; half an hour at each and a third as spread taken"
)
NETTE = (
    "Nette 2006 (10.1093/ndt/gfk070), 6 dialysis patients, 30 min of noradrenaline, blood volume -9 +- 3 %, "
    "abstract; two standard errors"
)
SHOCK_DOSE, SHOCK_MAP = 0.20, 60.0
"""Dose [ug/kg/min] at which the patients in shock had their lowest mean pressure [mmHg]."""
DIALYSED_MAP = 100.0
"""Mean pressure of the dialysis patients before the drug [mmHg], which the abstract does not state."""
CONSTRICTED = 1.47
"""Total peripheral resistance of the dialysis patients at the end, relative to that before."""
HIGHEST_DOSE = 3.0
_VENULES = (
    "arterioles alone answer to a drug unless a case says otherwise, since the effects of the drugs were "
    "fitted to patients whose plasma had moved; with venules that follow (fluid.venular_tone = 1) the rows "
    "of patients in shock hold"
)
LONG_MIN, BEGIN_MIN = 30.0, 1.0


def vasopressors_check() -> Check:
    """Compare plasma and blood volume on noradrenaline."""
    return compared("vasopressors", (*_in_shock(), _dialysed()))


def _in_shock() -> Iterator[Row]:
    """Rows for plasma volume at two pressures above the lowest."""
    for pressure, expected in ((75.0, -6.5), (90.0, -9.4)):
        label = f"noradrenaline, mean pressure 60 to {pressure:.0f} mmHg: plasma volume"
        change, spread = plasma_change(pressure), abs(expected) / 3.0
        row = within(f"{label} (test)", expected, change, spread, "%", source=NYGREN)
        yield row.explained_by(_VENULES, plasma_change(pressure, 1.0), f"{label}, experiment")


def plasma_change(pressure: float, venular_tone: float = 0.0) -> float:
    """Change of plasma volume [%] from haematocrits, at a dose with this mean pressure [mmHg] in the end."""
    rmc = _resistance(SHOCK_DOSE, SHOCK_MAP)
    settled = _titrated(rmc, SHOCK_DOSE, venular_tone, lambda r: float(r["MAP"][-1]) - pressure)
    before, after = (float(settled["haematocrit"][k]) for k in (0, -1))
    return 100.0 * (before / after - 1.0) / (1.0 - before)


def _dialysed() -> Row:
    """Row for blood volume after half an hour of noradrenaline."""
    label = "noradrenaline, resistance +47 %: blood volume"
    change, spread = blood_change(), 2.0 * 3.0 / 6.0**0.5
    row = within(f"{label} (test)", -9.0, change, spread, "%", source=NETTE)
    return row.explained_by(_VENULES, blood_change(1.0), f"{label}, experiment")


def blood_change(venular_tone: float = 0.0) -> float:
    """Change of blood volume [%] from haematocrits, at a dose that constricts as in the dialysis patients."""

    def missing(result: xr.Dataset) -> float:
        before, after = (_total_resistance(result, k) for k in (0, -1))
        return after / before - CONSTRICTED

    settled = _titrated(_resistance(0.0, DIALYSED_MAP), 0.0, venular_tone, missing)
    return 100.0 * float(settled["haematocrit"][0] / settled["haematocrit"][-1] - 1.0)


def _total_resistance(result: xr.Dataset, moment: int) -> float:
    """Total peripheral resistance at a moment of a course [mmHg min/L]."""
    pressure = result["MAP"][moment] - result["right_atrial_pressure"][moment]
    return float(pressure / result["CO"][moment])


@lru_cache
def _resistance(dose: float, pressure: float) -> float:
    """Resistance `Rmc` at which a patient on a dose has a mean arterial pressure [mmHg]."""

    def missing(rmc: float) -> float:
        return float(simulate(read_mapping(_patient(rmc, dose, 0.0)).case)["MAP"]) - pressure

    return root(missing, 0.05, 3.0, xtol=1e-4)


def _titrated(
    rmc: float, dose: float, venular_tone: float, missing: Callable[[xr.Dataset], float]
) -> xr.Dataset:
    """Half an hour at the dose at which something is no longer missing in the end."""

    def followed(infused: float) -> xr.Dataset:
        event = {"at_min": BEGIN_MIN, "set": {"drugs.noradrenaline": infused}}
        case = read_mapping({**_patient(rmc, dose, venular_tone), "events": [event]}).case
        return course(case, minutes=BEGIN_MIN + LONG_MIN)

    found = root(lambda infused: missing(followed(infused)), dose + 0.01, HIGHEST_DOSE, xtol=1e-3)
    return followed(found)


def _patient(rmc: float, dose: float, venular_tone: float) -> dict[str, object]:
    """A patient with soft veins and no reflex, as the drug's effects include those of reflexes."""
    patient = {
        "id": "vasopressor", "sex": "male", "age_years": 62, "height_cm": 175, "weight_kg": 80,
        "heart_rate_bpm": 95,
    }  # fmt: skip
    return {
        "format": 1, "patient": patient, "parameters": {"Rmc": rmc, "Csvn": 60.0, "P0svn": 6.0},
        "drugs": {"noradrenaline": dose},
        "fluid": {"haematocrit": 0.30, "plasma_protein_g_dl": 5.0, "venular_tone": venular_tone},
    }  # fmt: skip
