"""Follow a patient: parameters, forecasts and doubts, from one measurement to the next."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.stats import qmc

from eclsim.arguments import FiniteNumber, Kind, WholeNumber, check_fields, number_of
from eclsim.cases.cohort import plain_id
from eclsim.identification.after_update import Course, Miss, slope_in_z, unmet
from eclsim.identification.density import (
    KNOWN_PRIOR,
    Gaussian,
    NoSteadyBeatError,
    PosteriorDensity,
    Prior,
    PriorKind,
    beats_of_members,
    gaussian_approximation,
)
from eclsim.identification.filtering import (
    DRIFTS,
    UNUSUAL_SERIES,
    GaussianMixture,
    InnovationTest,
    Regression,
    as_drifts,
    outputs_after,
    regress,
    updated,
)
from eclsim.identification.importance import WeightedDraws, importance_sample
from eclsim.identification.multi_start import Progress, silent
from eclsim.identification.objective import Box
from eclsim.identification.points import (
    HOURS_PER_DAY,
    SHARES,
    Innovation,
    Interval,
    TrackedPoint,
    TrackResult,
)
from eclsim.identification.quantities import OUTPUTS, possible_range
from eclsim.identification.series import (
    Series,
    copied_measurements,
    elapsed_hours,
    falling_clotting,
    named_cases,
    notes_on_bounds,
    notes_on_time,
    passed_over,
    series_of,
)
from eclsim.identification.settings import FitSettings
from eclsim.identification.transport import Transport
from eclsim.identification.verdict import (
    Aspect,
    FitVerdict,
    Level,
    Reason,
    agreement,
    goodness_of,
    stronger_membrane,
)
from eclsim.inputs.mistakes import CaseError, Mistake, as_settings, shown
from eclsim.orbit.model import CaseSource, Model, as_case, model_of
from eclsim.outputs.signals import gas_dependent_outputs, output_names
from eclsim.outputs.steady_beat import SteadyBeat
from eclsim.outputs.uncertainty import measurement_errors

if TYPE_CHECKING:
    from eclsim.cases.case import Case
    from eclsim.circuit import Circuit

EXPLORED = 512
MAXIMISATIONS = 4
DRAWS = 512
MANY_PARAMETERS, MANY_DRAWS = 7, 2048
"""With more parameters, the first intervals need this number of draws for accurate ends."""
INTERVAL_DRAWS = 4000


@dataclass(frozen=True)
class TrackSettings:
    """Settings for following a patient.

    Args:
        fit: free parameters, bounds, uncertainties of the measurements, blood volume policy.
        prior: distribution of the parameters before the first measurement.
        drifts: standard deviations of the change of a latent variable over a day; each has its own filter,
            and the measurements weight the filters.
        seed: seed of the search for the first estimate.
        interval_hours: time between measurements if it is not known [h].
    """

    fit: FitSettings = field(default_factory=FitSettings)
    prior: PriorKind = "log-uniform"
    drifts: tuple[float, ...] = DRIFTS
    seed: int = 0
    interval_hours: float = HOURS_PER_DAY

    def __post_init__(self) -> None:
        check_fields(
            self, prior=KNOWN_PRIOR, fit=Kind(FitSettings), drifts=as_drifts, seed=WholeNumber(),
            interval_hours=number_of,
        )  # fmt: skip
        check_fields(self, interval_hours=FiniteNumber(least=0.0, unit="h"))

    def as_object(self) -> dict[str, Any]:
        """Plain data for JSON."""
        of_fit = self.fit.as_object()
        fit_keys = ("parameters", "bounds", "uncertainties", "blood_volume_policy")
        return {
            **{name: of_fit[name] for name in fit_keys},
            "prior": self.prior, "drifts": list(self.drifts), "seed": self.seed,
        }  # fmt: skip


@dataclass(frozen=True)
class _Estimate:
    """The patient's prior, the transport coordinates, and the distribution in these coordinates."""

    prior: Prior
    transport: Transport
    state: GaussianMixture

    def parameters(self, seed: int) -> dict[str, Interval]:
        draws, _ = self.transport.z_of(self.state.draws(INTERVAL_DRAWS, seed))
        rows = self.prior.values_of(np.quantile(draws, SHARES, axis=0)).T.tolist()
        return {n: Interval(*row) for n, row in zip(self.prior.names, rows, strict=True)}


class Tracker:
    """Follows one patient.

    Args:
        settings: what is tracked and how.
        progress: called with a description of the current step.
        series: common properties of all measurements; if None, each measurement adds its own.
    """

    def __init__(
        self, settings: TrackSettings | None = None, progress: Progress = silent, series: Series | None = None
    ):
        self.settings = settings or TrackSettings()
        self.progress = progress
        self.series = series or Series(self.settings.fit)
        self.patient: str | None = None
        self.drifts = np.array(self.settings.drifts)
        self.estimate: _Estimate | None = None
        self._prior: Prior | None = None
        self._starts: dict[Circuit, dict[str, float]] = {}
        self._left_out: dict[str, float] = {}
        self._course = Course(self.settings.fit.uncertainties)
        self._misses: dict[str, Miss] = {}
        self._still_open: dict[str, str] = {}
        self._reported_doubts: set[str] = set()
        self._before: TrackedPoint | None = None

    def update(self, name: str, case: CaseSource, hours: float | None = None) -> TrackedPoint:
        """Forecast a measurement, compare it with the forecast, and update the estimate.

        Args:
            name: name of the point.
            case: patient, devices and measurements at this time.
            hours: time since the previous measurement [h]; None takes the interval of the settings.

        Raises:
            CaseError: Nothing was measured, bounds are impossible, the patient differs, or the time is
                negative.
        """
        started = time.perf_counter()
        case = as_case(case)
        self._check_patient(case)
        days = self._days(hours)
        self.series.learn(name, case)
        prior, model, measured, doubts = self._read(case)
        since = None if self.patient is None else days * HOURS_PER_DAY
        self.patient = case.patient.id
        try:
            if self.estimate is None:
                point = self._first(name, prior, model, measured)
            else:
                point = self._next(name, self._forecast(self.estimate, days), model, measured)
            point = self._doubted(replace(point, warnings=self._warnings(model, point)), doubts)
            self._course.learn(measured)
        except NoSteadyBeatError as error:
            point = self._failed(name, measured, str(error), days)
        return replace(point, seconds=time.perf_counter() - started, hours=since)

    def forecast(
        self, case: CaseSource, hours: float | None = None
    ) -> tuple[dict[str, Interval], dict[str, Interval]]:
        """Forecast the next time with the devices of a case.

        Returns the intervals of the model's outputs, and those of measurements of them.

        Args:
            case: patient and devices at that time.
            hours: time since the last measurement [h]; None takes the interval of the settings.

        Raises:
            CaseError: The patient differs, or the time is before the last measurement.
            RuntimeError: There was no measurement yet.
        """
        if self.estimate is None:
            raise RuntimeError("nothing to forecast from: no measurement yet")
        case = as_case(case)
        self._check_patient(case)
        case, checked = self.series.checked(case)
        model = model_of(case).with_values(checked.fixed)
        forecast = self._forecast(self.estimate, self._days(hours))
        names, _, regression = self._regression(forecast, model)
        outputs = regression.outputs(forecast.state)
        return _intervals(names, outputs), self._expected(names, outputs, {})

    def _check_patient(self, case: Case) -> None:
        if self.patient is not None and plain_id(case.patient.id) != plain_id(self.patient):
            message = "not the patient followed so far"
            raise CaseError([Mistake("patient.id", message, shown(case.patient.id), shown(self.patient))])

    def _days(self, hours: float | None) -> float:
        hours = self.settings.interval_hours if hours is None else number_of("hours", hours)
        if not 0.0 <= hours < np.inf:
            message = "the time since the previous measurement"
            raise CaseError([Mistake("hours", message, shown(float(hours)), "0 or more hours")])
        return hours / HOURS_PER_DAY

    def _read(self, case: Case) -> tuple[Prior, Model, dict[str, float], tuple[str, ...]]:
        """Return prior, model, measurements and doubts for a case."""
        case, checked = self.series.checked(case)
        checked.raise_mistakes()
        self._prior = self._prior or Prior.within(Box.of(self.series.free()), self.settings.prior)
        model, doubts = model_of(case).with_values(checked.fixed), self.series.doubts(case, checked)
        return self._prior, model, dict(checked.targets), doubts

    def _doubted(self, point: TrackedPoint, doubts: tuple[str, ...]) -> TrackedPoint:
        """Return the point with its doubts; the message includes those that no earlier point had."""
        own = [miss.sentence(point.outputs[n]) for n, miss in self._misses.items()]
        still_open = {n: d for n, d in self._still_open.items() if n not in point.innovations}
        self._still_open = still_open | {n: m.sentence_later(point.name) for n, m in self._misses.items()}
        new = [*own, *(doubt for doubt in doubts if doubt not in self._reported_doubts)]
        if self._before is not None:
            new = [copied_measurements(self._before, point), falling_clotting(self._before, point), *new]
        self._before = point
        self._reported_doubts.update(new)
        reasons = [Reason(Aspect.PLAUSIBILITY, Level.DOUBTFUL, "", doubt) for doubt in doubts]
        verdict = None if point.verdict is None else point.verdict.with_reasons(reasons)
        message = "; ".join(filter(None, (point.message, *new)))
        return replace(point, verdict=verdict, message=message, doubts=(*own, *still_open.values(), *doubts))

    def _first(self, name: str, prior: Prior, model: Model, measured: Mapping[str, float]) -> TrackedPoint:
        """Estimate the posterior of the first measurement by itself."""
        settings = self.settings
        density = PosteriorDensity(model, measured, self._errors(measured), prior, self._policy(model))
        unit = qmc.Sobol(len(prior.names), rng=np.random.default_rng(settings.seed)).random(EXPLORED)
        points = 1.6 * (2.0 * unit - 1.0)
        self.progress("exploring")
        levels = density.potential(points, density.simulate(points))
        self.progress("climbing to the highest points")
        best = points[np.argsort(levels, kind="stable")[:MAXIMISATIONS]]
        gaussian = gaussian_approximation(density, prior.x_of(best))
        self.progress("weighted draws")
        count = MANY_DRAWS if len(prior.names) > MANY_PARAMETERS else DRAWS
        weighted = importance_sample(density, gaussian, count, settings.seed)
        weights, power = weighted.tempered()
        transport = weighted.transport if power == 1.0 else Transport.fit(weighted.z, weights)
        u, _ = transport.u_of(weighted.z)
        mean = weights @ u
        covariance = ((u - mean).T * weights) @ (u - mean)
        gaussian_state = GaussianMixture(np.ones(1), mean[None], covariance[None])
        count = len(self.drifts)
        same = (np.repeat(each[None], count, axis=0) for each in (mean, covariance))
        state = GaussianMixture(np.full(count, 1.0 / count), *same)
        self.estimate = _Estimate(prior, transport, state)
        self._starts[model.circuit] = density.numbers(transport.z_of(mean)[0])
        names, _, regression = self._regression(replace(self.estimate, state=gaussian_state), model)
        outputs, (values, scales) = regression.outputs(gaussian_state), self._in_order(names, measured)
        slope = slope_in_z(gaussian_state, regression.slope, transport)
        self._misses = unmet(names, values, scales, outputs, np.isfinite(values), slope, is_first=True)
        verdict = _verdict(density, gaussian)
        return TrackedPoint(
            name, {n: Innovation(v, met=n not in self._misses) for n, v in measured.items()},
            self.estimate.parameters(settings.seed), _intervals(names, outputs), self._drift(state),
            verdict=verdict, message=_doubt(verdict, weighted, power),
        )  # fmt: skip

    def _next(
        self, name: str, forecast: _Estimate, model: Model, measured: Mapping[str, float]
    ) -> TrackedPoint:
        """Compare a measurement with its forecast and update the estimate."""
        names, simulate, first = self._regression(forecast, model, measured)
        outputs = first.outputs(forecast.state)
        values, scales = self._in_order(names, measured)
        available = np.isfinite(values)
        missed = np.array([self._left_out.get(n, np.nan) for n in names])
        test = InnovationTest.of(values, scales, outputs, available, missed)
        used = available & ~test.left_out
        left = np.where(test.left_out, test.deviations, np.where(available, np.nan, missed))
        self._left_out |= dict(zip(names, left.tolist(), strict=True))
        state = updated(simulate, forecast.state, first, values, scales, used)
        self.estimate = replace(forecast, state=state)
        message, after, self._misses = self._message(test, names, measured), {}, {}
        try:
            given = outputs_after(simulate, state)
            slope = slope_in_z(forecast.state, first.slope, forecast.transport)
            self._misses, after = unmet(names, values, scales, given, used, slope), _intervals(names, given)
        except NoSteadyBeatError as error:
            message = "; ".join(filter(None, (message, f"after the update {error}")))
        innovations = {
            n: Innovation(
                float(values[k]),
                float(test.deviations[k]),
                bool(test.unusual[k]),
                bool(used[k]),
                n not in self._misses,
            )
            for k, n in enumerate(names)
            if available[k]
        }
        return TrackedPoint(
            name, innovations, self.estimate.parameters(self.settings.seed), after, self._drift(state),
            _intervals(names, outputs), self._expected(names, outputs, self._errors(measured)),
            test.chi_square, test.probability, test.probability < UNUSUAL_SERIES, message=message,
        )  # fmt: skip

    def _message(self, test: InnovationTest, names: Sequence[str], measured: Mapping[str, float]) -> str:
        """What does not fit, and whether others changed with an output that does not."""
        deviations = dict(zip(names, np.nan_to_num(test.deviations).tolist(), strict=True))
        alone = list(itertools.compress(names, test.left_out))
        changes = [self._course.sudden_change(n, measured, deviations) for n in alone]
        return test.message(names, "; ".join(filter(None, changes)))

    def _failed(self, name: str, measured: Mapping[str, float], message: str, days: float) -> TrackedPoint:
        """Return a point without a steady beat; the estimate only drifts for the elapsed time."""
        innovations = {n: Innovation(v, used=False) for n, v in measured.items()}
        parameters: dict[str, Interval] = {}
        if self.estimate is not None:
            self.estimate = self._forecast(self.estimate, days)
            parameters = self.estimate.parameters(self.settings.seed)
        return TrackedPoint(name, innovations, parameters, {}, np.nan, message=message, failed=True)

    def _warnings(self, model: Model, point: TrackedPoint) -> tuple[str, ...]:
        from eclsim.identification.estimate_warnings import DRAWN, estimate_warnings

        assert self.estimate is not None
        density = PosteriorDensity(model, {}, {}, self.estimate.prior, self._policy(model))
        z, _ = self.estimate.transport.z_of(self.estimate.state.draws(DRAWN, self.settings.seed))
        measured = {n: i.measured for n, i in point.innovations.items()}
        return estimate_warnings(density, z, point.outputs, measured)

    def _forecast(self, estimate: _Estimate, days: float) -> _Estimate:
        return replace(estimate, state=estimate.state.forecast(self.drifts, estimate.transport, days))

    def _regression(
        self, estimate: _Estimate, model: Model, measured: Collection[str] = ()
    ) -> tuple[tuple[str, ...], Callable[[np.ndarray], np.ndarray], Regression]:
        """Return measurable outputs, the model as a function of u, and its regression over an estimate.

        Outputs of gases are left out if the estimate has no steady gas state, unless gases were measured.

        Raises:
            NoSteadyBeatError: The estimate has no steady beat, or no steady state of the measured gases.
        """
        density = PosteriorDensity(model, {}, {}, estimate.prior, self._policy(model))
        names = tuple(n for n in OUTPUTS if n in output_names(model.circuit))
        if model.circuit not in self._starts:
            known = self.estimate or estimate
            self._starts[model.circuit] = density.numbers(known.transport.z_of(known.state.mean)[0])
        start = self._starts[model.circuit]

        def beats(u: np.ndarray) -> SteadyBeat:
            values = density.values(density.prior.x_of(estimate.transport.z_of(u)[0]))
            return beats_of_members(model, values, len(u), names, density.policy, start)

        def simulate(u: np.ndarray) -> np.ndarray:
            return beats(u).values.T

        if gases := gas_dependent_outputs(model.circuit, names):
            at_means = beats(estimate.state.means)
            if (without := at_means.without_gases).any():
                if needed := [n for n in gases if n in measured]:
                    reason = at_means.message(int(np.flatnonzero(without)[0]))
                    raise NoSteadyBeatError(f"{', '.join(needed)} measured; at the estimate so far: {reason}")
                names = tuple(n for n in names if n not in gases)
        return names, simulate, regress(simulate, estimate.state.means, estimate.state.covariances)

    def _expected(
        self, names: Sequence[str], outputs: GaussianMixture, known: Mapping[str, float]
    ) -> dict[str, Interval]:
        """Median and 90 % interval of expected measurements: outputs plus measurement noise."""
        typical = dict(zip(names, outputs.mean.tolist(), strict=True))
        errors = {**self._errors(typical), **known}
        noise = np.diag([errors[n] ** 2 for n in names])
        return _intervals(names, replace(outputs, covariances=outputs.covariances + noise))

    def _errors(self, values: Mapping[str, float]) -> dict[str, float]:
        return measurement_errors(values, self.settings.fit.uncertainties)

    def _in_order(self, names: Sequence[str], measured: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
        """Measured values and their uncertainties by output; NaN and infinity where nothing was measured."""
        errors = self._errors(measured)
        values = np.array([measured.get(n, np.nan) for n in names])
        return values, np.array([errors.get(n, np.inf) for n in names])

    def _policy(self, model: Model) -> str:
        return self.settings.fit.volume_policy or model.policy

    def _drift(self, state: GaussianMixture) -> float:
        return float(np.sqrt(state.weights @ self.drifts**2))


def _intervals(names: Sequence[str], outputs: GaussianMixture) -> dict[str, Interval]:
    """Median and 90 % interval of each output; what a normal distribution puts beyond a bound lies on it."""
    lowest, highest = np.array([possible_range(n) for n in names]).T
    rows = np.clip(outputs.quantiles(SHARES), lowest, highest).T.tolist()
    return {n: Interval(*row) for n, row in zip(names, rows, strict=True)}


def _verdict(density: PosteriorDensity, gaussian: Gaussian) -> FitVerdict:
    """Judge whether the model reproduces the first measurements at the maximum of their posterior."""
    simulated = dict(zip(density.outputs, gaussian.outputs.tolist(), strict=True))
    scaled = gaussian.jacobian / density.scale[:, None]
    goodness = goodness_of(density.measured, simulated, density.errors, scaled, gaussian.covariance)
    known = density.measured, simulated, goodness
    more = stronger_membrane(*known, density.prior.names, density.model.values)
    return FitVerdict(goodness, ()).with_reasons([*agreement(*known, "uncertainty"), *more])


def _doubt(verdict: FitVerdict, weighted: WeightedDraws, power: float) -> str:
    """Doubts about the first estimate and how they were handled; empty if there are none."""
    doubts = [f"first estimate: {verdict.headline}", *verdict.advice] if verdict.doubts else []
    if power < 1.0:
        doubts.append(
            f"the first estimate is itself uncertain: {'; '.join(weighted.reasons)}; its intervals are "
            f"widened (weights to the power {power:.2f}), and later measurements narrow them"
        )
    return "; ".join(doubts)


def track(
    points: Sequence[tuple[str, CaseSource]],
    *,
    settings: TrackSettings | None = None,
    progress: Progress = silent,
    left_out: Sequence[int] = (),
) -> TrackResult:
    """Follow one patient through a series of measurements.

    Args:
        points: name and case of each measurement in order of time. Names that are times give the intervals,
            with their dates or as clock times of one day; otherwise that of the settings is assumed, and a
            note says so.
        settings: what is tracked and how.
        progress: called with a description of the current step.
        left_out: number of missing measurements before each point. Where names are no times, each of these
            counts as an interval, too. Empty for none.

    Raises:
        CaseError: There are no points, times are impossible or not in order, or one of the errors of
            `Tracker.update`.
    """
    settings, points = as_settings(settings, TrackSettings), named_cases(points)
    cases = [(name, as_case(source)) for name, source in points]
    names, lost = [name for name, _ in points], passed_over(left_out, len(points))
    known, of_time = elapsed_hours(names), notes_on_time(names, settings.interval_hours, lost)
    assumed = [settings.interval_hours * (1 + missing) for missing in lost]
    hours = known or [None, *assumed[1:]]
    done: list[TrackedPoint] = []

    def say(step: object) -> None:
        progress(f"measurement {len(done) + 1} of {len(points)}" + (f": {step}" if step else ""))

    series = series_of(settings.fit, cases)
    tracker, patient = Tracker(settings, say, series), cases[0][1].patient.id
    for (name, case), passed in zip(cases, hours, strict=True):
        say("")
        done.append(tracker.update(name, case, passed))
    notes = (*of_time, *series.remarks(cases[-1][1]), *notes_on_bounds(done))
    return TrackResult(patient, tuple(done), None if known else settings.interval_hours, notes)
