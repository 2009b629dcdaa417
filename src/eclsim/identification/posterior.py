"""From a fit to its posterior: parameters and predictions with intervals, and whether to trust them."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from eclsim.identification.density import Posterior
from eclsim.identification.diagnostics import Diagnostics, diagnose
from eclsim.identification.fit import FitResult
from eclsim.identification.gaussian import Gaussian, approximate
from eclsim.identification.importance import Weighted, weigh
from eclsim.identification.nuts import Chains, Sampling, sample
from eclsim.identification.observation import OUTPUTS, measurement_errors
from eclsim.identification.prediction import Predicted, predict
from eclsim.identification.prior import Prior, PriorKind
from eclsim.identification.verdict import Level
from eclsim.orbit.model import Model, model_of

if TYPE_CHECKING:
    from eclsim.cases.case import Case
    from eclsim.sensitivity.uncertainties import Uncertainty

Method = Literal["gaussian", "importance", "nuts"]
KINDS: dict[Method, str] = {
    "nuts": "posterior (chains)",
    "importance": "posterior (weighted draws)",
    "gaussian": "Gaussian approximation",
}
STARTS = 5
PREDICTED_DRAWS = 1000
SAME_START = 0.05
UNCHECKED = (
    "a Gaussian approximation, which nothing has checked against the posterior: where that is curved or cut "
    "by a bound, medians and intervals are off"
)


@dataclass(frozen=True)
class PosteriorSettings:
    """How the posterior is found.

    Args:
        method: "nuts", chains; "importance", weighted draws; "gaussian", the approximation alone, unchecked.
        prior: what is known before any measurement.
        uncertainties: standard uncertainties of measurements that differ from the defaults.
        sampling: how long chains are.
        policy: blood volume policy; None, the one that the patient was fitted with.
    """

    method: Method = "nuts"
    prior: PriorKind = "log-uniform"
    uncertainties: Mapping[str, Uncertainty] = field(default_factory=dict)
    sampling: Sampling = field(default_factory=Sampling)
    policy: str | None = None


@dataclass(frozen=True)
class PosteriorResult:
    """A patient's posterior.

    Args:
        name: of the data point.
        posterior: density.
        gaussian: its approximation.
        draws: of the parameters in their units, shape (chains, draws, parameters).
        chains: what the sampler says; None where it was not asked.
        weighted: weighted draws; None where they were not asked for.
        diagnostics: of the chains; None without.
        predictions: by settings; the first are the measured settings.
        gaussian_predictions: the same from the Gaussian approximation.
        doubts: why the result is not to be trusted; empty where it is.
        settings: how it was found.
        seconds: wall time.
    """

    name: str
    posterior: Posterior
    gaussian: Gaussian
    draws: np.ndarray
    chains: Chains | None
    weighted: Weighted | None
    diagnostics: Diagnostics | None
    predictions: tuple[Predicted, ...]
    gaussian_predictions: tuple[Predicted, ...]
    doubts: tuple[str, ...]
    settings: PosteriorSettings
    seconds: float

    @property
    def trusted(self) -> bool:
        """Whether the draws are to be trusted."""
        return not self.doubts

    @property
    def checked(self) -> bool:
        """Whether anything could have found the draws wrong."""
        return self.settings.method != "gaussian"

    @property
    def kind(self) -> str:
        """What the draws are, in words."""
        return KINDS[self.settings.method]

    @property
    def verdict(self) -> str:
        """In capitals where the draws are not to be trusted, else empty."""
        if self.trusted:
            return ""
        return "NOT TO BE TRUSTED" if self.checked or len(self.doubts) > 1 else "NOT CHECKED"

    @property
    def names(self) -> tuple[str, ...]:
        """Free parameters."""
        return self.posterior.prior.names

    @property
    def flat(self) -> np.ndarray:
        """Draws of all chains, shape (draws, parameters)."""
        return self.draws.reshape(-1, self.draws.shape[-1])

    def gaussian_draws(self, count: int = PREDICTED_DRAWS) -> np.ndarray:
        """Parameters drawn from the Gaussian approximation, in their units, shape (draws, parameters)."""
        z = self.gaussian.draws(count, self.settings.sampling.seed)
        return np.exp(self.posterior.prior.x_of(z))


def posterior_of(fit: FitResult, settings: PosteriorSettings) -> Posterior:
    """The posterior density of a fitted data point's parameters."""
    box = fit.box
    start = np.clip(box.start, box.lower, box.upper)
    prior = Prior(box.names, box.lower, box.upper, start, settings.prior)
    errors = measurement_errors(fit.measured, settings.uncertainties)
    policy = settings.policy or fit.case.volume_policy
    return Posterior(model_of(fit.case), dict(fit.measured), errors, prior, policy)


def sample_posterior(
    fit: FitResult,
    settings: PosteriorSettings | None = None,
    predictions: Sequence[tuple[str, Case]] = (),
    report: Callable[[str], None] | None = None,
) -> PosteriorResult:
    """Find the posterior of a fitted data point and what it predicts.

    Args:
        fit: with a steady beat.
        settings: how it is found.
        predictions: settings as written and the fitted case with them.
        report: called with what is being done.

    Raises:
        NoSteadyBeatError: The fit has none.
        MissingPackageError: NumPyro is needed and not there.
    """
    settings = settings or PosteriorSettings()
    say = report or (lambda _: None)
    started = time.perf_counter()
    posterior = posterior_of(fit, settings)
    gaussian = approximate(posterior, _starts(fit))
    chains = weighted = diagnostics = None
    seed = settings.sampling.seed
    if settings.method == "gaussian":
        z = gaussian.draws(PREDICTED_DRAWS, seed)[None]
        doubts: tuple[str, ...] = (UNCHECKED,)
    else:
        say("weighted draws")
        weighted = weigh(posterior, gaussian, seed=seed)
        doubts = weighted.doubts
        z = weighted.z[weighted.resample(4 * PREDICTED_DRAWS, seed)][None]
    if settings.method == "nuts" and weighted is not None:
        chains = sample(
            posterior, weighted.proposals, settings.sampling, lambda n, of: say(f"draw {n} of {of}")
        )
        statistics = chains.statistics
        of_trajectories = (statistics[name] for name in ("diverging", "energy", "saturated"))
        diagnostics = diagnose(posterior.prior.names, chains.z, *of_trajectories)
        z, doubts = chains.z, diagnostics.doubts
    if fit.verdict.level is Level.POOR:
        doubts = (*doubts, f"{fit.verdict.headline}; what it predicts is not this patient")
    draws = np.exp(posterior.prior.x_of(z))
    say("predictions")
    models = [("", model_of(fit.case)), *((written, model_of(case)) for written, case in predictions)]
    exact = _predictions(models, posterior, draws.reshape(-1, draws.shape[-1]))
    by_gaussian = exact
    if settings.method != "gaussian":
        of_gaussian = np.exp(posterior.prior.x_of(gaussian.draws(PREDICTED_DRAWS, seed)))
        by_gaussian = _predictions(models, posterior, of_gaussian)
    return PosteriorResult(
        fit.name, posterior, gaussian, draws, chains, weighted, diagnostics, exact, by_gaussian, doubts,
        settings, time.perf_counter() - started,
    )  # fmt: skip


def _starts(fit: FitResult) -> np.ndarray:
    """The optimum and the ends of other starts, the best first."""
    ends = fit.optimum.starts.end[np.argsort(fit.optimum.starts.last_costs, kind="stable")]
    chosen = [fit.optimum.x]
    for end in ends:
        if len(chosen) < STARTS and min(np.abs(end - c).max() for c in chosen) > SAME_START:
            chosen.append(end)
    return np.stack(chosen)


def _predictions(
    models: Sequence[tuple[str, Model]], posterior: Posterior, draws: np.ndarray
) -> tuple[Predicted, ...]:
    from eclsim.outputs.signals import output_names

    chosen = draws[:: max(1, len(draws) // PREDICTED_DRAWS)][:PREDICTED_DRAWS]
    parameters = {n: chosen[:, k] for k, n in enumerate(posterior.prior.names)}
    found = []
    for written, model in models:
        known = output_names(model.circuit)
        outputs = tuple(o for o in OUTPUTS if o in known)
        found.append(predict(model, parameters, outputs, written, posterior.policy))
    return tuple(found)


def intervals_of(draws: np.ndarray) -> np.ndarray:
    """5 %, 50 % and 95 % quantile of each parameter, shape (parameters, 3)."""
    return np.quantile(draws, (0.05, 0.5, 0.95), axis=0).T


def as_object(result: PosteriorResult) -> dict[str, Any]:
    """As plain data for JSON; null for what is not known."""
    exact, approximate_ones = intervals_of(result.flat), intervals_of(result.gaussian_draws())
    d = result.diagnostics
    parameters = {
        n: {
            "median": exact[k, 1], "lower": exact[k, 0], "upper": exact[k, 2],
            "gaussian": _interval(approximate_ones[k]),
            **({} if d is None else {
                "r_hat": d.r_hat[k], "effective_bulk": d.effective_bulk[k],
                "effective_tail": d.effective_tail[k],
            }),
        }
        for k, n in enumerate(result.names)
    }  # fmt: skip
    return {
        "method": result.settings.method,
        "kind": result.kind,
        "trusted": result.trusted,
        "checked": result.checked,
        "verdict": result.verdict,
        "doubts": list(result.doubts),
        "prior": result.settings.prior,
        "uncertainties": dict(result.posterior.errors),
        "parameters": parameters,
        "predictions": [
            {
                "settings": p.settings or "as measured",
                "outputs": {
                    n: {**_interval(p.intervals[k]), "gaussian": _interval(g.intervals[k])}
                    for k, n in enumerate(p.outputs)
                },
                "without_steady_beat": p.lost,
                "draws": len(p.values),
                "draws_without_steady_beat": p.lost_draws,
                "doubts": [*result.doubts, *p.doubts],
            }
            for p, g in zip(result.predictions, result.gaussian_predictions, strict=True)
        ],
        "divergent": None if d is None else d.divergent,
        "energy_fraction": None if d is None else d.energy_fraction.tolist(),
        "cut_trajectories": None if d is None else d.saturated,
        **_chain_counts(result.chains),
        "draws": int(result.flat.shape[0]),
        **_weight_counts(result.weighted),
        "seconds": round(result.seconds, 3),
    }  # fmt: skip


def _chain_counts(chains: Chains | None) -> dict[str, Any]:
    names = ("jumps_taken", "evaluations", "evaluations_without_steady_beat")
    if chains is None:
        return dict.fromkeys(names)
    jumped = float(chains.statistics["jumped"].mean())
    return dict(zip(names, (jumped, chains.evaluations, chains.without_beat), strict=True))


def _weight_counts(weighted: Weighted | None) -> dict[str, Any]:
    names = ("pareto_k", "effective_draws", "weighted_draws", "weighted_draws_without_steady_beat")
    if weighted is None:
        return dict.fromkeys(names)
    shape = weighted.shape if np.isfinite(weighted.shape) else None
    counts = (shape, weighted.effective, len(weighted.z), weighted.without_beat)
    return dict(zip(names, counts, strict=True))


def _interval(quantiles: np.ndarray) -> dict[str, float | None]:
    values = [float(q) if np.isfinite(q) else None for q in quantiles]
    return {"lower": values[0], "median": values[1], "upper": values[2]}
