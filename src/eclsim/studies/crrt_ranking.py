"""Which scheme to prefer, and why: a fixed order of reasons, each a number of the study."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eclsim.studies.crrt_limits import CRRT_LIMITS

if TYPE_CHECKING:
    import xarray as xr

    from eclsim.studies.crrt_schemes import Scheme

ORDER = (
    "keeps the machine's pressure alarms at this speed",
    "keeps the access pressure below 190 mmHg at this speed",
    "draws and returns above atmospheric pressure (no air can be drawn in)",
    "keeps its limits up to the larger ECMO flow, in steps of 0.1 L/min",
    "recirculates less, in steps of 1 %",
    "stands further from its nearest limit at this speed",
)
"""What counts, in this order."""


@dataclass(frozen=True, slots=True)
class Ranked:
    """One scheme's place and the numbers that put it there.

    Args:
        letter: of the scheme.
        rank: 1 is best.
        alarms_kept: whether both lines stay within the machine's alarms at the case's speed.
        access_190_kept: whether the access pressure stays below 190 mmHg.
        lowest_site_pressure: lower of the mean pressures where the lines attach [mmHg].
        largest_flow: largest ECMO flow that keeps all limits of the CRRT lines [L/min].
        throughout: whether it keeps them up to the largest speed studied.
        recirculated: share of the access flow that comes straight from the return line.
        margin: distance to the nearest limit [mmHg].
        reasons: sentences.
    """

    letter: str
    rank: int
    alarms_kept: bool
    access_190_kept: bool
    lowest_site_pressure: float
    largest_flow: float
    throughout: bool
    recirculated: float
    margin: float
    reasons: tuple[str, ...]


def rank(means: xr.Dataset, limits: xr.Dataset, schemes: tuple[Scheme, ...]) -> tuple[Ranked, ...]:
    """Schemes from best to worst for one policy at one speed.

    Args:
        means: over `scheme`, at the case's speed and one policy.
        limits: of `largest_flows`, over `scheme` and `limit`, likewise.
        schemes: those of the study.
    """
    judged = [_judge(means.sel(scheme=s.letter), limits.sel(scheme=s.letter), s) for s in schemes]
    ordered = sorted(judged, key=_key)
    return tuple(
        Ranked(**{**{f: getattr(r, f) for f in Ranked.__slots__}, "rank": k + 1})
        for k, r in enumerate(ordered)
    )


def _key(one: Ranked) -> tuple[float, ...]:
    flow = -np.inf if np.isnan(one.largest_flow) else one.largest_flow
    return (
        not one.alarms_kept,
        not one.access_190_kept,
        one.lowest_site_pressure < 0.0,
        -np.round(flow, 1),
        np.round(np.nan_to_num(one.recirculated), 2),
        -np.nan_to_num(one.margin, nan=-np.inf),
    )


def _judge(one: xr.Dataset, limits: xr.Dataset, scheme: Scheme) -> Ranked:
    margin = {str(k): float(limits["margin"].sel(limit=k)) for k in limits["limit"].values}
    both = limits.sel(limit=CRRT_LIMITS)
    ranked = Ranked(
        letter=scheme.letter,
        rank=0,
        alarms_kept=margin["access_alarm"] >= 0.0 and margin["return_alarm"] >= 0.0,
        access_190_kept=margin["access_190"] >= 0.0,
        lowest_site_pressure=min(float(one["P" + node]) for node in scheme.nodes),
        largest_flow=float(both["largest_flow"]),
        throughout=bool(both["kept_throughout"]),
        recirculated=float(one["recirculated_fraction"]),
        margin=margin[CRRT_LIMITS],
        reasons=(),
    )
    sentences = tuple(_sentences(ranked, one))
    return Ranked(**{**{f: getattr(ranked, f) for f in Ranked.__slots__}, "reasons": sentences})


def _sentences(one: Ranked, means: xr.Dataset) -> list[str]:
    access, giving = float(means["Pcrrttuin"]), float(means["Pcrrttuout"])
    said = [f"access {_whole(access)} mmHg, return {_whole(giving)} mmHg"]
    if not one.alarms_kept:
        said.append("breaks a pressure alarm of the machine")
    if not one.access_190_kept:
        said.append("access pressure above 190 mmHg: early failure of the CRRT circuit is more likely")
    if one.lowest_site_pressure < 0.0:
        said.append(f"a line attaches at {_whole(one.lowest_site_pressure)} mmHg: a leak there draws in air")
    if np.isnan(one.largest_flow):
        said.append("keeps its limits at no speed studied")
    elif one.throughout:
        said.append(f"keeps its limits up to {one.largest_flow:.1f} L/min, the largest flow studied")
    else:
        said.append(f"keeps its limits up to {one.largest_flow:.1f} L/min of ECMO flow")
    if one.recirculated >= 0.005:
        said.append(
            f"{100.0 * one.recirculated:.0f} % of the access flow comes straight from the return line"
        )
    return said


def _whole(value: float) -> str:
    """A whole number with a real minus sign."""
    return f"{value:.0f}".replace("-", "−")
