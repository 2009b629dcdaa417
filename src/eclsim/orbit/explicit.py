"""The circuit as an ordinary differential equation: every law as it stands, nothing implicit.

    dV/dt = inflow - outflow,    L dQ/dt = dp - drop(Q),    Q = flow(dp) where there is no inertia

It shares the components with the semi-implicit beat and nothing else.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import jax.numpy as jnp

from eclsim.beat.recording import Moment, Recorder
from eclsim.circuit.assembly import Assembly, Constants, assemble
from eclsim.circuit.network import Circuit

VALVE_SMOOTHING_MMHG = 1e-6
"""A closed valve leaks CQ s / (2 sqrt(|dp|)): with the component's own 1e-3 mmHg 0.1 % of a weak heart."""


@dataclass(frozen=True)
class ExplicitCircuit:
    """Rates of change of a circuit's states."""

    assembly: Assembly

    def rates(self, state: Any, phase: Any, constants: Constants) -> Any:
        """d state / dt at a phase of 0 to 1."""
        assembly = self.assembly
        pressures = self._pressures(state, phase, constants)
        flows = self.flows(state, pressures, constants)
        changes: list[Any] = [0.0] * len(assembly.circuit.compartments)
        for flow, (source, target) in zip(flows, assembly.ends, strict=True):
            assembly.add_at(source, changes, -flow, constants)
            assembly.add_at(target, changes, flow, constants)
        for j in assembly.inertial:
            law, own = assembly.circuit.connections[j].component, constants.paths[j]
            push = self._push(j, pressures, constants)
            changes.append((push - law.pressure_drop(flows[j], own)) / law.inertance(own))
        return jnp.stack([c + 0.0 * state[0] for c in changes])

    def signals(
        self, names: tuple[str, ...], state: Any, phase: Any, constants: Constants, period: Any
    ) -> Any:
        """Signals of one moment (see `Recorder`), shape (signals,); `period` of the beat in s."""
        flows = self.flows(state, self._pressures(state, phase, constants), constants)
        moment = Moment(self.assembly.volumes(state), flows, self._activations(phase), constants, period)
        return Recorder(self.assembly, names).pick(moment)

    def flows(self, state: Any, pressures: Any, constants: Constants) -> list[Any]:
        """Flow of every connection [mL/s]."""
        own, found = self.assembly.inertial_flows(state), []
        for j, connection in enumerate(self.assembly.circuit.connections):
            if j in own:
                found.append(own[j])
            else:
                push = self._push(j, pressures, constants)
                found.append(connection.component.flow(push, 0.0, constants.paths[j]))
        return found

    def _push(self, j: int, pressures: Any, constants: Constants) -> Any:
        source, target = self.assembly.ends[j]
        return self.assembly.at(source, pressures, constants) - self.assembly.at(target, pressures, constants)

    def _activations(self, phase: Any) -> list[Any]:
        return [curve.at(phase, jnp) for curve in self.assembly.activations]

    def _pressures(self, state: Any, phase: Any, constants: Constants) -> Any:
        return self.assembly.pressures(self.assembly.volumes(state), self._activations(phase), constants)[0]


def explicit_circuit(circuit: Circuit) -> ExplicitCircuit:
    """A circuit for explicit integration, its valves all but sharp."""
    connections = (
        replace(c, component=c.component.sharpened(VALVE_SMOOTHING_MMHG)) for c in circuit.connections
    )
    return ExplicitCircuit(assemble(replace(circuit, connections=tuple(connections))))
