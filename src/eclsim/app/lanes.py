"""Lanes of the timeline: the key figures, and what changes slowly beside them."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eclsim.app.display import figures_of
from eclsim.app.texts import text
from eclsim.fluid.law import INTERSTITIUM, PLASMA, RED_CELLS, REFILLED, REMOVED
from eclsim.parameters.regulation import DRUG_DOSES, DRUGS

if TYPE_CHECKING:
    import xarray as xr

    from eclsim.cases.case import Case


class Lane(NamedTuple):
    """A curve over the minutes.

    Attributes:
        name: of the output, slow state or sum.
        label: in words.
        unit: of the values as shown.
        digits: behind the point.
        values: of each moment.
        usual: whether it is seen before anybody chooses.
    """

    name: str
    label: str
    unit: str
    digits: int
    values: np.ndarray
    usual: bool


_OUTPUTS = (
    ("heart_rate", "1/min", 0), ("DO2", "mL/min", 0), ("drainage_pressure", "mmHg", 0),
    ("unstressed_volume", "mL", 0), ("systemic_resistance_factor", "", 2), ("contractility_lv_factor", "", 2),
    ("tissue_PCO2", "mmHg", 0), ("haematocrit", "%", 1), ("plasma_protein", "g/dL", 1),
    ("oncotic_pressure", "mmHg", 1), ("urea", "mmol/L", 1), ("creatinine", "umol/L", 0),
    ("potassium", "mmol/L", 2), ("bicarbonate", "mmol/L", 1), ("hypoxic_resistance_factor", "", 2),
    (INTERSTITIUM, "mL", 0), (REFILLED, "mL", 0), (REMOVED, "mL", 0),
)  # fmt: skip
"""Name, unit as shown and digits of what can be chosen beside the key figures."""


def lanes_of(case: Case, result: xr.Dataset) -> list[Lane]:
    """What can be drawn of a course; drugs that have any effect."""
    rows = [
        Lane(one.output, one.label, one.unit, one.digits, result[one.output].to_numpy(), True)
        for one in figures_of(case)
        if one.output in result and not one.only_with
    ]
    blood = (result[PLASMA] + result[RED_CELLS]).to_numpy()
    rows.append(Lane("blood_volume", text("lane_blood_volume"), "mL", 0, blood, True))
    for drug in DRUG_DOSES:
        dose = result.get(f"{DRUGS}.{drug}_in_effect")
        if dose is not None and np.nanmax(dose.to_numpy(), initial=0.0) > 0.0:
            words = text("lane_drug", drug=drug)
            rows.append(Lane(str(dose.name), words, dose.attrs["units"], 2, dose.to_numpy(), True))
    for name, unit, digits in _OUTPUTS:
        if name in result:
            values = result[name].to_numpy() * (100.0 if unit == "%" else 1.0)
            rows.append(Lane(name, text(f"lane_{name}"), unit, digits, values, False))
    return [lane for lane in rows if np.isfinite(lane.values).any()]
