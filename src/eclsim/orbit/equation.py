"""The steady heartbeat as an equation: y = beat(y) is solved directly instead of simulating until it repeats.

The residual is F(y) = y - beat(y) + u (w . y - c). The last term fixes the blood volume: the beat conserves
it, so that y - beat(y) does not determine it. w marks the compartments that are counted, c is their stressed
volume at phase 0, and u distributes blood equally over all compartments.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Any

import numpy as np

from eclsim.arguments import FiniteNumber, WholeNumber, check_fields
from eclsim.beat.heartbeat import BeatProgram
from eclsim.circuit.assembly import StateLayout


@dataclass(frozen=True)
class OrbitOptions:
    """Accuracy and effort of the search for the steady beat.

    Args:
        tolerance: largest change of a state over a beat, relative to its size (`StateLayout`; for a volume or
            flow max(|state|, 1)).
        error_tolerance: largest estimated relative distance to the orbit (inverse Jacobian times residual);
            the returned state is corrected by that step, so its error is much smaller.
        quasi_newton_beats: beats of Broyden's method before Newton's method takes over.
        newton_iterations: iterations of Newton's method with a Jacobian by differences; 0 disables Newton's
            method.
        exact_iterations: further iterations with the exact Jacobian if those do not converge; members
            computed side by side use only these, unless this is 0.
    """

    tolerance: float = 1e-8
    error_tolerance: float = 1e-7
    quasi_newton_beats: int = 25
    newton_iterations: int = 12
    exact_iterations: int = 40

    def __post_init__(self) -> None:
        check_fields(
            self,
            tolerance=FiniteNumber(above=0.0),
            error_tolerance=FiniteNumber(above=0.0),
            quasi_newton_beats=WholeNumber(),
            newton_iterations=WholeNumber(),
            exact_iterations=WholeNumber(),
        )


@lru_cache(maxsize=64)
def by_broyden_only(options: OrbitOptions) -> OrbitOptions:
    """The same options without Newton's method."""
    return replace(options, newton_iterations=0)


@dataclass(frozen=True)
class Anchor:
    """Start of a search: a circuit's nominal orbit, or a guess for each patient.

    Args:
        state: start state, shape (states,) or (states, patients).
        inverse: inverse Jacobian of F at that state, in scaled states, shape (states, states[, patients]).
    """

    state: np.ndarray
    inverse: np.ndarray

    def states(self, count: int) -> np.ndarray:
        """Start states of `count` patients, shape (states, patients)."""
        return self.state if self.state.ndim == 2 else np.repeat(self.state[:, None], count, axis=1)

    def take(self, chosen: Any) -> Anchor:
        """The anchor of selected patients."""
        return self if self.state.ndim == 1 else Anchor(self.state[:, chosen], self.inverse[..., chosen])


@dataclass(frozen=True)
class Volume:
    """The blood volume condition: weights . state = target.

    Args:
        weights: 1 for each counted compartment, else 0, shape (states,).
        target: total stressed volume of the counted compartments [mL], shape (patients,).
    """

    weights: np.ndarray
    target: np.ndarray


@dataclass(frozen=True)
class Orbits:
    """Steady states of a batch; patients are the last axis.

    Args:
        states: states at phase 0, shape (states, patients).
        status: `Status` of each patient, shape (patients,).
        beats: number of beats computed for each patient.
        residual: largest relative change of a state over a beat.
        drift: largest change of a volume over a beat [mL].
    """

    states: np.ndarray
    status: np.ndarray
    beats: np.ndarray
    residual: np.ndarray
    drift: np.ndarray

    def put(self, members: np.ndarray, orbits: Orbits) -> None:
        """Store other orbits as those of selected members, in place."""
        for field in fields(Orbits):
            getattr(self, field.name)[..., members] = getattr(orbits, field.name)


def largest_allowed_steps(states: Any, largest_steps: Any) -> Any:
    """Largest change of each state in one solver step: half of its size plus the layout's largest step."""
    return 0.5 * abs(states) + largest_steps


@dataclass(frozen=True)
class Trial:
    """States and their change over one beat; patients are the last axis.

    Args:
        states: states at phase 0, shape (states, patients).
        moved: states minus states one beat later.
        size: sizes of the states to which their changes are relative.
        residual: F in scaled states; 0 if it is not finite.
        change: largest change of a state over the beat, relative to its size; shape (patients,).
        drift: largest change of a volume over the beat [mL].
        finite: whether the beat gave finite states, shape (patients,).
    """

    states: np.ndarray
    moved: np.ndarray
    size: np.ndarray
    residual: np.ndarray
    change: np.ndarray
    drift: np.ndarray
    finite: np.ndarray


@dataclass(frozen=True)
class OrbitProblem:
    """Residual F and its norms for the patients of a batch.

    Args:
        program: beat program of their circuit.
        packed: parameters, shape (names, patients).
        volume: the blood volume condition.
    """

    program: BeatProgram
    packed: np.ndarray
    volume: Volume

    @property
    def layout(self) -> StateLayout:
        """Layout of the states."""
        return self.program.assembly.layout

    @property
    def scale(self) -> np.ndarray:
        """Typical change of each state, shape (states, 1)."""
        return self.layout.scales[:, None]

    @property
    def spread(self) -> np.ndarray:
        """Share of each state in added blood, shape (states, 1)."""
        return self.layout.spread[:, None]

    @property
    def largest_steps(self) -> np.ndarray:
        """Largest solver step of each state in addition to half of its size, shape (states, 1)."""
        return self.layout.largest_steps[:, None]

    def take(self, chosen: Any) -> OrbitProblem:
        """The problem of selected patients."""
        volume = Volume(self.volume.weights, self.volume.target[chosen])
        return OrbitProblem(self.program, self.packed[:, chosen], volume)

    def trial(self, states: np.ndarray, after: np.ndarray) -> Trial:
        """Evaluate states and the states one beat later."""
        moved = states - after
        excess = self.volume.weights @ states - self.volume.target
        size = np.maximum(np.abs(states), self.layout.smallest_sizes[:, None])
        distance = np.abs(moved)
        drift = distance[self.layout.volumes.where].max(axis=0, initial=0.0)
        change = np.maximum(
            (distance / size).max(axis=0), np.abs(excess) / np.maximum(self.volume.target, 1.0)
        )
        finite = np.isfinite(change)
        residual = np.where(finite, (moved + self.spread * excess) / self.scale, 0.0)
        return Trial(states, moved, size, residual, change, drift, finite)
