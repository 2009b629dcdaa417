"""The posterior of a fitted patient, the quick way: weighted draws around the Gaussian approximation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from eclsim.app.posterior import MEMBERS
from eclsim.app.texts import text
from eclsim.cases.reading import read_mapping
from eclsim.identification.density import PosteriorDensity, Prior, approximate
from eclsim.identification.importance import importance_sample
from eclsim.identification.objective import Box
from eclsim.identification.quantities import measurement_errors
from eclsim.identification.settings import FitSettings, checked_fit
from eclsim.orbit.model import VolumePolicy, model_of

SHOWN_DRAWS = 4000
SEED = 0


@dataclass(frozen=True)
class _Reporting(PosteriorDensity):
    """A density that says how many beats it has computed, and so can be stopped by what it tells."""

    report: Callable[[str], None] = print
    done: list[int] = field(default_factory=list)

    def simulate(self, z: np.ndarray, centre: np.ndarray | None = None) -> np.ndarray:
        """As `PosteriorDensity.simulate`."""
        self.report(text("posterior_draws", count=sum(self.done)))
        result = super().simulate(z, centre)
        self.done.append(len(z))
        return result


def plain_posterior(
    raw: Mapping[str, Any], policy: VolumePolicy, report: Callable[[str], None]
) -> dict[str, Any]:
    """Members, intervals and the verdict for a fitted case.

    Args:
        raw: as a case file holds it, with measurements and the fitted parameters.
        policy: blood volume policy.
        report: called with what is being done; may raise to stop it.

    Returns:
        Plain data: names and members, intervals of the parameters, and what the weights say.
    """
    report(text("posterior_preparing"))
    posterior, start = _density(raw, policy, report)
    weighted = importance_sample(posterior, approximate(posterior, start[None]), seed=SEED)
    names = posterior.prior.names
    shown = posterior.prior.values_of(weighted.z[weighted.resample(SHOWN_DRAWS, SEED)])
    chosen = np.random.default_rng(SEED).permutation(weighted.resample(MEMBERS, SEED))
    members = posterior.prior.values_of(weighted.z[chosen])
    quantiles = np.quantile(shown, (0.05, 0.5, 0.95), axis=0).T.tolist()
    return {
        "names": list(names), "members": members.tolist(), "method": "importance",
        "doubts": list(weighted.doubts), "shape": float(weighted.shape), "effective": weighted.effective,
        "draws": len(weighted.z),
        "parameters": {
            n: {"lower": low, "median": middle, "upper": high}
            for n, (low, middle, high) in zip(names, quantiles, strict=True)
        },
    }  # fmt: skip


def _density(
    raw: Mapping[str, Any], policy: VolumePolicy, report: Callable[[str], None]
) -> tuple[_Reporting, np.ndarray]:
    """The density of a fitted case's parameters, and the coordinates of their fitted values."""
    case = read_mapping(raw).case
    checked = checked_fit(case, FitSettings(volume_policy=policy))
    prior = Prior.of(Box.of(checked.free))
    model = model_of(case).with_values(dict(checked.fixed))
    errors = measurement_errors(checked.targets)
    return _Reporting(model, dict(checked.targets), errors, prior, policy, report), prior.start
