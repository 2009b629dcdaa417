"""From a fit to its posterior: parameters and predictions with intervals, and whether to trust them."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from eclsim.arguments import Kind, OneOf, article, check_fields, written
from eclsim.cases.quantities import stated, with_values
from eclsim.devices.description import GASES as VO2
from eclsim.files import finite
from eclsim.identification.density import (
    KNOWN_PRIOR,
    Gaussian,
    PosteriorDensity,
    Prior,
    PriorKind,
    beats_of_members,
    gaussian_approximation,
)
from eclsim.identification.draws import away_from_fit, draws_as_tree, piled_up, several_solutions
from eclsim.identification.fit import FitResult
from eclsim.identification.importance import WeightedDraws, importance_sample, weighted_quantile
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
from eclsim.identification.quantities import predicted_outputs
from eclsim.identification.settings import (
    avoidable_assumptions,
    measured_open_set_points,
    remarks_on_assumptions,
    without_measurement,
)
from eclsim.identification.verdict import Aspect, Level
from eclsim.inputs.mistakes import CaseError, Mistake, as_settings, shown
from eclsim.orbit.model import AS_PUBLISHED, CaseSource, Model, VolumePolicy, as_case, model_of
from eclsim.outputs.alarms import IMPOSSIBLE_BEAT
from eclsim.outputs.signals import output_names, watched_waveforms
from eclsim.outputs.steady_beat import DEMAND_MET, SteadyBeat
from eclsim.outputs.uncertainty import Uncertainty, as_uncertainties, measurement_errors
from eclsim.parameters.adult_ranges import adult_ranges

if TYPE_CHECKING:
    import xarray as xr

    from eclsim.cases.case import Case

Method = Literal["gaussian", "importance", "nuts"]
KINDS: dict[Method, str] = {
    "nuts": "posterior (chains)",
    "importance": "posterior (weighted draws)",
    "gaussian": "Gaussian approximation",
}
PREDICTED_DRAWS = 1000
QUANTILES = np.array([0.05, 0.5, 0.95])
LARGEST_LOST_SHARE = 0.02
"""Largest share of draws without a steady beat; with more, too much of the posterior is missing."""
LARGEST_STARVED_SHARE = 0.05
"""Largest share of draws whose tissues extract nearly all oxygen; with more, 90 % intervals include them."""
EXTRACTION_OUTPUTS = ("VO2", "O2ER")
UNCHECKED = (
    "a Gaussian approximation that was not checked against the posterior: where the true density is curved "
    "or cut off by a bound, medians and intervals are wrong"
)
_LARGEST_EXTRACTION = adult_ranges("male")["O2ER"].plausible[1]


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
class Prediction:
    """Outputs of the draws of a posterior at some settings.

    Args:
        settings: settings that differ from the measured ones, as written; empty for the measured ones.
        outputs: names of the outputs.
        values: values of the outputs, shape (draws, outputs); NaN where a draw has no steady beat, a
            physically impossible one, or no steady gas state.
        intervals: 5 %, 50 % and 95 % quantile of each output, shape (outputs, 3).
        without_beat: share of the draws without a steady beat; the intervals exclude them.
        without_gases: share of the draws with a steady beat but no steady gas state; the intervals of gases
            exclude them.
        warnings: warnings about the beat at the medians of the draws.
        impossible: share of the draws with a beat that no patient can have, with a chamber without blood or a
            vein sucked shut; the intervals exclude them.
        starved: share of the draws whose tissues extract more oxygen than is plausible even in severe
            illness, or receive less than they demand.
    """

    settings: str
    outputs: tuple[str, ...]
    values: np.ndarray
    intervals: np.ndarray
    without_beat: float
    without_gases: float = 0.0
    warnings: tuple[str, ...] = ()
    starved: float = 0.0
    impossible: float = 0.0

    @property
    def label(self) -> str:
        """Text that names the settings."""
        return self.settings or "as measured"

    def number(self, share: float) -> int:
        """Number of draws of a share, such as `without_beat`."""
        return round(share * len(self.values))

    @property
    def doubts(self) -> tuple[str, ...]:
        """Reasons not to trust the intervals however good the draws are; empty if there are none."""
        lost = (
            ("have no steady heartbeat", self.number(self.without_beat), "intervals"),
            (f"are beats {IMPOSSIBLE_BEAT}", self.number(self.impossible) * bool(self.settings), "intervals"),
            ("have no steady gas state", self.number(self.without_gases), "intervals of gases"),
        )
        return tuple(
            f"{draws} of {len(self.values)} draws {what} at these settings (at most "
            f"{LARGEST_LOST_SHARE:.0%}): {self._lost_draws_text(draws, intervals)}; choose settings closer "
            "to the measured ones"
            for what, draws, intervals in lost
            if draws > LARGEST_LOST_SHARE * len(self.values)
        ) + (self.warning_of_starved_draws if self.settings else ())

    @property
    def warning_of_impossible_beats(self) -> tuple[str, ...]:
        """A warning if too many draws are beats that no patient can have, else empty."""
        if self.impossible <= LARGEST_LOST_SHARE:
            return ()
        return (
            f"{self.number(self.impossible)} of {len(self.values)} draws are beats {IMPOSSIBLE_BEAT}, "
            f"more than {LARGEST_LOST_SHARE:.0%}: the parameters fit, but no such patient exists; measure a "
            "filling pressure, or narrow the bounds",
        )

    @property
    def warning_of_starved_draws(self) -> tuple[str, ...]:
        """A warning if too many draws are patients who extract nearly all their oxygen, else empty."""
        if self.starved <= LARGEST_STARVED_SHARE:
            return ()
        share, most = 100.0 * self.starved, 100.0 * _LARGEST_EXTRACTION
        return (
            f"{share:.0f} % of the draws are patients whose tissues extract more than {most:.0f} % of their "
            "oxygen or get less than they need, which is implausible even in severe illness: cardiac output "
            "and "
            "consumption may be far from the patient's; measure one of them, or narrow its bounds",
        )

    def _lost_draws_text(self, lost: int, intervals: str) -> str:
        none = lost == len(self.values)
        return f"there are no {intervals}" if none else f"the {intervals} cover only the other draws"

    def column(self, output: str) -> np.ndarray:
        """Values of one output, shape (draws,); NaN if the circuit does not have it."""
        if output not in self.outputs:
            return np.full(len(self.values), np.nan)
        return self.values[:, self.outputs.index(output)]


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
    models = _models_of(fit, predictions, settings.volume_policy)
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
    draws = samples.reshape(-1, samples.shape[-1])
    exact = _predict_all(models, density, draws, warn=True)
    doubts = (*doubts, *exact[0].warning_of_impossible_beats, *exact[0].warning_of_starved_draws)
    by_gaussian = exact
    if settings.method != "gaussian":
        of_gaussian = density.prior.values_of(gaussian.draws(PREDICTED_DRAWS, seed))
        by_gaussian = _predict_all(models, density, of_gaussian)
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


def _models_of(
    fit: FitResult, predictions: Sequence[tuple[str, CaseSource]], chosen: VolumePolicy | None
) -> list[tuple[str, Model]]:
    """The fitted patient, and at other settings; label and model of each.

    Raises:
        CaseError: A prediction under another blood volume policy than the fit, and none `chosen` for all.
        ValueError: A case that lacks a section of the fitted parameters.
    """
    cases = _labelled_cases(predictions)
    own = fit.case.volume_policy
    allowed = f"{own}, or PosteriorSettings(volume_policy=...) for all"
    wrong = [
        Mistake(
            "blood_volume_policy", f"of the prediction {shown(label)}: another than that of the fit",
            case.volume_policy, allowed,
        )
        for label, case in cases
        if chosen is None and case.blood_volume_policy not in (None, own)
    ]  # fmt: skip
    if wrong:
        raise CaseError(wrong)
    models = [("", model_of(fit.case))]
    for label, case in cases:
        try:
            models.append((label, _fitted_model(fit, case)))
        except ValueError as error:
            if type(error) is not ValueError:  # a kind that callers know
                raise
            raise ValueError(f"prediction {shown(label)}: {error}") from error
    return models


def _labelled_cases(predictions: Sequence[tuple[str, CaseSource]]) -> list[tuple[str, Case]]:
    """Label and case of each prediction.

    Raises:
        TypeError: No list of labels with cases.
        ValueError: Labels that are empty or the same.
    """
    listed = isinstance(predictions, Sequence) and not isinstance(predictions, str)
    for one in predictions if listed else [predictions]:
        if not (isinstance(one, (tuple, list)) and len(one) == 2 and isinstance(one[0], str)):
            allowed = 'a list of labels with cases, such as [("4000 rpm", case)]'
            raise TypeError(
                f"predictions: {written(one)} is not a pair of label and case; allowed: {allowed}"
            )
    labels = [label for label, _ in predictions]
    for label in labels:
        if not label.strip() or labels.count(label) > 1:
            what = f"the label {shown(label)} is there twice" if label.strip() else "an empty label"
            raise ValueError(f"predictions: {what}; allowed: a label of its own for each")
    return [(label, as_case(source)) for label, source in predictions]


def _fitted_model(fit: FitResult, case: Case) -> Model:
    """The model of a case with the fitted patient's parameters, and with the verdict on them.

    Set points that it leaves open are those of the fit; where that had no reflexes, they are what was
    measured, or else what the fitted patient has at rest.
    """
    fitted = {n: v for n in fit.settings.names if (v := stated(fit.case, n)) is not None}
    points = measured_open_set_points(case.model_copy(update={"measurements": fit.case.measurements}))
    points |= {n: v for n in case.open_set_points if (v := stated(fit.case, n)) is not None}
    changed = with_values(case, {**points, **fitted})
    rest = None if case.as_written is None else with_values(case.as_written, fitted)
    return model_of(changed.model_copy(update={"fit_mark": fit.case.fit_mark, "as_written": rest}))


def _predict_all(
    models: Sequence[tuple[str, Model]], density: PosteriorDensity, draws: np.ndarray, warn: bool = False
) -> tuple[Prediction, ...]:
    """Predictions for each model; with `warn`, with warnings about the beat at the medians of the draws."""
    from eclsim.outputs.results import beat_warnings

    count = min(len(draws), PREDICTED_DRAWS)
    chosen = draws[np.arange(count) * len(draws) // count]  # evenly, since one chain follows the other
    parameters = {n: chosen[:, k] for k, n in enumerate(density.prior.names)}
    medians = dict(zip(density.prior.names, np.median(draws, axis=0).tolist(), strict=True))
    each = []
    for label, model in models:
        outputs = predicted_outputs(model.circuit)
        found = predict(model, parameters, outputs, label, density.policy)
        if warn:
            warnings = beat_warnings(model.with_values(medians), density.policy, outputs)
            found = replace(found, warnings=warnings)
        each.append(found)
    return tuple(each)


def predict(
    model: Model,
    parameters: Mapping[str, np.ndarray],
    outputs: tuple[str, ...],
    settings: str = "",
    policy: str = AS_PUBLISHED,
) -> Prediction:
    """Simulate draws of the parameters, with the other values of a model.

    Args:
        model: circuit and values for the settings of the prediction.
        parameters: draws of each free parameter, in its unit, shape (draws,).
        outputs: names of outputs, as in the registry.
        settings: label of the prediction.
        policy: blood volume policy.
    """
    count = len(next(iter(parameters.values())))
    medians = {n: float(np.median(v)) for n, v in parameters.items()}
    known = output_names(model.circuit)
    read = (*outputs, *(n for n in EXTRACTION_OUTPUTS if n in known and n not in outputs))
    drawn = {**model.values, **parameters}
    watched = watched_waveforms(model.circuit)
    beat = beats_of_members(model, drawn, count, read, policy, {**model.values, **medians}, watched)
    impossible = beat.collapsed
    values = np.where(impossible, np.nan, beat.values).T[:, : len(outputs)]
    intervals = np.full((len(outputs), 3), np.nan)
    for column, interval in zip(values.T, intervals, strict=True):
        finite_values = column[np.isfinite(column)]
        if len(finite_values):
            interval[:] = weighted_quantile(finite_values, np.ones(len(finite_values)), QUANTILES)
    return Prediction(
        settings, outputs, values, intervals, float(1.0 - beat.determined.mean()),
        float((beat.without_gases & ~impossible).mean()), starved=_starved_share(beat, read, drawn),
        impossible=float(impossible.mean()),
    )  # fmt: skip


def _starved_share(beat: SteadyBeat, read: tuple[str, ...], drawn: Mapping[str, float | np.ndarray]) -> float:
    """Share of the draws that extract too much of their oxygen or receive less than they demand."""
    if not {*EXTRACTION_OUTPUTS} <= {*read}:
        return 0.0
    consumed, extracted = (beat.values[read.index(name)] for name in EXTRACTION_OUTPUTS)
    unmet = consumed < DEMAND_MET * drawn[VO2]
    return float(np.mean(unmet | (extracted > _LARGEST_EXTRACTION)))


def _interval(quantiles: np.ndarray) -> dict[str, float | None]:
    lower, median, upper = (finite(float(q)) for q in quantiles)
    return {"lower": lower, "median": median, "upper": upper}
