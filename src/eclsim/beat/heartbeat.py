"""One heartbeat: map from the state at phase 0 to the state at phase 1 by semi-implicit steps.

Each step is the two-stage, second-order, L-stable SDIRK method (gamma = 1 - 1/sqrt 2; the implicit half of
ARS(2,2,2), Ascher, Ruuth and Spiteri 1997, doi 10.1016/S0168-9274(97)00056-1). In a stage with weight
k = gamma h every flow solves its own law together with the response of the two compartments it joins,

    dp* = (k (S_up + S_down) + L / k) Q + drop(Q),      S = dP/dV,

which each component solves in closed form. One Gauss-Seidel sweep runs over all connections in the direction
of flow (`eclsim.circuit.assembly.sweep_order`), a second one over those that end at a heart chamber. Volumes
change by the flows alone, so blood is conserved to rounding.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from eclsim.beat.compilation import compiled
from eclsim.beat.grid import STEPS_PER_BLOCK, PhaseGrid
from eclsim.beat.recording import MEAN, Moment, Readings, Recorder, all_signals, with_means, with_rates
from eclsim.circuit.assembly import Assembly, Constants, States, assemble
from eclsim.circuit.network import HEART_RATE, Circuit
from eclsim.components.base import Number, Values

GAMMA = 1.0 - 1.0 / math.sqrt(2.0)


RecordedBeat = Callable[[States, States], tuple[jax.Array, jax.Array]]
"""Map (state, parameters) -> state after one beat, signals at the end of every step."""


class StepConstants(NamedTuple):
    """Constants for a fixed step size: one entry per compartment or connection."""

    weight: Number
    compliance_load: list[Number]
    inertia_load: list[Number | None]
    fixed_load: list[Number | None]
    conductance: list[Number | None]


class Linearised(NamedTuple):
    """A stage linearised about given volumes: one entry per compartment or surrounding.

    Attributes:
        pressures: pressures of the compartments [mmHg], updated as flows are solved.
        loads: stiffness of the compartments' walls times the stage's weight.
        outlets: outlet resistances [mmHg s/mL]; None if there are none.
        around: slopes of the surroundings' pressures times the stage's weight.
    """

    pressures: list[Number]
    loads: list[Number]
    outlets: list[Number] | None
    around: list[Number]


class StepTables(NamedTuple):
    """Values that differ from step to step; the first two axes are blocks and steps.

    Attributes:
        activations: activations at both stages, (2, curves).
        weights: weight of each signal in a sum over the beat, (signals,).
        readings: weights of the step in means of readings (`Readings.weights`).
    """

    activations: States
    weights: States | None
    readings: States | None


class Carry(NamedTuple):
    """State carried through steps: volumes and flows, weighted sums of signals, readings of controllers."""

    volumes: list[Number]
    flows: list[Number]
    sums: list[Number]
    readings: list[Number]


@dataclass(frozen=True, eq=False)
class BeatProgram:
    """Compiled heartbeats of one circuit on one grid.

    States have the shape (states,) for one patient or (states, patients); parameters (names,) or
    (names, patients), in the order of `names`.
    """

    assembly: Assembly
    grid: PhaseGrid

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Order of the packed parameters: the heart rate, then the circuit's own."""
        return (HEART_RATE, *self.assembly.circuit.parameter_names())

    @cached_property
    def signals(self) -> tuple[str, ...]:
        """All signals of the circuit, followed by the rates and the means that exist."""
        circuit = self.assembly.circuit
        return with_means(circuit, with_rates(circuit, all_signals(self.assembly)))

    @cached_property
    def primary(self) -> tuple[str, ...]:
        """Signals from which all others follow: volumes, flows, and means of the flows of one-way paths."""
        return with_means(self.assembly.circuit, (*self._volumes, *self._flows))

    @cached_property
    def _volumes(self) -> tuple[str, ...]:
        return tuple("V" + c.name for c in self.assembly.circuit.compartments)

    @cached_property
    def _flows(self) -> tuple[str, ...]:
        return tuple("Q" + c.name for c in self.assembly.circuit.connections)

    def trace(self, signals: tuple[str, ...]) -> RecordedBeat:
        """Compiled beat that records signals (see `Recorder`) in the shape (steps, signals[, patients])."""
        return _trace(self, signals)

    def run(
        self, state: States, packed: States, signals: tuple[str, ...] = (), weights: States | None = None
    ) -> tuple[jax.Array, jax.Array]:
        """State after one beat, and signals; not compiled, for use inside other compiled functions.

        With weights (steps, signals) the weighted sum of each signal over the steps is returned instead,
        shape (signals[, patients]): any mean, and to first order any extreme, is such a sum.
        """
        given, constants, period = self._in_effect(state, packed)
        recorder, readings = Recorder(self.assembly, signals), Readings(self.assembly)

        def block(carry: Carry, inputs: tuple[Number, StepTables]) -> tuple[Carry, jax.Array | None]:
            length, tables = inputs
            steps = self._step_constants(GAMMA * period * length, constants)

            def step(carry: Carry, now: StepTables) -> tuple[Carry, jax.Array | None]:
                volumes, flows, means = self._step(carry, now.activations, steps, constants)
                moment = Moment(volumes, flows, now.activations[1], constants, period, means)
                picked = recorder.pick(moment)
                updated = readings.updated(carry.readings, moment, now.readings)
                if now.weights is None:
                    return Carry(volumes, flows, carry.sums, updated), picked
                sums = [total + now.weights[k] * picked[k] for k, total in enumerate(carry.sums)]
                return Carry(volumes, flows, sums, updated), None

            return jax.lax.scan(step, carry, tables)

        volumes, flows = self._start(state, constants, period)
        zero = jnp.zeros_like(volumes[0])
        sums: list[Number] = [] if weights is None else [zero] * len(signals)
        inputs = jnp.asarray(self.grid.block_steps), self._tables(weights, readings)
        carry = Carry(volumes, flows, sums, readings.initial(zero))
        carry, recorded = jax.lax.scan(block, carry, inputs)
        following = self.assembly.next_control_states(state, carry.readings, period, given)
        inertial = (carry.flows[j] for j in self.assembly.inertial)
        end = jnp.stack([*carry.volumes, *inertial, *(number + zero for number in following)])
        if weights is not None:
            return end, jnp.stack(carry.sums) if carry.sums else jnp.zeros((0, *end.shape[1:]))
        assert recorded is not None
        return end, recorded.reshape(self.grid.n_steps, *recorded.shape[2:])

    def derived(self, recorded: States, state: States, packed: States, signals: tuple[str, ...]) -> jax.Array:
        """Signals of a beat, computed from its start state and recorded `primary` signals; not compiled."""
        _, constants, period = self._in_effect(state, packed)
        recorder = Recorder(self.assembly, signals)

        def step(_: None, now: tuple[States, jax.Array]) -> tuple[None, jax.Array]:
            own = dict(zip(self.primary, now[0], strict=True))
            volumes, flows = [own[n] for n in self._volumes], [own[n] for n in self._flows]
            means = [own.get(n + MEAN, own[n]) for n in self._flows]
            return None, recorder.pick(Moment(volumes, flows, now[1], constants, period, means))

        return jax.lax.scan(step, None, (recorded, jnp.asarray(self._activations[:, 1])))[1]

    def _in_effect(self, state: States, packed: States) -> tuple[Values, Constants, Number]:
        """Given parameters; constants of the laws and period [s] as the controllers set them in this beat."""
        given = dict(zip(self.names, packed, strict=True))
        values = self.assembly.in_effect(given, state)
        return given, self.assembly.constants(values), 60.0 / values[HEART_RATE]

    @cached_property
    def _activations(self) -> np.ndarray:
        """Activations at both stages of each step, shape (steps, 2, curves)."""
        nodes = self.grid.phases
        stages = np.stack([nodes[:-1] + GAMMA * np.diff(nodes), nodes[1:]], axis=1)
        curves = [a.at(stages, np) for a in self.assembly.activations]
        return np.stack(curves, axis=-1) if curves else np.zeros((*stages.shape, 0))

    def _tables(self, weights: States | None, readings: Readings) -> StepTables:
        """Tables of the values that differ from step to step, in blocks of steps."""
        blocks, activations = (len(self.grid.block_steps), STEPS_PER_BLOCK), self._activations
        of_readings = readings.weights(np.diff(self.grid.phases))
        return StepTables(
            jnp.asarray(activations.reshape(*blocks, *activations.shape[1:])),
            None if weights is None else weights.reshape(*blocks, weights.shape[1]),
            None if of_readings is None else jnp.asarray(of_readings.reshape(*blocks, -1)),
        )

    def _start(
        self, state: States, constants: Constants, period: Number
    ) -> tuple[list[Number], list[Number]]:
        """Volumes and flows of all connections at phase 0."""
        assembly = self.assembly
        volumes, inertial = assembly.volumes(state), assembly.inertial_flows(state)
        zero = jnp.zeros_like(volumes[0])
        activations = [float(a.at(np.array(0.0), np)) for a in assembly.activations]
        pressures, stiffness = assembly.pressures(volumes, activations, constants)
        outlets = assembly.outlets(volumes, constants)
        weight = GAMMA * period * self.grid.systolic_step
        flows = []
        for j, (connection, (source, target)) in enumerate(
            zip(assembly.circuit.connections, assembly.ends, strict=True)
        ):
            if j in inertial:
                flows.append(inertial[j])
                continue
            drop = assembly.at(source, pressures, constants) - assembly.at(target, pressures, constants)
            load = assembly.at(source, stiffness, constants) + assembly.at(target, stiffness, constants)
            outlet = assembly.outlet(j, outlets, constants)
            total = weight * load if outlet is None else weight * load + outlet
            flows.append(connection.component.flow(drop, total, constants.paths[j]) + zero)
        return volumes, flows

    def _step_constants(self, weight: Number, constants: Constants) -> StepConstants:
        assembly = self.assembly
        loads: list[Number] = []
        for compartment, law in zip(assembly.circuit.compartments, constants.storages, strict=True):
            fixed = compartment.component.constant_stiffness
            loads.append(weight * compartment.component.pressure(0.0, 0.0, law)[1] if fixed else 0.0)
        inertia, fixed_load, conductance = [], [], []
        for j, connection in enumerate(assembly.circuit.connections):
            law, path = connection.component, constants.paths[j]
            inertia.append(law.inertance(path) / weight if law.inertial else None)
            if assembly.touches_chamber(j):
                fixed_load.append(None)
                conductance.append(None)
                continue
            source, target = assembly.ends[j]
            load = assembly.at(source, loads, constants) + assembly.at(target, loads, constants)
            total = load if inertia[j] is None else load + inertia[j]
            fixed_load.append(load)
            conductance.append(1.0 / (total + law.resistance(path)) if law.linear else None)
        return StepConstants(weight, loads, inertia, fixed_load, conductance)

    def _step(
        self, carry: Carry, activations: States, steps: StepConstants, constants: Constants
    ) -> tuple[list[Number], list[Number], list[Number]]:
        """Take one step: volumes and flows after it, and mean flows over it.

        Stage 1 at gamma h from the start, stage 2 at h from start + (1 - gamma) h f(stage 1).
        """

        @jax.jit  # one trace for both stages: halves the time to trace tangents
        def stage(
            base_v: list[Number], base_q: list[Number], guess: list[Number], curves: States
        ) -> tuple[list[Number], list[Number]]:
            return self._stage(base_v, base_q, guess, curves, steps, constants)

        volumes, flows = carry.volumes, carry.flows
        middle_v, middle_q = stage(volumes, flows, flows, activations[0])
        ratio = (1.0 - GAMMA) / GAMMA
        base_v = [a + ratio * (b - a) for a, b in zip(volumes, middle_v, strict=True)]
        base_q = [a + ratio * (b - a) for a, b in zip(flows, middle_q, strict=True)]
        end_v, end_q = stage(base_v, base_q, middle_q, activations[1])
        return end_v, end_q, [(1.0 - GAMMA) * a + GAMMA * b for a, b in zip(middle_q, end_q, strict=True)]

    def _stage(
        self,
        base_v: Sequence[Number],
        base_q: Sequence[Number],
        guess: Sequence[Number],
        activations: States,
        steps: StepConstants,
        constants: Constants,
    ) -> tuple[list[Number], list[Number]]:
        """Solve V = base_v + k dV/dt, Q = base_q + k dQ/dt for volumes and flows."""
        assembly = self.assembly
        flows = list(guess)
        volumes = self._volumes_after(base_v, flows, steps, constants)
        first = self._linearised(volumes, activations, steps, constants)
        for j in assembly.sweep:
            self._solve(j, flows, first, base_q, steps, constants)
        volumes = self._volumes_after(base_v, flows, steps, constants)
        again = self._linearised(volumes, activations, steps, constants)
        fixed = (c.component.constant_stiffness for c in assembly.circuit.compartments)
        both = zip(first.pressures, again.pressures, fixed, strict=True)
        again = again._replace(pressures=[old if keep else new for old, new, keep in both])
        for j in assembly.sweep:
            if assembly.touches_chamber(j):
                self._solve(j, flows, again, base_q, steps, constants)
        return self._volumes_after(base_v, flows, steps, constants), flows

    def _solve(
        self,
        j: int,
        flows: list[Number],
        stage: Linearised,
        base_q: Sequence[Number],
        steps: StepConstants,
        constants: Constants,
    ) -> None:
        """Solve one connection for its flow and update the pressures at both ends and in surroundings."""
        assembly, (pressures, loads, outlets, around) = self.assembly, stage
        source, target = assembly.ends[j]
        law = assembly.circuit.connections[j].component
        load = steps.fixed_load[j]
        if load is None:
            load = assembly.at(source, loads, constants) + assembly.at(target, loads, constants)
        gained = assembly.gained(j, constants)
        for k, share in gained.items():
            load = load + share * share * around[k]
        push = assembly.at(source, pressures, constants) - assembly.at(target, pressures, constants)
        push = push + load * flows[j]
        inertia, conductance = steps.inertia_load[j], steps.conductance[j]
        if inertia is not None:
            push = push + inertia * base_q[j]
        if conductance is not None:
            flow = push * conductance
        else:
            total = load if inertia is None else load + inertia
            outlet = assembly.outlet(j, outlets, constants)
            flow = law.flow(push, total if outlet is None else total + outlet, constants.paths[j])
        change = flow - flows[j]
        flows[j] = flow
        for k, share in gained.items():
            for position in assembly.enclosed[k]:
                pressures[position] = pressures[position] + share * around[k] * change
        assembly.add_at(source, pressures, -assembly.at(source, loads, constants) * change, constants)
        assembly.add_at(target, pressures, assembly.at(target, loads, constants) * change, constants)

    def _linearised(
        self, volumes: Sequence[Number], activations: States, steps: StepConstants, constants: Constants
    ) -> Linearised:
        """Pressures, stiffness and outlet resistances at given volumes."""
        around = self.assembly.surrounding_pressures(volumes, constants)
        pressures, stiffness = self.assembly.pressures(volumes, activations, constants, around)
        compartments = self.assembly.circuit.compartments
        loads: list[Number] = [
            fixed if c.component.constant_stiffness else steps.weight * s
            for c, s, fixed in zip(compartments, stiffness, steps.compliance_load, strict=True)
        ]
        outlets = self.assembly.outlets(volumes, constants)
        return Linearised(pressures, loads, outlets, [steps.weight * slope for _, slope in around])

    def _volumes_after(
        self, base: Sequence[Number], flows: Sequence[Number], steps: StepConstants, constants: Constants
    ) -> list[Number]:
        """Volumes after the flows have acted for the stage's weight."""
        volumes = list(base)
        for flow, (source, target) in zip(flows, self.assembly.ends, strict=True):
            amount = steps.weight * flow
            self.assembly.add_at(source, volumes, -amount, constants)
            self.assembly.add_at(target, volumes, amount, constants)
        return volumes


def beat_program(circuit: Circuit, resolution: int = 1) -> BeatProgram:
    """The beat of a circuit on the grid of a resolution; compiled on first use and cached."""
    return _program(circuit.without_exchanges(), resolution)


@lru_cache(maxsize=64)
def _program(circuit: Circuit, resolution: int) -> BeatProgram:
    return BeatProgram(assemble(circuit), PhaseGrid(resolution))


@lru_cache(maxsize=256)
def _trace(program: BeatProgram, signals: tuple[str, ...]) -> RecordedBeat:
    return compiled(lambda state, packed: program.run(state, packed, signals), ("trace", program, signals))
