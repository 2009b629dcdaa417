"""One more beat of every member of a batch, recorded: means, extremes, outputs, and some whole waveforms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eclsim.haemodynamics.evaluation import output_names
from eclsim.haemodynamics.measures import Measures
from eclsim.haemodynamics.outputs import output
from eclsim.haemodynamics.signals import whole_beat
from eclsim.solver.beat import beat_program
from eclsim.solver.lanes import FEW, LANES, map_parallel
from eclsim.solver.recording import all_signals
from eclsim.solver.status import Status
from eclsim.solver.steady import SteadyBeats


@dataclass(frozen=True)
class BeatRecords:
    """What was recorded of a batch; members last.

    Args:
        signals: names of the waveforms (P, Q, V and where).
        means: mean of each waveform over the beat, shape (signals, members); mmHg, mL/s, mL (stressed).
        lowest: smallest value of each waveform, likewise.
        highest: largest value of each waveform, likewise.
        names: names of the outputs.
        outputs: the registry's outputs, shape (names, members).
        phases: grid of the beat, shape (points,).
        waveforms: whole waveforms of the members asked for, shape (points, signals, kept members).
        volumes: stressed volume of each group of compartments at phase 0 [mL], by group, shape (members,).
        converged: whether the steady beat was found, shape (members,).
        beats: beats it took, shape (members,).
    """

    signals: tuple[str, ...]
    means: np.ndarray
    lowest: np.ndarray
    highest: np.ndarray
    names: tuple[str, ...]
    outputs: np.ndarray
    phases: np.ndarray
    waveforms: np.ndarray
    volumes: dict[str, np.ndarray]
    converged: np.ndarray
    beats: np.ndarray

    def mean(self, signal: str) -> np.ndarray:
        """Mean of a waveform over the beat, shape (members,)."""
        return self.means[self.signals.index(signal)]

    def output(self, name: str) -> np.ndarray:
        """An output of every member, shape (members,)."""
        return self.outputs[self.names.index(name)]


def record(steady: SteadyBeats, keep: Sequence[int] = ()) -> BeatRecords:
    """Record the steady beat of every member of a batch that is solved on one grid.

    Args:
        steady: solved batch.
        keep: members whose whole waveforms are wanted.
    """
    levels = np.unique(steady.resolution)
    if len(levels) != 1:
        raise ValueError(f"members on grids of different resolution {levels.tolist()}; record each grid by itself")
    program = beat_program(steady.batch.circuit, int(levels[0]))
    signals, names = all_signals(program.assembly), output_names(steady.batch.circuit)
    count = steady.batch.count
    size = LANES if count > FEW else 1
    chunks = [np.arange(k, min(k + size, count)) for k in range(0, count, size)]
    packed = steady.batch.packed(program)

    def one(chunk: np.ndarray) -> tuple[np.ndarray, ...]:
        series = _beat(steady, packed, chunk, size)
        measures = Measures({s: series[:, k] for k, s in enumerate(signals)}, program.grid.phases)
        means = np.stack([measures.mean(s) for s in signals])
        outputs = np.stack([output(n).compute(measures) for n in names])
        kept = series[:, :, np.isin(chunk, keep)]
        return means, series.min(axis=0), series.max(axis=0), outputs, kept

    means, lowest, highest, outputs, kept = (
        np.concatenate(parts, axis=-1) for parts in zip(*map_parallel(one, chunks), strict=True)
    )
    finite = np.isfinite(means).all(axis=0)
    return BeatRecords(
        signals, means, lowest, highest, names, outputs, program.grid.phases, kept, _volumes(steady),
        (steady.orbits.status == Status.CONVERGED) & finite, steady.orbits.beats,
    )  # fmt: skip


def _beat(steady: SteadyBeats, packed: np.ndarray, chunk: np.ndarray, size: int) -> np.ndarray:
    """Waveforms of some members over a whole beat, shape (points, signals, members)."""
    program = beat_program(steady.batch.circuit, int(steady.resolution[0]))
    trace = program.trace(all_signals(program.assembly))
    if size == 1:
        recorded = np.asarray(trace(steady.orbits.states[:, chunk[0]], packed[:, chunk[0]])[1])[..., None]
    else:
        lanes = np.resize(chunk, size)
        recorded = np.asarray(trace(steady.orbits.states[:, lanes], packed[:, lanes])[1])
    return whole_beat(recorded)[..., : len(chunk)]


def _volumes(steady: SteadyBeats) -> dict[str, np.ndarray]:
    compartments = steady.batch.circuit.compartments
    groups = dict.fromkeys(c.group for c in compartments)
    rows = {g: [i for i, c in enumerate(compartments) if c.group == g] for g in groups}
    return {group: steady.orbits.states[chosen].sum(axis=0) for group, chosen in rows.items()}
