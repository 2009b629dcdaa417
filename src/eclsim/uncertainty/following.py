"""One chain's steady beat, followed from point to point with exact derivatives.

A sampler moves in small steps, so the beat at the next point is foreseen from the last one and its
derivatives, and two or three more beats settle it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eclsim.circuit.assembly import assemble
from eclsim.solver.beat import beat_program
from eclsim.solver.orbit import Anchor, OrbitProblem, Volume, solve_orbits
from eclsim.solver.resolution import needed_resolution
from eclsim.solver.status import Status
from eclsim.solver.steady import Batch, anchor
from eclsim.uncertainty.density import Posterior
from eclsim.uncertainty.members import SETTLED
from eclsim.uncertainty.tangents import Linearised, linearise

STEP = 1e-4
"""Of a logarithm, for the derivative of the blood volume, which is a sum of products."""
FARTHEST_FORESEEN = 1.0
"""Largest change of a logarithm over which the last derivatives are trusted."""


@dataclass(frozen=True)
class Place:
    """Where a chain has been: logarithms of the parameters, orbit, d state / d log parameter, inverse."""

    x: np.ndarray
    state: np.ndarray
    slopes: np.ndarray
    inverse: np.ndarray


class Follower:
    """Evaluates a posterior and its gradient along a path.

    Args:
        posterior: density.
        centre: hidden variables near which the path stays; where nothing better is known, searches start
            from the orbit there.
    """

    def __init__(self, posterior: Posterior, centre: np.ndarray):
        self.posterior = posterior
        self.centre = posterior.values(posterior.prior.x_of(centre))
        self.assembly = assemble(posterior.model.circuit)
        self.last: Place | None = None

    def linear(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Outputs, shape (outputs,), and d output / dz (outputs, parameters); None without a steady beat."""
        posterior = self.posterior
        x = posterior.prior.x_of(z)
        problem, volume_slopes, level = self._problem(x)
        state = self._settle(problem, x, level)
        if state is None:
            return None
        in_unit = np.exp(x)
        names = posterior.prior.names
        try:
            found = linearise(problem, state, posterior.outputs, names, volume_slopes / in_unit)
        except np.linalg.LinAlgError:  # two orbits meet here, and none has derivatives
            return None
        if not np.isfinite(found.slopes).all():
            return None
        self._remember(x, state, found)
        return found.outputs, found.slopes * in_unit * posterior.prior.slopes(z)

    def potential(self, z: np.ndarray) -> tuple[float, np.ndarray]:
        """U and dU/dz; infinite and zero without a steady beat."""
        found = self.linear(z)
        if found is None:
            return np.inf, np.zeros(len(z))
        outputs, slopes = found
        misfit = (outputs - self.posterior.target) / self.posterior.scale
        return 0.5 * float(misfit @ misfit + z @ z), slopes.T @ (misfit / self.posterior.scale) + z

    def _problem(self, x: np.ndarray) -> tuple[OrbitProblem, np.ndarray, int]:
        """The orbit to find, d blood volume / d log parameter, and the resolution of the grid."""
        posterior, size = self.posterior, len(x)
        shifts = STEP * np.vstack([np.zeros(size), np.eye(size), -np.eye(size)])
        batch = Batch(posterior.model.circuit, posterior.values(x + shifts), len(shifts), posterior.policy)
        volume = batch.volume()
        level = int(np.ravel(needed_resolution(self.assembly, posterior.values(x)))[0])
        program = beat_program(batch.circuit, level)
        first = Batch(batch.circuit, posterior.values(x), 1, posterior.policy)
        problem = OrbitProblem(program, first.packed(program), Volume(volume.weights, volume.target[:1]))
        slopes = (volume.target[1 : 1 + size] - volume.target[1 + size :]) / (2.0 * STEP)
        return problem, slopes, level

    def _settle(self, problem: OrbitProblem, x: np.ndarray, level: int) -> np.ndarray | None:
        """State of the orbit at phase 0: from the last place, else from the centre."""
        starts = []
        if self.last is not None and np.abs(x - self.last.x).max() < FARTHEST_FORESEEN:
            foreseen = self.last.state + self.last.slopes @ (x - self.last.x)
            starts.append(Anchor(foreseen, self.last.inverse))
        posterior = self.posterior
        batch = Batch(posterior.model.circuit, posterior.values(x), 1, posterior.policy)
        for start in (*starts, None):
            orbits = solve_orbits(problem, start or anchor(batch, level, self.centre), SETTLED)
            if orbits.status[0] == Status.CONVERGED:
                return orbits.states[:, 0]
        return None

    def _remember(self, x: np.ndarray, state: np.ndarray, found: Linearised) -> None:
        self.last = Place(x, state, found.states * np.exp(x), found.inverse)
