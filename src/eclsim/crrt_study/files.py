"""Files of the CRRT study: page, JSON, CSV tables, NetCDF and figures."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

import pandas as pd
import xarray as xr

from eclsim import files
from eclsim.cases.fit_mark import with_doubts
from eclsim.crrt_study.assumptions import assumptions_in_words
from eclsim.crrt_study.beats import SPLIT_QUANTITIES, SUMMARISED
from eclsim.crrt_study.limits import Limit
from eclsim.crrt_study.ranking import choice_text, first_choice
from eclsim.crrt_study.renox import compared_with_schemes
from eclsim.crrt_study.report import EXCHANGE_COLUMNS, drawings, study_page
from eclsim.crrt_study.study import CrrtStudy
from eclsim.files import MADE_BY, Json, finite, frame_text, json_text, write_texts
from eclsim.orbit.model import AS_PUBLISHED, CASE, case_record

FILES = ("report.html", "study.json", "study.nc")
TABLES = ("means", "summary", "limits", "ranking", "uptake")
DRAWINGS = ("schemes", "beat", "speeds", "limits", "uptake")


def file_names() -> tuple[str, ...]:
    """Names of all files that a study may write."""
    return (*FILES, *(f"{name}.csv" for name in TABLES), *(f"{name}.svg" for name in DRAWINGS))


def write_study(study: CrrtStudy, folder: Path) -> list[Path]:
    """Write all files to a folder, which is created if necessary, and return their paths."""
    drawn = drawings(study)
    texts = {"report.html": study_page(study, drawn), "study.json": study_json(study)}
    texts |= {f"{name}.svg": svg for name, svg in drawn.items()}
    texts |= {f"{name}.csv": frame_text(table) for name, table in tables(study).items()}
    written = write_texts(folder, texts)
    write_netcdf(study, folder / "study.nc")
    return [*written, folder / "study.nc"]


def study_json(study: CrrtStudy) -> str:
    """The study as JSON text."""
    return json_text(study_object(study))


# --- JSON -----------------------------------------------------------------------------------------


MEANS = (
    "Psart", "Psvn", "Ppart", "Pcrrttuin", "Pcrrttuout", "Pecmodrain", "PF", "MAP", "CO", "EDVRV", "ESVRV",
    "SP", "DP", "MPAP", "PCWP", "lowest_drainage_pressure", "recirculated_fraction", "past_oxygenator",
)  # fmt: skip
"""Cycle means [mmHg], flows [L/min] and volumes [mL] of each scheme."""
EXCHANGE = (
    *(n for group in EXCHANGE_COLUMNS for n, *_ in group if n not in MEANS),
    "effluent_ml_h",
    "transmembrane_pressure",
)
"""Outputs of dialysis and gas exchange of each scheme, if the study has them."""
STATISTICS = ("median", "variation", "variation_percent", "highest", "lowest")
DIFFERENCES = ("difference", "uptake", "flow")
STATES = ("converged", "status", "gas_status")
"""How the searches for beats and, if the study has them, gas states ended."""


def study_object(study: CrrtStudy) -> dict[str, Json]:
    """The study as a mapping of plain values; numbers that are not finite are None."""
    content = {
        "id": study.case.patient.id,
        CASE: case_record(study.case),
        "converged": study.converged,
        "crrt_flow_ml_min": study.crrt_flow_ml_min,
        "rule": {**study.rule.as_object(), "in_words": [c.sentence for c in study.rule.criteria]},
        "not_known": [
            {"policy": entry.policy, "of": entry.place, "speeds_rpm": entry.speeds, "status": entry.status,
             "message": f"{entry.sentence}; {entry.advice}"}
            for entry in study.unsettled
        ],
        "assumed": assumptions_in_words(study),
        "warnings": list(study.warnings),
        "policies": {policy: _policy(study, policy) for policy in study.policies},
    }  # fmt: skip
    if study.uncertainty is not None:
        content["uncertainty"] = _uncertainty(study.uncertainty)
    return {key: finite(value) for key, value in content.items()}


def _names(study: CrrtStudy) -> list[str]:
    return [*MEANS, *(name for name in EXCHANGE if name in study.means)]


def _states(data: xr.Dataset) -> list[str]:
    return [name for name in STATES if name in data]


def _values(data: xr.Dataset, names: Sequence[str] | Mapping[str, str]) -> dict[str, object]:
    """Scalars of a dataset by name, or by the keys of a mapping to their names."""
    keys = names if isinstance(names, Mapping) else {name: name for name in names}
    return {key: data[name].item() for key, name in keys.items()}


def _policy(study: CrrtStudy, policy: str) -> dict[str, object]:
    at_case = {"policy": policy, "speed": study.case_speed}
    means, without_crrt = study.means.sel(at_case), study.without_crrt.sel(at_case)
    schemes = {}
    for scheme in study.schemes:
        scheme_means = means.sel(scheme=scheme.letter)
        schemes[scheme.letter] = {
            "name": scheme.name, "access_site": scheme.access_site, "return_site": scheme.return_site,
            "note": scheme.note, "returns_behind_oxygenator": scheme.returns_behind_oxygenator,
            "means": _values(scheme_means, _names(study)),
            "patient_volume_change_ml": scheme_means["patient_volume_change"].item(),
            **_values(scheme_means, _states(scheme_means)),
        }  # fmt: skip
        if study.uptake is not None and policy == AS_PUBLISHED:
            split = study.uptake.sel(scheme=scheme.letter)
            parts = {n: _values(split, {p: f"{n}_{p}" for p in DIFFERENCES}) for n in SPLIT_QUANTITIES}
            whole = _values(split, {"blood_taken_up_ml": "blood_taken_up", "status": "status"})
            schemes[scheme.letter]["difference_to_no_crrt"] = parts | whole
    best = first_choice(study.ranking[policy])
    known = [*(n for n in MEANS if n in without_crrt), *_states(without_crrt)]
    return {
        "speed_rpm": study.case_speed, "schemes": schemes, "without_crrt": _values(without_crrt, known),
        "summary": _summary(study.summary.sel(at_case)), "speeds": _at_speeds(study, policy),
        "limits": _limits(study.limits.sel(policy=policy), study.rule.limits),
        "first_choice": None if best is None else best.letter,
        "first_within_usual_alarms": next(
            (r.letter for r in study.ranking[policy] if r.usual_alarms_kept and r.rank is not None), None
        ),
        "first_choice_in_words": choice_text(study, policy),
        "ranking": [asdict(ranked) for ranked in study.ranking[policy]],
        **({"renox": compared_with_schemes(study, policy)} if study.renox is not None else {}),
    }  # fmt: skip


def _summary(summary: xr.Dataset) -> dict[str, object]:
    each = {
        name: _values(summary, {statistic: f"{name}_{statistic}" for statistic in STATISTICS})
        for name in SUMMARISED
    }
    return {"schemes_known": summary["schemes_known"].item(), **each}


def _at_speeds(study: CrrtStudy, policy: str) -> list[dict[str, object]]:
    """All schemes at every speed, read from plain arrays since there are thousands of numbers."""
    means = study.means.sel(policy=policy)
    names = (*_states(means), *_names(study))
    values = {name: means[name].transpose("scheme", "speed").values.tolist() for name in names}
    letters, rows = means["scheme"].values.tolist(), []
    for k, speed in enumerate(means["speed"].values.tolist()):
        schemes = {letter: {n: values[n][s][k] for n in names} for s, letter in enumerate(letters)}
        summary = _summary(study.summary.sel(policy=policy, speed=speed))
        rows.append({"speed_rpm": speed, "schemes": schemes, "summary": summary})
    return rows


_LIMIT_KEYS = {
    "largest_ecmo_flow_l_min": "largest_flow", "largest_speed_rpm": "largest_speed",
    "ecmo_flow_at_most_l_min": "flow_at_most", "state": "state", "in_words": "in_words",
    "kept_throughout": "kept_throughout", "margin_mmhg": "margin",
}  # fmt: skip


def _limits(limits: xr.Dataset, rule_limits: Sequence[Limit]) -> dict[str, object]:
    definitions = {
        limit.name: {"quantity": limit.quantity, "low_mmhg": limit.low, "high_mmhg": limit.high,
                     "meaning": limit.meaning}
        for limit in rule_limits
    }  # fmt: skip
    names, letters = (limits[dim].values.tolist() for dim in ("limit", "scheme"))
    schemes = {
        letter: {name: _values(limits.sel(scheme=letter, limit=name), _LIMIT_KEYS) for name in names}
        for letter in letters
    }
    return {"definitions": definitions, "schemes": schemes}


def _uncertainty(result: xr.Dataset) -> dict[str, object]:
    names = [str(name) for name in result.data_vars if str(name).endswith("_quantiles")]
    keys, schemes = result["limit"].values.tolist(), {}
    for letter in result["scheme"].values.tolist():
        scheme_result = result.sel(scheme=letter)
        shares = {
            name: dict(zip(keys, scheme_result[name].values.tolist(), strict=True))
            for name in ("probability_kept", "probability_at_least", "probability_at_most")
        }
        spread = {n.removesuffix("_quantiles"): scheme_result[n].values.tolist() for n in names}
        schemes[letter] = {**shares, "quantiles": spread, "settled": scheme_result["settled"].item()}
    about = {str(key): value for key, value in result.attrs.items() if key != MADE_BY}
    return {**about, "quantiles": result["quantile"].values.tolist(), "schemes": schemes}


# --- CSV ------------------------------------------------------------------------------------------


def tables(study: CrrtStudy) -> dict[str, pd.DataFrame]:
    """All tables by name, with units in the headers.

    `means` has one row for each policy, scheme and speed, `summary` for each policy and speed, `limits` for
    each policy, scheme and limit, `ranking` for each policy and scheme, `uptake` for each scheme. All have
    the column `doubts` if no number of the study can be trusted.
    """
    means = study.means[[*_names(study), "patient_volume_change", *_states(study.means)]]
    summary = study.summary[
        ["schemes_known", *(f"{name}_{statistic}" for name in SUMMARISED for statistic in STATISTICS)]
    ]
    about = ("policy", "scheme", "connection", "access_site", "return_site", "speed")
    by_speed = _frame(summary, ("policy", "speed")).rename(columns={"schemes_known [1]": "schemes_known"})
    result = {
        "means": _frame(means, about), "summary": by_speed, "limits": _frame(study.limits),
        "ranking": ranking_table(study),
    }  # fmt: skip
    if study.uptake is not None:
        result["uptake"] = _frame(study.uptake)
    return {name: with_doubts(table, study.warnings) for name, table in result.items()}


def _frame(data: xr.Dataset, first: Sequence[str] = ()) -> pd.DataFrame:
    """Convert a dataset to a table with units in the headers and the given coordinates first."""
    frame = data.to_dataframe().reset_index()
    ordered = pd.DataFrame(frame[[*first, *map(str, data.data_vars)]]) if first else frame
    heads = {str(n): f"{n} [{u}]" for n, v in data.variables.items() if (u := v.attrs.get("units"))}
    return ordered.rename(columns=heads)


def ranking_table(study: CrrtStudy) -> pd.DataFrame:
    """Table with one row for each policy and scheme, best first; rank is empty if not known."""
    rows = [
        {
            "policy": policy, "rank": scheme.rank, "scheme": scheme.letter,
            "best_place": scheme.places and scheme.places[0],
            "worst_place": scheme.places and scheme.places[1],
            "largest_flow [L/min]": scheme.largest_flow, "flow_at_most [L/min]": scheme.flow_at_most,
            "kept_at_the_largest_speed": scheme.throughout, "margin [mmHg]": scheme.margin,
            "usual_alarms_kept": scheme.usual_alarms_kept, "decided_by": scheme.decided_by,
            "why_no_rank": scheme.why_no_rank,
            "reasons": "; ".join(scheme.reasons),
        }
        for policy, ranked in study.ranking.items()
        for scheme in ranked
    ]  # fmt: skip
    places = ("rank", "best_place", "worst_place")
    return pd.DataFrame(rows).astype(dict.fromkeys(places, "Int64"))


# --- NetCDF ---------------------------------------------------------------------------------------


MORE = (
    "patient_volume", "ecmo_volume", "crrt_volume", "patient_volume_change", "beats", *STATES,
)  # fmt: skip


def write_netcdf(study: CrrtStudy, path: Path) -> None:
    """Write NetCDF: case and warnings at the root, groups means, without_crrt, waveforms, limits and uptake.

    Of the means, only pressures and the quantities of the JSON object are written.
    """
    about = {"id": study.case.patient.id, CASE: json.dumps(case_record(study.case))}
    groups = {
        "": xr.Dataset(attrs=about | {"converged": int(study.converged), "warnings": list(study.warnings)}),
        "means": study.means[_written(study.means)],
        "without_crrt": study.without_crrt[_written(study.without_crrt)],
        "waveforms": study.waveforms,
        "limits": study.limits,
    } | ({} if study.uptake is None else {"uptake": study.uptake})
    files.write_netcdf(groups, path)


def _written(data: xr.Dataset) -> list[str]:
    """Names of the variables of the means that are written to NetCDF."""
    names = [str(name) for name in data.data_vars]
    return [n for n in names if n in (*MEANS, *EXCHANGE, *MORE) or (n[0] == "P" and "Q" + n[1:] in names)]
