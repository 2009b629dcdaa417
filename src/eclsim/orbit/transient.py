"""Simulation in time from the published initial state, beat after beat."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from eclsim.beat.grid import PhaseGrid, needed_resolution
from eclsim.beat.heartbeat import HEART_RATE, beat_program
from eclsim.circuit.assembly import assemble
from eclsim.orbit.independent import AdaptiveBeats, adaptive_program
from eclsim.orbit.inputs import InvalidInputError, allowed_values
from eclsim.orbit.iteration import compiled_search
from eclsim.orbit.model import AS_PUBLISHED, Model
from eclsim.orbit.steady import ADAPTIVE, SEMI_IMPLICIT, SOLVERS, Batch, solve, start_state


@dataclass(frozen=True)
class Course:
    """Signals over time.

    Args:
        time: time from 0 [s], shape (points,).
        signals: values of the signals, shape (points, signals).
        state: state at the end of the last computed beat, shape (states,).
        steps_per_beat: number of recorded points per beat.
    """

    time: np.ndarray
    signals: np.ndarray
    state: np.ndarray
    steps_per_beat: int


Recording = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Map of one recorded beat: state -> state after it, signals after each step, shape (steps, signals)."""


def follow(
    model: Model,
    seconds: float,
    signals: tuple[str, ...],
    *,
    policy: str = AS_PUBLISHED,
    solver: str = SEMI_IMPLICIT,
    start: np.ndarray | None = None,
) -> Course:
    """Simulate a model in time.

    Args:
        model: circuit and values.
        seconds: duration [s].
        signals: signals to record (see `Recorder`).
        policy: blood volume policy; "patient_held" starts with primed circuits (`primed_start`).
        solver: "semi-implicit" or "adaptive".
        start: state at time 0; by default the published initial state.

    Raises:
        InvalidInputError: the circuit cannot be computed with a value.
    """
    if solver not in SOLVERS:
        raise ValueError(f"solver '{solver}'; allowed: {', '.join(SOLVERS)}")
    if not (math.isfinite(seconds) and seconds > 0.0):
        raise ValueError(f"seconds = {seconds}; allowed: a positive number")
    mistakes = allowed_values(model.circuit).reasons(model.values)
    if mistakes:
        raise InvalidInputError(mistakes)
    state = primed_start(model, policy) if start is None else np.asarray(start, dtype=float)
    assembly, elapsed = assemble(model.circuit), 0.0
    times, pieces = [np.zeros(1)], [_at_start(model, state, signals)]
    grid, record = _recorder(model, signals, solver)
    while elapsed < seconds * (1.0 - 1e-12):
        # A controller may change the heart rate, so that beats differ in length.
        period = 60.0 / float(assembly.in_effect(model.values, state)[HEART_RATE])
        state, recorded = record(state)
        times.append(elapsed + grid.phases[1:] * period)
        elapsed += period
        pieces.append(recorded)
    time = np.concatenate(times)
    within = time <= seconds * (1.0 + 1e-12)
    return Course(time[within], np.concatenate(pieces)[within], state, grid.n_steps)


def primed_start(model: Model, policy: str = AS_PUBLISHED) -> np.ndarray:
    """The published initial state; with "patient_held", circuits hold their volumes of the steady beat.

    The patient's blood then need not fill the circuits, and the simulation ends at the steady beat of that
    policy.
    """
    state, assembly = start_state(model), assemble(model.circuit)
    batch = Batch(model.circuit, model.values, 1, policy)
    batch.volume()  # refuses an unknown policy
    outside = np.array([c.group != "patient" for c in model.circuit.compartments])
    if policy == AS_PUBLISHED or not outside.any():
        return state
    steady, primed = solve(batch).states[:, 0], assembly.layout.conserved(outside) > 0.0
    if np.isfinite(steady).all():
        state[primed] = steady[primed]
    return state


def _recorder(model: Model, signals: tuple[str, ...], solver: str) -> tuple[PhaseGrid, Recording]:
    grid = PhaseGrid(int(needed_resolution(assemble(model.circuit), model.values)))
    if solver == ADAPTIVE:
        beats = AdaptiveBeats(model)

        def integrate(state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            after, recorded = beats.record(state, grid.phases, signals)
            return after, recorded[1:]

        return grid, integrate
    program = beat_program(model.circuit, grid.resolution)
    packed = np.array([float(model.values[name]) for name in program.names])
    search = compiled_search(program, 1)
    columns = [search.signals.index(name) for name in signals]

    def step(state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        after, recorded = search.beat(state, packed)
        return after, recorded[:, columns]

    return grid, step


def _at_start(model: Model, state: np.ndarray, signals: tuple[str, ...]) -> Any:
    """Signals at time 0, with flows without inertia computed from the pressures; shape (1, signals)."""
    program = adaptive_program(model.circuit)
    packed = np.array([float(model.values[name]) for name in program.names])
    return np.asarray(program.signals(signals)(state[None], np.zeros(1), packed))
