"""What the draws of a posterior predict: the fitted patient as measured, and at other settings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from eclsim.arguments import written
from eclsim.cases.cohort import plain_id
from eclsim.cases.quantities import stated, with_values
from eclsim.devices.description import GASES as VO2
from eclsim.identification.density import PosteriorDensity, beats_of_members
from eclsim.identification.importance import weighted_quantile
from eclsim.identification.quantities import predicted_outputs
from eclsim.identification.settings import measured_open_set_points
from eclsim.inputs.mistakes import CaseError, Mistake, shown
from eclsim.orbit.model import AS_PUBLISHED, CaseSource, Model, VolumePolicy, as_case, model_of
from eclsim.outputs.alarms import IMPOSSIBLE_BEAT
from eclsim.outputs.results import beat_warnings
from eclsim.outputs.signals import output_names, watched_waveforms
from eclsim.outputs.steady_beat import DEMAND_MET, SteadyBeat
from eclsim.parameters.adult_ranges import adult_ranges

if TYPE_CHECKING:
    from eclsim.cases.case import Case
    from eclsim.identification.fit import FitResult

PREDICTED_DRAWS = 1000
"""Largest number of draws that are simulated at each of the settings, the same from every chain."""
AS_MEASURED = "as measured"
"""Label of the prediction at the measured settings."""
QUANTILES = np.array([0.05, 0.5, 0.95])
LARGEST_LOST_SHARE = 0.02
"""Largest share of draws without a steady beat; with more, too much of the posterior is missing."""
LARGEST_STARVED_SHARE = 0.05
"""Largest share of draws whose tissues extract nearly all oxygen; with more, 90 % intervals include them."""
EXTRACTION_OUTPUTS = ("VO2", "O2ER")
_LARGEST_EXTRACTION = adult_ranges("male")["O2ER"].plausible[1]


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
        return self.settings or AS_MEASURED

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


def models_of_predictions(
    fit: FitResult, predictions: Sequence[tuple[str, CaseSource]], chosen: VolumePolicy | None
) -> list[tuple[str, Model]]:
    """The fitted patient, and at other settings; label and model of each.

    Raises:
        CaseError: A prediction for another patient, with a value for a fitted parameter, or under another
            blood volume policy than the fit while none is `chosen` for all.
        ValueError: A case that lacks a section of the fitted parameters.
    """
    cases = _labelled_cases(predictions)
    if wrong := [mistake for one in cases for mistake in _mistakes_of(fit, *one, chosen)]:
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


def _mistakes_of(fit: FitResult, label: str, case: Case, chosen: VolumePolicy | None) -> Iterator[Mistake]:
    """What a case asks of a prediction that its draws cannot give."""
    of, own = f"of the prediction {shown(label)}", fit.case.volume_policy
    if chosen is None and case.blood_volume_policy not in (None, own):
        allowed = f"{own}, or PosteriorSettings(volume_policy=...) for all"
        message = f"{of}: another than that of the fit"
        yield Mistake("blood_volume_policy", message, case.volume_policy, allowed)
    if plain_id(case.patient.id) != plain_id(fit.case.patient.id):
        message = f"{of}: not the patient who was fitted"
        yield Mistake("patient.id", message, shown(case.patient.id), shown(fit.case.patient.id))
    before = fit.objective.targets[fit.number].model.values
    for name in fit.settings.names:
        value = stated(case, name)
        if value is not None and value not in (before.get(name), stated(fit.case, name)):
            message = (
                f"{of}: it was fitted, so every draw has its own value; predict at another setting, or hold "
                "it in the fit"
            )
            yield Mistake(name, message, shown(value), f"{shown(before.get(name))}, as before the fit")


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
    labels = [AS_MEASURED, *(label for label, _ in predictions)]
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


def evenly_chosen(chains: int, draws: int) -> np.ndarray:
    """Numbers of the draws, the same in every chain, that predictions are made with."""
    count = min(draws, max(1, PREDICTED_DRAWS // chains))
    return np.arange(count) * draws // count  # one draw resembles the next


def predict_all(
    models: Sequence[tuple[str, Model]], density: PosteriorDensity, samples: np.ndarray, warn: bool = False
) -> tuple[Prediction, ...]:
    """Predictions for each model from samples (chains, draws, parameters), one chain after the other.

    With `warn` they have warnings about the beat at the medians of the draws.
    """
    draws = samples.reshape(-1, samples.shape[-1])
    chosen = samples[:, evenly_chosen(*samples.shape[:2])].reshape(-1, samples.shape[-1])
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
