"""Slow laws: changes of fluid, blood, solutes and drugs over minutes and hours.

A slow law reads means of the steady beat and sets parameters of the circuit. Many beats pass while a slow
state hardly changes, so its rates are evaluated at the steady beat (averaging over the fast time scale).
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
"""Volumes that events give, mL; bleeding is positive and leaves the patient."""
DOSE = "drug_mg"
"""Amount that events give of the drug of the section [dialysed_drug], mg."""
ALL_GIVEN = (*INFLOWS, DOSE)
"""All that events give."""


def kind_and_unit(name: str) -> tuple[str, str]:
    """Return words and unit of what an event gives, such as "red cells" and "mL" of "red_cells_ml"."""
    kind, _, unit = name.rpartition("_")
    return kind.replace("_", " "), {"ml": "mL"}.get(unit, unit)


class SlowState(NamedTuple):
    """A state that changes over minutes and hours.

    Attributes:
        name: name such as "fluid.plasma_ml".
        unit: unit of the value.
        words: name in words, such as "plasma volume".
        scale: smallest change that matters; the error tolerance of the integrator is relative to it.
        is_amount: whether the state cannot be negative; a course ends where it would become so.
        fades: whether the state approaches 0 from above; what the integrator leaves below 0 is shown as 0.
    """

    name: str
    unit: str
    words: str
    scale: float
    is_amount: bool = False
    fades: bool = False


class DerivedQuantity(NamedTuple):
    """A quantity that follows from slow states, such as a concentration.

    Attributes:
        name: name such as "urea".
        unit: unit of the values.
        description: description of the quantity.
        values: array of shape (members,).
    """

    name: str
    unit: str
    description: str
    values: np.ndarray


class SlowLaw(ABC):
    """Rates of change of slow states, and circuit parameters set by them, for all members of a batch.

    Volumes that were transferred (given, removed, refilled) are states as well, so that a balance is exact to
    the rounding of the integrator.
    """

    @property
    @abstractmethod
    def states(self) -> tuple[SlowState, ...]:
        """Slow states, in a fixed order."""

    @property
    @abstractmethod
    def reads(self) -> tuple[str, ...]:
        """Names of the outputs of the steady beat that the law reads."""

    @abstractmethod
    def start(self, settings: Named, beat: Named) -> Named:
        """Return the states at time 0.

        Args:
            settings: parameters of the case, by key.
            beat: outputs named by `reads`, of the steady beat without slow states.
        """

    @abstractmethod
    def in_effect(self, states: Named, settings: Named) -> Named:
        """Return the circuit parameters set by the slow states, by key."""

    @abstractmethod
    def rates(self, states: Named, settings: Named, beat: Named, inflows: Named) -> Named:
        """Return the rate of change of each state per second.

        Args:
            states: states of all laws, by name.
            settings: parameters of the case at that moment, with events and ramps applied.
            beat: outputs named by `reads`, of the steady beat at these states.
            inflows: rates of what events give at that moment, mL/s and mg/s, by the names in `ALL_GIVEN`.
        """

    @property
    def blood(self) -> tuple[str, ...]:
        """Names of states in which blood lags behind tissues [mmHg], unused where beats are followed."""
        return ()

    def beat_by_beat(self) -> SlowLaw:
        """Return the law to use where blood gases are followed beat by beat."""
        return self

    def derived_quantities(self, states: Named, in_effect: Named) -> tuple[DerivedQuantity, ...]:
        """Return quantities that follow from the states and are shown beside them.

        Args:
            states: states of all laws, by name.
            in_effect: parameters by key, including those that the laws set.
        """
        return ()
