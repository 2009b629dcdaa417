"""Layout of the numbers of a circuit's state: named blocks, one after the other.

Every solver gets at a state through its layout, so that a new kind of state is a new block here and nothing
else changes.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from eclsim.circuit.signals import Kind, Signal


class State(NamedTuple):
    """One number of a state.

    Attributes:
        name: of the state.
        scale: its typical change, its weight in the norms of a search.
        smallest_size: a relative change refers to this size at least.
        largest_step: how far a search may move it at once, besides half of its size.
    """

    name: str
    scale: float = 1.0
    smallest_size: float = 1.0
    largest_step: float = 50.0


@dataclass(frozen=True)
class Block:
    """States of one kind, from the position `first` on."""

    states: tuple[State, ...]
    first: int

    @property
    def positions(self) -> range:
        """Positions of the states."""
        return range(self.first, self.first + len(self.states))

    @property
    def where(self) -> slice:
        """The block in an array of states, along its first axis."""
        return slice(self.first, self.first + len(self.states))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the states."""
        return tuple(state.name for state in self.states)


@dataclass(frozen=True)
class StateLayout:
    """The blocks of a state, and what holds for each number of it as arrays of shape (states,).

    Args:
        volumes: "V" + compartment, stressed volume [mL].
        flows: "Q" + connection, flow of a connection with inertia [mL/s].
        controllers: controller + "." + state; they stay the same during a beat and change at its end.
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
        """Size that a relative change of each state refers to at least."""
        return np.array([state.smallest_size for state in self.states])

    @cached_property
    def largest_steps(self) -> np.ndarray:
        """How far a search may move each state at once, besides half of its size."""
        return np.array([state.largest_step for state in self.states])

    @cached_property
    def spread(self) -> np.ndarray:
        """1 mL of blood, the same amount in every compartment."""
        return self.conserved() / len(self.volumes.states)

    def conserved(self, counted: np.ndarray | None = None) -> np.ndarray:
        """Weights of the states in the blood volume; `counted` tells which compartments, else all of them."""
        weights = np.zeros(self.size)
        weights[self.volumes.where] = 1.0 if counted is None else counted
        return weights


def layout_of(
    compartments: Iterable[str], inertial: Iterable[str], controllers: Iterable[tuple[str, float]] = ()
) -> StateLayout:
    """The state of a circuit.

    Args:
        compartments: their names.
        inertial: names of the connections whose flow has inertia.
        controllers: name and typical change of each state of its controllers.
    """
    volumes = tuple(State(str(Signal(Kind.VOLUME, name))) for name in compartments)
    flows = tuple(State(str(Signal(Kind.FLOW, name)), 10.0, largest_step=500.0) for name in inertial)
    control = tuple(State(name, scale, scale, scale) for name, scale in controllers)
    return StateLayout(
        Block(volumes, 0), Block(flows, len(volumes)), Block(control, len(volumes) + len(flows))
    )
