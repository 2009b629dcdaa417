"""The slow laws of a course."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from eclsim.parameters.regulation import EXTRA_VOLUME
from eclsim.slow.law import INFLOWS, Named, SlowLaw, SlowState

if TYPE_CHECKING:
    from eclsim.circuit.network import Circuit

GIVEN, REMOVED, REFILLED = "fluid.given_ml", "fluid.removed_ml", "fluid.refilled_ml"
"""What went through the doors of the patient's blood volume."""
_HOUR = 3600.0


class VolumeLaw(SlowLaw):
    """Blood volume alone: what is given stays, what is filtered or bled is lost."""

    @property
    def states(self) -> tuple[SlowState, ...]:  # noqa: D102  (as documented in the base class; so below)
        return tuple(SlowState(name, "mL", 10.0) for name in (GIVEN, REMOVED, REFILLED))

    @property
    def reads(self) -> tuple[str, ...]:  # noqa: D102
        return ()

    def start(self, settings: Named, beat: Named) -> Named:  # noqa: D102
        return dict.fromkeys((s.name for s in self.states), np.zeros_like(settings[EXTRA_VOLUME]))

    def in_effect(self, states: Named, settings: Named) -> Named:  # noqa: D102
        return {EXTRA_VOLUME: settings[EXTRA_VOLUME] + states[GIVEN] - states[REMOVED] + states[REFILLED]}

    def rates(self, states: Named, settings: Named, beat: Named, inflows: Named) -> Named:  # noqa: D102
        zero = np.zeros_like(states[GIVEN])
        filtered = sum((v for k, v in settings.items() if k.endswith(".net_ultrafiltration_ml_h")), zero)
        given = sum((inflows[kind] for kind in INFLOWS if kind != "bleed_ml"), zero)
        return {GIVEN: given, REMOVED: inflows["bleed_ml"] + filtered / _HOUR, REFILLED: zero}


def laws_of(circuit: Circuit) -> tuple[SlowLaw, ...]:
    """The slow laws of a circuit."""
    return (VolumeLaw(),)


class Laws:
    """Several laws as one, of states in rows.

    Args:
        laws: the laws.
    """

    def __init__(self, laws: tuple[SlowLaw, ...]):
        self.laws = laws
        self.states = tuple(state for law in laws for state in law.states)
        self.names = tuple(state.name for state in self.states)
        self.scales = np.array([state.scale for state in self.states])
        self.reads = tuple(dict.fromkeys(name for law in laws for name in law.reads))

    def start(self, settings: Named, beat: Named) -> np.ndarray:
        """States at time 0, shape (states, members)."""
        found: dict[str, np.ndarray] = {}
        for law in self.laws:
            found |= law.start(settings, beat)
        return np.array([found[name] for name in self.names])

    def in_effect(self, states: np.ndarray, settings: Named) -> dict[str, np.ndarray]:
        """The settings with what slow states set."""
        named, values = self._named(states), dict(settings)
        for law in self.laws:
            values |= law.in_effect(named, values)
        return values

    def rates(self, states: np.ndarray, settings: Named, beat: Named, inflows: Named) -> np.ndarray:
        """Change of each state per second, shape (states, members)."""
        named, found = self._named(states), dict[str, np.ndarray]()
        for law in self.laws:
            found |= law.rates(named, settings, beat, inflows)
        return np.array([found[name] for name in self.names])

    def _named(self, states: np.ndarray) -> Mapping[str, np.ndarray]:
        return dict(zip(self.names, states, strict=True))
