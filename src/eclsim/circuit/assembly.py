"""From the two tables to states and rates: what every solver needs to know of a circuit, and nothing of time.

What the numbers of a state are says its layout. All functions are written for one entry per patient of a
batch: they take lists of arrays (or of numbers) and never look at shapes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from eclsim.circuit.filling import filled_to
from eclsim.circuit.layout import StateLayout, layout_of
from eclsim.circuit.network import Choice, Circuit, Site, StartPressure
from eclsim.circuit.sweep import sweep_order
from eclsim.circuit.validation import validate
from eclsim.components.base import Activation, Values, value_of


@dataclass(frozen=True)
class End:
    """End of a connection: positions of the compartments it may attach to and the parameter that chooses."""

    positions: tuple[int, ...]
    parameter: str | None = None


@dataclass(frozen=True)
class Constants:
    """What the laws of a circuit compute once from the parameters."""

    storages: tuple[Any, ...]
    paths: tuple[Any, ...]
    weights: dict[str, tuple[Any, ...]]


@dataclass(frozen=True)
class Assembly:
    """A circuit with its states numbered.

    Args:
        circuit: both tables.
        ends: of each connection.
        inertial: positions of the connections whose flow is a state.
        activations: curves that drive its chambers.
        sweep: positions of all connections in the order in which they are solved (`sweep_order`).
    """

    circuit: Circuit
    ends: tuple[tuple[End, End], ...]
    inertial: tuple[int, ...]
    activations: tuple[Activation, ...]
    sweep: tuple[int, ...]

    @cached_property
    def layout(self) -> StateLayout:
        """What the numbers of the state are."""
        compartments = tuple(c.name for c in self.circuit.compartments)
        return layout_of(compartments, tuple(self.circuit.connections[j].name for j in self.inertial))

    def volumes(self, state: Any) -> list[Any]:
        """Stressed volume of every compartment [mL]."""
        return [state[k] for k in self.layout.volumes.positions]

    def inertial_flows(self, state: Any) -> dict[int, Any]:
        """Flow of each connection with inertia [mL/s], by its position in the table."""
        return {j: state[k] for j, k in zip(self.inertial, self.layout.flows.positions, strict=True)}

    def activation_index(self, position: int) -> int | None:
        """Which activation curve drives a compartment; None for a passive one."""
        activation = self.circuit.compartments[position].component.activation
        return None if activation is None else self.activations.index(activation)

    def touches_chamber(self, connection: int) -> bool:
        """Whether a connection may end at a compartment whose stiffness changes over the beat."""
        positions = (p for end in self.ends[connection] for p in end.positions)
        return any(not self.circuit.compartments[p].component.constant_stiffness for p in positions)

    def constants(self, values: Values) -> Constants:
        """Everything that depends on the parameters alone."""
        storages = tuple(c.component.constants(values) for c in self.circuit.compartments)
        paths = tuple(c.component.constants(values) for c in self.circuit.connections)
        weights: dict[str, tuple[Any, ...]] = {}
        for end in (e for pair in self.ends for e in pair):
            if end.parameter is not None:
                chosen = values[end.parameter]
                weights[end.parameter] = tuple(
                    (abs(chosen - k) < 0.5) * 1.0 for k in range(len(end.positions))
                )
        return Constants(storages, paths, weights)

    def pressures(self, volumes: Any, activations: Any, constants: Constants) -> tuple[list[Any], list[Any]]:
        """Pressure [mmHg] and stiffness [mmHg/mL] of every compartment."""
        found = []
        for position, compartment in enumerate(self.circuit.compartments):
            index = self.activation_index(position)
            activation = 0.0 if index is None else activations[index]
            law = compartment.component
            found.append(law.pressure(volumes[position], activation, constants.storages[position]))
        return [p for p, _ in found], [s for _, s in found]

    def at(self, end: End, quantities: Any, constants: Constants) -> Any:
        """A quantity of the compartments, read at an end."""
        if end.parameter is None:
            return quantities[end.positions[0]]
        weights = constants.weights[end.parameter]
        return sum(w * quantities[p] for w, p in zip(weights, end.positions, strict=True))

    def add_at(self, end: End, quantities: list[Any], amount: Any, constants: Constants) -> None:
        """Add an amount to the compartment at an end, in place."""
        if end.parameter is None:
            position = end.positions[0]
            quantities[position] = quantities[position] + amount
            return
        for weight, position in zip(constants.weights[end.parameter], end.positions, strict=True):
            quantities[position] = quantities[position] + weight * amount

    def start_volumes(self, values: Values) -> list[Any]:
        """Stressed volume of every compartment at the start [mL]."""
        return [_start_volume(c, values) for c in self.circuit.compartments]

    def start_state(self, values: Values) -> np.ndarray:
        """State of one patient at the start: start volumes, flows at rest; shape (states,)."""
        state = np.zeros(self.layout.size)
        state[self.layout.volumes.where] = [float(v) for v in self.start_volumes(values)]
        return state


def _start_volume(compartment: Any, values: Values) -> Any:
    start = compartment.start
    if isinstance(start, StartPressure):
        pressure = value_of(values, start.pressure)
        if not compartment.component.constant_stiffness:
            return filled_to(compartment.component, pressure, values)
        at_rest, stiffness = compartment.component.pressure(0.0, 0.0, compartment.component.constants(values))
        return (pressure - at_rest) / stiffness
    volume = value_of(values, start.volume)
    return volume if start.fraction_of is None else volume * value_of(values, start.fraction_of)


@lru_cache(maxsize=256)
def assemble(circuit: Circuit) -> Assembly:
    """Number the states of a circuit; raises `CircuitError` if it does not hang together."""
    validate(circuit)
    position = {c.name: k for k, c in enumerate(circuit.compartments)}
    ends = tuple((_end(c.source, position), _end(c.target, position)) for c in circuit.connections)
    inertial = tuple(j for j, c in enumerate(circuit.connections) if c.component.inertial)
    curves = dict.fromkeys(c.component.activation for c in circuit.compartments if c.component.activation)
    return Assembly(circuit, ends, inertial, tuple(curves), sweep_order(circuit))


def _end(site: Site, position: dict[str, int]) -> End:
    if isinstance(site, Choice):
        return End(tuple(position[s] for s in site.sites), site.parameter)
    return End((position[site],))
