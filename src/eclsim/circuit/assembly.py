"""Assembly of a circuit's tables into a numbered state and functions for all solvers, independent of time.

`StateLayout` describes the elements of a state. All functions serve batches: they take sequences of arrays
(one entry per patient) or of numbers, and do not depend on shapes.

Every solver accesses a state through its layout, so that a new kind of state only needs a new block here.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import jax
import numpy as np

from eclsim.circuit.network import Choice, Circuit, Compartment, Connection, Site, sites_of
from eclsim.circuit.signals import Kind, Signal
from eclsim.circuit.validation import validate
from eclsim.circuit.volumes import start_volume
from eclsim.components.base import Activation, Number, Values

States = np.ndarray | jax.Array
"""State vectors along the first axis, shape (states[, patients])."""


class End(NamedTuple):
    """End of a connection: indices of its possible compartments and the parameter that selects one."""

    positions: tuple[int, ...]
    parameter: str | None = None


class Constants(NamedTuple):
    """Constants of the laws, which depend only on the parameters; `weights` select the sites of ends."""

    storages: tuple[object, ...]
    paths: tuple[object, ...]
    weights: Mapping[str, tuple[Number, ...]]
    surroundings: tuple[object, ...] = ()


@dataclass(frozen=True)
class Assembly:
    """A circuit with its states numbered.

    Args:
        circuit: the circuit.
        ends: both ends of each connection.
        inertial: indices of the connections whose flow is a state.
        activations: activation curves of its chambers.
        sweep: indices of all connections in the order in which they are solved (`sweep_order`).
    """

    circuit: Circuit
    ends: tuple[tuple[End, End], ...]
    inertial: tuple[int, ...]
    activations: tuple[Activation, ...]
    sweep: tuple[int, ...]

    @cached_property
    def layout(self) -> StateLayout:
        """Layout of the state."""
        return layout_of(
            [c.name for c in self.circuit.compartments],
            [self.circuit.connections[j].name for j in self.inertial],
            [(f"{c.name}.{s.name}", s.scale) for c in self.circuit.controllers for s in c.component.states],
        )

    def volumes(self, state: States) -> list[Number]:
        """Stressed volume of every compartment [mL]."""
        return [state[k] for k in self.layout.volumes.positions]

    def inertial_flows(self, state: States) -> dict[int, Number]:
        """Flow of each connection with inertia [mL/s], by the connection's index."""
        return {j: state[k] for j, k in zip(self.inertial, self.layout.flows.positions, strict=True)}

    def activation_index(self, position: int) -> int | None:
        """Index of the activation curve of a compartment; None for a passive compartment."""
        activation = self.circuit.compartments[position].component.activation
        return None if activation is None else self.activations.index(activation)

    def touches_chamber(self, connection: int) -> bool:
        """Whether a connection may end at a compartment whose stiffness changes over the beat."""
        positions = (p for end in self.ends[connection] for p in end.positions)
        return any(not self.circuit.compartments[p].component.constant_stiffness for p in positions)

    def constants(self, values: Values) -> Constants:
        """Constants that depend only on the parameters."""
        storages = tuple(c.component.constants(values) for c in self.circuit.compartments)
        paths = tuple(c.component.constants(values) for c in self.circuit.connections)
        weights: dict[str, tuple[Number, ...]] = {}
        for end in (e for pair in self.ends for e in pair):
            if end.parameter is not None:
                chosen = values[end.parameter]
                weights[end.parameter] = tuple(
                    (abs(chosen - k) < 0.5) * 1.0 for k in range(len(end.positions))
                )
        surroundings = tuple(s.component.constants(values) for s in self.circuit.surroundings)
        return Constants(storages, paths, weights, surroundings)

    @cached_property
    def enclosed(self) -> tuple[tuple[int, ...], ...]:
        """Indices of the compartments in each surrounding."""
        place = {c.name: k for k, c in enumerate(self.circuit.compartments)}
        return tuple(tuple(place[name] for name in s.members) for s in self.circuit.surroundings)

    def surrounding_pressures(
        self, volumes: Sequence[Number], constants: Constants
    ) -> list[tuple[Number, Number]]:
        """Pressure [mmHg] that each surrounding adds to its members, and its slope [mmHg/mL]."""
        return [
            around.component.pressure(sum((volumes[k] for k in inside[1:]), start=volumes[inside[0]]), own)
            for around, inside, own in zip(
                self.circuit.surroundings, self.enclosed, constants.surroundings, strict=True
            )
        ]

    def gained(self, connection: int, constants: Constants) -> dict[int, Number]:
        """Volume change of each affected surrounding per unit of flow through a connection."""
        result = dict[int, Number]()
        for k, inside in enumerate(self.enclosed):
            shares = [float(p in inside) for p in range(len(self.circuit.compartments))]
            source, target = self.ends[connection]
            if {shares[p] for p in (*source.positions, *target.positions)} != {shares[source.positions[0]]}:
                result[k] = self.at(target, shares, constants) - self.at(source, shares, constants)
        return result

    @cached_property
    def narrowing(self) -> tuple[int, ...]:
        """Indices of the compartments with an outlet resistance."""
        return tuple(k for k, c in enumerate(self.circuit.compartments) if c.component.narrows)

    def outlets(self, volumes: Sequence[Number], constants: Constants) -> list[Number] | None:
        """Outlet resistance [mmHg s/mL] of each compartment; None if no compartment has one."""
        if not self.narrowing:
            return None
        result: list[Number] = [0.0] * len(volumes)
        for k in self.narrowing:
            law = self.circuit.compartments[k].component
            result[k] = law.outlet(volumes[k], constants.storages[k])
        return result

    def outlet(self, connection: int, outlets: list[Number] | None, constants: Constants) -> Number | None:
        """Outlet resistance at the source of a connection; None if no possible source has one."""
        source = self.ends[connection][0]
        if outlets is None or not set(source.positions) & set(self.narrowing):
            return None
        return self.at(source, outlets, constants)

    def pressures(
        self,
        volumes: Sequence[Number],
        activations: Sequence[Number] | States,
        constants: Constants,
        around: Sequence[tuple[Number, Number]] | None = None,
    ) -> tuple[list[Number], list[Number]]:
        """Pressure [mmHg] of every compartment, and stiffness [mmHg/mL] of its own wall.

        `around` holds the `surrounding_pressures` if they are already known.
        """
        pairs = []
        for position, compartment in enumerate(self.circuit.compartments):
            index = self.activation_index(position)
            activation = 0.0 if index is None else activations[index]
            law = compartment.component
            pairs.append(law.pressure(volumes[position], activation, constants.storages[position]))
        pressures = [p for p, _ in pairs]
        around = self.surrounding_pressures(volumes, constants) if around is None else around
        for (outside, _), inside in zip(around, self.enclosed, strict=True):
            for position in inside:
                pressures[position] = pressures[position] + outside
        return pressures, [s for _, s in pairs]

    def at(self, end: End, quantities: Sequence[Number], constants: Constants) -> Number:
        """Value of a compartment quantity at an end of a connection."""
        if end.parameter is None:
            return quantities[end.positions[0]]
        weights = constants.weights[end.parameter]
        return sum(w * quantities[p] for w, p in zip(weights, end.positions, strict=True))

    def add_at(self, end: End, quantities: list[Number], amount: Number, constants: Constants) -> None:
        """Add an amount in place to the quantity of the compartment at an end of a connection."""
        if end.parameter is None:
            position = end.positions[0]
            quantities[position] = quantities[position] + amount
            return
        for weight, position in zip(constants.weights[end.parameter], end.positions, strict=True):
            quantities[position] = quantities[position] + weight * amount

    def in_effect(self, values: Values, state: States) -> Values:
        """Parameter values in the beat that starts from a state: as given, then changed by controllers."""
        if not self.circuit.controllers:
            return values
        acted = dict(values)
        for control, states in zip(self.circuit.controllers, self._control_states(state), strict=True):
            law, given = control.component, [acted[name] for name in control.acts_on]
            acted.update(
                zip(control.acts_on, law.in_effect(states, given, law.constants(values)), strict=True)
            )
        return acted

    def next_control_states(
        self, state: States, readings: Sequence[Number], period: Number, values: Values
    ) -> list[Number]:
        """States of all controllers after the beat that starts from a state.

        Args:
            state: state at the beginning of the beat.
            readings: readings of the beat, of all controllers one after the other.
            period: length of the beat [s].
            values: given values of the parameters.
        """
        rest, following = list(readings), list[Number]()
        for control, states in zip(self.circuit.controllers, self._control_states(state), strict=True):
            own, rest = rest[: len(control.reads)], rest[len(control.reads) :]
            law = control.component
            following += law.next_states(states, own, period, law.constants(values))
        return following

    def _control_states(self, state: States) -> list[list[Number]]:
        """States of each controller."""
        rest = [state[k] for k in self.layout.controllers.positions]
        own = []
        for control in self.circuit.controllers:
            count = len(control.component.states)
            own.append(rest[:count])
            rest = rest[count:]
        return own

    def start_volumes(self, values: Values) -> list[Number]:
        """Stressed volume of every compartment at the start [mL]."""
        return [start_volume(c, values) for c in self.circuit.compartments]

    @cached_property
    def start_names(self) -> tuple[str, ...]:
        """Names of the parameters from which start volumes are computed."""
        return tuple(dict.fromkeys(name for _, names in self._read_by_compartments for name in names))

    def start_changes(self, before: Values, now: Values) -> list[Number]:
        """Change of each compartment's start volume [mL] of one patient between two sets of values."""
        return [
            start_volume(c, now) - start_volume(c, before) if any(before[n] != now[n] for n in names) else 0.0
            for c, names in self._read_by_compartments
        ]

    @cached_property
    def _read_by_compartments(self) -> list[tuple[Compartment, tuple[str, ...]]]:
        return [(c, c.parameter_names()) for c in self.circuit.compartments]

    def start_state(self, values: Values) -> np.ndarray:
        """Initial state of one patient: start volumes, zero flows, controllers' start; shape (states,)."""
        state = np.zeros(self.layout.size)
        state[self.layout.volumes.where] = [float(v) for v in self.start_volumes(values)]
        laws = [c.component for c in self.circuit.controllers]
        started = [float(number) for law in laws for number in law.start(law.constants(values))]
        state[self.layout.controllers.where] = started
        return state


@lru_cache(maxsize=256)
def assemble(circuit: Circuit) -> Assembly:
    """Number the states of a circuit; raises `CircuitError` if the circuit is not consistent."""
    validate(circuit)
    position = {c.name: k for k, c in enumerate(circuit.compartments)}
    ends = tuple((_end(c.source, position), _end(c.target, position)) for c in circuit.connections)
    inertial = tuple(j for j, c in enumerate(circuit.connections) if c.component.inertial)
    curves = dict.fromkeys(c.component.activation for c in circuit.compartments if c.component.activation)
    return Assembly(circuit, ends, inertial, tuple(curves), sweep_order(circuit))


def _end(site: Site, position: Mapping[str, int]) -> End:
    if isinstance(site, Choice):
        return End(tuple(position[s] for s in site.sites), site.parameter)
    return End((position[site],))


# --- order in which connections are solved ---------------------------------------------------------


def sweep_order(circuit: Circuit) -> tuple[int, ...]:
    """Indices of all connections in the order in which they are solved.

    A step solves each flow with the latest pressures at its ends (Gauss-Seidel), so its result depends
    slightly on the order, within the error of the step. The order follows from which compartments are joined
    and from names, never from the order of the table.

    Groups are solved one by one, that with most connections first: the patient, ECMO, CRRT, an assist device.
    Within a group the order follows the flow from where blood enters. A closed loop has no such place; it is
    cut after the connection whose name is last in the alphabet, which is the systemic vein (`svn`) in a
    patient.
    """
    groups: dict[str, dict[str, Connection]] = {}
    for connection in circuit.connections:
        groups.setdefault(connection.group, {})[connection.name] = connection
    place = {connection.name: k for k, connection in enumerate(circuit.connections)}
    own = {c.name: c.group for c in circuit.compartments}
    order: list[int] = []
    for group in sorted(groups, key=lambda g: (-len(groups[g]), g)):
        inside = {name for name, of in own.items() if of == group}
        order += [place[name] for name in _in_flow_order(groups[group], inside)]
    return tuple(order)


def _in_flow_order(connections: dict[str, Connection], inside: set[str]) -> list[str]:
    """Names of the connections of a group, each after one that ends where it begins, if there is one."""
    ends = {name: set(sites_of(c.target)) & inside for name, c in connections.items()}
    begins = {name: set(sites_of(c.source)) & inside for name, c in connections.items()}
    left, order = set(connections), list[str]()
    while left:
        behind = [name for name in left if order and ends[order[-1]] & begins[name]]
        chosen = min(behind or _entrances(left, begins, ends))
        order.append(chosen)
        left.remove(chosen)
    return order


def _entrances(left: set[str], begins: dict[str, set[str]], ends: dict[str, set[str]]) -> list[str]:
    """Connections with no predecessor; in a loop those after the name that is last in the alphabet."""
    after = {name: [other for other in left if ends[name] & begins[other]] for name in left}
    led_to = {other for others in after.values() for other in others}
    return sorted(left - led_to) or after[max(name for name in left if after[name])]


# --- layout of the state vector -------------------------------------------------------------------


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
