"""Limits of machine and circuit, and the largest ECMO flow at which a scheme keeps them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eclsim.haemodynamics.alarms import SANSOM_ACCESS_MMHG, SUCTION_MMHG
from eclsim.parameters.devices import CRRT_ALARMS_MMHG

if TYPE_CHECKING:
    import xarray as xr

FINE_POINTS = 4001


@dataclass(frozen=True, slots=True)
class Limit:
    """A bound on a quantity of the steady beat.

    Args:
        name: key.
        quantity: variable of the study's means.
        low: smallest allowed value [mmHg], -inf for none.
        high: largest allowed value [mmHg], inf for none.
        meaning: what it is and where it comes from.
        of_crrt: whether the CRRT scheme is judged by it.
    """

    name: str
    quantity: str
    low: float
    high: float
    meaning: str
    of_crrt: bool = True

    def margin(self, value: np.ndarray | float) -> np.ndarray:
        """Distance to the nearer bound [mmHg]; negative where it is broken."""
        return np.minimum(np.asarray(value) - self.low, self.high - np.asarray(value))


LIMITS = (
    Limit("access_alarm", "Pcrrttuin", *CRRT_ALARMS_MMHG["access"], "usual alarms of the access line"),
    Limit("return_alarm", "Pcrrttuout", *CRRT_ALARMS_MMHG["return"], "usual alarms of the return line"),
    Limit(
        "access_190", "Pcrrttuin", -np.inf, SANSOM_ACCESS_MMHG,
        "access pressure above which CRRT circuits failed early (Sansom et al. 2023)",
    ),
    Limit(
        "suction", "lowest_drainage_pressure", SUCTION_MMHG, np.inf,
        "drainage pressure below which suction and haemolysis are feared (a convention)", False,
    ),
)  # fmt: skip
CRRT_LIMITS = "crrt"
"""Key of all limits by which the scheme is judged, taken together."""


def largest_flows(means: xr.Dataset, case_speed: float) -> xr.Dataset:
    """What each scheme keeps at the case's speed, and up to which ECMO flow.

    Args:
        means: over `policy`, `scheme` and `speed`; pressures, `PF` [L/min] and `converged`.
        case_speed: speed [rpm] of the case, one of the speeds.

    Returns:
        Over `policy`, `scheme` and `limit` (the last one, "crrt", is all limits of the CRRT lines together):
        `largest_flow` [L/min] and `largest_speed` [rpm] at which the limit is kept, NaN if it never is;
        `kept_throughout`, if the limit is kept up to the largest speed studied; `margin` [mmHg] at the case's
        speed, negative where the limit is broken.
    """
    import xarray as xr

    keys = [limit.name for limit in LIMITS] + [CRRT_LIMITS]
    shape = (means.sizes["policy"], means.sizes["scheme"], len(keys))
    found = {name: np.full(shape, np.nan) for name in ("largest_flow", "largest_speed", "margin")}
    throughout = np.zeros(shape, dtype=bool)
    few = means[[*dict.fromkeys(limit.quantity for limit in LIMITS), "PF", "converged"]]
    at_case = int(np.flatnonzero(means["speed"].values == case_speed)[0])
    for p, s in np.ndindex(shape[:2]):
        one = few.isel(policy=p, scheme=s)
        margins = _margins(one)
        for k, name in enumerate(keys):
            found["margin"][p, s, k] = margins[name][at_case]
            flow, speed, end = _largest(one, margins[name])
            found["largest_flow"][p, s, k], found["largest_speed"][p, s, k], throughout[p, s, k] = (
                flow,
                speed,
                end,
            )
    dims = ("policy", "scheme", "limit")
    words = {
        "largest_flow": ("L/min", "largest ECMO flow that keeps the limit"),
        "largest_speed": ("rpm", "pump speed at that flow"),
        "margin": ("mmHg", "distance to the limit at the case's speed; negative: broken"),
    }
    data = {n: (dims, v, {"units": words[n][0], "long_name": words[n][1]}) for n, v in found.items()}
    data["kept_throughout"] = (dims, throughout, {"long_name": "kept up to the largest speed studied"})
    return xr.Dataset(data, {"policy": means["policy"], "scheme": means["scheme"], "limit": keys})


def _margins(one: xr.Dataset) -> dict[str, np.ndarray]:
    margins = {limit.name: limit.margin(one[limit.quantity].values) for limit in LIMITS}
    margins[CRRT_LIMITS] = np.min([margins[limit.name] for limit in LIMITS if limit.of_crrt], axis=0)
    return margins


def _largest(one: xr.Dataset, margin: np.ndarray) -> tuple[float, float, bool]:
    """Flow and speed where a margin runs out for good, by monotone cubics in speed; whether it never does."""
    from scipy.interpolate import PchipInterpolator

    known = np.isfinite(margin) & one["converged"].values.astype(bool)
    speed, flow = one["speed"].values[known], one["PF"].values[known]
    if len(speed) == 0 or not (margin[known] >= 0.0).any():
        return np.nan, np.nan, False
    if margin[known][-1] >= 0.0:
        return float(flow[-1]), float(speed[-1]), True
    if len(speed) < 2:
        return np.nan, np.nan, False
    fine = np.linspace(speed[0], speed[-1], FINE_POINTS)
    last = fine[np.flatnonzero(PchipInterpolator(speed, margin[known])(fine) >= 0.0)[-1]]
    return float(PchipInterpolator(speed, flow)(last)), float(last), False
