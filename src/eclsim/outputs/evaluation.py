"""From orbits to numbers and waveforms: one more beat, recorded and measured."""

from __future__ import annotations

import numpy as np

from eclsim.beat.heartbeat import BeatProgram, beat_program
from eclsim.beat.recording import MEAN, RATE, all_signals, has_mean, has_rate
from eclsim.beat.vectorisation import FEW, LANES, map_parallel
from eclsim.circuit.network import Circuit
from eclsim.orbit.steady import SteadyBeats
from eclsim.outputs.measures import Measures
from eclsim.outputs.registry import available, output
from eclsim.outputs.signals import whole_beat


def output_names(circuit: Circuit) -> tuple[str, ...]:
    """All outputs that a circuit has, in the order of the registry."""
    return tuple(o.name for o in available(all_signals(beat_program(circuit).assembly)))


def needed_signals(circuit: Circuit, names: tuple[str, ...]) -> tuple[str, ...]:
    """Signals that some outputs are computed from, with the rates that place their extremes."""
    entries = [output(name) for name in names]
    signals = {signal for entry in entries for signal in entry.needs}
    rates = {signal + RATE for entry in entries for signal in entry.extremes if has_rate(circuit, signal)}
    means = {signal + MEAN for signal in signals if has_mean(circuit, signal)}
    return tuple(sorted(signals | rates | means))


def batch_outputs(
    steady: SteadyBeats, names: tuple[str, ...], wide: bool | None = None, threads: int | None = None
) -> np.ndarray:
    """Outputs of every patient of a batch, shape (outputs, patients); NaN where there is no state.

    Args:
        steady: solved orbits.
        names: of the registry.
        wide: whether to take the program for many; left out, with more than `FEW` patients.
        threads: how many run in parallel; left out, see `lanes.threads`.
    """
    found = np.full((len(names), steady.batch.count), np.nan)
    if not names:
        return found
    for level in np.unique(steady.resolution):
        members = np.flatnonzero(steady.resolution == level)
        lanes = len(members) > FEW if wide is None else wide
        size = LANES if lanes else 1
        parts = [members[k : k + size] for k in range(0, len(members), size)]
        program = beat_program(steady.batch.circuit, int(level))
        packed = steady.batch.packed(program)
        states = steady.orbits.states

        jobs = [(program, names, states[:, part], packed[:, part], lanes) for part in parts]
        measured = map_parallel(lambda job: _measure(*job), jobs, threads)
        for part, values in zip(parts, measured, strict=True):
            found[:, part] = values
    return found


def _measure(
    program: BeatProgram, names: tuple[str, ...], states: np.ndarray, packed: np.ndarray, wide: bool
) -> np.ndarray:
    """Outputs of some patients, shape (outputs, patients): of one alone, or of up to `LANES` side by side."""
    count = states.shape[1]
    if not wide:
        signals = program.signals
        recorded = program.trace(signals)(states[:, 0], packed[:, 0])[1][..., None]
    else:
        signals = needed_signals(program.assembly.circuit, names)
        lanes = np.resize(np.arange(count), LANES)
        recorded = program.trace(signals)(states[:, lanes], packed[:, lanes])[1]
    series = whole_beat(np.asarray(recorded))[..., :count]
    measures = Measures({name: series[:, k] for k, name in enumerate(signals)}, program.grid.phases)
    return np.stack([output(name).compute(measures) for name in names])
