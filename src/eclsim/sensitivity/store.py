"""The folder of an analysis: what is to be done, what is done, and the finished samples.

    DIR/design.json       inputs, seed, sequence, model, version: all that the numbers follow from
    DIR/blocks/*.parquet  one file for each finished block, until all are there
    DIR/samples.parquet   all runs: inputs, outputs, status

A file appears under its name when it is whole, or not at all. The samples hold no times and no machine
names: the same design gives the same file, however it was interrupted, sharded or distributed.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from eclsim._version import __version__
from eclsim.files import whole_file
from eclsim.sensitivity.design import Design
from eclsim.sensitivity.evaluation import Evaluated, Evaluator

_DESIGN = "design.json"
_BESIDE_IDENTITY = ("hash", "samples")
_BLOCKS = "blocks"
SAMPLES = "samples.parquet"


class StoreError(RuntimeError):
    """A folder that does not fit the analysis; the text says what to do."""


class Store:
    """Finished blocks of one design in one folder."""

    def __init__(self, folder: Path, design: Design, outputs: tuple[str, ...], model: dict[str, Any]):
        self.folder = folder
        self.design = design
        self.outputs = outputs
        self.identity: dict[str, Any] = {
            "version": __version__,
            "design": design.description(),
            "outputs": list(outputs),
            "model": model,
        }
        text = json.dumps(self.identity, sort_keys=True, ensure_ascii=False)
        self.hash = hashlib.sha256(text.encode()).hexdigest()[:16]

    @classmethod
    def of(cls, folder: Path, design: Design, evaluator: Evaluator) -> Store:
        """For an analysis about to be run."""
        return cls(folder, design, evaluator.outputs, evaluator.description())

    @classmethod
    def found_in(cls, folder: Path) -> Store:
        """For the analysis that a folder holds."""
        held = _read_json(folder / _DESIGN)
        if held is None:
            raise StoreError(f"{folder}: holds no analysis ({_DESIGN} is missing)")
        design = Design.described(held["design"], held["samples"])
        store = cls(folder, design, tuple(held["outputs"]), held["model"])
        if store.hash != held["hash"]:
            said = f"version {held['version']} of eclsim; this is {__version__}"
            raise StoreError(f"{folder}: its analysis was made by {said}, or its {_DESIGN} was changed")
        return store

    def open(self, resume: bool, fresh: bool = False) -> None:
        """Make the folder, or check that it holds the same analysis, perhaps with another number of rows.

        Args:
            resume: go on with what is there.
            fresh: throw away what is there.
        """
        self._blocks.mkdir(parents=True, exist_ok=True)
        if fresh:
            self._clear()
        held = _read_json(self.folder / _DESIGN) or {}
        identity = {k: v for k, v in held.items() if k not in _BESIDE_IDENTITY}
        if held and identity != self.identity:
            differs = ", ".join(_differences(identity, self.identity))
            raise StoreError(
                f"{self.folder}: holds another analysis (different: {differs}); choose another folder"
            )
        if held and not resume:
            raise StoreError(
                f"{self.folder}: holds this analysis already; --resume goes on, --force starts anew"
            )
        if held.get("samples") != self.design.samples:
            text = json.dumps(self._about(), indent=1, ensure_ascii=False)
            write_whole(self.folder / _DESIGN, lambda path: path.write_text(text + "\n", encoding="utf-8"))

    def finished(self) -> set[int]:
        """Blocks that are done."""
        whole = range(min(self._blocks_in_samples(), self.design.blocks))
        return {*whole, *(b for b in range(self.design.blocks) if self._block_file(b).exists())}

    def shard(self, number: int, count: int) -> range:
        """Blocks of one of `count` shards, numbered from 1."""
        if not 1 <= number <= count:
            raise StoreError(f"shard {number}/{count}: allowed: 1/{count} to {count}/{count}")
        return range((number - 1) * self.design.blocks // count, number * self.design.blocks // count)

    def save(self, block: int, found: Evaluated) -> None:
        """Keep a finished block."""
        columns = {name: found.values[:, k] for k, name in enumerate(self.outputs)}
        self._write(self._block_file(block), columns | _columns_about(found))

    def load(self, blocks: range) -> Evaluated:
        """Results of finished blocks, in order."""
        whole = self._blocks_in_samples()
        parts = []
        if blocks.start < whole:
            runs = self.design.rows_per_block * self.design.runs_per_row
            together = slice(blocks.start * runs, min(blocks.stop, whole) * runs)
            parts.append(self._read(self.folder / SAMPLES, together))
        parts += [self._read(self._block_file(b)) for b in blocks if b >= whole]
        names = ("values", "status", "beats", "residual")
        return Evaluated(*(np.concatenate([getattr(p, n) for p in parts]) for n in names))

    def finish(self, found: Evaluated) -> None:
        """Write the samples of all blocks as one file; the files of the blocks go."""
        rows = len(found.status) // self.design.runs_per_row
        if self._blocks_in_samples() * self.design.rows_per_block < rows:
            unit = self.design.unit(0, rows)
            inputs = {i.name: i.table_column(unit[:, k]) for k, i in enumerate(self.design.inputs)}
            outputs = {name: found.values[:, k] for k, name in enumerate(self.outputs)}
            self._write(self.folder / SAMPLES, inputs | outputs | _columns_about(found), rows)
        for path in [
            *self._blocks.glob("block-*.parquet"),
            *self._blocks.glob(".eclsim-*"),
            *self.folder.glob(".eclsim-*"),
        ]:
            path.unlink(missing_ok=True)
        if self._blocks.is_dir() and not any(self._blocks.iterdir()):
            self._blocks.rmdir()

    @property
    def _blocks(self) -> Path:
        return self.folder / _BLOCKS

    def _block_file(self, block: int) -> Path:
        return self._blocks / f"block-{block:05d}.parquet"

    def _blocks_in_samples(self) -> int:
        import pyarrow.parquet as pq

        path = self.folder / SAMPLES
        if not path.exists():
            return 0
        return pq.read_metadata(path).num_rows // (self.design.rows_per_block * self.design.runs_per_row)

    def _clear(self) -> None:
        for path in [self.folder / _DESIGN, self.folder / SAMPLES, *self._blocks.glob("block-*.parquet")]:
            path.unlink(missing_ok=True)

    def _about(self, rows: int | None = None) -> dict[str, Any]:
        return self.identity | {"hash": self.hash, "samples": rows or self.design.samples}

    def _write(self, path: Path, columns: dict[str, np.ndarray], rows: int | None = None) -> None:
        import pyarrow as pa
        import pyarrow.parquet as pq

        about = {"eclsim": json.dumps(self._about(rows), ensure_ascii=False)}
        arrays = [
            pa.array(c).dictionary_encode() if c.dtype == object else pa.array(c) for c in columns.values()
        ]
        table = pa.Table.from_arrays(arrays, names=list(columns)).replace_schema_metadata(about)
        write_whole(
            path, lambda partial: pq.write_table(table, partial, compression="zstd", use_dictionary=False)
        )

    def _read(self, path: Path, rows: slice = slice(None)) -> Evaluated:
        import pyarrow.parquet as pq

        names = [*self.outputs, "status", "beats", "residual"]
        table = pq.read_table(path, columns=names)
        about = json.loads((table.schema.metadata or {}).get(b"eclsim", b"{}"))
        if about.get("hash") != self.hash:
            raise StoreError(f"{path}: belongs to another analysis; remove it or choose another folder")
        columns = [table.column(name).to_numpy()[rows] for name in names]
        values = np.stack(columns[: len(self.outputs)], axis=1)
        return Evaluated(values, *columns[len(self.outputs) :])


def write_whole(path: Path, write: Callable[[Path], object]) -> None:
    """Write beside the target, then rename: the file is whole or absent."""
    with whole_file(path) as partial:
        write(partial)


def _columns_about(found: Evaluated) -> dict[str, np.ndarray]:
    return {
        "status": found.status.astype(np.int8),
        "beats": found.beats.astype(np.int32),
        "residual": found.residual.astype(float),
    }


def _read_json(path: Path) -> dict[str, Any] | None:
    if not path.exists():
        return None
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise StoreError(f"{path}: cannot be read ({error}); --force starts anew") from error


def _differences(held: Any, wanted: Any, path: str = "") -> list[str]:
    """Names of the entries that differ."""
    if isinstance(held, dict) and isinstance(wanted, dict):
        found = []
        for key in sorted({*held, *wanted}):
            found += _differences(held.get(key), wanted.get(key), f"{path}.{key}" if path else key)
        return found
    return [] if held == wanted else [path]
