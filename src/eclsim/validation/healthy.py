"""A healthy adult: the reference case of a healthy man against norms.

The set is the paper's with a stronger left ventricle (Emaxlv 2.8 mmHg/mL), 75 bpm, 40 years, 180 cm, 80 kg;
nothing in it was fitted to these norms. A norm given as mean and standard deviation counts as its mean +- 2
deviations.
"""

from __future__ import annotations

import csv
from collections.abc import Callable

import xarray as xr

from eclsim.validation.cases import DATA
from eclsim.validation.reference_cases import reference_result
from eclsim.validation.rows import Check, Row

CASE = "cvs_healthy_75bpm"
BODY_SURFACE_M2 = (180.0 * 80.0 / 3600.0) ** 0.5
"""Mosteller's formula for 180 cm and 80 kg."""

Derived = Callable[[xr.Dataset], float]
DERIVED: dict[str, Derived] = {
    "RV systolic pressure": lambda r: float(r["peak_pressure_rv"]),
    "RV end-diastolic pressure": lambda r: float(r["end_diastolic_pressure_rv"]),
    "cardiac index": lambda r: float(r["CO"]) / BODY_SURFACE_M2,
    "pulmonary vascular resistance": lambda r: float((r["MPAP"] - r["PCWP"]) / r["CO"]),
    "systemic vascular resistance": lambda r: float((r["MAP"] - r["right_atrial_pressure"]) / r["CO"]),
    "transpulmonary gradient": lambda r: float(r["MPAP"] - r["PCWP"]),
    "stroke volume of the LV by imaging": lambda r: float(r["stroke_volume_lv"]),
    "stroke volume of the LA": lambda r: float(r["EDVLA"] - r["ESVLA"]),
}


def checks() -> list[Check]:
    """Every norm."""
    result = reference_result(CASE)
    with (DATA / "healthy_adult.csv").open(encoding="utf-8", newline="") as file:
        rows = tuple(_row(row, result) for row in csv.DictReader(file))
    title = "A healthy adult (the paper's parameters, Emaxlv 2.8, man of 40 years) against norms"
    bar = "the norm's range, or mean +- 2 standard deviations; compared, not required"
    remark = (
        "atrial volumes are stressed volumes: the paper's atria have no volume at zero pressure, so they are "
        "smaller than those of imaging"
    )
    return [Check("healthy", title, bar, rows, required=False, remarks=(remark,))]


def _row(row: dict[str, str], result: xr.Dataset) -> Row:
    name, source = row["output"], f"{row['source']} ({row['population']})"
    got = DERIVED[name](result) if name in DERIVED else float(result[name])
    label = name if name in DERIVED else str(result[name].attrs["long_name"])
    if row["middle"]:
        middle, spread = float(row["middle"]), float(row["spread"])
        return Row(label, got, middle - 2 * spread, middle + 2 * spread, row["unit"], middle, source=source)
    return Row(label, got, float(row["low"]), float(row["high"]), row["unit"], source=source)
