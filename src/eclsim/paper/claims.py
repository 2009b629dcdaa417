"""What sections 3.3 and 4 of Thiel et al. 2025 say in words about the nine schemes, as tests of a study."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eclsim.crrt_study.limits import LIMITS
from eclsim.orbit.model import AS_PUBLISHED
from eclsim.paper.published_crrt import AT_CASE

if TYPE_CHECKING:
    import xarray as xr

    from eclsim.crrt_study.study import CrrtStudy

SMALL_FLOW_L_MIN = 1.2


@dataclass(frozen=True, slots=True)
class Claim:
    """A statement.

    Args:
        section: where it is printed.
        words: what is said.
        holds: whether it holds for a study.
        why: said where it does not.
    """

    section: str
    words: str
    holds: Callable[[CrrtStudy], bool]
    why: str = ""


def _means(study: CrrtStudy) -> xr.Dataset:
    return study.means.sel(policy=AS_PUBLISHED)


def _at_case(study: CrrtStudy) -> xr.Dataset:
    return _means(study).sel(speed=AT_CASE)


def _upper(study: CrrtStudy) -> xr.Dataset:
    """Means from the smallest flow that the text speaks of."""
    means = _means(study)
    return means.isel(speed=means["PF"].median("scheme").values >= 0.95 * SMALL_FLOW_L_MIN)


def _extreme(study: CrrtStudy, name: str, word: str) -> str:
    return str(study.summary[f"{name}_{word}"].sel(policy=AS_PUBLISHED, speed=AT_CASE).item())


def _largest_relative(study: CrrtStudy, names: tuple[str, ...]) -> dict[str, float]:
    summary = study.summary.sel(policy=AS_PUBLISHED, speed=AT_CASE)
    return {name: float(summary[f"{name}_variation_percent"]) for name in names}


def _most_on_veins(study: CrrtStudy) -> bool:
    found = _largest_relative(study, ("Psart", "Ppart", "Psvn"))
    return max(found, key=lambda k: found[k]) == "Psvn" and min(found, key=lambda k: found[k]) == "Psart"


def _loops_follow(study: CrrtStudy) -> bool:
    """Scheme a has the smallest right-ventricular volumes and stroke volume, h the largest volumes."""
    means = _at_case(study)
    stroke = means["EDVRV"] - means["ESVRV"]
    smallest = str(stroke["scheme"].values[np.argmin(stroke.values)])
    ends = {(n, w): _extreme(study, n, w) for n in ("EDVRV", "ESVRV") for w in ("lowest", "highest")}
    return smallest == "a" and all(ends[n, w] == ("a" if w == "lowest" else "h") for n, w in ends)


def _within_alarms(study: CrrtStudy) -> bool:
    means = _at_case(study)
    alarms = [limit for limit in LIMITS if limit.name.endswith("alarm")]
    return all(bool((limit.margin(means[limit.quantity].values) >= 0.0).all()) for limit in alarms)


def _negative_only_in_h(study: CrrtStudy) -> bool:
    means = _at_case(study)
    negative = (means["Pcrrttuin"] < 0.0) | (means["Pcrrttuout"] < 0.0)
    return means["scheme"].values[negative.values].tolist() == ["h"]


def _monotone(study: CrrtStudy, name: str, sign: float) -> bool:
    return bool((sign * _upper(study)[name].diff("speed") > 0.0).all())


def _more_with_speed(study: CrrtStudy) -> bool:
    variation = study.summary["Psart_variation"].sel(policy=AS_PUBLISHED).sel(speed=_upper(study)["speed"])
    return bool((variation.diff("speed") > 0.0).all())


def _order_changes(study: CrrtStudy) -> bool:
    summary = study.summary.sel(policy=AS_PUBLISHED).sel(speed=_upper(study)["speed"])
    return any(len(set(summary[f"Psart_{word}"].values.tolist())) > 1 for word in ("highest", "lowest"))


def _falls_upstream_of_the_pump(study: CrrtStudy) -> bool:
    """The return pressure falls with flow for the return lines upstream of the pump, and for no other."""
    change = _upper(study)["Pcrrttuout"].diff("speed")
    falls, rises = (change < 0.0).all("speed"), (change > 0.0).all("speed")
    upstream = np.isin(change["scheme"].values.astype(str), list("bchi"))
    return bool((falls.values == upstream).all() and (rises.values == ~upstream).all())


def _best_three(study: CrrtStudy) -> bool:
    """g, d and c keep the access pressure below 190 mmHg up to larger flows than the others but h."""
    flows = study.limits["largest_flow"].sel(policy=AS_PUBLISHED, limit="access_190")
    return float(flows.sel(scheme=list("gdc")).min()) > float(flows.sel(scheme=list("abefi")).max())


_AT_ITS_SPEED, _ANY = "3.3, 3425 rpm", "3.3"
_ORDER = "the same schemes at all flows of the text"
_LARGEST = "it grows up to 4750 rpm; at 5000 rpm it is 2 % less"
_UNPRINTED = "the variation in the pulmonary artery is not printed"

CLAIMS = (
    Claim(_AT_ITS_SPEED, "the scheme of the highest arterial pressure is h",
          lambda s: _extreme(s, "Psart", "highest") == "h"),
    Claim(_AT_ITS_SPEED, "the scheme of the lowest arterial pressure is a",
          lambda s: _extreme(s, "Psart", "lowest") == "a"),
    Claim(_AT_ITS_SPEED, "relative variation is largest in the veins, smallest in the arteries",
          _most_on_veins, _UNPRINTED),
    Claim(_AT_ITS_SPEED, "right ventricle: a smallest volumes and stroke volume, h largest volumes",
          _loops_follow),
    Claim(_AT_ITS_SPEED, "all line pressures are within the usual alarms", _within_alarms),
    Claim(_AT_ITS_SPEED, "a line pressure is negative in scheme h alone", _negative_only_in_h),
    Claim(_ANY, "arterial pressure rises with flow in every scheme", lambda s: _monotone(s, "Psart", 1.0)),
    Claim(_ANY, "pulmonary arterial pressure falls with flow in every scheme",
          lambda s: _monotone(s, "Ppart", -1.0)),
    Claim(_ANY, "venous pressure falls with flow in every scheme", lambda s: _monotone(s, "Psvn", -1.0)),
    Claim(_ANY, "the variation of the arterial pressure grows with speed", _more_with_speed, _LARGEST),
    Claim(_ANY, "which scheme has the highest or lowest arterial pressure depends on flow",
          _order_changes, _ORDER),
    Claim(_ANY, "return pressure falls with flow in b, c, h, i and rises in the others",
          _falls_upstream_of_the_pump),
    Claim("4", "return pressures are positive in all schemes at 3425 rpm",
          lambda s: bool((_at_case(s)["Pcrrttuout"] > 0.0).all())),
    Claim("4", "access is below 190 mmHg up to larger flows in g, d, c than in a, b, e, f, i", _best_three),
    Claim("4", "the ECMO flow lies between those of Wu et al., 3.1 and 4.4 L/min",
          lambda s: 3.1 <= float(_at_case(s)["PF"].median()) <= 4.4),
)  # fmt: skip
"""Statements of sections 3.3 and 4."""
