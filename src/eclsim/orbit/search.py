"""Search for steady heartbeats by Broyden's and Newton's methods.

Broyden's method starts from the inverse Jacobian of a known orbit. A member for which it does not converge is
solved by Newton's method with a Jacobian by differences if the member is alone, and with the exact Jacobian
if that fails. Where blood shifts towards the lungs until a valve opens, neither method lowers the residual at
first: implicit steps of many beats then follow the drift (pseudo-transient continuation, Kelley and Keyes
1998, doi 10.1137/S0036142996304796). No member's result depends on the other members of a batch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eclsim.orbit.derivatives import exact_jacobian
from eclsim.orbit.equation import Anchor, OrbitOptions, OrbitProblem, Orbits, Trial, largest_allowed_steps
from eclsim.orbit.iteration import CompiledSearch, compiled_search
from eclsim.orbit.status import Status

WAITING_BEATS = 30
"""Plain beats after a search that did not converge."""
DAMPING = (1.0, 0.5, 0.25, 0.1)
"""Shares of a Newton step that are tried in turn until the residual falls."""
EXACT_DAMPING = (1.0, 0.5, 0.25)
"""Shares of a Newton step with the exact Jacobian."""
FIRST_EULER_BEATS, MOST_EULER_BEATS = 16.0, 4096.0
"""Beats of the first and of the longest implicit Euler step, used if no share of a Newton step lowers the
residual."""
LARGEST_RESIDUAL_GROWTH = 2.0
"""Growth of the residual over an implicit Euler step above which the next step is shorter."""
BEATS_AFTER_EXACT_STEP = 5
"""Plain beats after a step with the exact Jacobian, as fast modes would hide the progress of slow ones."""
LARGEST_MULTIPLIER = 1.0 + 1e-4
"""Largest Floquet multiplier of a stable beat; 1 belongs to conserved blood, rounding splits several."""
RANK_TOLERANCE, RANK_TOLERANCE_IN_COLLAPSE = 1e-13, 1e-10
"""Shares of the largest singular value below which a direction is taken for noise of the differences. Where
veins collapse, the right heart is trapped and the beat repeats, which the smaller share does not detect."""


def solve_orbits(problem: OrbitProblem, anchor: Anchor, options: OrbitOptions, width: int = 1) -> Orbits:
    """Solve for the steady states of all members of a problem, `width` of them side by side."""
    search = compiled_search(problem.program, width)
    start = anchor.states(problem.packed.shape[1])
    result = search.search(start, anchor.inverse, problem.packed, problem.volume, options)
    status = np.where(result.converged, Status.CONVERGED, Status.NOT_CONVERGED)
    orbits = Orbits(result.best, status, result.beats, result.change, result.drift)
    if options.newton_iterations:
        for member in map(int, np.flatnonzero(~result.converged)):
            state = orbits.states[:, [member]]
            state = state if np.isfinite(state).all() else start[:, [member]]
            single = _by_newton(problem.take([member]), options, state, by_differences=width == 1)
            single.beats[:] += orbits.beats[member]
            orbits.put(np.array([member]), single)
    return orbits


def _by_newton(
    problem: OrbitProblem, options: OrbitOptions, state: np.ndarray, by_differences: bool
) -> Orbits:
    """Solve for the steady beat of one member, on its own, from a state of shape (states, 1).

    For a single patient, differences avoid the seconds of compiling the exact Jacobian; in a batch that time
    is negligible and the exact Jacobian is faster.
    """
    search, beats = compiled_search(problem.program, 1), 0
    if by_differences or not options.exact_iterations:
        result = _Newton(search, problem, options).solve(state)
        if not options.exact_iterations or result.status[0] == Status.CONVERGED:
            return result
        beats = result.beats
    result = _Newton(search, problem, options, exact=True).solve(state)
    result.beats[:] += beats
    return result


@dataclass(frozen=True)
class _Newton:
    """Damped Newton's method for one member, with a Jacobian by differences or exact."""

    search: CompiledSearch
    problem: OrbitProblem
    options: OrbitOptions
    exact: bool = False

    def solve(self, states: np.ndarray) -> Orbits:
        """Solve from a state of shape (states, 1)."""
        result, after, euler_beats = _no_orbit(len(states)), self._wait(states), FIRST_EULER_BEATS
        for _ in range(self.options.exact_iterations if self.exact else self.options.newton_iterations):
            trial = self.problem.trial(states, after)
            if not trial.finite[0]:
                result.status[:] = Status.NOT_FINITE
                return result
            jacobian = self.jacobian(states)
            step = -np.linalg.lstsq(jacobian, trial.residual, rcond=self.rank_tolerance)[0]
            moves = step * self.problem.scale
            result.beats[:] += 1 + len(states)
            if trial.change[0] <= result.residual[0]:
                _store(result, trial)
            error = (np.abs(moves) / trial.size).max()
            converged = trial.change[0] <= self.options.tolerance and error <= self.options.error_tolerance
            if converged and (not self.exact or self._attracts(jacobian)):
                result.states[:] = states + moves
                result.status[:] = Status.CONVERGED
                return result
            new_states = self._damped_step(trial, moves)
            if new_states is None and self.exact:
                new_states, euler_beats = self._implicit_euler_step(trial, jacobian, euler_beats)
            elif new_states is None and self.options.exact_iterations:
                return result
            states, after = new_states or self._after_beats(trial.states - trial.moved, 4)
            result.beats[:] += 1
        return self._result_after_waiting(result, after)

    @property
    def rank_tolerance(self) -> float:
        """Share of the largest singular value above which a direction counts."""
        collapses = not self.exact and bool(self.problem.program.assembly.narrowing)
        return RANK_TOLERANCE_IN_COLLAPSE if collapses else RANK_TOLERANCE

    def jacobian(self, states: np.ndarray) -> np.ndarray:
        """dF/dy in scaled states, exact or by central differences over a batch of beats."""
        if self.exact:
            return exact_jacobian(self.problem, states[:, 0])
        n, scale = len(states), self.problem.scale[:, 0]
        shift = 1e-4 * np.maximum(np.abs(states[:, 0]), scale)
        points = np.concatenate([states + np.diag(shift), states - np.diag(shift)], axis=1)
        values = self.problem.take(np.zeros(2 * n, dtype=int)).trial(points, self._wait(points)).residual
        return (values[:, :n] - values[:, n:]) / (2.0 * shift) * scale

    def _attracts(self, jacobian: np.ndarray) -> bool:
        """Whether the orbit is stable, from the exact Jacobian at it: plain beats lead back to it."""
        scale, weights = self.problem.scale, self.problem.volume.weights
        volume = self.problem.spread * weights * scale[:, 0] / scale
        multipliers = np.linalg.eigvals(np.eye(len(scale)) + volume - jacobian)
        return bool(np.abs(multipliers).max() <= LARGEST_MULTIPLIER)

    def _wait(self, states: np.ndarray, beats: int = 1) -> np.ndarray:
        return self.search.wait(states, np.repeat(self.problem.packed, states.shape[1], axis=1), beats)

    def _after_beats(self, states: np.ndarray, beats: int) -> tuple[np.ndarray, np.ndarray]:
        """States after a number of plain beats, and after one more."""
        states = self._wait(states, beats) if beats else states
        return states, self._wait(states)

    def _damped_step(self, trial: Trial, moves: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """States after a share of the Newton step, and one beat later; None if the residual does not fall."""
        size = np.linalg.norm(trial.residual)
        share = float(allowed_share(moves, trial.states, self.problem.largest_steps)[0])
        for fraction in EXACT_DAMPING if self.exact else DAMPING:
            states, after = self._after_beats(
                trial.states + fraction * share * moves, BEATS_AFTER_EXACT_STEP * self.exact
            )
            next_trial = self.problem.trial(states, after)
            if (
                next_trial.finite[0]
                and np.linalg.norm(next_trial.residual) < (1.0 - 0.1 * fraction * share) * size
            ):
                return states, after
        return None

    def _implicit_euler_step(
        self, trial: Trial, jacobian: np.ndarray, beats: float
    ) -> tuple[tuple[np.ndarray, np.ndarray] | None, float]:
        """States after many plain beats, approximated by one implicit Euler step, and the next step's beats.

        Returns no states if they are not finite. While blood shifts, a step that ends after the opening of a
        valve raises the residual.
        """
        step = -np.linalg.lstsq(np.eye(len(jacobian)) / beats + jacobian, trial.residual, rcond=None)[0]
        moves = step * self.problem.scale
        share = allowed_share(moves, trial.states, self.problem.largest_steps)
        states, after = self._after_beats(trial.states + share * moves, BEATS_AFTER_EXACT_STEP)
        next_trial = self.problem.trial(states, after)
        if next_trial.finite[0] and next_trial.change[0] <= LARGEST_RESIDUAL_GROWTH * trial.change[0]:
            return (states, after), min(2.0 * beats, MOST_EULER_BEATS)
        return (states, after) if next_trial.finite[0] else None, beats / 4.0

    def _result_after_waiting(self, result: Orbits, states: np.ndarray) -> Orbits:
        """Result without an orbit: the state after plain beats, not an iterate of the search."""
        before = self._wait(states, WAITING_BEATS - 1)
        after = self._wait(before)
        if not np.isfinite(after).all():
            result.status[:] = Status.NOT_FINITE
            return result
        _store(result, self.problem.trial(before, after))
        result.beats[:] += WAITING_BEATS
        return result


def anchor_at(problem: OrbitProblem, state: np.ndarray, beats: int, width: int = 1) -> Anchor:
    """Steady state and inverse Jacobian of a problem's only member, found after a number of plain beats.

    Returns the start `state` itself, with a unit matrix, if the states are not finite.
    """
    search, unchanged = compiled_search(problem.program, width), Anchor(state, np.eye(len(state)))
    states = search.wait(state[:, None], problem.packed, beats)
    if not np.isfinite(states).all():
        return unchanged
    options = OrbitOptions()
    newton = _Newton(search, problem, options)
    start = Anchor(states[:, 0], np.linalg.pinv(newton.jacobian(states)))
    solved = solve_orbits(problem, start, options, width)
    if not np.isfinite(solved.states).all():
        return unchanged
    return Anchor(solved.states[:, 0], np.linalg.pinv(newton.jacobian(solved.states)))


def inverse_at(
    problem: OrbitProblem, states: np.ndarray, width: int = 1, held: Sequence[Sequence[str]] = ()
) -> np.ndarray:
    """Inverse Jacobian in scaled states at the orbit of a problem's only member, shape (states, states).

    A search that starts with it changes the volume of no part in `held`, groups of compartments that closed
    valves isolate: their volumes are conditions such as that of the total volume, with their terms in the
    Jacobian, and are met at the start.
    """
    newton = _Newton(compiled_search(problem.program, width), problem, OrbitOptions())
    jacobian, scale = newton.jacobian(states[:, None]), problem.scale[:, 0]
    for part in held:
        inside = np.isin(problem.layout.names, [f"V{name}" for name in part])
        jacobian = jacobian + np.outer(inside / scale, inside * scale) / inside.sum()
    return np.linalg.pinv(jacobian)


def allowed_share(moves: np.ndarray, states: np.ndarray, largest_steps: np.ndarray) -> np.ndarray:
    """Largest share of a step that moves no state further than allowed; shape (members,)."""
    return 1.0 / np.maximum((np.abs(moves) / largest_allowed_steps(states, largest_steps)).max(axis=0), 1.0)


def _no_orbit(n: int) -> Orbits:
    return Orbits(
        np.full((n, 1), np.nan), np.array([Status.NOT_CONVERGED]), np.zeros(1, dtype=int),
        np.full(1, np.inf), np.full(1, np.inf),
    )  # fmt: skip


def _store(result: Orbits, trial: Trial) -> None:
    """Store a member's trial as the best result so far."""
    result.states[:], result.residual[:], result.drift[:] = trial.states, trial.change, trial.drift
