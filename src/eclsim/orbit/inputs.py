"""Checks of a circuit's parameter values; each message names the key, the value and what is allowed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from eclsim.beat.heartbeat import HEART_RATE
from eclsim.circuit.assembly import assemble
from eclsim.circuit.network import Choice, Circuit, StartPressure, StartVolume
from eclsim.components.base import value_of
from eclsim.inputs.mistakes import ListedError
from eclsim.parameters.regulation import REGULATION, SOLVED_FOR


class InvalidInputError(ListedError):
    """Raised for values with which a circuit cannot be computed; `mistakes` holds one sentence per value."""


@dataclass(frozen=True)
class Allowed:
    """Allowed values of a circuit's parameters, in addition to being finite.

    Args:
        circuit: the circuit.
        names: names of the parameters, in the order of the compiled programs.
        above_zero: marks parameters that must be above zero, shape (names,).
        not_negative: marks parameters that must be zero or above, shape (names,).
        sites: by parameter, the sites that it selects by their index from 0.
    """

    circuit: Circuit
    names: tuple[str, ...]
    above_zero: np.ndarray
    not_negative: np.ndarray
    sites: dict[str, tuple[str, ...]]

    def refused(self, packed: np.ndarray) -> np.ndarray:
        """Whether any value of each patient is not allowed, from parameters of shape (names, patients)."""
        with np.errstate(invalid="ignore"):
            wrong = ~np.isfinite(packed)
            wrong |= self.above_zero[:, None] & (packed <= 0.0)
            wrong |= self.not_negative[:, None] & (packed < 0.0)
        result: np.ndarray = np.any(wrong, axis=0)
        for name, sites in self.sites.items():
            site = packed[self.names.index(name)]
            result = result | (site < 0.0) | (site >= len(sites)) | (site != np.floor(site))
        return result

    def reasons(self, values: Mapping[str, Any]) -> list[str]:
        """One sentence for each value of one patient that is not allowed or has no start volume."""
        result = [text for name in self.names if (text := self._reason(name, float(values[name])))]
        return result or unreachable_starts(self.circuit, values)

    def _reason(self, name: str, value: float) -> str:
        k = self.names.index(name)
        text = f"{name} = {value:g}"
        if name in self.sites and value not in range(len(self.sites[name])):
            numbers = ", ".join(f"{i} ({site})" for i, site in enumerate(self.sites[name]))
            return f"{text}: not a site of this circuit; allowed: {numbers}"
        if math.isnan(value) and name in SOLVED_FOR:
            return f"{name} responds to the gases of a steady beat, which this computation does not solve for"
        if not math.isfinite(value):
            at_rest = math.isnan(value) and name.startswith(f"{REGULATION}.")
            why = "not a number that can be computed with; allowed: a finite number"
            return f"{name}: the case at rest does not determine it; give it" if at_rest else f"{text}: {why}"
        if self.above_zero[k] and value <= 0.0:
            return f"{text}: allowed: above zero"
        if self.not_negative[k] and value < 0.0:
            return f"{text}: allowed: zero or above"
        return ""


@lru_cache(maxsize=256)
def allowed_values(circuit: Circuit) -> Allowed:
    """Allowed values of a circuit's parameters, from its components and sites."""
    above, least = {HEART_RATE}, set[str]()
    for part in (*circuit.compartments, *circuit.connections, *circuit.surroundings):
        above.update(part.component.names_of(part.component.above_zero))
        least.update(part.component.names_of(part.component.not_negative))
    for compartment in circuit.compartments:
        if isinstance(compartment.start, StartVolume):
            least.update(compartment.start.parameter_names())
    names = (HEART_RATE, *circuit.parameter_names())
    ends = (site for c in circuit.connections for site in (c.source, c.target))
    sites = {site.parameter: site.sites for site in ends if isinstance(site, Choice)}
    above_zero, not_negative = (np.array([n in group for n in names]) for group in (above, least))
    return Allowed(circuit, names, above_zero, not_negative, sites)


def unreachable_starts(circuit: Circuit, values: Mapping[str, Any]) -> list[str]:
    """One sentence for each compartment whose start pressure is reached at no volume."""
    volumes = assemble(circuit).start_volumes(values)
    return [
        f"start pressure of compartment '{c.name}' = {value_of(values, c.start.pressure):g} mmHg: at rest, "
        "no volume gives this pressure; allowed: a pressure that its passive curve reaches"
        for c, volume in zip(circuit.compartments, volumes, strict=True)
        if isinstance(c.start, StartPressure) and not np.isfinite(volume)
    ]
