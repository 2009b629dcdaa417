"""The steady heartbeat as an equation: y = beat(y) is solved instead of waiting for it.

The residual is F(y) = y - beat(y) + u (w . y - c). The last term is the blood volume: the beat conserves it,
so y - beat(y) says nothing about it, and w . y = c fixes it (w: which compartments are counted, c: their
stressed volume at phase 0, u: the same amount in every compartment).
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from eclsim.arguments import FiniteNumber, WholeNumber, check_fields
from eclsim.beat.heartbeat import BeatProgram
from eclsim.circuit.layout import StateLayout


@dataclass(frozen=True)
class OrbitOptions:
    """How hard to look for the steady beat.

    Args:
        tolerance: largest change of a state over a beat, relative to its size (`StateLayout`; of a volume or
            flow max(|state|, 1)).
        error_tolerance: largest estimated distance to the orbit (inverse Jacobian times residual), relative;
            the state handed back is one step of that size further on, and so much nearer.
        quasi_newton_beats: beats of Broyden's method before Newton's method takes over.
        newton_iterations: iterations of Newton's method, one Jacobian by differences each; 0 leaves out both.
        exact_iterations: further ones with the exact Jacobian, where those end without a steady beat; members
            that are computed side by side have these alone, unless they are 0.
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


@dataclass(frozen=True)
class Anchor:
    """Where a search starts: a circuit's nominal orbit, or a guess for each patient.

    Args:
        state: shape (states,), or (states, patients).
        inverse: inverse Jacobian of F there, in scaled states, shape (states, states[, patients]).
    """

    state: np.ndarray
    inverse: np.ndarray

    def states(self, count: int) -> np.ndarray:
        """State that each of some patients starts from, shape (states, patients)."""
        return self.state if self.state.ndim == 2 else np.repeat(self.state[:, None], count, axis=1)

    def take(self, chosen: Any) -> Anchor:
        """For some of the patients."""
        return self if self.state.ndim == 1 else Anchor(self.state[:, chosen], self.inverse[..., chosen])


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

    def put(self, members: np.ndarray, orbits: Orbits) -> None:
        """Write down other orbits as those of some members, in place."""
        for field in fields(Orbits):
            getattr(self, field.name)[..., members] = getattr(orbits, field.name)


def largest_allowed_steps(states: Any, largest_steps: Any) -> Any:
    """Largest change of each state in one step of a search: half of it more than its layout says."""
    return 0.5 * abs(states) + largest_steps


@dataclass(frozen=True)
class Trial:
    """States and where a beat takes them, patients last.

    Args:
        states: states at phase 0, shape (states, patients).
        moved: states minus states a beat later.
        size: of the states, what their changes are relative to.
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


@dataclass(frozen=True)
class OrbitProblem:
    """F and its norms for the patients of a batch.

    Args:
        program: a beat of their circuit.
        packed: their parameters, shape (names, patients).
        volume: the blood volume condition.
    """

    program: BeatProgram
    packed: np.ndarray
    volume: Volume

    @property
    def layout(self) -> StateLayout:
        """What the states are."""
        return self.program.assembly.layout

    @property
    def scale(self) -> np.ndarray:
        """Typical change of each state, shape (states, 1)."""
        return self.layout.scales[:, None]

    @property
    def spread(self) -> np.ndarray:
        """Share of each state in blood that is given, shape (states, 1)."""
        return self.layout.spread[:, None]

    @property
    def largest_steps(self) -> np.ndarray:
        """How far a search may move each state besides half of its size, shape (states, 1)."""
        return self.layout.largest_steps[:, None]

    def take(self, chosen: Any) -> OrbitProblem:
        """The same problem for some of the patients."""
        volume = Volume(self.volume.weights, self.volume.target[chosen])
        return OrbitProblem(self.program, self.packed[:, chosen], volume)

    def trial(self, states: np.ndarray, after: np.ndarray) -> Trial:
        """What some states and those a beat later say."""
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
