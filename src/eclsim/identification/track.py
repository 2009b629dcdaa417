"""Following a patient: parameters, forecasts and doubts, from one measurement to the next."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.stats import qmc

from eclsim.cases.ids import plain_id
from eclsim.identification.batch_outputs import simulate_members
from eclsim.identification.density import Posterior
from eclsim.identification.filtering import DRIFTS, Belief, Regression, outputs_of, regress, updated
from eclsim.identification.gaussian import NoSteadyBeatError, approximate
from eclsim.identification.importance import Weighted, weigh
from eclsim.identification.observation import OUTPUTS, elapsed_hours, measurement_errors
from eclsim.identification.prior import Prior, PriorKind
from eclsim.identification.settings import FitSettings, checked_fit
from eclsim.identification.track_results import (
    SHARES,
    UNUSUAL_SERIES,
    Fitting,
    Innovation,
    Interval,
    TrackedPoint,
    expected_measurements,
    intervals,
    named,
)
from eclsim.identification.transport import Transport
from eclsim.inputs.mistakes import CaseError, Mistake, shown
from eclsim.orbit.model import Model, model_of

if TYPE_CHECKING:
    from eclsim.cases.case import Case

HOURS_PER_DAY = 24.0
EXPLORED = 512
CLIMBS = 4
DRAWS = 512
DRAWN = 4000


@dataclass(frozen=True)
class TrackSettings:
    """What is tracked and how.

    Args:
        fit: free parameters, bounds, uncertainties of the measurements, blood volume policy.
        prior: what is known before the first measurement.
        drifts: standard deviations of the change of a hidden variable over a day; each has a filter of its
            own, and the measurements choose.
        seed: of the search for the first estimate.
        interval_hours: time from one measurement to the next where it is not known.
    """

    fit: FitSettings = field(default_factory=FitSettings)
    prior: PriorKind = "log-uniform"
    drifts: tuple[float, ...] = DRIFTS
    seed: int = 0
    interval_hours: float = HOURS_PER_DAY

    def as_object(self) -> dict[str, Any]:
        """As plain data for JSON."""
        of_fit = self.fit.as_object()
        kept = ("parameters", "bounds", "uncertainties", "blood_volume_policy")
        return {
            **{name: of_fit[name] for name in kept},
            "prior": self.prior, "drifts": list(self.drifts), "seed": self.seed,
        }  # fmt: skip


class Tracker:
    """Follows one patient.

    Args:
        settings: what is tracked and how.
        report: called with what is being done.
    """

    def __init__(self, settings: TrackSettings | None = None, report: Callable[[str], None] | None = None):
        self.settings = settings or TrackSettings()
        self.report = report or (lambda _: None)
        self.patient: str | None = None
        self.drifts = np.array(self.settings.drifts)
        self.belief: Belief | None = None
        self.prior: Prior | None = None
        self.transport: Transport | None = None
        self.near: dict[Any, Mapping[str, float]] = {}

    def update(self, name: str, case: Case, hours: float | None = None) -> TrackedPoint:
        """Forecast a measurement, hold it against that, and learn from it.

        Args:
            name: of the point.
            case: patient, devices and measurements at this time.
            hours: since the measurement before; left out, the interval of the settings.

        Raises:
            CaseError: Nothing measured, bounds that cannot be, another patient, or a time that runs back.
        """
        started = time.perf_counter()
        self._check_patient(case)
        passed = self._days(hours)
        model, measured, errors = self._read(case)
        first = self.patient is None
        self.patient = case.patient.id
        try:
            if self.belief is None:
                point = self._first(name, model, measured, errors)
            else:
                moved = self.belief.moved_on(self.drifts, self._transport, passed)
                point = self._next(name, moved, model, measured, errors)
        except NoSteadyBeatError as error:
            point = self._failed(name, measured, str(error), passed)
        since = None if first else passed * HOURS_PER_DAY
        return replace(point, seconds=time.perf_counter() - started, hours=since)

    def forecast(
        self, case: Case, hours: float | None = None
    ) -> tuple[dict[str, Interval], dict[str, Interval]]:
        """Outputs expected at the next time with the devices of a case: of the model, and as measured.

        Args:
            case: patient and devices then.
            hours: from the last measurement; left out, the interval of the settings.

        Raises:
            CaseError: Another patient, or a time before the last measurement.
            RuntimeError: Before the first measurement.
        """
        if self.belief is None:
            raise RuntimeError("nothing to forecast from: no measurement yet")
        self._check_patient(case)
        model = model_of(case).with_values(self._fixed(case))
        names = self._outputs(model)
        moved = self.belief.moved_on(self.drifts, self._transport, self._days(hours))
        outputs = outputs_of(regress(self._simulation(model, names), moved.means, moved.covariances), moved)
        typical = dict(zip(names, outputs.mean.tolist(), strict=True))
        return intervals(names, outputs), expected_measurements(names, outputs, self._errors(typical))

    def _check_patient(self, case: Case) -> None:
        if self.patient is not None and plain_id(case.patient.id) != plain_id(self.patient):
            message = "another patient than the one followed so far"
            raise CaseError([Mistake("patient.id", message, shown(case.patient.id), shown(self.patient))])

    def _days(self, hours: float | None) -> float:
        hours = self.settings.interval_hours if hours is None else hours
        if not 0.0 <= hours < np.inf:
            message = "the time since the measurement before"
            raise CaseError([Mistake("hours", message, shown(float(hours)), "0 or more hours")])
        return hours / HOURS_PER_DAY

    def _first(
        self, name: str, model: Model, measured: Mapping[str, float], errors: Mapping[str, float]
    ) -> TrackedPoint:
        prior = self._prior
        posterior = Posterior(model, measured, errors, prior, self._policy(model))
        unit = qmc.Sobol(len(prior.names), rng=np.random.default_rng(self.settings.seed)).random(EXPLORED)
        points = 1.6 * (2.0 * unit - 1.0)
        self.report("exploring")
        levels = posterior.potential(points, posterior.simulate(points))
        self.report("climbing to the highest points")
        best = points[np.argsort(levels, kind="stable")[:CLIMBS]]
        gaussian = approximate(posterior, prior.x_of(best))
        self.report("weighted draws")
        weighted = weigh(posterior, gaussian, DRAWS, self.settings.seed)
        weights, power = weighted.widened()
        self.transport = weighted.transport if power == 1.0 else Transport.fitted(weighted.z, weights)
        u, _ = self.transport.u_of(weighted.z)
        mean = weights @ u
        covariance = ((u - mean).T * weights) @ (u - mean)
        count = len(self.drifts)
        middle = prior.x_of(self.transport.z_of(mean)[0])
        self.near[model.circuit] = {k: float(v) for k, v in posterior.values(middle).items()}
        self.belief = Belief(
            np.full(count, 1.0 / count), np.tile(mean, (count, 1)), np.tile(covariance, (count, 1, 1))
        )
        names = self._outputs(model)
        innovations = {n: Innovation(v, None, False, True) for n, v in measured.items()}
        after = regress(self._simulation(model, names), self.belief.means[:1], self.belief.covariances[:1])
        one = Belief(np.ones(1), self.belief.means[:1], self.belief.covariances[:1])
        return TrackedPoint(
            name, {}, {}, innovations, None, None, False, self._parameters(),
            intervals(names, outputs_of(after, one)), self._drift(), 0.0, _doubt(weighted, power),
        )  # fmt: skip

    def _next(
        self, name: str, moved: Belief, model: Model, measured: Mapping[str, float],
        errors: Mapping[str, float],
    ) -> TrackedPoint:  # fmt: skip
        names = self._outputs(model)
        simulation = self._simulation(model, names)
        first = regress(simulation, moved.means, moved.covariances)
        outputs = outputs_of(first, moved)
        values = np.array([measured.get(n, np.nan) for n in names])
        scales = np.array([errors.get(n, np.inf) for n in names])
        given = np.isfinite(values)
        fitting = Fitting.of(values, scales, outputs, given)
        used = given & ~fitting.left_out
        self.belief = updated(simulation, moved, first, values, scales, used)
        expected = expected_measurements(
            names, outputs, {**self._errors(named(names, outputs.mean)), **errors}
        )
        innovations = {
            n: Innovation(
                float(values[k]), float(fitting.deviations[k]), bool(fitting.unusual[k]), bool(used[k])
            )
            for k, n in enumerate(names)
            if given[k]
        }
        return TrackedPoint(
            name, intervals(names, outputs), expected, innovations, fitting.chi_square, fitting.probability,
            fitting.probability < UNUSUAL_SERIES, self._parameters(), self._after(first, moved, names),
            self._drift(), 0.0, fitting.message(names),
        )  # fmt: skip

    def _after(self, first: Regression, moved: Belief, names: Sequence[str]) -> dict[str, Interval]:
        """Outputs after an update, to first order in what the update moved."""
        belief = self._known
        means = first.mean + np.einsum("fop,fp->fo", first.slope, belief.means - moved.means)
        return intervals(names, outputs_of(replace(first, mean=means), belief))

    def _failed(self, name: str, measured: Mapping[str, float], message: str, days: float) -> TrackedPoint:
        """A point without a steady beat: only time has passed."""
        innovations = {n: Innovation(v, None, False, False) for n, v in measured.items()}
        if self.belief is not None:
            self.belief = self.belief.moved_on(self.drifts, self._transport, days)
        known = {} if self.belief is None else self._parameters()
        return TrackedPoint(
            name, {}, {}, innovations, None, None, False, known, {}, np.nan, 0.0, message, failed=True
        )

    @property
    def _known(self) -> Belief:
        if self.belief is None:
            raise RuntimeError("no measurement yet")
        return self.belief

    @property
    def _transport(self) -> Transport:
        if self.transport is None:
            raise RuntimeError("no measurement yet")
        return self.transport

    @property
    def _prior(self) -> Prior:
        if self.prior is None:
            raise RuntimeError("no measurement yet")
        return self.prior

    def _read(self, case: Case) -> tuple[Model, dict[str, float], dict[str, float]]:
        checked = checked_fit(case, self.settings.fit)
        if checked.mistakes:
            raise CaseError(checked.mistakes)
        if self.prior is None:
            table = np.log(np.array(list(checked.free.values())))
            self.prior = Prior(
                tuple(checked.free), table[:, 1], table[:, 2], table[:, 0], self.settings.prior
            )
        model = model_of(case).with_values(dict(checked.fixed))
        return model, dict(checked.targets), self._errors(checked.targets)

    def _fixed(self, case: Case) -> dict[str, float]:
        return dict(checked_fit(case, self.settings.fit).fixed)

    def _policy(self, model: Model) -> str:
        return self.settings.fit.policy or model.policy

    def _errors(self, values: Mapping[str, float]) -> dict[str, float]:
        return measurement_errors(values, self.settings.fit.uncertainties)

    def _outputs(self, model: Model) -> tuple[str, ...]:
        from eclsim.outputs.signals import output_names

        known = output_names(model.circuit)
        return tuple(n for n in OUTPUTS if n in known)

    def _simulation(self, model: Model, names: tuple[str, ...]) -> Callable[[np.ndarray], np.ndarray]:
        posterior = Posterior(model, {}, {}, self._prior, self._policy(model))

        def run(u: np.ndarray) -> np.ndarray:
            z, _ = self._transport.z_of(u)
            near = self.near.get(model.circuit)
            if near is None:
                middle = posterior.prior.x_of(self._transport.z_of(self._known.mean)[0])
                near = self.near[model.circuit] = {k: float(v) for k, v in posterior.values(middle).items()}
            values = posterior.values(posterior.prior.x_of(z))
            return simulate_members(model, values, len(z), names, posterior.policy, near)

        return run

    def _parameters(self) -> dict[str, Interval]:
        prior = self._prior
        draws, _ = self._transport.z_of(self._known.draws(DRAWN, self.settings.seed))
        found = np.exp(prior.x_of(np.quantile(draws, SHARES, axis=0)))
        return {n: Interval(*map(float, found[:, k])) for k, n in enumerate(prior.names)}

    def _drift(self) -> float:
        return float(np.sqrt(self._known.weights @ self.drifts**2))


def _doubt(weighted: Weighted, power: float) -> str:
    """What is doubtful about the first estimate, and what was done; empty where nothing is."""
    if power == 1.0:
        return ""
    return (
        f"the first estimate is uncertain in itself: {'; '.join(weighted.reasons)}; its intervals are "
        f"widened (weights to the power {power:.2f}), and later measurements narrow them"
    )


def track(
    points: Sequence[tuple[str, Case]],
    settings: TrackSettings | None = None,
    report: Callable[[str], None] | None = None,
) -> list[TrackedPoint]:
    """Follow one patient through a series.

    Args:
        points: name and case of each, in order of time; names that are times say how far apart they are.
        settings: what is tracked and how.
        report: called with what is being done.

    Raises:
        CaseError: As `Tracker.update`.
    """
    hours = elapsed_hours([name for name, _ in points]) or [None] * len(points)
    done = 0

    def say(step: str) -> None:
        if report is not None:
            report(f"measurement {done + 1} of {len(points)}" + (f": {step}" if step else ""))

    tracker, found = Tracker(settings, say), []
    for (name, case), passed in zip(points, hours, strict=True):
        say("")
        found.append(tracker.update(name, case, passed))
        done += 1
    return found
