"""Published effects of the devices: does the model move the right way, and by how much?

Signs and sizes are two rows each. A size passes within one standard deviation of the measured change. The
animals and patients are not the model's: a failing heart of the reference cases stands in for them.
"""

from __future__ import annotations

import csv
import math
from functools import lru_cache

import xarray as xr

from eclsim.devices.ecmo import RollerPump
from eclsim.orbit.model import model_of
from eclsim.outputs.dataset import simulate
from eclsim.outputs.registry import output
from eclsim.validation.cases import DATA, reference_case
from eclsim.validation.paper import beat_value, scheme_result
from eclsim.validation.rows import Check, Row, near

FAILING = "cvs_failure_90bpm"
FLOWS_L_MIN = (1.0, 5.0)
CANNULAE_FR = (25.0, 21.0)
NO_REFLEX = (
    "the model's heart and vessels do not react (no reflexes, no better contraction with perfusion) and its "
    "blood volume is fixed, so blood that ECMO holds in the arteries is missing from the lungs; which of "
    "these makes a row miss has not been shown"
)
RAMPS = {
    "HMII": (8000.0, 12000.0, 400.0),
    "HVAD": (2300.0, 3200.0, 100.0),
}
"""LVAD: first speed, last speed and step [rpm]."""
RAMP_SOURCE = "ramp tests in 35 patients, doi:10.1016/j.jchf.2015.10.001"
RAMP_EFFECTS = (("CO", 0.16, 0.19), ("PCWP", -1.23, 0.85))
"""Output, measured change per step and its standard deviation [L/min, mmHg]."""
WU = (("Pcrrttuin", "g", 175.0, 23.0), ("Pcrrttuout", "g", 360.0, 8.0),
      ("Pcrrttuin", "c", 171.0, 22.0), ("Pcrrttuout", "c", 41.0, 13.0))  # fmt: skip
WU_SOURCE = "Wu et al., as cited by Thiel et al., section 4; ECMO flows 3.1 and 4.4 L/min"


def checks() -> list[Check]:
    """V-A ECMO on the failing heart, CRRT pressures, LVAD ramps."""
    bar = "sign, and size within 1 standard deviation; compared, not required"
    pigs = "V-A ECMO, 1 to 5 L/min, on a failing heart, against pigs"
    parts = (
        ("ecmo-effects", pigs, ecmo_rows(), (NO_REFLEX,)),
        ("crrt-effects", "CRRT pressures against patients", crrt_rows(), ()),
        ("lvad-effects", "LVAD ramps against patients", lvad_rows(), ()),
    )
    return [
        Check(key, title, bar, tuple(rows), required=False, remarks=remarks)
        for key, title, rows, remarks in parts
    ]


def _sign(name: str, expected: float, got: float, source: str) -> Row:
    wanted = math.copysign(1.0, expected)
    return near(f"{name}: sign", wanted, math.copysign(1.0, got), 0.5, source=source)


@lru_cache(maxsize=4)
def _on_ecmo(flow_l_min: float) -> xr.Dataset:
    ecmo = reference_case("va_ecmo_default").ecmo
    assert ecmo is not None
    drainage, giving = CANNULAE_FR
    roller = RollerPump(roller_l_min=flow_l_min)
    pumped = {"pump": roller, "speed_rpm": None, "drainage_fr": drainage, "return_fr": giving}
    case = reference_case(FAILING).model_copy(update={"ecmo": ecmo.model_copy(update=pumped)})
    return simulate(model_of(case))


def ecmo_rows() -> list[Row]:
    """Relative change from low to high flow, as animal and model start from different values."""
    low, high = (_on_ecmo(flow) for flow in FLOWS_L_MIN)
    rows = []
    with (DATA / "effects.csv").open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            start, end = float(row["from"]), float(row["to"])
            spread = math.hypot(float(row["from_sd"]), float(row["to_sd"])) / start
            expected, name = end / start - 1.0, row["quantity"]
            got = float(high[name] / low[name] - 1.0)
            label = f"{row['study']}: {output(name).long_name}"
            rows.append(_sign(label, expected, got, row["source"]))
            change = (100 * expected, 100 * got, 100 * spread)
            rows.append(near(f"{label}: change", *change, "%", source=row["source"]))
    return rows


def crrt_rows() -> list[Row]:
    """Pressures of the CRRT lines, and what moving the return line and raising the speed does to them."""
    rows = []
    for quantity, scheme, expected, spread in WU:
        got = beat_value(scheme_result(scheme, 3425.0), quantity)
        words = "access" if quantity == "Pcrrttuin" else "return"
        rows.append(
            near(f"scheme {scheme}: {words} pressure", expected, got, spread, "mmHg", source=WU_SOURCE)
        )
    pressure = {s: beat_value(scheme_result(s, 3425.0), "Pcrrttuout") for s in "gc"}
    label = "return line moved from pre oxygenator to pre pump: return pressure"
    rows.append(_sign(label, -319.0, pressure["c"] - pressure["g"], source=WU_SOURCE))
    change = pressure["c"] - pressure["g"]
    rows.append(near(f"{label}, change", -319.0, change, math.hypot(8.0, 13.0), "mmHg", source=WU_SOURCE))
    for quantity, words in (("Pcrrttuin", "access"), ("Pcrrttuout", "return")):
        rise = beat_value(scheme_result("g", 5000.0), quantity) - beat_value(
            scheme_result("g", 1750.0), quantity
        )
        source = "Sansom et al. 2023 and Xu et al.: pressures rise with the ECMO flow"
        rows.append(_sign(f"more ECMO flow: {words} pressure", 1.0, rise, source=source))
    return rows


def lvad_rows() -> list[Row]:
    """Mean change of a step over the whole ramp."""
    rows = []
    for pump in RAMPS:
        first, last, step = RAMPS[pump]
        steps = (last - first) / step
        low, high = (_on_lvad(pump, speed) for speed in (first, last))
        for name, expected, spread in RAMP_EFFECTS:
            got = float(high[name] - low[name]) / steps
            label = f"{pump} +{step:g} rpm: {output(name).long_name}"
            rows.append(_sign(label, expected, got, source=RAMP_SOURCE))
            rows.append(
                near(f"{label}, change", expected, got, spread, output(name).unit, source=RAMP_SOURCE)
            )
    return rows


def _on_lvad(pump: str, speed_rpm: float) -> xr.Dataset:
    case = reference_case("lvad_hvad_2600")
    assert case.lvad is not None
    lvad = case.lvad.model_copy(update={"pump": pump, "speed_rpm": speed_rpm})
    return simulate(model_of(case.model_copy(update={"lvad": lvad})))
