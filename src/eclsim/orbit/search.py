"""The search for steady heartbeats.

Broyden's method starts from the inverse Jacobian at the circuit's nominal parameters, or from one that the
caller knows; a patient it does not settle is handed to Newton's method with a Jacobian of its own. Nothing
here depends on the other patients of a batch.
"""

from __future__ import annotations

import numpy as np

from eclsim.orbit.broyden import InverseJacobian
from eclsim.orbit.equation import Anchor, OrbitOptions, OrbitProblem, Orbits, Trial, allowed_moves, joined
from eclsim.orbit.single_search import TERMS, solve_alone
from eclsim.orbit.status import Status

PASSING_BEATS = 30
"""Plain beats after a search that found nothing."""


def solve_orbits(problem: OrbitProblem, anchor: Anchor, options: OrbitOptions) -> Orbits:
    """Steady states of all patients of a problem."""
    if problem.lone and options.quasi_newton_beats <= TERMS:
        found = _one_by_one(problem, anchor, options)
    else:
        found = _quasi_newton(problem, anchor, options)
    for patient in map(int, np.flatnonzero(found.status != Status.CONVERGED)):
        if options.newton_iterations:
            chosen = [patient]
            _replace(
                found,
                patient,
                _newton(problem.take(chosen), found.states[:, chosen], anchor.take(chosen), options),
            )
    return found


def _one_by_one(problem: OrbitProblem, anchor: Anchor, options: OrbitOptions) -> Orbits:
    count = problem.packed.shape[1]
    if count == 1:
        return solve_alone(problem, anchor, options)
    return joined([solve_alone(problem.take([k]), anchor.take([k]), options) for k in range(count)])


def _quasi_newton(problem: OrbitProblem, anchor: Anchor, options: OrbitOptions) -> Orbits:
    count = problem.packed.shape[1]
    found = _empty(problem, count)
    where = np.arange(count)
    states = anchor.state if anchor.state.ndim == 2 else np.repeat(anchor.state[:, None], count, axis=1)
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
        share = affordable(moves, states, problem.largest_steps)
        step, states = step * share, states + moves * share
    return found


def _settled(trial: Trial, moves: np.ndarray, options: OrbitOptions) -> np.ndarray:
    """Whether neither the beat nor the step to the orbit changes anything; shape (patients,)."""
    error = (np.abs(moves) / trial.size).max(axis=0)
    return trial.finite & (trial.change <= options.tolerance) & (error <= options.error_tolerance)


def _newton(problem: OrbitProblem, start: np.ndarray, anchor: Anchor, options: OrbitOptions) -> Orbits:
    """Damped Newton for one patient, from the better of the given state and a few plain beats."""
    found = _empty(problem, 1)
    states = start if np.isfinite(start).all() else anchor.state.reshape(len(start), 1)
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
        states, after = _line_search(problem, trial, moves * affordable(moves, states, problem.largest_steps))
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


def affordable(moves: np.ndarray, states: np.ndarray, largest_steps: np.ndarray) -> np.ndarray:
    """Share of a step that moves no state further than is allowed; shape (patients,)."""
    return 1.0 / np.maximum((np.abs(moves) / allowed_moves(states, largest_steps)).max(axis=0), 1.0)


def _empty(problem: OrbitProblem, count: int) -> Orbits:
    n = problem.program.assembly.layout.size
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
