"""A dialysed drug in a course: how long it was above its target, and where the doses went."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import xarray as xr

from eclsim.cases.fluid import DialysedDrug
from eclsim.course.result import TIME
from eclsim.fluid.dialysed_drug import AMOUNTS, CONCENTRATION, UNBOUND
from eclsim.inputs.sections import CHECKED
from eclsim.orbit.model import CASE

TINY_MG_L = 1e-12
"""Change of a concentration between two moments below which it is constant."""


def dialysed_drug_of(result: xr.Dataset) -> DialysedDrug | None:
    """Section [dialysed_drug] of the case of a course or of a band; None if there is none."""
    if UNBOUND not in result:
        return None
    stated = json.loads(result.attrs[CASE])[DialysedDrug.section]
    return DialysedDrug.model_validate(stated, context=CHECKED)


def drug_record(result: xr.Dataset) -> dict[str, Any] | None:
    """The drug of a course in numbers: target, share of the time above it, extremes, and a balance [mg].

    Args:
        result: a course.

    Returns:
        None without a drug or without moments. `share_above_target` is None without a target; `error_mg` is
        the part of the balance that is not accounted for.
    """
    drug, minute = dialysed_drug_of(result), result[TIME].to_numpy()
    if drug is None or not len(minute):
        return None
    unbound, plasma = result[UNBOUND].to_numpy(), result[CONCENTRATION].to_numpy()
    change = {name.split(".")[1]: float(result[name][-1] - result[name][0]) for name in AMOUNTS}
    left = change["dialysed_mg"] + change["eliminated_mg"] + change["bled_mg"]
    held = change.pop("central_mg") + change.pop("peripheral_mg")
    return {
        "name": drug.label,
        "target_mg_l": drug.target_mg_l or None,
        "share_above_target": share_above(minute, unbound, drug.target_mg_l) if drug.target_mg_l else None,
        "highest_mg_l": float(plasma.max()),
        "last_mg_l": float(plasma[-1]),
        **change,
        "error_mg": change["given_mg"] - left - held,
    }


def share_above(minute: np.ndarray, values: np.ndarray, target: float) -> float:
    """Share of the time in which a quantity, linear between moments, is above a target."""
    before, after, steps = values[:-1] - target, values[1:] - target, np.diff(minute)
    total = steps.sum()
    if not total:
        return float(values[-1] > target)
    above = np.clip(np.maximum(before, after) / np.maximum(np.abs(after - before), TINY_MG_L), 0.0, 1.0)
    return float((above * steps).sum() / total)


def drug_in_words(result: xr.Dataset) -> str:
    """Sentence on the drug of a course; empty if there is none."""
    record = drug_record(result)
    if record is None:
        return ""
    words = f"{record['name']}: at most {record['highest_mg_l']:.1f} mg/L in the plasma"
    if (share := record["share_above_target"]) is not None:
        nearly = 0.995 <= share < 1.0
        percent = "more than 99 %" if nearly else f"{100.0 * share:.0f} %"
        words += f", unbound above {record['target_mg_l']:g} mg/L for {percent} of the time"
    went = f"{record['dialysed_mg']:.0f} mg by dialysis, {record['eliminated_mg']:.0f} mg by the body"
    went += f", {record['bled_mg']:.0f} mg by bleeding" * (abs(record["bled_mg"]) >= 0.5)
    return f"{words}; given {record['given_mg']:.0f} mg, removed {went}"
