"""The CRRT study as one JSON object."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from eclsim.crrt_study.limits import LIMITS
from eclsim.crrt_study.ranking import first_choice
from eclsim.crrt_study.statistics import SUMMARISED
from eclsim.crrt_study.unknown_beats import FOUND
from eclsim.crrt_study.uptake import SPLIT
from eclsim.crrt_study.words import choice

if TYPE_CHECKING:
    import xarray as xr

    from eclsim.crrt_study.study import CrrtStudy

MEANS = (
    "Psart", "Psvn", "Ppart", "Pcrrttuin", "Pcrrttuout", "Pecmodrain", "PF", "MAP", "CO", "EDVRV", "ESVRV",
    "SP", "DP", "MPAP", "PCWP", "lowest_drainage_pressure", "recirculated_fraction",
)  # fmt: skip
"""Cycle means [mmHg], flows [L/min] and volumes [mL] of each scheme."""


def study_object(study: CrrtStudy) -> dict[str, Any]:
    """The study as a mapping of plain values; a number that is not finite is None."""
    return {
        "id": study.case.patient.id,
        "converged": study.converged,
        "crrt_flow_ml_min": study.crrt_flow_ml_min,
        "not_known": [
            {
                "policy": one.policy,
                "of": one.place,
                "speeds_rpm": list(one.speeds),
                "status": one.status,
                "message": f"{one.sentence}; {one.advice}",
            }
            for one in study.unsettled
        ],
        "policies": {policy: _policy(study, policy) for policy in study.policies},
    } | ({} if study.uncertainty is None else {"uncertainty": _uncertainty(study.uncertainty)})


def _policy(study: CrrtStudy, policy: str) -> dict[str, Any]:
    own, means = (
        study.case_speed,
        study.means[[*MEANS, "patient_volume_change", "converged", "status"]].sel(policy=policy),
    )
    schemes = {}
    for scheme in study.schemes:
        one = means.sel(scheme=scheme.letter, speed=own)
        schemes[scheme.letter] = {
            "name": scheme.name,
            "access_site": scheme.access_site,
            "return_site": scheme.return_site,
            "note": scheme.note,
            "means": {name: number(one[name]) for name in MEANS},
            "patient_volume_change_ml": number(one["patient_volume_change"]),
            "converged": bool(one["converged"]),
            "status": str(one["status"].item()),
        }
        if study.uptake is not None and policy == "as_published":
            schemes[scheme.letter]["difference_to_no_crrt"] = _split(study.uptake.sel(scheme=scheme.letter))
    alone = study.without_crrt.sel(policy=policy, speed=own)
    best = first_choice(study.ranking[policy])
    return {
        "speed_rpm": own,
        "schemes": schemes,
        "without_crrt": {name: number(alone[name]) for name in MEANS if name in alone}
        | {"converged": bool(alone["converged"]), "status": str(alone["status"].item())},
        "summary": _summary(study.summary.sel(policy=policy, speed=own)),
        "speeds": _at_speeds(study, policy),
        "limits": _limits(study, policy),
        "first_choice": None if best is None else best.letter,
        "first_choice_in_words": choice(study, policy),
        "ranking": [asdict(r) | {"reasons": list(r.reasons)} | _finite(r) for r in study.ranking[policy]],
    }


def _summary(summary: xr.Dataset) -> dict[str, Any]:
    return {"schemes_known": int(summary["schemes_known"])} | {
        name: {
            "median": number(summary[f"{name}_median"]),
            "variation": number(summary[f"{name}_variation"]),
            "variation_percent": number(summary[f"{name}_variation_percent"]),
            "highest": str(summary[f"{name}_highest"].item()),
            "lowest": str(summary[f"{name}_lowest"].item()),
        }
        for name in SUMMARISED
    }


def _at_speeds(study: CrrtStudy, policy: str) -> list[dict[str, Any]]:
    """All schemes at every speed; read from plain arrays, as there are thousands of numbers."""
    means = study.means.sel(policy=policy)
    letters = means["scheme"].values.astype(str)
    values = {name: means[name].transpose("scheme", "speed").values for name in MEANS}
    status = means["status"].transpose("scheme", "speed").values.astype(str)
    found = []
    for k, speed in enumerate(means["speed"].values):
        schemes = {
            letter: {"converged": bool(status[s, k] == FOUND), "status": str(status[s, k])}
            | {name: number(values[name][s, k]) for name in MEANS}
            for s, letter in enumerate(letters)
        }
        summary = _summary(study.summary.sel(policy=policy, speed=speed))
        found.append({"speed_rpm": float(speed), "schemes": schemes, "summary": summary})
    return found


def _limits(study: CrrtStudy, policy: str) -> dict[str, Any]:
    limits = study.limits.sel(policy=policy)
    definitions = {
        limit.name: {
            "quantity": limit.quantity,
            "low_mmhg": number(limit.low),
            "high_mmhg": number(limit.high),
            "meaning": limit.meaning,
        }
        for limit in LIMITS
    }
    schemes = {}
    for letter in limits["scheme"].values.astype(str):
        schemes[letter] = {}
        for name in limits["limit"].values.astype(str):
            one = limits.sel(scheme=letter, limit=name)
            schemes[letter][name] = {
                "largest_ecmo_flow_l_min": number(one["largest_flow"]),
                "largest_speed_rpm": number(one["largest_speed"]),
                "ecmo_flow_at_most_l_min": number(one["flow_at_most"]),
                "state": str(one["state"].item()),
                "in_words": str(one["in_words"].item()),
                "kept_throughout": bool(one["kept_throughout"]),
                "margin_mmhg": number(one["margin"]),
            }
    return {"definitions": definitions, "schemes": schemes}


def _uncertainty(found: xr.Dataset) -> dict[str, Any]:
    names = [str(name) for name in found.data_vars if str(name).endswith("_quantiles")]
    schemes = {}
    for letter in found["scheme"].values.astype(str):
        one = found.sel(scheme=letter)
        kept = {
            f"probability_{w}": _by_limit(one[f"probability_{w}"]) for w in ("kept", "at_least", "at_most")
        }
        spread = {n.removesuffix("_quantiles"): [number(v) for v in one[n].values] for n in names}
        schemes[letter] = kept | {"quantiles": spread, "settled": number(one["settled"])}
    return {
        **{str(k): v for k, v in found.attrs.items()},
        "quantiles": [float(q) for q in found["quantile"].values],
        "schemes": schemes,
    }


def _by_limit(shares: xr.DataArray) -> dict[str, float | None]:
    return {str(k): number(shares.sel(limit=k)) for k in shares["limit"].values}


def _split(one: xr.Dataset) -> dict[str, Any]:
    parts = ("difference", "uptake", "flow")
    found: dict[str, Any] = {n: {p: number(one[f"{n}_{p}"]) for p in parts} for n in SPLIT}
    return found | {"blood_taken_up_ml": number(one["blood_taken_up"]), "status": str(one["status"].item())}


def _finite(ranked: Any) -> dict[str, Any]:
    names = ("lowest_site_pressure", "largest_flow", "flow_at_most", "recirculated", "margin")
    return {name: number(getattr(ranked, name)) for name in names}


def number(value: Any) -> float | None:
    """A finite number, else None."""
    found = float(value)
    return found if math.isfinite(found) else None
