"""Tables of the CRRT study as data frames, for CSV and for the page."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eclsim.crrt_study.json_object import MEANS
from eclsim.crrt_study.statistics import SUMMARISED

if TYPE_CHECKING:
    import pandas as pd

    from eclsim.crrt_study.study import CrrtStudy


def tables(study: CrrtStudy) -> dict[str, pd.DataFrame]:
    """All tables by name; units stand in the heads."""
    return {
        "means": means_table(study),
        "summary": summary_table(study),
        "limits": limits_table(study),
        "ranking": ranking_table(study),
    } | ({"uptake": uptake_table(study)} if study.uptake is not None else {})


def means_table(study: CrrtStudy) -> pd.DataFrame:
    """A row for each policy, scheme and speed."""
    import pandas as pd

    names = [*MEANS, "patient_volume_change", "converged", "status"]
    frame = study.means[names].to_dataframe().reset_index()
    ordered = ["policy", "scheme", "connection", "access_site", "return_site", "speed", *names]
    return pd.DataFrame(frame[ordered]).rename(columns=_headed(study))


def summary_table(study: CrrtStudy) -> pd.DataFrame:
    """A row for each policy and speed: median and variation over the schemes."""
    import pandas as pd

    words = ("median", "variation", "variation_percent", "highest", "lowest")
    names = [f"{name}_{word}" for name in SUMMARISED for word in words]
    ordered = ["policy", "speed", "schemes_known", *names]
    frame = study.summary[["schemes_known", *names]].to_dataframe().reset_index()[ordered]
    heads = {n: f"{n} [{u}]" for n in names if (u := study.summary[n].attrs.get("units"))}
    return pd.DataFrame(frame).rename(columns=heads | {"speed": "speed [rpm]"})


def limits_table(study: CrrtStudy) -> pd.DataFrame:
    """A row for each policy, scheme and limit."""
    frame = study.limits.to_dataframe().reset_index()
    heads = {str(n): f"{n} [{u}]" for n, v in study.limits.data_vars.items() if (u := v.attrs.get("units"))}
    return frame.rename(columns=heads)


def ranking_table(study: CrrtStudy) -> pd.DataFrame:
    """A row for each policy and scheme, best first; rank is empty where the place is not known."""
    import pandas as pd

    rows = []
    for policy, ranked in study.ranking.items():
        for one in ranked:
            rows.append(
                {
                    "policy": policy,
                    "rank": one.rank,
                    "scheme": one.letter,
                    "best_place": one.places and one.places[0],
                    "worst_place": one.places and one.places[1],
                    "largest_flow [L/min]": one.largest_flow,
                    "flow_at_most [L/min]": one.flow_at_most,
                    "margin [mmHg]": one.margin,
                    "why_no_rank": one.why_no_rank,
                    "reasons": "; ".join(one.reasons),
                }
            )
    places = ("rank", "best_place", "worst_place")
    return pd.DataFrame(rows).astype(dict.fromkeys(places, "Int64"))


def uptake_table(study: CrrtStudy) -> pd.DataFrame:
    """A row for each scheme: differences to the patient without CRRT, split."""
    assert study.uptake is not None
    return study.uptake.to_dataframe().reset_index().rename(columns={"blood_taken_up": "blood_taken_up [mL]"})


def _headed(study: CrrtStudy) -> dict[str, str]:
    units = {str(n): v.attrs.get("units") for n, v in study.means.variables.items()}
    return {name: f"{name} [{unit}]" for name, unit in units.items() if unit}
