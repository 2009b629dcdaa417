"""From a fit to its posterior: parameters and predictions with intervals, and whether to trust them."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from eclsim.arguments import Kind, OneOf, article, check_fields
from eclsim.files import finite
from eclsim.identification.density import (
    KNOWN_PRIOR,
    Gaussian,
    PosteriorDensity,
    Prior,
    PriorKind,
    gaussian_approximation,
)
from eclsim.identification.draws import away_from_fit, draws_as_tree, piled_up, several_solutions
from eclsim.identification.fit import FitResult
from eclsim.identification.importance import WeightedDraws, importance_sample
from eclsim.identification.multi_start import Progress, silent
from eclsim.identification.nuts import (
    Chains,
    Diagnostics,
    Sampling,
    diagnose,
    numpyro_hmc,
    remarks_on_divergence,
    sample,
)
from eclsim.identification.objective import Explored
from eclsim.identification.predictions import (
    PREDICTED_DRAWS,
    QUANTILES,
    Prediction,
    evenly_chosen,
    models_of_predictions,
    predict_all,
)
from eclsim.identification.settings import (
    avoidable_assumptions,
    remarks_on_assumptions,
    without_measurement,
)
from eclsim.identification.verdict import Aspect, Level
from eclsim.inputs.mistakes import CaseError, as_settings
from eclsim.orbit.model import CaseSource, VolumePolicy, model_of
from eclsim.outputs.uncertainty import Uncertainty, as_uncertainties, measurement_errors

if TYPE_CHECKING:
    import xarray as xr


Method = Literal["gaussian", "importance", "nuts"]
KINDS: dict[Method, str] = {
    "nuts": "posterior (chains)",
    "importance": "posterior (weighted draws)",
    "gaussian": "Gaussian approximation",
}
UNCHECKED = (
    "a Gaussian approximation that was not checked against the posterior: where the true density is curved "
    "or cut off by a bound, medians and intervals are wrong"
)


@dataclass(frozen=True)
class PosteriorSettings:
    """Settings for sampling a posterior.

    Args:
        method: "nuts" for chains, "importance" for weighted draws, "gaussian" for the unchecked approximation
            alone.
        prior: distribution of the parameters before any measurement.
        uncertainties: standard uncertainties of measurements that differ from the defaults; None takes the
            fit's.
        sampling: length and number of chains.
        volume_policy: blood volume policy; None takes the one that the patient was fitted with.
    """

    method: Method = "nuts"
    prior: PriorKind = "log-uniform"
    uncertainties: Mapping[str, Uncertainty] | None = None
    sampling: Sampling = field(default_factory=Sampling)
    volume_policy: VolumePolicy | None = None

    def __post_init__(self) -> None:
        sampling = Kind(Sampling, "eclsim.Sampling(...)")
        check_fields(self, method=OneOf(tuple(KINDS)), prior=KNOWN_PRIOR, sampling=sampling)
        if self.uncertainties is not None:
            as_uncertainties(self.uncertainties)


@dataclass(frozen=True)
class PosteriorResult:
    """The posterior of a patient's parameters.

    Args:
        name: name of the data point.
        density: posterior density of the latent variables.
        gaussian: Gaussian approximation of the density.
        samples: samples of the parameters in their units, shape (chains, draws, parameters).
        chains: chains of the sampler; None if it was not used.
        weighted: weighted draws; None if they were not requested.
        diagnostics: diagnostics of the chains; None without chains.
        predictions: predictions by settings; the first are for the measured settings.
        gaussian_predictions: the same predictions from the Gaussian approximation.
        doubts: reasons not to trust the result; empty if there are none.
        settings: settings of the posterior.
        seconds: wall time.
        notes: assumptions that are not reflected in the draws.
    """

    name: str
    density: PosteriorDensity
    gaussian: Gaussian
    samples: np.ndarray
    chains: Chains | None
    weighted: WeightedDraws | None
    diagnostics: Diagnostics | None
    predictions: tuple[Prediction, ...]
    gaussian_predictions: tuple[Prediction, ...]
    doubts: tuple[str, ...]
    settings: PosteriorSettings
    seconds: float
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        draws = f"{len(self.flat)} draws of {', '.join(self.names)}"
        return f"<PosteriorResult {self.name}: {draws}; {'; '.join(self.doubts) or 'to be trusted'}>"

    @property
    def trusted(self) -> bool:
        """Whether the draws can be trusted."""
        return not self.doubts

    @property
    def checked(self) -> bool:
        """Whether the draws come from a method that can detect errors."""
        return self.settings.method != "gaussian"

    @property
    def kind(self) -> str:
        """Description of the draws."""
        return KINDS[self.settings.method]

    @property
    def verdict(self) -> str:
        """The verdict in capitals if the draws cannot be trusted, else empty."""
        if self.trusted:
            return ""
        return "NOT TO BE TRUSTED" if self.checked or len(self.doubts) > 1 else "NOT CHECKED"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the free parameters."""
        return self.density.prior.names

    @property
    def flat(self) -> np.ndarray:
        """Samples of all chains, shape (draws, parameters)."""
        return self.samples.reshape(-1, self.samples.shape[-1])

    @property
    def predicted_draws(self) -> np.ndarray:
        """Numbers of the draws that were predicted with, within each chain, shape (draws,)."""
        return evenly_chosen(*self.samples.shape[:2])

    def gaussian_draws(self, count: int = PREDICTED_DRAWS) -> np.ndarray:
        """Parameters drawn from the Gaussian approximation, in their units, shape (draws, parameters)."""
        z = self.gaussian.draws(count, self.settings.sampling.seed)
        return self.density.prior.values_of(z)

    @property
    def draws(self) -> xr.DataTree:
        """Draws, statistics of the sampler, predictions and measurements, one group each.

        Groups and names follow ArviZ's schema, so its functions accept the tree.
        """
        return draws_as_tree(self)

    def as_object(self) -> dict[str, Any]:
        """Plain data for JSON; null for unknown values."""
        exact, gaussian = (np.quantile(v, QUANTILES, axis=0).T for v in (self.flat, self.gaussian_draws()))
        d, c, w = self.diagnostics, self.chains, self.weighted
        parameters = {
            n: {
                "median": exact[k, 1], "lower": exact[k, 0], "upper": exact[k, 2],
                "gaussian": _interval(gaussian[k]),
                **({} if d is None else {
                    "r_hat": d.r_hat[k], "effective_bulk": d.effective_bulk[k],
                    "effective_tail": d.effective_tail[k],
                }),
            }
            for k, n in enumerate(self.names)
        }  # fmt: skip
        predictions = [
            {
                "settings": p.label,
                "outputs": {
                    n: {**_interval(p.intervals[k]), "gaussian": _interval(g.intervals[k])}
                    for k, n in enumerate(p.outputs)
                },
                "without_steady_beat": p.without_beat,
                "draws": len(p.values),
                "draws_without_steady_beat": p.number(p.without_beat),
                "draws_impossible": p.number(p.impossible),
                "draws_without_steady_gases": p.number(p.without_gases),
                "share_of_draws_starved": p.starved,
                "doubts": [*self.doubts, *p.doubts],
                "warnings": list(p.warnings),
            }
            for p, g in zip(self.predictions, self.gaussian_predictions, strict=True)
        ]
        return {
            "id": self.name,
            "blood_volume_policy": self.density.policy,
            "set_points": self.density.set_points,
            "method": self.settings.method,
            "kind": self.kind,
            "trusted": self.trusted,
            "checked": self.checked,
            "verdict": self.verdict,
            "doubts": list(self.doubts),
            "notes": list(self.notes),
            "prior": self.settings.prior,
            "uncertainties": dict(self.density.errors),
            "parameters": parameters,
            "predictions": predictions,
            "divergent": None if d is None else d.divergent,
            "energy_fraction": None if d is None else d.energy_fraction.tolist(),
            "cut_trajectories": None if d is None else d.saturated,
            "jumps_taken": None if c is None else float(c.statistics["jumped"].mean()),
            "evaluations": None if c is None else c.evaluations,
            "evaluations_without_steady_beat": None if c is None else c.without_beat,
            "draws": len(self.flat),
            "pareto_k": None if w is None else finite(w.shape),
            "effective_draws": None if w is None else w.effective,
            "weighted_draws": None if w is None else len(w.z),
            "weighted_draws_without_steady_beat": None if w is None else w.without_beat,
            "seconds": round(self.seconds, 3),
        }


def posterior(
    fit: FitResult,
    *,
    settings: PosteriorSettings | None = None,
    predictions: Sequence[tuple[str, CaseSource]] = (),
    progress: Progress = silent,
) -> PosteriorResult:
    """Sample the posterior of a fitted data point's parameters, and predict outputs with it.

    Args:
        fit: with a steady beat.
        settings: how it is sampled.
        predictions: label and case at other settings; the fitted parameters are replaced in it.
        progress: called with what is being done.

    Raises:
        CaseError: An uncertainty of what was not measured, or a prediction under another blood volume policy.
        NoSteadyBeatError: The fit has none.
        MissingPackageError: NumPyro is needed and not there.
        TypeError: No fit, no `PosteriorSettings`, or predictions that are no labels with cases.
        ValueError: Labels of predictions that are empty or the same.
    """
    settings = as_settings(settings, PosteriorSettings)
    if not isinstance(fit, FitResult):
        kind = article(type(fit).__name__)
        raise TypeError(f"fit: {kind} is not a fit; allowed: what eclsim.fit(case) returns")
    if unused := without_measurement(settings.uncertainties or (), fit.measured):
        raise CaseError(unused)
    if settings.method == "nuts":
        numpyro_hmc()  # before minutes of work, not after them
    models = models_of_predictions(fit, predictions, settings.volume_policy)
    started = time.perf_counter()
    density = density_of(fit, settings)
    gaussian = maxima_of(fit, density)
    chains = weighted = diagnostics = None
    seed, doubts = settings.sampling.seed, ()
    if settings.method == "gaussian":
        z, doubts = gaussian.draws(PREDICTED_DRAWS, seed)[None], (UNCHECKED,)
    else:
        progress("weighted draws")
        weighted = importance_sample(density, gaussian, seed=seed)
        z, doubts = weighted.z[weighted.resample(4 * PREDICTED_DRAWS, seed)][None], weighted.doubts
    if settings.method == "nuts" and weighted is not None:
        chains = sample(
            density, weighted.proposals, settings.sampling, lambda n, of: progress(f"draw {n} of {of}")
        )
        diagnostics = diagnose(density.prior.names, chains.z, chains.statistics)
        z, doubts = chains.z, diagnostics.doubts
    if fit.verdict.level is Level.POOR:
        doubts = (*doubts, f"{fit.verdict.headline}; its predictions do not describe this patient")
    held = (reason.sentence for reason in fit.verdict.doubts if reason.aspect is Aspect.HELD)
    doubts = (*doubts, *avoidable_assumptions(fit.case, fit.measured, fit.parameters), *held)
    samples = density.prior.values_of(z)
    progress("predictions")
    exact = predict_all(models, density, samples, warn=True)
    doubts = (*doubts, *exact[0].warning_of_impossible_beats, *exact[0].warning_of_starved_draws)
    by_gaussian = exact
    if settings.method != "gaussian":
        of_gaussian = density.prior.values_of(gaussian.draws(PREDICTED_DRAWS, seed))
        by_gaussian = predict_all(models, density, of_gaussian[None])
    point = (fit.case, fit.measured, fit.parameters)
    return PosteriorResult(
        fit.name, density, gaussian, samples, chains, weighted, diagnostics, exact, by_gaussian, doubts,
        settings, time.perf_counter() - started,
        (*several_solutions(density.prior, z, gaussian), *piled_up(density.prior, z),
         *away_from_fit(density.prior, z, fit.optimum.x), *remarks_on_assumptions(*point).values(),
         *(() if diagnostics is None else remarks_on_divergence(diagnostics))),
    )  # fmt: skip


def density_of(fit: FitResult, settings: PosteriorSettings) -> PosteriorDensity:
    """Return the posterior density of a fitted data point's parameters."""
    uncertainties = fit.settings.uncertainties if settings.uncertainties is None else settings.uncertainties
    policy = settings.volume_policy or fit.case.volume_policy
    errors = measurement_errors(fit.measured, uncertainties)
    return PosteriorDensity(
        model_of(fit.case), dict(fit.measured), errors, Prior.within(fit.box, settings.prior), policy
    )


def maxima_of(fit: FitResult, density: PosteriorDensity) -> Gaussian:
    """Return the maxima of a fit's posterior density that its search ended in or explored.

    Raises:
        NoSteadyBeatError: None was reached; see `gaussian_approximation`.
    """
    explored = fit.optimum.best_explored
    rows = [fit.objective.outputs.index(n) for n in density.outputs]
    sets = Explored(explored.x, explored.outputs[:, rows])
    return gaussian_approximation(density, fit.optimum.distinct_ends, sets)


def _interval(quantiles: np.ndarray) -> dict[str, float | None]:
    lower, median, upper = (finite(float(q)) for q in quantiles)
    return {"lower": lower, "median": median, "upper": upper}
