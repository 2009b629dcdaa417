"""One patient's steady beat with exact derivatives, at point after point of the latent variables.

A short search for the beat and one step of Newton's method, with the Jacobian that the derivatives need
anyway, bring the state onto the orbit. All points share a grid in phase, so that the density is smooth.

A sampler needs a potential that is a function of the point: each search then starts from the beat at the
centre, and what was evaluated before changes nothing, to the last bit. A climb to the highest point may go
far from where it began; its searches start from where the last point and its derivatives foresee the beat.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from eclsim.beat.grid import needed_resolution
from eclsim.beat.heartbeat import BeatProgram, beat_program
from eclsim.circuit.assembly import assemble
from eclsim.identification.density import PosteriorDensity
from eclsim.orbit.equation import Anchor, OrbitOptions, OrbitProblem, Volume
from eclsim.orbit.search import affordable, solve_orbits
from eclsim.orbit.status import NoDerivativesError, Status
from eclsim.orbit.steady import Batch, anchor
from eclsim.outputs.derivatives import Linearisation, linearise

FOLLOWED = OrbitOptions(tolerance=3e-4, error_tolerance=1e-3, newton_iterations=4)
"""Enough to begin with: a step of Newton's method follows."""
CLOSER = OrbitOptions(tolerance=1e-6, error_tolerance=1e-5)
"""Where the step of Newton's method from there would be too long, or nothing was found."""
QUICK = replace(FOLLOWED, quasi_newton_beats=10, newton_iterations=0)
"""From the last place; if this does not settle, it is searched for from the centre."""
STEP = 1e-4
"""Relative, for the derivative of the blood volume, which is a sum of products."""
FARTHEST_NEWTON = 2e-3
"""Largest relative change in the step of Newton's method: its error is about the square."""


@dataclass(frozen=True)
class Place:
    """Where a path has been: logarithms of the parameters, orbit, d state / d log parameter, inverse."""

    x: np.ndarray
    state: np.ndarray
    slopes: np.ndarray
    inverse: np.ndarray

    def foreseen(self, x: np.ndarray, largest_steps: np.ndarray) -> Anchor:
        """Where the orbit at other parameters is expected."""
        moves = self.slopes @ (x - self.x)
        return Anchor(self.state + moves * affordable(moves, self.state, largest_steps), self.inverse)


class BloodVolume:
    """The blood volume of a patient as a function of the free parameters.

    Args:
        posterior: gives the model and the free parameters.
        x: logarithms of the parameters at the centre.
    """

    def __init__(self, posterior: PosteriorDensity, x: np.ndarray):
        self.posterior = posterior
        self.middle = np.exp(x)
        size = len(x)
        shifts = STEP * np.vstack([np.zeros(size), np.eye(size), -np.eye(size)])
        found = self._exact(self.middle * (1.0 + shifts))
        self.weights, self.target = found.weights, float(found.target[0])
        difference = found.target[1 : 1 + size] - found.target[1 + size :]
        self.slopes = difference / (2.0 * STEP * self.middle)
        elsewhere = self.middle * np.linspace(0.5, 2.0, size)
        exact = self._exact(elsewhere[None]).target[0]
        self.straight = bool(np.isclose(self._straight(elsewhere), exact, rtol=1e-7))

    def at(self, parameters: np.ndarray) -> tuple[Volume, np.ndarray]:
        """Condition of the orbit and d volume / d parameter [mL per unit], shape (parameters,)."""
        if self.straight:
            return Volume(self.weights, np.array([self._straight(parameters)])), self.slopes
        here = BloodVolume(self.posterior, np.log(parameters))
        return Volume(here.weights, np.array([here.target])), here.slopes

    def _straight(self, parameters: np.ndarray) -> float:
        return self.target + float(self.slopes @ (parameters - self.middle))

    def _exact(self, parameters: np.ndarray) -> Volume:
        model, policy = self.posterior.model, self.posterior.policy
        return Batch(
            model.circuit, self.posterior.values(np.log(parameters)), len(parameters), policy
        ).volume()


class GradientEvaluator:
    """Evaluates a posterior and its gradient at one point after the other.

    Args:
        posterior: density.
        centre: latent variables near which the points stay; where nothing better is known, searches start
            from the orbit there, and all points have the grid that is needed there.
        by_point: whether what is found at a point must not depend on the points before.
    """

    def __init__(self, posterior: PosteriorDensity, centre: np.ndarray, *, by_point: bool = False):
        self.posterior, self.by_point = posterior, by_point
        x = posterior.prior.x_of(centre)
        circuit, values = posterior.model.circuit, posterior.values(x)
        level = int(np.ravel(needed_resolution(assemble(circuit), values))[0])
        self.program: BeatProgram = beat_program(circuit, level)
        batch = Batch(circuit, values, 1, posterior.policy)
        self.near = anchor(batch, level, {k: float(v) for k, v in values.items()})
        self.packed = batch.packed(self.program)
        self.rows = [self.program.names.index(n) for n in posterior.prior.names]
        self.volume = BloodVolume(posterior, x)
        self.last: Place | None = None

    def linear(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Outputs, shape (outputs,), and d output / dz (outputs, parameters); None without a steady beat."""
        posterior = self.posterior
        x = posterior.prior.x_of(z)
        in_unit = np.exp(x)
        volume, volume_slopes = self.volume.at(in_unit)
        packed = self.packed.copy()
        packed[self.rows, 0] = in_unit
        problem = OrbitProblem(self.program, packed, volume)
        for search in self._searches(x):
            state = search(problem)
            found = None if state is None else self._linearised(problem, state, volume_slopes)
            if found is not None:
                orbit = found.orbit
                state = orbit.anchor.state + orbit.step
                self.last = Place(x, state, orbit.states * in_unit, orbit.anchor.inverse)
                return found.values_on_orbit, found.slopes * in_unit * posterior.prior.slopes(z)
        return None

    def potential(self, z: np.ndarray) -> tuple[float, np.ndarray]:
        """U and dU/dz; infinite and zero without a steady beat."""
        found = self.linear(z)
        if found is None:
            return np.inf, np.zeros(len(z))
        outputs, slopes = found
        misfit = (outputs - self.posterior.target) / self.posterior.scale
        return 0.5 * float(misfit @ misfit + z @ z), slopes.T @ (misfit / self.posterior.scale) + z

    def _linearised(
        self, problem: OrbitProblem, state: np.ndarray, volume_slopes: np.ndarray
    ) -> Linearisation | None:
        """Outputs and derivatives; None if the state is too far from the orbit or has none."""
        names = self.posterior.prior.names
        try:
            found = linearise(problem, state, self.posterior.outputs, names, volume_slopes)
        except NoDerivativesError:  # two orbits meet here, and none has derivatives
            return None
        near = np.isfinite(found.slopes).all() and found.orbit.distance < FARTHEST_NEWTON
        return found if near else None

    def _searches(self, x: np.ndarray) -> Iterator[Callable[[OrbitProblem], np.ndarray | None]]:
        """Searches for the state of the orbit at phase 0, one after the other until one is good enough."""
        last = self.last
        if last is not None and not self.by_point:
            yield lambda problem: _found(problem, last.foreseen(x, problem.layout.largest_steps), QUICK)
        for options in (FOLLOWED, CLOSER):
            yield lambda problem, options=options: _found(problem, self.near, options)


def _found(problem: OrbitProblem, start: Anchor, options: OrbitOptions) -> np.ndarray | None:
    orbits = solve_orbits(problem, start, options)
    return orbits.states[:, 0] if orbits.status[0] == Status.CONVERGED else None
