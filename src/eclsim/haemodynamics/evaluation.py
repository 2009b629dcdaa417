"""From orbits to numbers and waveforms: one more beat, recorded and measured."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from eclsim.circuit.network import Circuit
from eclsim.haemodynamics.measures import Measures
from eclsim.haemodynamics.outputs import available, output
from eclsim.haemodynamics.signals import signals
from eclsim.solver.beat import BeatProgram, beat_program
from eclsim.solver.lanes import FEW, LANES, map_parallel
from eclsim.solver.steady import SteadyBeats


@dataclass(frozen=True)
class Evaluation:
    """Compiled evaluation of one beat of a circuit."""

    program: BeatProgram
    names: tuple[str, ...]

    def measured(self, state: Any, packed: Any) -> tuple[Any, Any]:
        """State after the beat and the outputs, shape (outputs[, patients]); uncompiled."""
        end, volumes, flows = self.program.run(state, packed, record=True)
        return end, self._outputs(self._waveforms(volumes, flows, packed), packed)

    def _waveforms(self, volumes: Any, flows: Any, packed: Any) -> dict[str, Any]:
        flows = jnp.concatenate([flows[-1:], flows[1:]])
        return signals(self.program.assembly, self.program.grid, self._values(packed), volumes, flows)

    def _values(self, packed: Any) -> dict[str, Any]:
        return dict(zip(self.program.names, packed, strict=True))

    def _outputs(self, waveforms: dict[str, Any], packed: Any) -> Any:
        measures = Measures(waveforms, self.program.grid.phases, self._values(packed))
        return jnp.stack([output(name).compute(measures) for name in self.names])

    @cached_property
    def outputs(self) -> Any:
        """Compiled map (state, parameters) -> outputs."""

        def evaluate(state: Any, packed: Any) -> Any:
            _, volumes, flows = self.program.trace(state, packed)
            return self._outputs(self._waveforms(volumes, flows, packed), packed)

        return jax.jit(evaluate)

    @cached_property
    def beat(self) -> Any:
        """Compiled map (state, parameters) -> waveforms by name, outputs."""

        def evaluate(state: Any, packed: Any) -> Any:
            _, volumes, flows = self.program.trace(state, packed)
            waveforms = self._waveforms(volumes, flows, packed)
            return waveforms, self._outputs(waveforms, packed)

        return jax.jit(evaluate)


def output_names(circuit: Circuit) -> tuple[str, ...]:
    """All outputs that a circuit has, in the order of the registry."""
    names = {"P" + c.name for c in circuit.compartments} | {"V" + c.name for c in circuit.compartments}
    names |= {"Q" + c.name for c in circuit.connections}
    names |= {"P" + c.name for c in circuit.connections if "pump" in c.name}
    return tuple(o.name for o in available(names))


@lru_cache(maxsize=128)
def evaluation(circuit: Circuit, resolution: int, names: tuple[str, ...]) -> Evaluation:
    """The evaluation of a circuit; compiled on first use and kept."""
    return Evaluation(beat_program(circuit, resolution), names)


def batch_outputs(steady: SteadyBeats, names: tuple[str, ...]) -> np.ndarray:
    """Outputs of every patient of a batch, shape (outputs, patients); NaN where there is no state."""
    found = np.full((len(names), steady.batch.count), np.nan)
    for level in np.unique(steady.resolution):
        members = np.flatnonzero(steady.resolution == level)
        run = evaluation(steady.batch.circuit, int(level), names)
        packed = steady.batch.packed(run.program)

        def part(chosen: np.ndarray, run: Any = run, packed: Any = packed) -> np.ndarray:
            if len(chosen) <= FEW:
                single = [np.asarray(run.outputs(steady.orbits.states[:, i], packed[:, i])) for i in chosen]
                return np.stack(single, axis=1)
            wide = np.resize(chosen, LANES)
            return np.asarray(run.outputs(steady.orbits.states[:, wide], packed[:, wide]))[:, : len(chosen)]

        step = 1 if len(members) <= FEW else LANES
        parts = [members[k : k + step] for k in range(0, len(members), step)]
        for chosen, values in zip(parts, map_parallel(part, parts), strict=True):
            found[:, chosen] = values
    return found
