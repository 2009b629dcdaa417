"""One more beat of every member of a batch, recorded: means, extremes, outputs, and some whole waveforms.

A member without a steady beat has no number here: all of its values are NaN, and its status says why.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eclsim.beat.heartbeat import beat_program
from eclsim.beat.recording import all_signals, with_means, with_rates
from eclsim.beat.vectorisation import FEW, LANES, map_parallel
from eclsim.circuit.assembly import assemble
from eclsim.orbit.status import Status
from eclsim.orbit.steady import SteadyBeats
from eclsim.outputs.evaluation import output_names
from eclsim.outputs.measures import Measures
from eclsim.outputs.registry import output
from eclsim.outputs.signals import whole_beat


@dataclass(frozen=True)
class BeatRecords:
    """What was recorded of a batch; members last. NaN for members without a steady beat.

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
        status: how the search for the steady beat ended, a `Status` for each member, shape (members,).
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
    status: np.ndarray
    beats: np.ndarray

    @property
    def converged(self) -> np.ndarray:
        """Whether the steady beat was found, shape (members,)."""
        return self.status == Status.CONVERGED

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
        raise ValueError(
            f"members on grids of different resolution {levels.tolist()}; record each grid by itself"
        )
    program = beat_program(steady.batch.circuit, int(levels[0]))
    signals, names = all_signals(program.assembly), output_names(steady.batch.circuit)
    recorded = with_means(steady.batch.circuit, with_rates(steady.batch.circuit, signals))
    packed = steady.batch.packed(program)
    blocks = [np.arange(k, min(k + LANES, steady.batch.count)) for k in range(0, steady.batch.count, LANES)]
    wide = steady.batch.count > FEW
    parts = []
    for block in blocks:
        series = _beats(steady, packed, block, wide, recorded)
        measures = Measures({s: series[:, k] for k, s in enumerate(recorded)}, program.grid.phases)
        series = series[:, : len(signals)]
        means = np.stack([measures.mean(s) for s in signals])
        outputs = np.stack([output(n).compute(measures) for n in names])
        kept = series[:, :, np.isin(block, keep)]
        parts.append((means, series.min(axis=0), series.max(axis=0), outputs, kept))
    means, lowest, highest, outputs, kept = (np.concatenate(p, axis=-1) for p in zip(*parts, strict=True))
    status = _status(steady, np.concatenate((means, outputs)))
    known = status == Status.CONVERGED
    for values in (means, lowest, highest, outputs):
        values[:, ~known] = np.nan
    kept[:, :, ~known[np.isin(np.arange(steady.batch.count), keep)]] = np.nan
    volumes = {group: np.where(known, ml, np.nan) for group, ml in _volumes(steady).items()}
    return BeatRecords(
        signals, means, lowest, highest, names, outputs, program.grid.phases, kept, volumes, status,
        steady.orbits.beats,
    )  # fmt: skip


def _status(steady: SteadyBeats, values: np.ndarray) -> np.ndarray:
    """How each search ended; a beat whose numbers are not all finite is no beat. Shape (members,)."""
    status = np.array(steady.orbits.status)
    lost = (status != Status.INVALID_INPUT) & ~np.isfinite(values).all(axis=0)
    return np.where(lost, Status.NOT_FINITE, status)


def _beats(
    steady: SteadyBeats, packed: np.ndarray, block: np.ndarray, wide: bool, signals: tuple[str, ...]
) -> np.ndarray:
    """Waveforms of up to `LANES` members over a whole beat, shape (points, signals, members)."""
    program = beat_program(steady.batch.circuit, int(steady.resolution[0]))
    trace, states = program.trace(signals), steady.orbits.states
    if wide:
        lanes = np.resize(block, LANES)
        recorded = np.asarray(trace(states[:, lanes], packed[:, lanes])[1])
    else:
        single = map_parallel(lambda i: np.asarray(trace(states[:, i], packed[:, i])[1]), list(block))
        recorded = np.stack(single, axis=-1)
    return whole_beat(recorded)[..., : len(block)]


def _volumes(steady: SteadyBeats) -> dict[str, np.ndarray]:
    compartments = steady.batch.circuit.compartments
    volumes = steady.orbits.states[assemble(steady.batch.circuit).layout.volumes.where]
    groups = dict.fromkeys(c.group for c in compartments)
    rows = {g: [i for i, c in enumerate(compartments) if c.group == g] for g in groups}
    return {group: volumes[chosen].sum(axis=0) for group, chosen in rows.items()}
