"""Fit cases: estimate a patient's parameters from measurements, with intervals and a verdict on the fit."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from eclsim.cases.fit_mark import FitMark
from eclsim.cases.quantities import with_values
from eclsim.devices.description import CAUTION, labelled_sentence
from eclsim.files import ORIGIN, finite
from eclsim.identification.fitted_parameters import (
    SAME_PARAMETER_SHARE,
    FittedParameter,
    doubts_of_bounds,
    fitted_parameters,
    gains_beyond_bounds,
    nothing_identifiable,
    with_wider_intervals,
)
from eclsim.identification.held_parameters import (
    Compensation,
    consumption_uncertainty,
    held_that_move,
    undetermined_outputs,
)
from eclsim.identification.multi_start import (
    Exploration,
    FitStatus,
    Optimum,
    Progress,
    fit_shared,
    identify,
    optimum_without_fit,
    silent,
)
from eclsim.identification.objective import Box, Objective, Target, correlation, within_90
from eclsim.identification.output_intervals import (
    FIRST,
    ONE_OF_MANY,
    OutputInterval,
    output_intervals,
    undetermined_reasons,
    widened,
)
from eclsim.identification.profiles import HeldFits, held_fits
from eclsim.identification.quantities import relative_scale, unit_of, unit_of_parameter
from eclsim.identification.settings import (
    FitSettings,
    avoidable_assumptions,
    case_to_fit,
    checked_fit,
    common_policy,
    remarks_on_assumptions,
    remarks_on_fixed_consumption,
    remarks_on_unfitted,
    unmeasured_uncertainties,
)
from eclsim.identification.verdict import (
    DOUBTFUL_DIFFERENCE,
    Aspect,
    FitVerdict,
    Level,
    Reason,
    agreement,
    contradictory_measurements,
    goodness_of,
    held_but_missed,
    informative_but_fixed,
    not_used_as_weights,
    plausibility,
    search,
    set_points_not_given,
    single_start,
    stronger_membrane,
)
from eclsim.inputs.mistakes import CaseError, as_settings
from eclsim.orbit.model import CASE, CaseSource, as_case, case_json, model_of
from eclsim.outputs.alarms import findings
from eclsim.outputs.contraction import softening
from eclsim.outputs.results import simulate
from eclsim.outputs.uncertainty import measurement_errors
from eclsim.parameters.adult_ranges import AdultRange, adult_ranges
from eclsim.parameters.thiel2025 import stiff_atria
from eclsim.sensitivity.identifiability import ScaledSensitivities

if TYPE_CHECKING:
    from eclsim.cases.case import Case

_ENDS = {"lower": "low", "upper": "high"}
NOT_FROM_A_POOR_FIT = "the fit is poor, so neither its value nor its interval is to be used"


@dataclass(frozen=True)
class FitResult:
    """The fit of one data point.

    Args:
        name: name of the data point.
        case: case with the fitted parameters; unchanged if nothing could be fitted.
        measured: measured values that were fitted [mmHg, L/min].
        simulated: values of all outputs of the fitted model that can be measured.
        intervals: 90 % interval of each of these outputs, and whether it is determined.
        parameters: estimates of the free parameters.
        correlation: correlation matrix of the estimates, shape (parameters, parameters).
        objective: objective that was minimised.
        box: bounds of the free parameters.
        optimum: result of the search.
        number: number of the data point in the objective.
        uncertainties: standard uncertainty of each measurement [mmHg, L/min].
        settings: settings of the fit.
        verdict: whether the fit can be used, with reasons.
        named_as_undetermined: outputs that the reason about held parameters names as not determined.
        implied: outputs of the fitted patient for which adult reference ranges are known, in their units.
        profile: 90 % interval of each parameter by profile likelihood; empty if it was not computed.
        warnings: warnings about the steady beat of the fitted patient.
        seconds: wall time; points fitted side by side share theirs evenly.
    """

    name: str
    case: Case
    measured: Mapping[str, float]
    simulated: Mapping[str, float]
    parameters: Mapping[str, FittedParameter]
    correlation: np.ndarray
    objective: Objective
    box: Box
    optimum: Optimum
    number: int
    uncertainties: Mapping[str, float]
    settings: FitSettings
    verdict: FitVerdict
    intervals: Mapping[str, OutputInterval] = field(default_factory=dict)
    named_as_undetermined: tuple[str, ...] = ()
    implied: Mapping[str, float] = field(default_factory=dict)
    profile: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    seconds: float = 0.0

    def __repr__(self) -> str:
        fitted = ", ".join(f"{n} = {p.value:.3g}" for n, p in self.parameters.items())
        return f"<FitResult {self.name}: {fitted}; {self.verdict.headline}>"

    @property
    def status(self) -> FitStatus:
        """How the search ended."""
        return self.optimum.status

    @property
    def ranges(self) -> dict[str, AdultRange]:
        """Adult reference ranges for the patient's sex, by output."""
        return adult_ranges(self.case.patient.sex)

    def judged(self, more: Iterable[Reason]) -> FitResult:
        """Return the fit with further reasons; parameters that a doubt concerns are no longer determined."""
        verdict = self.verdict.with_reasons(more)
        disagreeing = {
            r.about: r.sentence.removeprefix(f"{r.about}: ")
            for r in verdict.doubts
            if r.aspect is Aspect.INTERVALS
        }
        parameters = self.with_undetermined(disagreeing)
        if verdict.level is Level.POOR:
            nothing = {"identifiable": False, "reason": NOT_FROM_A_POOR_FIT}
            parameters = {name: replace(p, **nothing) for name, p in parameters.items()}
        mark = FitMark(str(verdict.level), is_changed=False)
        case = self.case.model_copy(update={"fit_mark": mark})
        return replace(self, case=case, verdict=verdict, parameters=parameters)

    def wider_intervals(self, reaches: Mapping[str, tuple[float, float]]) -> dict[str, OutputInterval]:
        """Return the intervals of the outputs, which reach at least to given ends."""
        own = {name: ends for name, ends in reaches.items() if name in self.intervals}
        return widened(self.intervals, own, self.simulated, self.measured, self.settings.uncertainties)

    def with_undetermined(self, reasons: Mapping[str, str]) -> dict[str, FittedParameter]:
        """Return the parameters; those with a reason, by name, are marked as not determined."""
        return {
            name: replace(p, identifiable=False, reason=reasons[name])
            if p.identifiable and name in reasons
            else p
            for name, p in self.parameters.items()
        }

    @property
    def dataset(self) -> xr.Dataset:
        """Parameters with their 90 % intervals and correlation, and outputs beside the measurements.

        The attribute `case` is the fitted case as JSON text, for `Case.model_validate_json`; `reasons` are
        those of the verdict, each after its level.
        """
        names, outputs = list(self.parameters), list(self.simulated or self.measured)
        columns = ("value", "lower", "upper", "at_bound", "identifiable", "reason")
        data: dict[
            str, tuple[str | tuple[str, ...], object] | tuple[tuple[str, ...], object, dict[str, str]]
        ] = {
            column: ("parameter", [getattr(p, column) for p in self.parameters.values()])
            for column in columns
        }
        data["correlation"] = (("parameter", "with_parameter"), self.correlation, {"units": "1"})
        rows = {"measured": self.measured, "simulated": self.simulated, "uncertainty": self.uncertainties}
        data |= {row: ("output", [values.get(n, np.nan) for n in outputs]) for row, values in rows.items()}
        known = [self.intervals.get(n, OutputInterval(np.nan, np.nan, determined=False)) for n in outputs]
        data |= {f"simulated_{end}": ("output", [getattr(i, of) for i in known]) for end, of in _ENDS.items()}
        data["determined"] = ("output", [i.determined for i in known])
        coordinates = {
            "parameter": names, "with_parameter": names, "output": outputs,
            "parameter_units": ("parameter", list(map(unit_of_parameter, names))),
            "output_units": ("output", [unit_of(n) for n in outputs]),
        }  # fmt: skip
        attributes = {
            **ORIGIN, "id": self.name, "status": str(self.status), "message": self.status.message,
            "verdict": str(self.verdict.level), "headline": self.verdict.headline,
            "reasons": [f"{r.level}: {r.sentence}" for r in self.verdict.reasons],
            "sum_of_squares": self.optimum.cost, "warnings": list(self.warnings),
            CASE: case_json(self.case, self.objective.policy),
        }  # fmt: skip
        return xr.Dataset(data, coordinates, attributes)

    def as_object(self) -> dict[str, Any]:
        """Plain data for JSON; null for unknown values."""
        names, explored = dict.fromkeys([*self.measured, *self.simulated]), self.optimum.explored
        return {
            "id": self.name,
            "verdict": self.verdict.as_object(),
            "warnings": list(self.warnings),
            "cost": finite(self.optimum.cost),
            "outputs": {
                n: {
                    "measured": self.measured.get(n), "simulated": finite(self.simulated.get(n)),
                    **_interval_object(self.intervals.get(n)),
                }
                for n in names
            },
            "uncertainties": dict(self.uncertainties),
            "implied": {
                n: {
                    "value": finite(self.implied[n]), "words": r.description, "unit": r.unit,
                    "healthy": list(r.healthy), "source": r.source,
                }
                for n, r in self.ranges.items() if n in self.implied
            },
            "parameters": {
                n: {
                    "value": finite(p.value), "lower": finite(p.lower), "upper": finite(p.upper),
                    "profile": None if n not in self.profile else list(self.profile[n]),
                    "at_bound": p.at_bound, "identifiable": p.identifiable, "reason": p.reason,
                }
                for n, p in self.parameters.items()
            },
            "correlation": {
                a: dict(zip(self.parameters, map(finite, row), strict=True))
                for a, row in zip(self.parameters, self.correlation.tolist(), strict=True)
            },
            "starts_agreeing": self.optimum.agreeing,
            "starts_refined": len(self.optimum.starts.agreeing),
            "explored": explored.points,
            "explored_without_steady_beat": explored.without_beat,
            "explored_one_of_many": explored.one_of_many,
            "explored_without_steady_gases": explored.without_gases,
            "seconds": round(self.seconds, 3),
            "status": str(self.status),
            "message": self.status.message,
        }  # fmt: skip


def _interval_object(interval: OutputInterval | None) -> dict[str, Any]:
    """Plain data of the interval of an output."""
    if interval is None:
        return {"lower": None, "upper": None, "determined": False}
    return {"lower": finite(interval.low), "upper": finite(interval.high), "determined": interval.determined}


def fit(case: CaseSource, *, settings: FitSettings | None = None, progress: Progress = silent) -> FitResult:
    """Fit one case to its measurements: multi-start least squares with exact derivatives.

    Other patients who fit the measurements as well are sought; the verdict names them.

    Args:
        case: case with measurements.
        settings: free parameters, weights and extent of the search.
        progress: called with a description of the current step.

    Raises:
        CaseError: Nothing was measured, bounds are impossible, or an uncertainty has no measurement.
        TypeError: The argument is no case, or the settings are no `FitSettings`.
    """
    case, settings = as_case(case), as_settings(settings, FitSettings)
    wrong = unmeasured_uncertainties([case], settings)
    if wrong:
        raise CaseError(wrong)
    from eclsim.identification.solutions import with_solutions_sought

    (found,) = fit_cases([(case.patient.id, case)], settings, progress)
    progress("looking for other patients that fit as well")
    return with_solutions_sought(found)


def fit_cases(
    cases: Sequence[tuple[str, Case]], settings: FitSettings | None = None, progress: Progress = silent
) -> list[FitResult]:
    """Fit cases that have the same circuit, side by side; see `with_solutions_sought` for other patients.

    Args:
        cases: name and case of each data point.
        settings: free parameters, weights and extent of the search.
        progress: called with a description of the current step.

    Raises:
        CaseError: A case has no measurements, bounds are impossible, or blood volume policies differ.
    """
    settings = settings or FitSettings()
    started = time.perf_counter()
    if not cases:
        return []
    cases = [(name, case_to_fit(case, settings)) for name, case in cases]
    objective, box = problem_of([case for _, case in cases], settings)
    optima = identify(objective, box, settings.multi_start, progress)
    if settings.shared and len(cases) > 1:
        errors = [measurement_errors(t.measured, settings.uncertainties) for t in objective.targets]
        errors = [np.array(list(by_output.values())) for by_output in errors]
        optima = fit_shared(objective, box, optima, errors, settings.shared)
    results = [
        _result(name, case, objective, k, box, optimum, settings)
        for k, ((name, case), optimum) in enumerate(zip(cases, optima, strict=True))
    ]
    results = [
        checked_by_simulation(result) for result in _without_compensating_parameters(results, objective, box)
    ]
    seconds = (time.perf_counter() - started) / len(cases)
    return [replace(result, seconds=seconds) for result in results]


def failed_fit(name: str, case: Case, settings: FitSettings, error: Exception) -> FitResult:
    """Return the result of a data point whose fit was ended by an error of the program."""
    case = case_to_fit(case, settings)
    objective, box = problem_of([case], settings)
    optimum = optimum_without_fit(len(box.names), len(objective.outputs), FitStatus.BROKEN_OFF, Exploration())
    result = _result(name, case, objective, 0, box, optimum, settings)
    about = f"{type(error).__name__}: {error}"
    return replace(result, verdict=FitVerdict(None, tuple(search(optimum.status, about))))


def problem_of(cases: Sequence[Case], settings: FitSettings) -> tuple[Objective, Box]:
    """Return the objective for cases prepared by `case_to_fit`, and the bounds."""
    targets, boxes = [], []
    for case in cases:
        checked = checked_fit(case, settings)
        checked.raise_mistakes()
        errors = measurement_errors(checked.targets, settings.uncertainties)
        if settings.weights == "relative":
            errors = {n: relative_scale(n, v) or errors[n] for n, v in checked.targets.items()}
        targets.append(Target(model_of(case).with_values(checked.fixed), checked.targets, errors))
        boxes.append(Box.of(checked.free))
    policy = common_policy(cases, settings.volume_policy)
    return Objective(targets, boxes[0].names, policy), boxes[0]


def _result(
    name: str, case: Case, objective: Objective, number: int, box: Box, optimum: Optimum,
    settings: FitSettings,
) -> FitResult:  # fmt: skip
    measured = objective.targets[number].measured
    nothing = FittedParameter(np.nan, np.nan, np.nan, False, False, optimum.status.message)
    result = FitResult(
        name=name,
        case=case,
        measured=measured,
        simulated={},
        parameters=dict.fromkeys(box.names, nothing),
        correlation=np.full((len(box.names),) * 2, np.nan),
        objective=objective,
        box=box,
        optimum=optimum,
        number=number,
        uncertainties=measurement_errors(measured, settings.uncertainties),
        settings=settings,
        verdict=FitVerdict(None, tuple(search(optimum.status))),
    )
    return _with_estimates(result) if optimum.exists else result


def _with_estimates(fit: FitResult) -> FitResult:
    """Return a fit with values, intervals and verdict at its optimum."""
    objective, box, optimum, settings = fit.objective, fit.box, fit.optimum, fit.settings
    number, target, known = fit.number, objective.targets[fit.number], fit.uncertainties
    rows = [objective.outputs.index(o) for o in target.measured]
    errors = np.array(list(known.values()))
    scaled = ScaledSensitivities(tuple(target.measured), box.names, optimum.jacobian[rows] / errors[:, None])
    weights = objective.weights[number][rows] * errors
    spread = box.covariance(scaled.matrix, weights) if optimum.shared is None else optimum.shared.covariance
    simulated = dict(zip(objective.outputs, optimum.outputs.tolist(), strict=True))
    best_weights = box.covariance(scaled.matrix) if optimum.shared is None else spread
    goodness = goodness_of(target.measured, simulated, known, scaled.matrix, best_weights)
    gains = gains_beyond_bounds(objective, number, optimum, box, goodness.chi_square)
    measured, least = np.array(list(target.measured.values())), goodness.chi_square
    as_good = optimum.starts.within_90(rows, measured, errors, least)
    deviations = np.sqrt(np.einsum("ij,jk,ik->i", optimum.jacobian, spread, optimum.jacobian))
    others = optimum.starts.outputs[as_good] if optimum.shared is None else np.zeros((0, len(simulated)))
    errors_of_fit, ends = np.sqrt(np.diag(spread)), optimum.starts.end[as_good]
    parameters = fitted_parameters(optimum, box, scaled, errors_of_fit, gains, ends)
    fitted = {n: p.value for n, p in parameters.items()}
    fixed = {n: target.model.values[n] for n in settings.names if n not in fitted}
    set_points = {n: target.model.values[n] for n in fit.case.open_set_points}
    changed = with_values(fit.case, {**fixed, **fitted, **set_points})
    changed = changed.model_copy(update={"blood_volume_policy": objective.policy})
    reasons = [
        *agreement(target.measured, simulated, goodness, settings.weights),
        *contradictory_measurements(target.measured),
        *not_used_as_weights(target.measured, settings.uncertainties, settings.weights),
        *stronger_membrane(target.measured, simulated, goodness, box.names, target.model.values),
        *search(optimum.status),
        *single_start(optimum.agreeing, len(optimum.starts.agreeing)),
        *doubts_of_bounds(parameters, gains), *informative_but_fixed(goodness, box.names),
        *set_points_not_given(set_points),
        *(Reason(Aspect.AGREEMENT, Level.GOOD, "", s)
          for s in remarks_on_unfitted(fit.case, target.measured)),
    ]  # fmt: skip
    return replace(
        fit,
        case=changed,
        simulated=simulated,
        parameters=parameters,
        correlation=correlation(spread),
        verdict=FitVerdict(goodness, ()).with_reasons(reasons),
        intervals=output_intervals(simulated, deviations, others, target.measured, settings.uncertainties),
    )


def checked_by_simulation(result: FitResult) -> FitResult:
    """Simulate the fitted patient and return the fit with doubts, such as outputs outside adult ranges."""
    if not result.simulated:
        return result
    model = model_of(result.case)
    beat = simulate(model, result.objective.policy)
    if not beat.attrs["converged"]:
        sentence = f"`eclsim simulate` on the fitted case: {beat.attrs['message']}"
        return result.judged([Reason(Aspect.PLAUSIBILITY, Level.DOUBTFUL, "", sentence)])
    if beat.attrs["one_of_many"]:
        optimum = replace(result.optimum, status=FitStatus.ONE_OF_MANY)
        return replace(result, optimum=optimum).judged(search(optimum.status, str(beat.attrs["message"])))
    outputs = {str(n): float(v) for n, v in beat.items() if v.ndim == 0}
    extremes = {str(n): (float(v.min()), float(v.max())) for n, v in beat.items() if v.dims == ("phase",)}
    collapsed = [f.sentence for f in findings(outputs, extremes) if f.kind == "collapse"]
    weak = [f.sentence for f in softening(outputs, extremes, model.circuit, model.values)]
    implied = {n: outputs[n] for n in result.ranges if n in outputs}
    reasons = plausibility(implied, result.ranges, result.measured, collapsed + weak)
    for sentence in avoidable_assumptions(result.case, result.measured, result.parameters):
        reasons.append(Reason(Aspect.PLAUSIBILITY, Level.DOUBTFUL, "", sentence))
    result, consumption = _with_consumption_unknown(result)
    result, held_reasons = _with_held_parameters_free(result)
    reasons += held_reasons + consumption + _held_that_would_help(result)
    reasons += nothing_identifiable(result.parameters)
    reasons += undetermined_reasons(result.intervals, result.simulated, result.named_as_undetermined)
    of_atria = {key: text for key, text in stiff_atria(model.values).items() if key in result.box.names}
    assumed = remarks_on_assumptions(result.case, result.measured, result.parameters)
    for about, sentence in {**of_atria, **assumed}.items():
        reasons.append(Reason(Aspect.PLAUSIBILITY, Level.GOOD, about, sentence))
    warnings = tuple(beat.attrs["warnings"])
    if FIRST in result.intervals and not result.intervals[FIRST].determined:
        advice = labelled_sentence(CAUTION, "")  # how to read a number holds for every patient
        warnings = tuple(w if w.startswith(advice) else f"{w}; {ONE_OF_MANY}" for w in warnings)
    return replace(result, implied=implied, warnings=warnings).judged(reasons)


def _held_that_would_help(result: FitResult) -> list[Reason]:
    """Doubts where missed measurements depend on parameters that the fit holds at usual values."""
    goodness = result.verdict.goodness
    if goodness is None or result.optimum.shared is not None:
        return []
    missed = [name for name, off in goodness.differences.items() if abs(off) > DOUBTFUL_DIFFERENCE]
    if not missed:
        return []
    case, free, errors, policy = _as_fitted(result)
    moved_by = held_that_move(case, free, {name: errors[name] for name in missed}, policy)
    return held_but_missed(moved_by, result.box.names)


def _with_consumption_unknown(result: FitResult) -> tuple[FitResult, list[Reason]]:
    """Return the fit with intervals that allow for an unknown oxygen consumption, and reasons."""
    sentences = remarks_on_fixed_consumption(result.case, result.measured, result.parameters)
    alone = result.optimum.shared is None
    if sentences and alone and (found := consumption_uncertainty(*_as_fitted(result))):
        return _widened(result, found)
    level = Level.GOOD if alone else Level.DOUBTFUL
    return result, [Reason(Aspect.HELD, level, "", sentence) for sentence in sentences]


def _with_held_parameters_free(result: FitResult) -> tuple[FitResult, list[Reason]]:
    """Return the fit with intervals that allow for unknown values of held parameters, and reasons."""
    if result.optimum.shared is not None:
        return result, []
    case, free, errors, policy = _as_fitted(result)
    found = undetermined_outputs(case, free, result.measured, errors, policy)
    return (result, []) if found is None else _widened(result, found)


def _widened(result: FitResult, found: Compensation) -> tuple[FitResult, list[Reason]]:
    """Return the fit with wider intervals of parameters, marked as not determined, and the reason."""
    result = replace(result, parameters=with_wider_intervals(result.parameters, found.intervals))
    parameters = result.with_undetermined(dict.fromkeys(found.intervals, found.why))
    reason = Reason(Aspect.HELD, Level.DOUBTFUL, "", found.sentence)
    intervals = result.wider_intervals({n: (reach.low, reach.high) for n, reach in found.outputs.items()})
    named = tuple(found.outputs) or result.named_as_undetermined
    result = replace(result, parameters=parameters, intervals=intervals, named_as_undetermined=named)
    return result, [reason]


def _as_fitted(
    result: FitResult,
) -> tuple[Case, Mapping[str, tuple[float, float, float]], Mapping[str, float], str]:
    """Return the fitted case, value and bounds of each free parameter, uncertainties and volume policy."""
    ends = (result.box.scale.values(x) for x in (result.optimum.x, result.box.lower, result.box.upper))
    free = dict(zip(result.box.names, zip(*(e.tolist() for e in ends), strict=True), strict=True))
    return result.case, free, result.uncertainties, result.objective.policy


def _without_compensating_parameters(
    results: Sequence[FitResult], objective: Objective, box: Box
) -> list[FitResult]:
    """Return the fits; parameters that compensate for undetermined ones are marked as undetermined, too.

    Intervals of undetermined parameters reach to the values at which the others make up for them.
    """
    undetermined = [
        [k for k, p in enumerate(f.parameters.values()) if not p.identifiable]
        if f.simulated and f.optimum.shared is None
        else []
        for f in results
    ]
    held = held_fits(objective, box, [f.optimum.x for f in results], undetermined)
    judged = []
    for result, held_fit in zip(results, held, strict=True):
        moved, followed = held_fit.compensation(result.optimum.x)
        reasons = {
            name: (
                f"follows {box.names[followed[k]]}, which the measurements do not determine: with other "
                f"values of it, {box.scale.difference_text(k, moved[k])} apart at the same outputs"
            )
            for k, name in enumerate(box.names)
            if moved[k] > np.log1p(SAME_PARAMETER_SHARE)
        }
        reaches, of_outputs = _reaches(result, held_fit)
        parameters = with_wider_intervals(result.with_undetermined(reasons), reaches)
        judged.append(replace(result, parameters=parameters, intervals=result.wider_intervals(of_outputs)))
    return judged


def _reaches(
    result: FitResult, held: HeldFits
) -> tuple[dict[str, tuple[float, float]], dict[str, tuple[float, float]]]:
    """Return between which values the parameters that were held fit as well, and the outputs then are."""
    if not len(held.held) or result.verdict.goodness is None:
        return {}, {}
    rows = [result.objective.outputs.index(n) for n in result.measured]
    measured, errors = (np.array(list(each.values())) for each in (result.measured, result.uncertainties))
    squares = np.sum(((held.outputs[:, rows] - measured) / errors) ** 2, axis=1)
    least = result.verdict.goodness.chi_square
    meeting = held.outputs[within_90(squares, least)]
    ends = np.stack([meeting.min(axis=0), meeting.max(axis=0)], axis=1).tolist() if len(meeting) else []
    of_outputs = {n: (low, high) for n, (low, high) in zip(result.simulated, ends, strict=False)}
    return held.intervals(result.box.names, result.optimum.x, squares, least), of_outputs
