"""Slow regulation: what changes once a beat and acts on parameters of the circuit."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar, Generic, NamedTuple

from eclsim.components.base import Component, Constants, Number, Values


class ControlState(NamedTuple):
    """One number that a controller keeps from beat to beat.

    `scale` is its typical change: a search moves it by no more than this and half of its size at once.
    """

    name: str
    scale: float = 1.0


class Controller(Component, ABC, Generic[Constants]):
    """A controller's law: a map from its states and what it reads off a beat to its states a beat later.

        readings of the beat --> [ states ] --> values in effect during the next beat

    The circuit's table says which readings it gets and which parameters it acts on, in which order. Every
    argument is a number, or one for each patient. The steady beat is the one after which the states are as
    before it; they are solved for together with volumes and flows, so that `next_states` must depend smoothly
    on readings and states, and `in_effect` should stay within what the circuit can be computed with.
    """

    relative: ClassVar[bool] = False
    """Whether it multiplies or shifts what it is given, so that several such may act on one parameter."""

    @property
    @abstractmethod
    def states(self) -> tuple[ControlState, ...]:
        """What it keeps from beat to beat; none where it acts the same whatever the beat."""

    def constants(self, values: Values) -> Constants:
        """What can be computed once from the parameters; handed back to the methods below."""
        return values  # pyright: ignore[reportReturnType]  # what a law without this method is written for

    @abstractmethod
    def start(self, constants: Constants) -> Sequence[Number]:
        """States at the start."""

    @abstractmethod
    def in_effect(
        self, states: Sequence[Number], values: Sequence[Number], constants: Constants
    ) -> Sequence[Number]:
        """Values in effect during a beat, from the given values of the parameters it acts on."""

    @abstractmethod
    def next_states(
        self, states: Sequence[Number], readings: Sequence[Number], period: Number, constants: Constants
    ) -> Sequence[Number]:
        """States a beat later; `period` is the length of the beat that was read [s]."""
