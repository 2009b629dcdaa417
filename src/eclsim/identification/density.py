"""The posterior density of a patient's parameters: prior, measurements and the model that relates them.

Every free parameter has its own latent variable z, which is standard normal before any measurement. The
parameter is an increasing function of z that tends to the bounds. Samplers and filters work on z: it has no
bounds and one scale, and where the measurements say nothing about a parameter, z remains N(0, 1).

Every measurement is normally distributed around the model's output, with the standard uncertainty of the
measurement, independent of the others. The potential is minus the logarithm of the posterior density of z, up
to a constant:

    U(z) = sum ((output(z) - measured) / uncertainty)^2 / 2 + z . z / 2

and infinite where the model has no steady beat: such parameters are excluded.

The gradient is exact: a short search for the steady beat and one Newton step, with the Jacobian that the
derivatives need anyway, bring the state onto the orbit. All points share one grid in phase, so that the
density is smooth.

A sampler needs a potential that depends on the point alone. Each of its searches therefore starts from the
beat at the centre, and earlier evaluations change nothing, to the last bit. Maximisation may move far from
its start; its searches start from the beat extrapolated from the last point with its derivatives.

The maximum is found by the Levenberg-Marquardt method on the latent variables, whose prior adds one residual
for each. The curvature there is the Gauss-Newton approximation J' W J + I, with the exact Jacobian J.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, get_args

import numpy as np
from scipy.special import ndtr, ndtri

from eclsim.arguments import OneOf
from eclsim.beat.grid import include_switching_times, refined_for_switching_times
from eclsim.beat.heartbeat import beat_program
from eclsim.circuit.assembly import assemble
from eclsim.identification.objective import Box, Explored, Tangent, execution_of
from eclsim.orbit.equation import Anchor, OrbitOptions, OrbitProblem
from eclsim.orbit.model import AS_PUBLISHED, Model
from eclsim.orbit.search import solve_orbits
from eclsim.orbit.status import NoDerivativesError, Status
from eclsim.orbit.steady import Batch, Values, anchor
from eclsim.outputs.coupling import open_parameters
from eclsim.outputs.derivatives import Linearisation, linearise
from eclsim.outputs.signals import needed_parameters, parameters_read
from eclsim.outputs.steady_beat import SteadyBeat, steady_beat

PriorKind = Literal["log-uniform", "log-normal"]
DEVIATIONS_TO_BOUNDS = 2.0
"""Distance of the bounds from the start value in standard deviations of the log-normal prior (wider side)."""
LARGEST_LATENT = 6.0
"""Largest |z| that a parameter is converted to: 1e-9 of the prior probability lies beyond on each side."""
DENSITY_OPTIONS = OrbitOptions(tolerance=1e-5, error_tolerance=1e-4, newton_iterations=6, exact_iterations=0)
"""Accuracy sufficient for a density: outputs differ from the exact orbit's by 1e-4 of their uncertainty."""


KNOWN_PRIOR = OneOf(get_args(PriorKind))
"""Check for the kind of a prior; an unknown one would be treated as log-normal."""


@dataclass(frozen=True)
class Prior(Box):
    """Independent priors of the coordinates of the free parameters, between their bounds.

    Args:
        kind: "log-uniform", uniform in each coordinate between the bounds, or "log-normal", normal in each
            coordinate with the start value as median before truncation at the bounds.
    """

    kind: PriorKind = "log-uniform"

    @classmethod
    def within(cls, box: Box, kind: PriorKind = "log-uniform") -> Prior:
        """Return the prior of free parameters within their bounds."""
        return cls(box.names, box.clip(box.start), box.lower, box.upper, kind)

    def values_of(self, z: np.ndarray) -> np.ndarray:
        """Convert latent variables to parameters in their units, shape (..., parameters)."""
        return self.scale.values(self.x_of(z))

    def x_of(self, z: np.ndarray) -> np.ndarray:
        """Convert latent variables to coordinates of the parameters, shape (..., parameters)."""
        share = ndtr(z)
        if self.kind == "log-uniform":
            return self.lower + self.width * share
        first, last = self._latent_ends()
        inside = self.start + self._spread() * ndtri(first + (last - first) * share)
        return np.clip(inside, self.lower, self.upper)

    def slopes(self, z: np.ndarray) -> np.ndarray:
        """Derivatives d coordinate / dz, shape (..., parameters)."""
        density = np.exp(-0.5 * np.asarray(z) ** 2) / np.sqrt(2.0 * np.pi)
        if self.kind == "log-uniform":
            return self.width * density
        first, last = self._latent_ends()
        standard = (self.x_of(z) - self.start) / self._spread()
        return self._spread() * (last - first) * density / (np.exp(-0.5 * standard**2) / np.sqrt(2.0 * np.pi))

    def z_of(self, x: np.ndarray) -> np.ndarray:
        """Convert coordinates to latent variables; at a bound these are -/+ `LARGEST_LATENT`."""
        if self.kind == "log-uniform":
            share = (np.asarray(x) - self.lower) / self.width
        else:
            first, last = self._latent_ends()
            share = (ndtr((np.asarray(x) - self.start) / self._spread()) - first) / (last - first)
        return np.clip(ndtri(np.clip(share, 0.0, 1.0)), -LARGEST_LATENT, LARGEST_LATENT)

    def _spread(self) -> np.ndarray:
        return np.maximum(self.upper - self.start, self.start - self.lower) / DEVIATIONS_TO_BOUNDS

    def _latent_ends(self) -> tuple[np.ndarray, np.ndarray]:
        spread = self._spread()
        return ndtr((self.lower - self.start) / spread), ndtr((self.upper - self.start) / spread)


@dataclass(frozen=True)
class PosteriorDensity:
    """Posterior density of the latent variables of a patient's free parameters.

    Args:
        model: circuit and parameter values; the values of the free parameters are replaced.
        measured: measured value of each output [mmHg, L/min].
        errors: standard uncertainty of each measurement, in the unit of the output.
        prior: prior of the free parameters.
        policy: blood volume policy.
    """

    model: Model
    measured: Mapping[str, float]
    errors: Mapping[str, float]
    prior: Prior
    policy: str = AS_PUBLISHED

    @cached_property
    def outputs(self) -> tuple[str, ...]:
        """Names of the measured outputs."""
        return tuple(self.measured)

    @cached_property
    def target(self) -> np.ndarray:
        """Measured values, shape (outputs,)."""
        return np.array([self.measured[n] for n in self.outputs])

    @cached_property
    def scale(self) -> np.ndarray:
        """Standard uncertainties, shape (outputs,)."""
        return np.array([self.errors[n] for n in self.outputs])

    @property
    def set_points(self) -> dict[str, float]:
        """Set points of the reflexes that act on the draws, by key; empty without reflexes."""
        return {n: self.model.values[n] for n in parameters_read(self.model.circuit) if "set_point" in n}

    def values(self, x: np.ndarray) -> dict[str, float | np.ndarray]:
        """Parameter values from coordinates x, shape (members, parameters) or (parameters,)."""
        free = np.moveaxis(self.prior.scale.values(x), -1, 0)
        return {**self.model.values, **dict(zip(self.prior.names, free, strict=True))}

    def numbers(self, z: np.ndarray) -> dict[str, float]:
        """Parameter values at one point in latent space."""
        return {name: float(value) for name, value in self.values(self.prior.x_of(z)).items()}

    def potential(self, z: np.ndarray, outputs: np.ndarray, temper: float = 1.0) -> np.ndarray:
        """Compute U, shape (members,), from the outputs of members, shape (members, outputs).

        Args:
            z: latent variables, shape (members, parameters).
            outputs: outputs of the model at z.
            temper: weight of the measurements: 1 for the posterior, 0 for the prior.
        """
        misfit = np.sum(((outputs - self.target) / self.scale) ** 2, axis=-1)
        likelihood = np.where(np.isfinite(misfit), 0.5 * temper * misfit, np.inf)
        return likelihood + 0.5 * np.sum(np.square(z), axis=-1)

    def simulate(self, z: np.ndarray, centre: np.ndarray | None = None) -> np.ndarray:
        """Simulate members side by side; outputs have shape (members, outputs), NaN without a steady beat.

        Args:
            z: latent variables, shape (members, parameters).
            centre: latent variables near those of all members, where searches for the beat start.
        """
        return self.beats(z, centre).values.T

    def beats(self, z: np.ndarray, centre: np.ndarray | None = None) -> SteadyBeat:
        """Compute the steady beats of members; the arguments are those of `simulate`."""
        start = None if centre is None else self.numbers(centre)
        values = self.values(self.prior.x_of(z))
        return beats_of_members(self.model, values, len(z), self.outputs, self.policy, start)


def beats_of_members(
    model: Model,
    values: Values,
    count: int,
    outputs: tuple[str, ...],
    policy: str = AS_PUBLISHED,
    start: Mapping[str, float] | None = None,
    waveforms: tuple[str, ...] = (),
) -> SteadyBeat:
    """Beats of members that share a circuit; only uniquely determined beats have outputs.

    Args:
        model: model that gives the circuit.
        values: a number or an array (members,) for every parameter.
        count: number of members.
        outputs: names of the registry.
        policy: blood volume policy.
        start: parameter values near those of all members; searches start from the beat at these values.
        waveforms: waveforms whose smallest and largest values are computed.
    """
    batch = Batch(model.circuit, values, count, policy)
    beat = steady_beat(
        batch,
        outputs,
        waveforms=waveforms,
        options=DENSITY_OPTIONS,
        start=start,
        execution=execution_of(count),
    )
    return beat.determined_only()


# --- evaluation of posterior and gradient, Gaussian approximation -----------------------------------


FIRST_SEARCH = OrbitOptions(tolerance=3e-4, error_tolerance=1e-3, newton_iterations=4, exact_iterations=0)
"""Accuracy of the first search for the orbit; a Newton step follows."""
THOROUGH_SEARCH = OrbitOptions(tolerance=1e-6, error_tolerance=1e-5, exact_iterations=0)
"""Used when the Newton step after `FIRST_SEARCH` would be too long, or no beat was found."""
CONTINUED_SEARCH = replace(FIRST_SEARCH, quasi_newton_beats=10, newton_iterations=0)
"""Search that starts from the last point; if it fails, the search starts from the centre."""
LARGEST_NEWTON_STEP = 2e-3
"""Largest relative change in the Newton step; the error is about the square of the change."""
LARGEST_START = 2.5
"""Start values are limited to this |z|: at a bound z is infinite and all derivatives vanish."""
ITERATIONS = 40
SMALLEST_PROMISED_FALL = 1e-4
"""The search ends when the predicted decrease of U is smaller; 1e-4 is about 0.01 standard deviations."""
LARGEST_DAMPING = 1e8
LONGEST_STEP = 1.0
SMALLEST_SHARE = 1e-3
"""Probability around a further maximum, relative to that around the best, below which it is negligible."""
SMALLEST_DISTANCE = 3.0
"""Maxima that are nearer to each other, in their standard deviations, are one solution."""
FURTHER_CLIMBS, BEST_EXPLORED = 8, 64
"""Number of climbs from explored points, and of the best of these points among which they are chosen."""
LARGEST_LEFT_FALL = 1e-2
"""Predicted decrease of U above which the end of such a climb is no maximum: it was stopped on its way."""


class NoSteadyBeatError(ValueError):
    """Raised where a steady beat is needed and the model has none or no unique one."""


class GradientEvaluator:
    """Evaluates a posterior and its gradient at a sequence of points.

    Args:
        posterior: density to evaluate.
        centre: latent variables near all points. Searches start from the orbit there unless a better start is
            known, and the grid needed there is used for all points.
        by_point: whether the result at a point must not depend on earlier points.
    """

    def __init__(self, posterior: PosteriorDensity, centre: np.ndarray, *, by_point: bool = False):
        self.posterior, self.by_point = posterior, by_point
        batch = self._batch(posterior.prior.x_of(centre))
        if open_parameters(batch):
            message = (
                "a patient whose circulation responds to blood gases can only be sampled without gradients: "
            )
            raise NoSteadyBeatError(message + "use the method importance")
        level = int(batch.resolutions()[0])
        if include_switching_times(assemble(batch.circuit), posterior.prior.names):
            level = refined_for_switching_times(level)
        self.program = beat_program(batch.circuit, level)
        self.centre = anchor(batch, level, batch.member(0))
        self.last: Tangent | None = None

    def linear(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Outputs (outputs,) and d output / dz (outputs, parameters); None without a steady beat."""
        prior = self.posterior.prior
        x = prior.x_of(z)
        batch, unit = self._batch(x), prior.scale.slopes(x)
        problem = OrbitProblem(self.program, batch.packed(self.program), batch.volume())
        volume_slopes = batch.volume_slopes(prior.names)
        for start, options in self._searches(x):
            orbits = solve_orbits(problem, start, options)
            if orbits.status[0] != Status.CONVERGED:
                continue
            linear = self._linearised(batch, problem, orbits.states[:, 0], volume_slopes)
            if linear is not None:
                orbit = linear.orbit
                beat = Anchor(orbit.anchor.state + orbit.step, orbit.anchor.inverse)
                self.last = Tangent(x, beat, orbit.states * unit)
                return linear.values_on_orbit, linear.slopes * unit * prior.slopes(z)
        return None

    def potential(self, z: np.ndarray) -> tuple[float, np.ndarray]:
        """U and dU/dz; infinity and zeros without a steady beat."""
        linear = self.linear(z)
        if linear is None:
            return np.inf, np.zeros(len(z))
        outputs, slopes = linear
        misfit = (outputs - self.posterior.target) / self.posterior.scale
        return 0.5 * float(misfit @ misfit + z @ z), slopes.T @ (misfit / self.posterior.scale) + z

    def _batch(self, x: np.ndarray) -> Batch:
        model, policy = self.posterior.model, self.posterior.policy
        return Batch(model.circuit, self.posterior.values(x), 1, policy)

    def _linearised(
        self, batch: Batch, problem: OrbitProblem, state: np.ndarray, volume_slopes: np.ndarray
    ) -> Linearisation | None:
        """Outputs and derivatives; None if the state is too far from the orbit or has no derivatives."""
        outputs, names = self.posterior.outputs, self.posterior.prior.names
        read = needed_parameters(batch.circuit, outputs)
        try:
            linear = linearise(
                problem, state, outputs, names, volume_slopes, batch.numbers_for(read), batch.circuit
            )
        except NoDerivativesError:  # two orbits coincide here, and no derivatives exist
            return None
        finite = np.isfinite(linear.values_on_orbit).all() and np.isfinite(linear.slopes).all()
        settled = finite and linear.orbit.distance < LARGEST_NEWTON_STEP
        return linear if settled else None

    def _searches(self, x: np.ndarray) -> Iterator[tuple[Anchor, OrbitOptions]]:
        """Starts and solver options of searches, in the order in which they are tried."""
        if self.last is not None and not self.by_point:
            yield Anchor(self.last.state(x), self.last.anchor.inverse), CONTINUED_SEARCH
        yield self.centre, FIRST_SEARCH
        yield self.centre, THOROUGH_SEARCH


@dataclass(frozen=True)
class Gaussian:
    """A normal distribution of the latent variables.

    Args:
        centre: maximum of the posterior density, shape (parameters,).
        covariance: covariance matrix, shape (parameters, parameters).
        outputs: outputs of the model at the centre, shape (outputs,).
        jacobian: d output / dz at the centre, shape (outputs, parameters).
        potential: U at the centre.
        others: normal distributions at further maxima that hold a part of the probability; usually none.
    """

    centre: np.ndarray
    covariance: np.ndarray
    outputs: np.ndarray
    jacobian: np.ndarray
    potential: float
    others: tuple[Gaussian, ...] = ()

    @classmethod
    def at_maxima(cls, maxima: Sequence[Gaussian]) -> Gaussian:
        """Return the best of several maxima, with the others that are distinct and not negligible."""
        best, *rest = sorted(maxima, key=lambda g: g.potential)
        kept = [best]
        for other in rest:
            share = np.exp(other.log_probability - best.log_probability)
            if share > SMALLEST_SHARE and all(one.distance(other) > SMALLEST_DISTANCE for one in kept):
                kept.append(other)
        return replace(best, others=tuple(kept[1:]))

    @property
    def solutions(self) -> tuple[Gaussian, ...]:
        """This distribution and those at the further maxima."""
        return (self, *self.others)

    @property
    def log_probability(self) -> float:
        """Logarithm of the probability around the centre (Laplace's approximation), up to a constant."""
        return 0.5 * float(np.linalg.slogdet(self.covariance)[1]) - self.potential

    def distance(self, other: Gaussian) -> float:
        """Distance between the centres in standard deviations of the difference of two draws."""
        apart = other.centre - self.centre
        return float(np.sqrt(apart @ np.linalg.solve(self.covariance + other.covariance, apart)))

    def nearest(self, z: np.ndarray) -> np.ndarray:
        """Index of the solution nearest to latent variables (..., parameters), in its standard deviations."""
        return np.argmin([each.rises(z, each.centre) for each in self.solutions], axis=0)

    def rises(self, z: np.ndarray, centre: np.ndarray) -> np.ndarray:
        """Rise of U from a centre to latent variables (..., parameters) by the curvature of this maximum."""
        away = z - centre
        return 0.5 * np.sum(away @ np.linalg.inv(self.covariance) * away, axis=-1)

    def is_near(self, z: np.ndarray, potential: float) -> bool:
        """Whether latent variables with this U belong to this maximum."""
        nearest = 0.5 * SMALLEST_DISTANCE**2
        return potential - self.potential < nearest and float(self.rises(z, self.centre)) < nearest

    def left_fall(self, posterior: PosteriorDensity) -> float:
        """Decrease of U that the slope at the centre still promises; 0 at a maximum of the density."""
        misfit = (self.outputs - posterior.target) / posterior.scale**2
        gradient = self.jacobian.T @ misfit + self.centre
        return 0.5 * float(gradient @ self.covariance @ gradient)

    def draws(self, count: int, seed: int) -> np.ndarray:
        """Random latent variables, shape (count, parameters)."""
        normal = np.random.default_rng(seed).standard_normal((count, len(self.centre)))
        return self.centre + normal @ np.linalg.cholesky(self.covariance).T


def gaussian_approximation(
    posterior: PosteriorDensity, starts: np.ndarray, explored: Explored | None = None
) -> Gaussian:
    """Return the best maximum of the density reached from several starts, with the curvature there.

    Further maxima that hold a part of the probability are its `others`.

    Args:
        posterior: density to maximise.
        starts: coordinates of the parameters, shape (starts, parameters).
        explored: sets of parameters, with the measured outputs in the order of the density. Those that the
            maxima reached do not explain are starts, too; what is reached from them is used only if it is a
            solution of its own.

    Raises:
        NoSteadyBeatError: No start reaches a maximum, or the beat there is not unique or lacks a steady state
            of the gases that were measured.
    """
    latent = [posterior.prior.z_of(x) for x in np.atleast_2d(starts)]
    climbs = [g for z in latent if (g := _maximise_from(posterior, z))]
    if climbs and explored is not None:
        climbs += _further_maxima(posterior, climbs, explored)
    best = Gaussian.at_maxima(climbs) if climbs else None
    centre = np.clip(latent[0], -LARGEST_START, LARGEST_START) if best is None else best.centre
    beat = posterior.beats(centre[None])
    complete = np.isfinite(beat.values).all()
    if best is not None and complete:
        return best
    if beat.without_gases[0] and not complete:
        raise NoSteadyBeatError(f"gases were measured, and at the fitted parameters: {beat.message()}")
    if best is None:
        raise NoSteadyBeatError(
            "no steady heartbeat at the fitted parameters: check heart rate, devices and fixed parameters"
        )
    raise NoSteadyBeatError(
        "at the likeliest parameters valves stay shut throughout the beat, and the steady heartbeat is one "
        "of many: "
        "check pump speed and CO, and raise the lower bounds of Emaxlv and Emaxrv"
    )


def _further_maxima(
    posterior: PosteriorDensity, found: Sequence[Gaussian], explored: Explored
) -> list[Gaussian]:
    """Return maxima, apart from all that were found, that are reached from explored sets of parameters.

    Near a maximum that was found, U rises as its curvature says. A set whose U is far below that belongs to
    another maximum, so the sets with the smallest share of the predicted rise are tried first. A set whose
    climb ended at a known maximum predicts a rise around itself, too, so that the next start is elsewhere.
    """
    z = np.clip(posterior.prior.z_of(explored.x), -LARGEST_START, LARGEST_START)
    potential = posterior.potential(z, explored.outputs)
    best = np.argsort(potential, kind="stable")[:BEST_EXPLORED]
    best = best[np.isfinite(potential[best])]
    z, excess = z[best], potential[best] - min(g.potential for g in found)
    predicted = np.min([g.rises(z, g.centre) for g in found], axis=0)
    left = predicted > 0.5 * SMALLEST_DISTANCE**2
    known, further = list(found), []
    for _ in range(min(FURTHER_CLIMBS, int(left.sum()))):
        if not left.any():
            break
        k = int(np.argmin(np.where(left, excess / np.maximum(predicted, 1e-300), np.inf)))
        left[k] = False
        end = _maximise_from(posterior, z[k], known)
        if end is None:
            continue
        if all(one.distance(end) > SMALLEST_DISTANCE for one in known):
            known.append(end)
            if end.left_fall(posterior) < LARGEST_LEFT_FALL:
                further.append(end)
        for centre in (end.centre, z[k]):
            predicted = np.minimum(predicted, end.rises(z, centre))
        left &= predicted > 0.5 * SMALLEST_DISTANCE**2
    return further


def _maximise_from(
    posterior: PosteriorDensity, start: np.ndarray, known: Sequence[Gaussian] = ()
) -> Gaussian | None:
    """Climb to a maximum; one of the known maxima if the climb comes near it, None without a steady beat."""
    z = np.clip(start, -LARGEST_START, LARGEST_START)
    evaluator = GradientEvaluator(posterior, z)
    linear = evaluator.linear(z)
    if linear is None:
        return None
    damping, size = 1e-3, len(z)
    level = float(posterior.potential(z, linear[0]))
    for _ in range(ITERATIONS):
        outputs, jacobian = linear
        scaled = jacobian / posterior.scale[:, None]
        gradient = scaled.T @ ((outputs - posterior.target) / posterior.scale) + z
        curvature = scaled.T @ scaled + np.eye(size)
        if (
            gradient @ np.linalg.solve(curvature, gradient) < 2.0 * SMALLEST_PROMISED_FALL
            or damping > LARGEST_DAMPING
        ):
            break
        step = -np.linalg.solve(curvature + damping * np.diag(np.diag(curvature)), gradient)
        step *= min(1.0, LONGEST_STEP / np.abs(step).max())
        trial = evaluator.linear(z + step)
        lower = np.inf if trial is None else float(posterior.potential(z + step, trial[0]))
        if trial is not None and lower < level:
            z, linear, level, damping = z + step, trial, lower, damping / 5.0
            if reached := next((one for one in known if one.is_near(z, level)), None):
                return reached
        else:
            damping = max(damping * 4.0, 1e-3)
    outputs, jacobian = linear
    scaled = jacobian / posterior.scale[:, None]
    covariance = np.linalg.inv(scaled.T @ scaled + np.eye(size))
    return Gaussian(z, covariance, outputs, jacobian, level)
