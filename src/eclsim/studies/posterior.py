"""From a fit to its posterior: parameters and predictions with intervals, and whether to trust them."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from eclsim.identification.objective import OUTPUTS
from eclsim.solver.model import Model, model_of
from eclsim.studies.identification import Fit
from eclsim.studies.measurement_errors import measurement_errors
from eclsim.uncertainty.density import Posterior
from eclsim.uncertainty.diagnostics import Diagnostics, diagnose
from eclsim.uncertainty.gaussian import Gaussian, approximate
from eclsim.uncertainty.importance import Weighted, weigh
from eclsim.uncertainty.nuts import Chains, Sampling, sample
from eclsim.uncertainty.prediction import Predicted, predict
from eclsim.uncertainty.prior import Prior, PriorKind

if TYPE_CHECKING:
    from eclsim.patients.case import Case
    from eclsim.sensitivity.uncertainties import Uncertainty

Method = Literal["gaussian", "importance", "nuts"]
STARTS = 5
PREDICTED_DRAWS = 1000
SAME_START = 0.05


@dataclass(frozen=True)
class PosteriorSettings:
    """How the posterior is found.

    Args:
        method: "nuts", chains; "importance", weighted draws; "gaussian", the approximation alone.
        prior: what is known before any measurement.
        uncertainties: standard uncertainties of measurements that differ from the defaults.
        sampling: how long chains are.
        policy: blood volume policy.
    """

    method: Method = "nuts"
    prior: PriorKind = "log-uniform"
    uncertainties: Mapping[str, Uncertainty] = field(default_factory=dict)
    sampling: Sampling = field(default_factory=Sampling)
    policy: str = "as_published"


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


def posterior_of(fit: Fit, settings: PosteriorSettings) -> Posterior:
    """The posterior density of a fitted data point's parameters."""
    box = fit.box
    start = np.clip(box.start, box.lower, box.upper)
    prior = Prior(box.names, box.lower, box.upper, start, settings.prior)
    errors = measurement_errors(fit.measured, settings.uncertainties)
    return Posterior(model_of(fit.case), dict(fit.measured), errors, prior, settings.policy)


def sample_posterior(
    fit: Fit,
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
        doubts: tuple[str, ...] = ()
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
        diagnostics = diagnose(posterior.prior.names, chains.z, statistics["diverging"])
        z, doubts = chains.z, diagnostics.doubts
    draws = np.exp(posterior.prior.x_of(z))
    say("predictions")
    models = [("", model_of(fit.case)), *((written, model_of(case)) for written, case in predictions)]
    exact = _predictions(models, posterior, draws.reshape(-1, draws.shape[-1]))
    by_gaussian = _predictions(
        models, posterior, np.exp(posterior.prior.x_of(gaussian.draws(PREDICTED_DRAWS, seed)))
    )
    return PosteriorResult(
        fit.name, posterior, gaussian, draws, chains, weighted, diagnostics, exact, by_gaussian, doubts,
        settings, time.perf_counter() - started,
    )  # fmt: skip


def _starts(fit: Fit) -> np.ndarray:
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
    from eclsim.haemodynamics.evaluation import output_names

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
        "trusted": result.trusted,
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
            }
            for p, g in zip(result.predictions, result.gaussian_predictions, strict=True)
        ],
        "divergent": None if d is None else d.divergent,
        "draws": int(result.flat.shape[0]),
        "pareto_k": None if result.weighted is None else result.weighted.shape,
        "seconds": round(result.seconds, 3),
    }  # fmt: skip


def _interval(quantiles: np.ndarray) -> dict[str, float | None]:
    values = [float(q) if np.isfinite(q) else None for q in quantiles]
    return {"lower": values[0], "median": values[1], "upper": values[2]}
