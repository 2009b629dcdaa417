"""The steady heartbeat: solve y = beat(y) instead of waiting for it.

The residual is F(y) = y - beat(y) + u (w . y - c). The last term is the blood volume: the beat conserves it,
so y - beat(y) says nothing about it, and w . y = c fixes it (w: which compartments are counted, c: their
stressed volume at phase 0, u: the same amount in every compartment). Broyden's method starts from the inverse
Jacobian at the circuit's nominal parameters; a patient it does not settle is handed to Newton's method with a
Jacobian of its own. Nothing here depends on the other patients of a batch.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from eclsim.solver.beat import BeatProgram
from eclsim.solver.broyden import InverseJacobian
from eclsim.solver.lanes import run_lanes
from eclsim.solver.status import Status

PASSING_BEATS = 30
"""Plain beats after a search that found nothing."""
FLOW_SCALE = 10.0
"""Weight of a flow [mL/s] against a volume [mL] in the norms of the iteration."""


@dataclass(frozen=True)
class OrbitOptions:
    """How hard to look for the steady beat.

    Args:
        tolerance: largest change of a state over a beat, relative to max(|state|, 1).
        error_tolerance: largest estimated distance to the orbit (inverse Jacobian times residual), relative;
            the state handed back is one step of that size further on, and so much nearer.
        quasi_newton_beats: beats of Broyden's method before Newton's method takes over.
        newton_iterations: iterations of Newton's method, one Jacobian each.
    """

    tolerance: float = 1e-8
    error_tolerance: float = 1e-7
    quasi_newton_beats: int = 25
    newton_iterations: int = 12


@dataclass(frozen=True)
class Anchor:
    """A circuit's nominal orbit: where every solve of that circuit starts.

    Args:
        state: nominal orbit, shape (states,).
        inverse: inverse Jacobian of F there, in scaled states, shape (states, states).
    """

    state: np.ndarray
    inverse: np.ndarray


@dataclass(frozen=True)
class Volume:
    """The blood volume condition: weights . state = target.

    Args:
        weights: 1 for each compartment counted, 0 else, shape (states,).
        target: their stressed volume [mL], shape (patients,).
    """

    weights: np.ndarray
    target: np.ndarray


@dataclass(frozen=True)
class Orbits:
    """Steady states of a batch, patients last.

    Args:
        states: state at phase 0, shape (states, patients).
        status: `Status` of each, shape (patients,).
        beats: beats computed for each.
        residual: largest relative change of a state over a beat.
        drift: largest change of a volume over a beat [mL].
    """

    states: np.ndarray
    status: np.ndarray
    beats: np.ndarray
    residual: np.ndarray
    drift: np.ndarray


def scales(program: BeatProgram) -> np.ndarray:
    """Scale of each state: 1 mL for volumes, `FLOW_SCALE` for flows; shape (states,)."""
    assembly = program.assembly
    return np.r_[np.ones(assembly.n_volumes), np.full(len(assembly.inertial), FLOW_SCALE)]


class OrbitProblem:
    """F and its norms for the patients of a batch; `wide` runs them with the program for many patients."""

    def __init__(self, program: BeatProgram, packed: np.ndarray, volume: Volume, wide: bool = False):
        self.program = program
        self.wide = wide
        self.packed = packed
        self.volume = volume
        self.scale = scales(program)[:, None]
        spread = np.r_[np.ones(program.assembly.n_volumes), np.zeros(len(program.assembly.inertial))]
        self.spread = (spread / spread.sum())[:, None]

    def take(self, chosen: Any) -> OrbitProblem:
        """The same problem for some of the patients."""
        volume = Volume(self.volume.weights, self.volume.target[chosen])
        return OrbitProblem(self.program, self.packed[:, chosen], volume, self.wide)

    def beat(self, states: np.ndarray) -> np.ndarray:
        """State after one beat, shape (states, patients)."""
        return run_lanes(self.program, states, self.packed, self.wide)

    def residual(self, states: np.ndarray, after: np.ndarray) -> np.ndarray:
        """F in scaled states."""
        excess = self.volume.weights @ states - self.volume.target
        return (states - after + self.spread * excess) / self.scale

    def relative_change(self, states: np.ndarray, after: np.ndarray) -> np.ndarray:
        """Largest change of a state over a beat, relative to max(|state|, 1); shape (patients,)."""
        excess = np.abs(self.volume.weights @ states - self.volume.target) / np.maximum(
            self.volume.target, 1.0
        )
        change = np.max(np.abs(states - after) / np.maximum(np.abs(states), 1.0), axis=0)
        return np.maximum(change, excess)


def solve_orbits(problem: OrbitProblem, anchor: Anchor, options: OrbitOptions) -> Orbits:
    """Steady states of all patients of a problem."""
    found = _quasi_newton(problem, anchor, options)
    for patient in map(int, np.flatnonzero(found.status != Status.CONVERGED)):
        _replace(
            found, patient, _newton(problem.take([patient]), found.states[:, [patient]], anchor, options)
        )
    return found


def _quasi_newton(problem: OrbitProblem, anchor: Anchor, options: OrbitOptions) -> Orbits:
    count = problem.packed.shape[1]
    found = _empty(problem, count)
    where = np.arange(count)
    states = np.repeat(anchor.state[:, None], count, axis=1)
    inverse = InverseJacobian(anchor.inverse, count, options.quasi_newton_beats)
    step, residual = None, None
    for beat in range(1, options.quasi_newton_beats + 1):
        after = problem.beat(states)
        previous, residual = residual, problem.residual(states, after)
        finite = np.isfinite(residual).all(axis=0)
        residual = np.where(finite, residual, 0.0)
        if step is not None and previous is not None:
            inverse.learn(step, residual - previous)
        step = -inverse.times(residual)
        change = problem.relative_change(states, after)
        error = np.max(np.abs(step * problem.scale) / np.maximum(np.abs(states), 1.0), axis=0)
        done = finite & (change <= options.tolerance) & (error <= options.error_tolerance)
        better = finite & (change < found.residual[where])
        _store(found, where, better | done, states, change, np.abs(states - after), problem)
        found.states[:, where[done]] = (states + step * problem.scale)[:, done]
        found.beats[where] = beat
        found.status[where[done]] = Status.CONVERGED
        rest = finite & ~done
        if not rest.any():
            break
        step = _limited(step, states, problem.scale)
        if not rest.all():
            where, problem = where[rest], problem.take(rest)
            states, step, residual = states[:, rest], step[:, rest], residual[:, rest]
            inverse.keep(rest)
        states = states + step * problem.scale
    return found


def _newton(problem: OrbitProblem, start: np.ndarray, anchor: Anchor, options: OrbitOptions) -> Orbits:
    """Damped Newton for one patient, from the better of the given state and a few plain beats."""
    found = _empty(problem, 1)
    states = start if np.isfinite(start).all() else anchor.state[:, None]
    after = problem.beat(states)
    for _ in range(options.newton_iterations):
        change = problem.relative_change(states, after)
        residual = problem.residual(states, after)
        if not np.isfinite(residual).all():
            found.status[:] = Status.NOT_FINITE
            return found
        step = -np.linalg.lstsq(jacobian(problem, states), residual, rcond=1e-13)[0]
        error = np.max(np.abs(step * problem.scale) / np.maximum(np.abs(states), 1.0), axis=0)
        _store(found, np.arange(1), change <= found.residual, states, change, np.abs(states - after), problem)
        found.beats[:] += 1 + len(states)
        if (change <= options.tolerance)[0] and (error <= options.error_tolerance)[0]:
            found.states[:] = states + step * problem.scale
            found.status[:] = Status.CONVERGED
            return found
        states, after = _line_search(problem, states, after, _limited(step, states, problem.scale), residual)
        found.beats[:] += 1
    return _in_passing(problem, found, after)


def _in_passing(problem: OrbitProblem, found: Orbits, states: np.ndarray) -> Orbits:
    """No orbit: hand back a state on the way, after some plain beats, not an iterate of the search."""
    before = states
    for _ in range(PASSING_BEATS):
        before, states = states, problem.beat(states)
    if not np.isfinite(states).all():
        found.status[:] = Status.NOT_FINITE
        return found
    change = problem.relative_change(before, states)
    _store(found, np.arange(1), np.array([True]), before, change, np.abs(before - states), problem)
    found.beats[:] += PASSING_BEATS
    return found


def _line_search(
    problem: OrbitProblem, states: np.ndarray, after: np.ndarray, step: np.ndarray, residual: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Halve the step until the residual falls; settle for plain beats where it does not."""
    size = np.linalg.norm(residual)
    for fraction in (1.0, 0.5, 0.25, 0.1):
        trial = states + fraction * step * problem.scale
        trial_after = problem.beat(trial)
        trial_size = np.linalg.norm(problem.residual(trial, trial_after))
        if np.isfinite(trial_size) and trial_size < (1.0 - 0.1 * fraction) * size:
            return trial, trial_after
    for _ in range(5):
        states, after = after, problem.beat(after)
    return states, after


def jacobian(problem: OrbitProblem, states: np.ndarray) -> np.ndarray:
    """dF/dy in scaled states of one patient, by central differences over one batch of beats."""
    n = len(states)
    shift = 1e-4 * np.maximum(np.abs(states[:, 0]), problem.scale[:, 0])
    points = np.concatenate([states + np.diag(shift), states - np.diag(shift)], axis=1)
    wide = problem.take(np.zeros(2 * n, dtype=int))
    values = wide.residual(points, wide.beat(points))
    return (values[:, :n] - values[:, n:]) / (2.0 * shift) * problem.scale[:, 0]


def _limited(step: np.ndarray, states: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Shorten a scaled step that would move any state by more than half its size plus 50 scales."""
    allowed = 0.5 * np.abs(states) / scale + 50.0
    factor = np.min(np.minimum(1.0, allowed / np.maximum(np.abs(step), 1e-300)), axis=0)
    return step * factor


def _empty(problem: OrbitProblem, count: int) -> Orbits:
    n = problem.program.assembly.n_states
    return Orbits(
        np.full((n, count), np.nan),
        np.full(count, Status.NOT_CONVERGED),
        np.zeros(count, dtype=int),
        np.full(count, np.inf),
        np.full(count, np.inf),
    )


def _store(
    found: Orbits, where: Any, chosen: Any, states: Any, change: Any, moved: Any, problem: OrbitProblem
) -> None:
    place = where[chosen]
    found.states[:, place] = states[:, chosen]
    found.residual[place] = change[chosen]
    found.drift[place] = moved[: problem.program.assembly.n_volumes, chosen].max(axis=0, initial=0.0)


def _replace(found: Orbits, patient: int, single: Orbits) -> None:
    found.states[:, patient] = single.states[:, 0]
    found.status[patient] = single.status[0]
    found.beats[patient] += single.beats[0]
    found.residual[patient] = single.residual[0]
    found.drift[patient] = single.drift[0]
