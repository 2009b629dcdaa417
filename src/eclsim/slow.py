"""Laws of what changes over minutes and hours: fluid, blood, solutes, drugs.

A slow law reads the steady beat as means and sets parameters of the circuit; the heart beats many times
while a slow state hardly moves, so its rates are those at the steady beat (averaging over the fast scale).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

if TYPE_CHECKING:
    import numpy as np

Named: TypeAlias = "Mapping[str, np.ndarray]"
"""Values by name, each of shape (members,)."""

INFLOWS = ("crystalloid_ml", "albumin_ml", "red_cells_ml", "blood_ml", "bleed_ml")
"""What events give, mL; bleeding is positive and leaves the patient."""


class SlowState(NamedTuple):
    """A number that changes over minutes and hours.

    Attributes:
        name: such as "fluid.plasma_ml".
        unit: of its value.
        scale: a change that is felt; the tolerance of its error is relative to it.
        is_amount: whether there cannot be less than nothing of it; a course ends where there would be.
    """

    name: str
    unit: str
    scale: float
    is_amount: bool = False


class DerivedQuantity(NamedTuple):
    """A quantity that follows from slow states, such as a concentration.

    Attributes:
        name: such as "urea".
        unit: of its values.
        description: what it is.
        values: of shape (members,).
    """

    name: str
    unit: str
    description: str
    values: np.ndarray


class SlowLaw(ABC):
    """How some slow states change, and what they set in the circuit; of all members of a batch at once.

    Volumes that went through a door (given, removed, refilled) are states like others, so that a balance
    holds to the rounding of the integrator.
    """

    @property
    @abstractmethod
    def states(self) -> tuple[SlowState, ...]:
        """The states, in the order of their names' first use."""

    @property
    @abstractmethod
    def reads(self) -> tuple[str, ...]:
        """Names of outputs that are read off the steady beat."""

    @abstractmethod
    def start(self, settings: Named, beat: Named) -> Named:
        """States at time 0.

        Args:
            settings: the case's parameters, by key.
            beat: what is read, of the steady beat without slow states.
        """

    @abstractmethod
    def in_effect(self, states: Named, settings: Named) -> Named:
        """Parameters of the circuit that slow states set, by key."""

    @abstractmethod
    def rates(self, states: Named, settings: Named, beat: Named, inflows: Named) -> Named:
        """Change of each state per second.

        Args:
            states: of all laws, by name.
            settings: the case's parameters at that moment, events and ramps applied.
            beat: what is read, of the steady beat at these states.
            inflows: what events give at that moment, mL/s by the names of `INFLOWS`.
        """

    @property
    def blood(self) -> tuple[str, ...]:
        """States of how far the blood has followed [mmHg], not needed where beats are followed."""
        return ()

    def beat_by_beat(self) -> SlowLaw:
        """The law where gases of the blood are followed beat by beat."""
        return self

    def derived_quantities(self, states: Named, in_effect: Named) -> tuple[DerivedQuantity, ...]:
        """Quantities that follow from the states and are shown beside them.

        Args:
            states: of all laws, by name.
            in_effect: parameters, by key, those included that the laws set.
        """
        return ()
