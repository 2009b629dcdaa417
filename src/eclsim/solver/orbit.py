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
from eclsim.solver.lanes import Lanes
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


@dataclass(frozen=True)
class Trial:
    """States and where a beat takes them, patients last.

    Args:
        states: states at phase 0, shape (states, patients).
        moved: states minus states a beat later.
        size: max(|states|, 1).
        residual: F in scaled states; 0 where it is not finite.
        change: largest change of a state over the beat, relative to its size; shape (patients,).
        drift: largest change of a volume over the beat [mL].
        finite: whether the beat went well.
    """

    states: np.ndarray
    moved: np.ndarray
    size: np.ndarray
    residual: np.ndarray
    change: np.ndarray
    drift: np.ndarray
    finite: np.ndarray


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
        self._lanes = Lanes(program, packed, wide)

    def take(self, chosen: Any) -> OrbitProblem:
        """The same problem for some of the patients."""
        volume = Volume(self.volume.weights, self.volume.target[chosen])
        return OrbitProblem(self.program, self.packed[:, chosen], volume, self.wide)

    def beat(self, states: np.ndarray) -> np.ndarray:
        """State after one beat, shape (states, patients)."""
        return self._lanes.beat(states)

    def trial(self, states: np.ndarray, after: np.ndarray | None = None) -> Trial:
        """One beat from some states, or what is known of it if the states `after` it are."""
        moved = states - (self.beat(states) if after is None else after)
        excess = self.volume.weights @ states - self.volume.target
        size = np.maximum(np.abs(states), 1.0)
        distance = np.abs(moved)
        drift = distance[: self.program.assembly.n_volumes].max(axis=0, initial=0.0)
        change = np.maximum(
            (distance / size).max(axis=0), np.abs(excess) / np.maximum(self.volume.target, 1.0)
        )
        finite = np.isfinite(change)
        residual = (moved + self.spread * excess) / self.scale
        if not finite.all():
            residual = np.where(finite, residual, 0.0)
        return Trial(states, moved, size, residual, change, drift, finite)


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
        trial = problem.trial(states)
        previous, residual = residual, trial.residual
        if step is not None and previous is not None:
            inverse.learn(step, residual - previous)
        step = -inverse.times(residual)
        moves = step * problem.scale
        done = _settled(trial, moves, options)
        _store(found, where, done | (trial.finite & (trial.change < found.residual[where])), trial)
        found.beats[where] = beat
        rest = trial.finite & ~done
        if not rest.all():
            found.states[:, where[done]] = (states + moves)[:, done]
            found.status[where[done]] = Status.CONVERGED
            if not rest.any():
                break
            where, problem = where[rest], problem.take(rest)
            states, step, moves, residual = (x[:, rest] for x in (states, step, moves, residual))
            inverse.keep(rest)
        share = _affordable(moves, states, problem.scale)
        step, states = step * share, states + moves * share
    return found


def _settled(trial: Trial, moves: np.ndarray, options: OrbitOptions) -> np.ndarray:
    """Whether neither the beat nor the step to the orbit changes anything; shape (patients,)."""
    error = (np.abs(moves) / trial.size).max(axis=0)
    return trial.finite & (trial.change <= options.tolerance) & (error <= options.error_tolerance)


def _newton(problem: OrbitProblem, start: np.ndarray, anchor: Anchor, options: OrbitOptions) -> Orbits:
    """Damped Newton for one patient, from the better of the given state and a few plain beats."""
    found = _empty(problem, 1)
    states = start if np.isfinite(start).all() else anchor.state[:, None]
    after = problem.beat(states)
    for _ in range(options.newton_iterations):
        trial = problem.trial(states, after)
        if not trial.finite.all():
            found.status[:] = Status.NOT_FINITE
            return found
        step = -np.linalg.lstsq(jacobian(problem, states), trial.residual, rcond=1e-13)[0]
        moves = step * problem.scale
        _store(found, np.arange(1), trial.change <= found.residual, trial)
        found.beats[:] += 1 + len(states)
        if _settled(trial, moves, options)[0]:
            found.states[:] = states + moves
            found.status[:] = Status.CONVERGED
            return found
        states, after = _line_search(problem, trial, moves * _affordable(moves, states, problem.scale))
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
    _store(found, np.arange(1), np.array([True]), problem.trial(before, states))
    found.beats[:] += PASSING_BEATS
    return found


def _line_search(problem: OrbitProblem, trial: Trial, moves: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Halve the step until the residual falls; settle for plain beats where it does not."""
    size = np.linalg.norm(trial.residual)
    for fraction in (1.0, 0.5, 0.25, 0.1):
        states = trial.states + fraction * moves
        after = problem.beat(states)
        nearer = problem.trial(states, after)
        if nearer.finite[0] and np.linalg.norm(nearer.residual) < (1.0 - 0.1 * fraction) * size:
            return states, after
    states, after = trial.states, trial.states - trial.moved
    for _ in range(5):
        states, after = after, problem.beat(after)
    return states, after


def jacobian(problem: OrbitProblem, states: np.ndarray) -> np.ndarray:
    """dF/dy in scaled states of one patient, by central differences over one batch of beats."""
    n = len(states)
    shift = 1e-4 * np.maximum(np.abs(states[:, 0]), problem.scale[:, 0])
    points = np.concatenate([states + np.diag(shift), states - np.diag(shift)], axis=1)
    wide = problem.take(np.zeros(2 * n, dtype=int))
    values = wide.trial(points).residual
    return (values[:, :n] - values[:, n:]) / (2.0 * shift) * problem.scale[:, 0]


def _affordable(moves: np.ndarray, states: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Share of a step that moves no state by more than half its size plus 50 scales; shape (patients,)."""
    allowed = 0.5 * np.abs(states) + 50.0 * scale
    return 1.0 / np.maximum((np.abs(moves) / allowed).max(axis=0), 1.0)


def _empty(problem: OrbitProblem, count: int) -> Orbits:
    n = problem.program.assembly.n_states
    return Orbits(
        np.full((n, count), np.nan),
        np.full(count, Status.NOT_CONVERGED),
        np.zeros(count, dtype=int),
        np.full(count, np.inf),
        np.full(count, np.inf),
    )


def _store(found: Orbits, where: np.ndarray, chosen: np.ndarray, trial: Trial) -> None:
    """Keep the chosen patients' trial as the best so far."""
    place = where[chosen]
    found.states[:, place] = trial.states[:, chosen]
    found.residual[place] = trial.change[chosen]
    found.drift[place] = trial.drift[chosen]


def _replace(found: Orbits, patient: int, single: Orbits) -> None:
    found.states[:, patient] = single.states[:, 0]
    found.status[patient] = single.status[0]
    found.beats[patient] += single.beats[0]
    found.residual[patient] = single.residual[0]
    found.drift[patient] = single.drift[0]
