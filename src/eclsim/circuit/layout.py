"""Layout of a circuit's state vector: named blocks, one after the other.

Every solver accesses a state through its layout, so that a new kind of state only needs a new block here.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from eclsim.circuit.signals import Kind, Signal


class State(NamedTuple):
    """One element of the state vector.

    Attributes:
        name: name of the state.
        scale: typical change, used as the weight in a solver's norms.
        smallest_size: lower limit of the size that relative changes refer to.
        largest_step: largest change in one solver step, in addition to half of the state's size.
    """

    name: str
    scale: float = 1.0
    smallest_size: float = 1.0
    largest_step: float = 50.0


@dataclass(frozen=True)
class Block:
    """States of one kind, stored from position `first` onwards."""

    states: tuple[State, ...]
    first: int

    @property
    def positions(self) -> range:
        """Positions of the states."""
        return range(self.first, self.first + len(self.states))

    @property
    def where(self) -> slice:
        """Slice of the block along the first axis of an array of states."""
        return slice(self.first, self.first + len(self.states))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the states."""
        return tuple(state.name for state in self.states)


@dataclass(frozen=True)
class StateLayout:
    """The blocks of a state vector, and properties of its elements as arrays of shape (states,).

    Args:
        volumes: stressed volumes [mL], named "V" + compartment.
        flows: flows of connections with inertia [mL/s], named "Q" + connection.
        controllers: controllers' states, named controller + "." + state; constant in a beat, updated at its
            end.
    """

    volumes: Block
    flows: Block
    controllers: Block

    @cached_property
    def states(self) -> tuple[State, ...]:
        """All states in order."""
        return self.volumes.states + self.flows.states + self.controllers.states

    @property
    def size(self) -> int:
        """Number of states."""
        return len(self.states)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of every state."""
        return tuple(state.name for state in self.states)

    @cached_property
    def scales(self) -> np.ndarray:
        """Typical change of each state."""
        return np.array([state.scale for state in self.states])

    @cached_property
    def smallest_sizes(self) -> np.ndarray:
        """Lower limit of the size that relative changes of each state refer to."""
        return np.array([state.smallest_size for state in self.states])

    @cached_property
    def largest_steps(self) -> np.ndarray:
        """Largest change of each state in one solver step, in addition to half of its size."""
        return np.array([state.largest_step for state in self.states])

    @cached_property
    def spread(self) -> np.ndarray:
        """State vector of 1 mL of blood, divided equally among all compartments."""
        return self.conserved() / len(self.volumes.states)

    def conserved(self, counted: np.ndarray | None = None) -> np.ndarray:
        """Weights of the states in the blood volume; `counted` marks compartments, by default all."""
        weights = np.zeros(self.size)
        weights[self.volumes.where] = 1.0 if counted is None else counted
        return weights


def layout_of(
    compartments: Iterable[str], inertial: Iterable[str], controllers: Iterable[tuple[str, float]] = ()
) -> StateLayout:
    """Create the state layout of a circuit.

    Args:
        compartments: names of the compartments.
        inertial: names of the connections whose flow has inertia.
        controllers: name and typical change of each controller state.
    """
    volumes = tuple(State(str(Signal(Kind.VOLUME, name))) for name in compartments)
    flows = tuple(State(str(Signal(Kind.FLOW, name)), 10.0, largest_step=500.0) for name in inertial)
    control = tuple(State(name, scale, scale, scale) for name, scale in controllers)
    return StateLayout(
        Block(volumes, 0), Block(flows, len(volumes)), Block(control, len(volumes) + len(flows))
    )
