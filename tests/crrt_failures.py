"""A CRRT study of which some beats are taken as not found: what the records would hold, and what follows."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import xarray as xr

from eclsim.crrt_study.beats import summarise
from eclsim.crrt_study.limits import largest_flows
from eclsim.crrt_study.ranking import rank
from eclsim.crrt_study.study import CrrtStudy

ALL = slice(None)


def with_failures(
    study: CrrtStudy, failures: Iterable[tuple[str, object, object]], status: str = "no_ejection"
) -> CrrtStudy:
    """The study with beats missing that are named by policy, scheme and speed; slices stand for all."""
    means = study.means.copy(deep=True)
    means["status"] = means["status"].astype(object)
    for policy, scheme, speed in failures:
        forget(means, {"policy": policy, "scheme": scheme, "speed": speed}, status)
    limits = largest_flows(means, study.case_speed)
    ranking = {
        policy: rank(
            means.sel(policy=policy, speed=study.case_speed), limits.sel(policy=policy), study.schemes
        )
        for policy in study.policies
    }
    return replace(study, means=means, limits=limits, ranking=ranking, summary=summarise(means))


def forget(data: xr.Dataset, where: dict[str, object], status: str) -> None:
    """Take the numbers out of a dataset where a beat was not found."""
    for name, values in data.data_vars.items():
        if values.dtype.kind == "f":
            data[name].loc[where] = np.nan
    data["converged"].loc[where] = False
    data["status"].loc[where] = status
