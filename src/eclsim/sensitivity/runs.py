"""Runs of a design: the model at each point, block by block, and the folder that stores them.

    DIR/design.json       inputs, seed, sequence, model, version: all that the numbers follow from; warnings
    DIR/blocks/*.parquet  one file for each finished block, until all are there
    DIR/samples.parquet   all runs: inputs, outputs, status

A file is only visible under its name when it is complete. The samples hold no times and no machine names: the
same design gives the same file, however it was interrupted, sharded or distributed.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Protocol

import numpy as np

from eclsim._version import __version__
from eclsim.beat.grid import needed_resolution
from eclsim.circuit.assembly import assemble
from eclsim.circuit.network import Circuit
from eclsim.devices.registry import digests_of_own_files
from eclsim.execution import ExecutionError, Executor, Format, TaskFolder, Tasks
from eclsim.execution.folder import read_inputs
from eclsim.files import LOCK, PARTIAL, whole_file
from eclsim.gas.network import GasStatus
from eclsim.orbit.execution import Execution
from eclsim.orbit.status import Status
from eclsim.orbit.steady import Batch
from eclsim.outputs.signals import watched_waveforms
from eclsim.outputs.steady_beat import steady_beat
from eclsim.sensitivity.design import Design
from eclsim.sensitivity.inputs import Description

DESIGN = "design.json"
SAMPLES = "samples.parquet"
WITHOUT_GASES = 100
"""Added to the `GasStatus` of a run with a steady beat and no steady gas state."""


@dataclass(frozen=True)
class Runs:
    """Results of several runs of a model.

    Args:
        values: outputs, shape (runs, outputs).
        status: 0 where a run succeeded, shape (runs,).
        beats: number of beats computed for each run.
        residual: largest relative change of a state over the beat.
        impossible: whether the beat is one that no patient can have, shape (runs,).
    """

    values: np.ndarray
    status: np.ndarray
    beats: np.ndarray
    residual: np.ndarray
    impossible: np.ndarray

    @classmethod
    def joined(cls, pieces: list[Runs]) -> Runs:
        """Concatenate runs."""
        names = ("values", "status", "beats", "residual", "impossible")
        return cls(*(np.concatenate([getattr(piece, name) for piece in pieces]) for name in names))

    def complete_rows(self, design: Design) -> tuple[np.ndarray, np.ndarray]:
        """Outputs by row, shape (rows, runs per row, outputs), and whether each row has no failed run."""
        values = self.values.reshape(-1, design.runs_per_row, self.values.shape[1])
        return values, (self.status == 0).reshape(len(values), -1).all(axis=1)


class Evaluator(Protocol):
    """Interface of a model that a design can be run on."""

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs."""
        ...

    def __call__(self, settings: Mapping[str, np.ndarray], count: int) -> Runs:
        """Run `count` points; `settings` has an array (count,) for each varied parameter."""
        ...

    def description(self) -> Description:
        """Plain data that determine the outputs, besides the settings."""
        ...


@dataclass(frozen=True)
class SteadyBeatEvaluator:
    """Computes the steady beat of a circuit around base values.

    Args:
        circuit: circuit of the case, with choices where sites are inputs.
        base: value of every parameter.
        outputs: names of outputs, as in the registry.
        policy: blood volume policy.
        name: name of the case.
        resolution: resolution of the phase grid, the same for all runs, since runs that differ in one input
            must not also differ in their grids.
    """

    circuit: Circuit
    base: Mapping[str, float] = field(hash=False)
    outputs: tuple[str, ...]
    policy: str
    name: str = "model"
    resolution: int = field(kw_only=True)

    def __call__(self, settings: Mapping[str, np.ndarray], count: int) -> Runs:
        """Run several points."""
        batch = Batch(self.circuit, {**self.base, **settings}, count, self.policy)
        beat = steady_beat(
            batch, self.outputs, waveforms=watched_waveforms(self.circuit),
            start=self.base, resolution=self.resolution, execution=Execution(threads=1),
        ).determined_only()  # fmt: skip
        status = np.where(beat.without_gases, WITHOUT_GASES + beat.gas_status, beat.status)
        return Runs(beat.values.T, status, beat.orbits.beats, beat.orbits.residual, beat.collapsed)

    def description(self) -> Description:
        """Plain data that describe the runs."""
        return {
            "case": self.name,
            "circuit": _ADDRESS.sub("", str(self.circuit)).splitlines(),
            "base": {k: float(v) for k, v in sorted(self.base.items())},
            "outputs": list(self.outputs),
            "blood_volume_policy": self.policy,
            "resolution": self.resolution,
            **digests_of_own_files(),
        }


_ADDRESS = re.compile(r" at 0x[0-9A-Fa-f]+")
"""Place in memory of a function, such as that of a reflex: another one in every process."""


def design_resolution(circuit: Circuit, base: Mapping[str, float], design: Design) -> int:
    """Resolution of the grid that the most demanding run of a design needs."""
    values = {**base, **design.settings(design.unit())}
    return int(np.max(needed_resolution(assemble(circuit), values)))


def status_word(status: int) -> str:
    """Name of the way in which a run ended."""
    if status >= WITHOUT_GASES:
        return GasStatus(status - WITHOUT_GASES).word
    return Status(status).word


def status_message(status: int) -> str:
    """Explanation of the way in which a run ended."""
    kind = GasStatus(status - WITHOUT_GASES) if status >= WITHOUT_GASES else Status(status)
    return kind.message


def gas_words() -> set[str]:
    """Names of ways to end that only runs with a steady beat and without steady gases have."""
    return {status.word for status in GasStatus} - {status.word for status in Status}


@dataclass(frozen=True)
class Analysis:
    """An analysis to be run.

    Args:
        design: design with the points.
        evaluator: model that is run.
        warnings: warnings about the ranges and about the beat at the base values.
    """

    design: Design
    evaluator: Evaluator
    warnings: tuple[str, ...] = ()

    def block(self, number: int) -> Runs:
        """Run one block of the design."""
        unit = self.design.unit(*self.design.block_rows(number))
        return self.evaluator(self.design.settings(unit), len(unit))

    @property
    def tasks(self) -> Tasks[int, Runs]:
        """Return the blocks as tasks."""
        return Tasks("sensitivity", "blocks", self.block, range(self.design.blocks), side_by_side=True)

    def folder(self, path: Path) -> SampleFolder:
        """Return the folder that stores the runs."""
        evaluator = self.evaluator
        return SampleFolder(path, self.design, evaluator.outputs, evaluator.description(), self.warnings)


class SampleFolder:
    """Folder that stores finished blocks of one design and finally all samples."""

    def __init__(
        self,
        folder: Path,
        design: Design,
        outputs: tuple[str, ...],
        model: Description,
        warnings: tuple[str, ...] = (),
    ):
        self.path, self.design, self.outputs, self.warnings = folder, design, outputs, warnings
        self.samples = folder / SAMPLES
        self.blocks: TaskFolder[Runs] = TaskFolder(
            folder / "blocks",
            {"design": design.description(), "outputs": list(outputs), "model": model},
            Format(".parquet", self._write_block, partial(_read, outputs=outputs)),
            file=folder / DESIGN,
            beside={"samples": design.samples, "warnings": list(warnings)},
            name="block-",
        )

    @classmethod
    def of_folder(cls, folder: Path) -> SampleFolder:
        """Open the folder of an existing analysis."""
        recorded: Description | None = read_inputs(folder / DESIGN)
        if recorded is None:
            raise ExecutionError(f"{folder}: holds no analysis ({DESIGN} is missing)")
        design = Design.described(recorded["design"], recorded["samples"])
        warnings = tuple(recorded.get("warnings", ()))
        store = cls(folder, design, tuple(recorded["outputs"]), recorded["model"], warnings)
        if store.blocks.fingerprint != recorded["hash"]:
            made_by = f"version {recorded['version']} of eclsim; this is {__version__}"
            raise ExecutionError(f"{folder}: its analysis was made by {made_by}, or its {DESIGN} was changed")
        return store

    def open(self, executor: Executor) -> None:
        """Create the folder or check that it holds the same analysis, whatever the number of rows."""
        if executor.distribution.force:
            self.samples.unlink(missing_ok=True)
        executor.open(self.blocks, executor.distribution.numbers(self.design.blocks))

    def finished(self) -> set[int]:
        """Blocks that are done."""
        return {*range(min(self._blocks_in_samples(), self.design.blocks)), *self.blocks.finished()}

    def save(self, number: int, result: Runs) -> None:
        """Store a finished block."""
        self.blocks.save(number, result)

    def load(self, blocks: range) -> Runs:
        """Results of finished blocks, in order."""
        joined = self._blocks_in_samples()
        pieces = []
        if blocks.start < joined:
            runs = self.design.rows_per_block * self.design.runs_per_row
            rows = slice(blocks.start * runs, min(blocks.stop, joined) * runs)
            pieces.append(self.blocks.read(self.samples, partial(_read, outputs=self.outputs, rows=rows)))
        return Runs.joined([*pieces, *(self.blocks.load(b) for b in blocks if b >= joined)])

    def finish(self, runs: Runs) -> None:
        """Write the samples of all blocks as one file and delete the files of the blocks."""
        rows = len(runs.status) // self.design.runs_per_row
        if self._blocks_in_samples() * self.design.rows_per_block < rows:
            unit = self.design.unit(0, rows)
            inputs = {i.name: i.table_column(unit[:, k]) for k, i in enumerate(self.design.inputs)}
            with whole_file(self.samples) as partial_file:
                _write(partial_file, inputs | _columns(runs, self.outputs), self._about | {"samples": rows})
        folder = self.blocks.folder
        unfinished = (*folder.glob(f"{PARTIAL}*"), *self.path.glob(f"{PARTIAL}*"))
        for path in [*folder.glob("block-*"), *(one for one in unfinished if not one.name.startswith(LOCK))]:
            path.unlink(missing_ok=True)
        if folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()

    def _write_block(self, path: Path, runs: Runs, mark: str) -> None:
        _write(path, _columns(runs, self.outputs), self._about | {"hash": mark})

    @property
    def _about(self) -> Description:
        return {key: value for key, value in self.blocks.about.items() if key != "warnings"}

    def _blocks_in_samples(self) -> int:
        import pyarrow.parquet as pq

        if not self.samples.exists():
            return 0
        return pq.read_metadata(self.samples).num_rows // (
            self.design.rows_per_block * self.design.runs_per_row
        )


def _columns(runs: Runs, outputs: tuple[str, ...]) -> dict[str, np.ndarray]:
    return {name: runs.values[:, k] for k, name in enumerate(outputs)} | {
        "status": runs.status.astype(np.int8),
        "beats": runs.beats.astype(np.int32),
        "residual": runs.residual.astype(float),
        "impossible": runs.impossible.astype(bool),
    }


def _write(path: Path, columns: Mapping[str, np.ndarray], about: Description) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    arrays = [pa.array(c).dictionary_encode() if c.dtype == object else pa.array(c) for c in columns.values()]
    metadata = {"eclsim": json.dumps(about, ensure_ascii=False)}
    table = pa.Table.from_arrays(arrays, names=list(columns)).replace_schema_metadata(metadata)
    pq.write_table(table, path, compression="zstd", use_dictionary=False, write_page_checksum=True)


def _read(path: Path, outputs: tuple[str, ...], rows: slice = slice(None)) -> tuple[Runs, str]:
    import pyarrow.parquet as pq

    names = [*outputs, "status", "beats", "residual", "impossible"]
    table = pq.read_table(path, columns=names, page_checksum_verification=True)
    about = json.loads((table.schema.metadata or {}).get(b"eclsim", b"{}"))
    columns = [table.column(name).to_numpy()[rows] for name in names]
    values = np.stack(columns[: len(outputs)], axis=1)
    return Runs(values, *columns[len(outputs) :]), about.get("hash", "")
