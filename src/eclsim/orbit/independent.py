"""Independent verification solver: the circuit's differential equation by Dopri8 until it is steady.

    dV/dt = inflow - outflow,    L dQ/dt = dp - drop(Q),    Q = flow(dp) where there is no inertia

It verifies the semi-implicit beat and the orbit solver, with which it shares only the laws of the components.
Steps are adaptive and end at the break points of the activation curves, so that no step straddles a kink.
Source of the method: Prince and Dormand 1981, doi 10.1016/0771-050X(81)90010-3, as implemented in Diffrax.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from types import ModuleType
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from eclsim.beat.compilation import compiled
from eclsim.beat.grid import PhaseGrid
from eclsim.beat.recording import Moment, Recorder
from eclsim.circuit.assembly import Assembly, Constants, assemble
from eclsim.circuit.network import HEART_RATE, Circuit, Statistic
from eclsim.orbit.model import AS_PUBLISHED, PATIENT_HELD, Model
from eclsim.orbit.steady import start_state

MOST_STEPS = 100_000
"""Largest number of steps between two stops of a beat; a healthy beat takes about a thousand in all."""
BEATS_COMPARED = 20
VALVE_SMOOTHING_MMHG = 1e-6
"""A closed valve leaks CQ s / (2 sqrt(|dp|)); the component's own s = 1e-3 mmHg is 0.1 % of a weak heart."""


@dataclass(frozen=True)
class ExplicitCircuit:
    """Right-hand side of a circuit's differential equation."""

    assembly: Assembly

    def rates(self, state: Any, phase: Any, constants: Constants) -> Any:
        """d state / dt at a phase of 0 to 1."""
        assembly = self.assembly
        pressures = self._pressures(state, phase, constants)
        flows = self.flows(state, pressures, constants)
        outlets = assembly.outlets(assembly.volumes(state), constants)
        changes: list[Any] = [0.0] * len(assembly.circuit.compartments)
        for flow, (source, target) in zip(flows, assembly.ends, strict=True):
            assembly.add_at(source, changes, -flow, constants)
            assembly.add_at(target, changes, flow, constants)
        for j in assembly.inertial:
            law, path_constants = assembly.circuit.connections[j].component, constants.paths[j]
            push = self._push(j, pressures, constants) - law.pressure_drop(flows[j], path_constants)
            outlet = assembly.outlet(j, outlets, constants)
            push = push if outlet is None else push - outlet * flows[j]
            changes.append(push / law.inertance(path_constants))
        changes += [0.0] * len(assembly.layout.controllers.states)
        return jnp.stack([c + 0.0 * state[0] for c in changes])

    def signals(
        self, names: tuple[str, ...], state: Any, phase: Any, constants: Constants, period: Any
    ) -> Any:
        """Signals at one moment (see `Recorder`), shape (signals,); `period` of the beat in s."""
        flows = self.flows(state, self._pressures(state, phase, constants), constants)
        moment = Moment(self.assembly.volumes(state), flows, self._activations(phase), constants, period)
        return Recorder(self.assembly, names).pick(moment)

    def flows(self, state: Any, pressures: Any, constants: Constants) -> list[Any]:
        """Flow of every connection [mL/s]."""
        inertial, result = self.assembly.inertial_flows(state), []
        outlets = self.assembly.outlets(self.assembly.volumes(state), constants)
        for j, connection in enumerate(self.assembly.circuit.connections):
            if j in inertial:
                result.append(inertial[j])
            else:
                push, outlet = (
                    self._push(j, pressures, constants),
                    self.assembly.outlet(j, outlets, constants),
                )
                load = 0.0 if outlet is None else outlet
                result.append(connection.component.flow(push, load, constants.paths[j]))
        return result

    def _push(self, j: int, pressures: Any, constants: Constants) -> Any:
        source, target = self.assembly.ends[j]
        return self.assembly.at(source, pressures, constants) - self.assembly.at(target, pressures, constants)

    def _activations(self, phase: Any) -> list[Any]:
        return [curve.at(phase, jnp) for curve in self.assembly.activations]

    def _pressures(self, state: Any, phase: Any, constants: Constants) -> Any:
        return self.assembly.pressures(self.assembly.volumes(state), self._activations(phase), constants)[0]


def explicit_circuit(circuit: Circuit) -> ExplicitCircuit:
    """A circuit for explicit integration, with its valves almost sharp."""
    connections = (
        replace(c, component=c.component.sharpened(VALVE_SMOOTHING_MMHG)) for c in circuit.connections
    )
    return ExplicitCircuit(assemble(replace(circuit, connections=tuple(connections))))


@dataclass(frozen=True)
class AdaptiveOptions:
    """Accuracy of the integration and limits of the wait for a steady beat.

    Args:
        tolerance: relative and absolute tolerance of a step [mL, mL/s].
        change: the beat is steady once no state changes by more than this, relative to max(|state|, 1), over
            two consecutive beats. At a tolerance of 1e-8 the beat map repeats to about 1e-7. Where valves
            stay half open it repeats only to 1e-5; then the means over `BEATS_COMPARED` beats must agree as
            well as if each beat changed by half of this.
        seconds: largest simulated time [s].
    """

    tolerance: float = 1e-8
    change: float = 2e-7
    seconds: float = 300.0


@dataclass(frozen=True)
class WaitingResult:
    """Result of integrating beat after beat.

    Args:
        state: last state at phase 0, shape (states,).
        beats: number of integrated beats.
        change: largest relative change of a state over the last beat.
        drift: largest change of a volume over the last beat [mL].
        steady: whether the beat became steady.
    """

    state: np.ndarray
    beats: int
    change: float
    drift: float
    steady: bool


def _solvers() -> ModuleType:
    """Import the package of adaptive solvers, which only verification needs."""
    try:
        import diffrax
    except ModuleNotFoundError:
        raise ImportError("the adaptive solver needs diffrax: pip install 'eclsim[verify]'") from None
    return diffrax


@dataclass(frozen=True)
class AdaptiveProgram:
    """Compiled integration of one circuit; parameters are packed in the order of `names`."""

    explicit: ExplicitCircuit
    tolerance: float

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Order of the packed parameters: the heart rate, then the circuit's own."""
        return (HEART_RATE, *self.explicit.assembly.circuit.parameter_names())

    @cached_property
    def break_points(self) -> np.ndarray:
        """Phases from 0 to 1 at which steps must end."""
        inside = {p for a in self.explicit.assembly.activations for p in a.break_points if 0.0 < p < 1.0}
        return np.array([0.0, *sorted(inside), 1.0])

    @cached_property
    def advance(self) -> Any:
        """Compiled map (state, packed, start phase, end phase) -> state; NaN if it takes too many steps."""
        _solvers()  # raise the same error even if the program is stored on disk
        return compiled(self._advance, ("adaptive", self))

    def signals(self, names: tuple[str, ...]) -> Any:
        """Compiled map (states, phases, packed) -> signals, shape (points, signals)."""
        return _signals(self, names)

    def _advance(self, state: Any, packed: Any, start: Any, end: Any) -> Any:
        assembly = self.explicit.assembly
        values = assembly.in_effect(dict(zip(self.names, packed, strict=True)), state)
        constants, period = assembly.constants(values), 60.0 / values[HEART_RATE]
        diffrax = _solvers()
        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(lambda t, y, _: self.explicit.rates(y, t / period, constants)),
            diffrax.Dopri8(),
            start * period,
            end * period,
            None,
            state,
            stepsize_controller=diffrax.PIDController(self.tolerance, self.tolerance, pcoeff=0.3, icoeff=0.4),
            saveat=diffrax.SaveAt(t1=True),
            max_steps=MOST_STEPS,
            throw=False,
        )
        arrived = solution.result == diffrax.RESULTS.successful
        assert solution.ys is not None
        return jnp.where(arrived, solution.ys[0], jnp.nan)


@lru_cache(maxsize=32)
def adaptive_program(circuit: Circuit, tolerance: float = AdaptiveOptions.tolerance) -> AdaptiveProgram:
    """The integration of a circuit; compiled on first use and cached."""
    return AdaptiveProgram(explicit_circuit(circuit), tolerance)


@lru_cache(maxsize=64)
def _signals(program: AdaptiveProgram, names: tuple[str, ...]) -> Any:
    def all_points(states: Any, phases: Any, packed: Any) -> Any:
        assembly, parameters = program.explicit.assembly, dict(zip(program.names, packed, strict=True))

        def one(state: Any, phase: Any) -> Any:
            values = assembly.in_effect(parameters, state)
            constants, period = assembly.constants(values), 60.0 / values[HEART_RATE]
            return program.explicit.signals(names, state, phase, constants, period)

        return jax.vmap(one)(states, phases)

    return jax.jit(all_points)


class AdaptiveBeats:
    """Integration of one model beat after beat."""

    def __init__(self, model: Model, options: AdaptiveOptions | None = None):
        self.model = model
        self.options = options or AdaptiveOptions()
        self.program = adaptive_program(model.circuit, self.options.tolerance)
        self.packed = np.array([float(model.values[name]) for name in self.program.names])

    def beat(self, state: np.ndarray) -> np.ndarray:
        """State after one beat."""
        return self.record(state, self.program.break_points, ())[0]

    def along(self, state: np.ndarray, phases: np.ndarray) -> np.ndarray:
        """States at increasing phases, beginning with `state` at the first; shape (phases, states)."""
        result = [np.asarray(state)]
        for start, end in pairwise(phases):
            # A state that is not finite stays so and would cost the largest number of steps.
            failed = not np.isfinite(result[-1]).all()
            after = result[-1] if failed else self.program.advance(result[-1], self.packed, start, end)
            result.append(np.asarray(after))
        return np.stack(result)

    def record(
        self, state: np.ndarray, phases: np.ndarray, names: tuple[str, ...]
    ) -> tuple[np.ndarray, np.ndarray]:
        """State after one beat, and signals at the given phases of 0 to 1, shape (phases, signals)."""
        stops = np.union1d(phases, self.program.break_points)
        if self.model.circuit.controllers:
            stops = np.union1d(stops, PhaseGrid().phases)
        states = self.along(state, stops)
        after = self._regulated(stops, states)
        if not names:
            return after, np.empty((len(phases), 0))
        at_phases = states[np.searchsorted(stops, phases)]
        return after, np.asarray(self.program.signals(names)(at_phases, phases, self.packed))

    def _regulated(self, phases: np.ndarray, states: np.ndarray) -> np.ndarray:
        """State at the end of a beat, with the controllers' states updated from its readings."""
        controllers, assembly = self.model.circuit.controllers, self.program.explicit.assembly
        if not controllers:
            return states[-1]
        reads = [reading for control in controllers for reading in control.reads]
        series = self.program.signals(tuple(str(r.signal) for r in reads))(states, phases, self.packed)
        statistics = {
            Statistic.MEAN: lambda values: np.trapezoid(values, phases),
            Statistic.MAXIMUM: np.max,
            Statistic.MINIMUM: np.min,
        }
        readings = [
            statistics[r.statistic](values) for r, values in zip(reads, np.asarray(series).T, strict=True)
        ]
        parameters = dict(zip(self.program.names, self.packed, strict=True))
        period = 60.0 / assembly.in_effect(parameters, states[0])[HEART_RATE]
        after = states[-1].copy()
        after[assembly.layout.controllers.where] = assembly.next_control_states(
            states[0], readings, period, parameters
        )
        return after

    def wait(self, policy: str = AS_PUBLISHED) -> WaitingResult:
        """Integrate beat after beat from the published initial state until the beat is steady.

        With the policy "patient_held" the patient's volumes are scaled after each beat to their initial sum,
        as if primed circuits took no blood from the patient. In the steady beat the scaling has no effect.
        """
        of_patient = np.array([c.group == "patient" for c in self.model.circuit.compartments])
        state = start_state(self.model)
        layout = self.program.explicit.assembly.layout
        counted = layout.conserved(of_patient) > 0.0
        total = state[counted].sum()
        change, drift, calm, last = np.inf, np.inf, 0, deque([state], maxlen=2 * BEATS_COMPARED)
        most = int(np.ceil(self.options.seconds * self.model.values[HEART_RATE] / 60.0))
        for count in range(1, most + 1):
            after = self.beat(state).copy()
            if policy == PATIENT_HELD:
                after[counted] *= total / after[counted].sum()
            change = float(np.max(np.abs(after - state) / np.maximum(np.abs(state), layout.smallest_sizes)))
            drift = float(np.max(np.abs(after - state)[layout.volumes.where]))
            state = after
            last.append(state)
            calm = calm + 1 if change <= self.options.change else 0
            steady = calm == 2 or _oscillates_about_mean(last, 0.5 * self.options.change)
            if steady or not np.isfinite(change):
                return WaitingResult(state, count, change, drift, steady)
        return WaitingResult(state, most, change, drift, False)


def _oscillates_about_mean(last: deque[np.ndarray], change: float) -> bool:
    """Whether the states of the last beats oscillate about a constant mean."""
    if len(last) < 2 * BEATS_COMPARED:
        return False
    states = np.stack(last)
    before, after = states[:BEATS_COMPARED].mean(axis=0), states[BEATS_COMPARED:].mean(axis=0)
    return bool(np.max(np.abs(after - before) / np.maximum(np.abs(after), 1.0)) <= BEATS_COMPARED * change)
