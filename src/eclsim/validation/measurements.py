"""Comparison with measurements: the paper's text, healthy adults, devices on the bench, animals and patients.

None of these numbers was used for fitting. They are compared and shown, but do not fail the validation.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import xarray as xr

from eclsim.crrt_study.study import CrrtStudy, crrt_study
from eclsim.devices import lvad
from eclsim.devices.cannulae import CANNULAE
from eclsim.devices.ecmo import ECMO, RollerPump
from eclsim.devices.ecmo_parts import PUMPS
from eclsim.files import read_table
from eclsim.orbit.model import AS_PUBLISHED, model_of
from eclsim.outputs.registry import output
from eclsim.outputs.results import simulate
from eclsim.paper.comparison import Check, Row, within
from eclsim.paper.crrt import compute, paper_case, with_blood_volume
from eclsim.paper.printed import AT_CASE, HIGH, LOW, QUANTITIES, TEXT, OfScheme, OverSchemes, Printed
from eclsim.validation.reference_cases import (
    DATA,
    PROTOCOLS,
    compared,
    reference_case,
    reference_result,
    sign,
    with_devices_of,
)

# --- the text of the paper: nine CRRT schemes at three speeds, in the patient of Table S-4 ---------

TEXT_RELATIVE = 0.02
SMALLER_PATIENT_ML = 3247.0
"""Blood volume of the paper's patient as estimated by `eclsim reproduce` [mL]."""
PATIENT_UNKNOWN = (
    "the paper does not print the sex, age and size of its patient, which determine the blood volume; with "
    f"{SMALLER_PATIENT_ML:.0f} mL in place of that of the reference cases, eclsim gives the printed number"
)


def paper_check() -> Check:
    """Compare every number of the text about the nine schemes, except percentages of other rows."""
    rows = tuple(
        _text_row(printed, printed.what)
        for printed in TEXT
        if isinstance(printed.what, OverSchemes | OfScheme)
        and not (printed.other_data or printed.unit == "%")
    )
    return compared("paper", rows)


@lru_cache(maxsize=2)
def text_study(blood_volume_ml: float | None = None) -> CrrtStudy:
    """Return the study of nine schemes at the three speeds of the text, as run by the published code."""
    case = paper_case() if blood_volume_ml is None else with_blood_volume(paper_case(), blood_volume_ml)
    return crrt_study(case, speeds=(LOW, AT_CASE, HIGH), volume_policy=AS_PUBLISHED)


def _text_row(printed: Printed, definition: OverSchemes | OfScheme) -> Row:
    """Row for a number of the text; a miss is explained if a patient with less blood reproduces it."""
    whole = isinstance(definition, OverSchemes)
    statistic = definition.statistic if whole else f"of scheme {definition.scheme}"
    label = f"{QUANTITIES[definition.quantity]}, {definition.speed:.0f} rpm, {statistic}"
    tolerance = max(10.0**-printed.decimals, TEXT_RELATIVE * abs(printed.value))
    source = f"Thiel et al., section {printed.section.partition(',')[0]}"
    got = compute(printed, text_study())
    row = within(label, printed.value, got, tolerance, printed.unit, source=source)
    if row.holds:
        return row
    smaller = compute(printed, text_study(SMALLER_PATIENT_ML))
    return row.explained_by(PATIENT_UNKNOWN, smaller, f"{label}, {SMALLER_PATIENT_ML:.0f} mL")


# --- devices: the published constants against bench data that they were not fitted to -------------

BENCH_RELATIVE, BENCH_MMHG = 0.1, 10.0
OTHER_MAKER = 0.3
"""A point passes within twice its own spread, or within 10 % or 10 mmHg if none is given; the flow of a
cannula of another manufacturer within 30 %, the difference between manufacturers at one size."""


def devices_check() -> Check:
    """Compare pump heads and cannula flows with bench data."""
    rows = tuple(_bench_row(row) for row in read_table(DATA / "devices.csv"))
    heads = [row for row in rows if row.name.startswith("HM3")]
    error = math.sqrt(sum(row.difference**2 for row in heads) / len(heads))
    spread = f"HeartMate 3: root mean square difference over {len(heads)} points {error:.1f} mmHg"
    check = compared("devices", rows)
    return replace(check, remarks=(spread, *check.remarks))


def _bench_row(row: dict[str, str]) -> Row:
    expected, label = float(row["value"]), f"{row['device']} {row['quantity']}, {row['condition']}"
    source = f"{row['source']}; {row['how_read']}; fluid: {row['fluid']}"
    if row["quantity"] == "head":
        got = (PUMPS | lvad.PUMPS)[row["device"]].head_mmhg(float(row["speed_rpm"]), float(row["flow_l_min"]))
        spread = 2.0 * float(row["spread"]) if row["spread"] else None
        tolerance = max(BENCH_RELATIVE * expected, BENCH_MMHG) if spread is None else spread
    else:
        resistance = CANNULAE[row["device"]].resistance(float(row["size_fr"]))
        got, tolerance = math.sqrt(float(row["pressure_mmhg"]) / resistance), OTHER_MAKER * expected
    return within(label, expected, got, tolerance, row["unit"], source=source)


# --- a healthy adult: the reference case of a healthy man against norms ---------------------------

HEALTHY = "cvs_healthy_75bpm"
"""Paper's parameters, stronger left ventricle (Emaxlv 2.8 mmHg/mL), 75 bpm, 40 years, 180 cm, 80 kg."""
BODY_SURFACE_M2 = (180.0 * 80.0 / 3600.0) ** 0.5
"""Body surface area by Mosteller's formula for 180 cm and 80 kg [m2]."""

DERIVED: dict[str, Callable[[xr.Dataset], float]] = {
    "RV systolic pressure": lambda r: float(r["peak_pressure_rv"]),
    "RV end-diastolic pressure": lambda r: float(r["end_diastolic_pressure_rv"]),
    "cardiac index": lambda r: float(r["CO"]) / BODY_SURFACE_M2,
    "pulmonary vascular resistance": lambda r: float((r["MPAP"] - r["PCWP"]) / r["CO"]),
    "systemic vascular resistance": lambda r: float((r["MAP"] - r["right_atrial_pressure"]) / r["CO"]),
    "transpulmonary gradient": lambda r: float(r["MPAP"] - r["PCWP"]),
    "stroke volume of the LV by imaging": lambda r: float(r["stroke_volume_lv"]),
    "stroke volume of the LA": lambda r: float(r["EDVLA"] - r["ESVLA"]),
}


def healthy_check() -> Check:
    """Compare all reference values; a mean with standard deviation allows +- 2 standard deviations."""
    rows = (_norm_row(row, reference_result(HEALTHY)) for row in read_table(DATA / "healthy_adult.csv"))
    return compared("healthy", rows)


def _norm_row(row: dict[str, str], result: xr.Dataset) -> Row:
    name, source = row["output"], f"{row['source']} ({row['population']})"
    got = DERIVED[name](result) if name in DERIVED else float(result[name])
    label = name if name in DERIVED else str(result[name].attrs["long_name"])
    if row["middle"]:
        middle, spread = float(row["middle"]), float(row["spread"])
        return within(label, middle, got, 2.0 * spread, row["unit"], source=source)
    return Row(label, got, float(row["low"]), float(row["high"]), row["unit"], source=source)


# --- effects of the devices: direction and size ---------------------------------------------------

FAILING = "cvs_failure_90bpm"
"""Reference case with a failing heart that represents the animals and patients."""
FLOWS_L_MIN = (1.0, 5.0)
CANNULAE_FR = (25.0, 21.0)
EFFECTS = PROTOCOLS["effects"]
WU_SPREAD_MMHG = {
    ("Pcrrttuin", "g"): 23.0, ("Pcrrttuout", "g"): 8.0, ("Pcrrttuin", "c"): 22.0, ("Pcrrttuout", "c"): 13.0,
}  # fmt: skip
RAMP_EFFECTS = (("CO", 0.16, 0.19), ("PCWP", -1.23, 0.85))
"""Output, measured change per step and its standard deviation [L/min, mmHg]."""


def effects_checks() -> list[Check]:
    """Compare V-A ECMO on the failing heart, CRRT pressures, LVAD ramps; sign and size are separate rows."""
    parts = {"circuit-effects": ecmo_rows, "line-effects": crrt_rows, "assist-effects": lvad_rows}
    return [compared(name, rows()) for name, rows in parts.items()]


@lru_cache(maxsize=4)
def _on_ecmo(flow_l_min: float) -> xr.Dataset:
    drainage_fr, return_fr = CANNULAE_FR
    roller = RollerPump(roller_l_min=flow_l_min)
    pumped = {"pump": roller, "speed_rpm": None, "drainage_fr": drainage_fr, "return_fr": return_fr}
    case = reference_case(PROTOCOLS["reference"]["circuit"]).with_section(ECMO.key, **pumped)
    return simulate(model_of(with_devices_of(reference_case(FAILING), case)))


def ecmo_rows() -> list[Row]:
    """Relative changes from low to high flow, since animals and model start from different values."""
    low, high = (_on_ecmo(flow) for flow in FLOWS_L_MIN)
    rows = []
    for row in read_table(DATA / "effects.csv"):
        start, end, name = float(row["from"]), float(row["to"]), row["quantity"]
        spread = math.hypot(float(row["from_sd"]), float(row["to_sd"])) / start
        expected, got = end / start - 1.0, float(high[name] / low[name] - 1.0)
        label = f"{row['study']}: {output(name).long_name}"
        rows.append(sign(label, expected, got, row["source"]))
        change = (100 * expected, 100 * got, 100 * spread)
        rows.append(within(f"{label}: change", *change, "%", source=row["source"]))
    return rows


def crrt_rows() -> list[Row]:
    """Rows for CRRT line pressures, and effects of moving the return line and of increasing the speed."""
    means = text_study().means.sel(policy=AS_PUBLISHED)

    def pressure(quantity: str, scheme: str, speed: float = AT_CASE) -> float:
        return float(means[quantity].sel(scheme=scheme, speed=speed))

    rows, measured = [], {}
    for printed in TEXT:
        if printed.other_data and isinstance(printed.what, OfScheme):
            quantity, scheme, _ = printed.what
            measured[quantity, scheme] = printed.value
            label, spread = f"scheme {scheme}: {QUANTITIES[quantity]}", WU_SPREAD_MMHG[quantity, scheme]
            got = pressure(quantity, scheme)
            rows.append(within(label, printed.value, got, spread, "mmHg", source=EFFECTS["lines"]))
    label = "return line moved from pre oxygenator to pre pump: return pressure"
    expected = measured["Pcrrttuout", "c"] - measured["Pcrrttuout", "g"]
    change = pressure("Pcrrttuout", "c") - pressure("Pcrrttuout", "g")
    spread = math.hypot(WU_SPREAD_MMHG["Pcrrttuout", "c"], WU_SPREAD_MMHG["Pcrrttuout", "g"])
    rows.append(sign(label, expected, change, source=EFFECTS["lines"]))
    rows.append(within(f"{label}, change", expected, change, spread, "mmHg", source=EFFECTS["lines"]))
    for quantity in ("Pcrrttuin", "Pcrrttuout"):
        rise = pressure(quantity, "g", HIGH) - pressure(quantity, "g", LOW)
        label = f"{EFFECTS['rising_label']}: {QUANTITIES[quantity]}"
        rows.append(sign(label, 1.0, rise, source=EFFECTS["rising"]))
    return rows


def lvad_rows() -> list[Row]:
    """Rows for the mean change per step over the whole ramp."""
    case, rows = reference_case(PROTOCOLS["reference"]["assist"]), []
    for pump, (first, last, step) in EFFECTS["ramps"].items():
        cases = (case.with_section(lvad.LVAD.key, pump=pump, speed_rpm=speed) for speed in (first, last))
        low, high = (simulate(model_of(each)) for each in cases)
        for name, expected, spread in RAMP_EFFECTS:
            got = float(high[name] - low[name]) * step / (last - first)
            label, unit = f"{pump} +{step:g} rpm: {output(name).long_name}", output(name).unit
            rows.append(sign(label, expected, got, source=EFFECTS["ramp"]))
            rows.append(within(f"{label}, change", expected, got, spread, unit, source=EFFECTS["ramp"]))
    return rows
