"""Following a patient: parameters, forecasts and doubts, from one measurement to the next."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.stats import qmc

from eclsim.identification.objective import OUTPUTS
from eclsim.patients.mistakes import CaseError
from eclsim.solver.model import Model, model_of
from eclsim.studies.fit_settings import FitSettings, checked_fit
from eclsim.studies.measurement_errors import measurement_errors
from eclsim.studies.track_results import (
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
from eclsim.uncertainty.density import Posterior
from eclsim.uncertainty.filtering import DRIFTS, Belief, Regression, outputs_of, regress, updated
from eclsim.uncertainty.gaussian import NoSteadyBeatError, approximate
from eclsim.uncertainty.importance import weigh
from eclsim.uncertainty.members import simulate_members
from eclsim.uncertainty.prior import Prior, PriorKind
from eclsim.uncertainty.transport import Transport

if TYPE_CHECKING:
    from eclsim.patients.case import Case

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
        drifts: standard deviations of the change of a hidden variable from one measurement to the next; each
            has a filter of its own, and the measurements choose.
        seed: of the search for the first estimate.
    """

    fit: FitSettings = field(default_factory=FitSettings)
    prior: PriorKind = "log-uniform"
    drifts: tuple[float, ...] = DRIFTS
    seed: int = 0


class Tracker:
    """Follows one patient.

    Args:
        settings: what is tracked and how.
    """

    def __init__(self, settings: TrackSettings | None = None):
        self.settings = settings or TrackSettings()
        self.drifts = np.array(self.settings.drifts)
        self.belief: Belief | None = None
        self.prior: Prior | None = None
        self.transport: Transport | None = None
        self.near: dict[Any, Mapping[str, float]] = {}

    def update(self, name: str, case: Case) -> TrackedPoint:
        """Forecast a measurement, hold it against that, and learn from it.

        Args:
            name: of the point.
            case: patient, devices and measurements at this time.

        Raises:
            CaseError: Nothing measured, or bounds that cannot be.
        """
        started = time.perf_counter()
        model, measured, errors = self._read(case)
        try:
            if self.belief is None:
                point = self._first(name, model, measured, errors)
            else:
                point = self._next(name, self.belief, model, measured, errors)
        except NoSteadyBeatError as error:
            point = self._failed(name, measured, str(error))
        return replace(point, seconds=time.perf_counter() - started)

    def forecast(self, case: Case) -> tuple[dict[str, Interval], dict[str, Interval]]:
        """Outputs expected at the next time with the devices of a case: of the model, and as measured.

        Raises:
            RuntimeError: Before the first measurement.
        """
        if self.belief is None:
            raise RuntimeError("nothing to forecast from: no measurement yet")
        model = model_of(case).with_values(self._fixed(case))
        names = self._outputs(model)
        moved = self.belief.moved_on(self.drifts, self._transport)
        outputs = outputs_of(regress(self._simulation(model, names), moved.means, moved.covariances), moved)
        typical = dict(zip(names, outputs.mean.tolist(), strict=True))
        return intervals(names, outputs), expected_measurements(names, outputs, self._errors(typical))

    def _first(
        self, name: str, model: Model, measured: Mapping[str, float], errors: Mapping[str, float]
    ) -> TrackedPoint:
        prior = self._prior
        posterior = Posterior(model, measured, errors, prior, self.settings.fit.policy)
        unit = qmc.Sobol(len(prior.names), rng=np.random.default_rng(self.settings.seed)).random(EXPLORED)
        points = 1.6 * (2.0 * unit - 1.0)
        levels = posterior.potential(points, posterior.simulate(points))
        best = points[np.argsort(levels, kind="stable")[:CLIMBS]]
        gaussian = approximate(posterior, prior.x_of(best))
        weighted = weigh(posterior, gaussian, DRAWS, self.settings.seed)
        self.transport = weighted.transport
        u, _ = self.transport.u_of(weighted.z)
        mean = weighted.weights @ u
        covariance = ((u - mean).T * weighted.weights) @ (u - mean)
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
            intervals(names, outputs_of(after, one)), self._drift(), 0.0,
        )  # fmt: skip

    def _next(
        self, name: str, before: Belief, model: Model, measured: Mapping[str, float],
        errors: Mapping[str, float],
    ) -> TrackedPoint:  # fmt: skip
        names = self._outputs(model)
        simulation = self._simulation(model, names)
        moved = before.moved_on(self.drifts, self._transport)
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

    def _failed(self, name: str, measured: Mapping[str, float], message: str) -> TrackedPoint:
        """A point without a steady beat: only time has passed."""
        innovations = {n: Innovation(v, None, False, False) for n, v in measured.items()}
        if self.belief is not None:
            self.belief = self.belief.moved_on(self.drifts, self._transport)
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

    def _errors(self, values: Mapping[str, float]) -> dict[str, float]:
        return measurement_errors(values, self.settings.fit.uncertainties)

    def _outputs(self, model: Model) -> tuple[str, ...]:
        from eclsim.haemodynamics.evaluation import output_names

        known = output_names(model.circuit)
        return tuple(n for n in OUTPUTS if n in known)

    def _simulation(self, model: Model, names: tuple[str, ...]) -> Callable[[np.ndarray], np.ndarray]:
        posterior = Posterior(model, {}, {}, self._prior, self.settings.fit.policy)

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


def track(points: Sequence[tuple[str, Case]], settings: TrackSettings | None = None) -> list[TrackedPoint]:
    """Follow one patient through a series.

    Args:
        points: name and case of each, in order of time.
        settings: what is tracked and how.
    """
    tracker = Tracker(settings)
    return [tracker.update(name, case) for name, case in points]
