"""Saltelli's design: which combinations of the inputs are run.

Each of the N rows of the design is a pair of points A and B of a scrambled Sobol sequence, and the points
that exchange one factor between them: A, AB_1 .. AB_F, BA_1 .. BA_F, B, in this order. The numbers are those
of `SALib.sample.sobol.sample` for the same seed, bit for bit, and any row can be made without the others: a
shard, a resumed run and a worker on another machine all see the same design.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from eclsim.sensitivity.inputs import Description, Input, described_input

RUNS_PER_BLOCK = 2048
"""A block, the unit of work, has the largest power of two of rows with at most so many runs."""


class DesignError(ValueError):
    """A design that cannot be made; the text says what is allowed."""


@dataclass(frozen=True)
class Design:
    """A Saltelli design.

    Args:
        inputs: what is varied.
        samples: N, number of rows; a power of two.
        seed: of the scrambling, 0 or more.
        groups: name of the factor that each input belongs to; left out, each input is its own factor. The
            inputs of a factor are exchanged together and have one index.
        second_order: with the BA points, N (2 F + 2) runs; without, N (F + 2).
    """

    inputs: tuple[Input, ...]
    samples: int
    seed: int = 1
    groups: tuple[str, ...] = ()
    second_order: bool = True

    def __post_init__(self) -> None:
        names = [i.name for i in self.inputs]
        twice = sorted({n for n in names if names.count(n) > 1})
        if not names or twice:
            raise DesignError(f"inputs: {'none given' if not names else 'given twice: ' + ', '.join(twice)}")
        if self.samples < 2 or self.samples & (self.samples - 1):
            raise DesignError(
                f"samples = {self.samples}: allowed: a power of two from 2, such as 1024 or 2048"
            )
        if self.groups and len(self.groups) != len(self.inputs):
            raise DesignError(f"groups: {len(self.groups)} names for {len(self.inputs)} inputs")
        if self.seed < 0:
            raise DesignError(f"seed = {self.seed}: allowed: 0, 1, 2 ...")

    @property
    def factors(self) -> tuple[str, ...]:
        """Names of what gets an index: inputs or groups, in order of appearance."""
        return tuple(dict.fromkeys(self.groups or (i.name for i in self.inputs)))

    @property
    def runs_per_row(self) -> int:
        """Number of model runs of one row."""
        return (2 if self.second_order else 1) * len(self.factors) + 2

    @property
    def evaluations(self) -> int:
        """Number of model runs of the whole design."""
        return self.samples * self.runs_per_row

    @property
    def rows_per_block(self) -> int:
        """Rows of a block; it depends on the design alone."""
        rows = max(1, RUNS_PER_BLOCK // self.runs_per_row)
        return min(self.samples, 1 << (rows.bit_length() - 1))

    @property
    def blocks(self) -> int:
        """Number of blocks."""
        return self.samples // self.rows_per_block

    @cached_property
    def _exchanged(self) -> np.ndarray:
        """True where a point of a row takes the coordinate of B, shape (runs per row, inputs)."""
        labels = np.array(self.groups or [i.name for i in self.inputs])
        own = np.array([labels == factor for factor in self.factors])
        first, last = np.zeros((1, len(labels)), dtype=bool), np.ones((1, len(labels)), dtype=bool)
        return np.concatenate([first, own, ~own, last] if self.second_order else [first, own, last])

    def unit(self, first_row: int = 0, last_row: int | None = None) -> np.ndarray:
        """Coordinates in [0, 1) of all runs of some rows, shape (rows x runs per row, inputs)."""
        count = len(self.inputs)
        pair = _sobol_sequence(2 * count, self.samples, self.seed)[first_row:last_row]
        points = np.where(self._exchanged, pair[:, None, count:], pair[:, None, :count])
        return points.reshape(-1, count)

    def settings(self, unit: np.ndarray) -> dict[str, np.ndarray]:
        """Values of every parameter that the inputs set, each of shape (runs,)."""
        result: dict[str, np.ndarray] = {}
        for k, chosen in enumerate(self.inputs):
            result |= chosen.settings(unit[:, k])
        return result

    def block_rows(self, block: int) -> tuple[int, int]:
        """First row and row after the last of a block."""
        return block * self.rows_per_block, (block + 1) * self.rows_per_block

    def description(self) -> Description:
        """As plain data: all that the numbers of a row follow from.

        The number of rows is not among it: a design is the beginning of the same design with more rows.
        """
        beginning = _sobol_sequence(2 * len(self.inputs), self.samples, self.seed)[:2]
        return {
            "inputs": [i.description() for i in self.inputs],
            "groups": list(self.groups),
            "seed": self.seed,
            "second_order": self.second_order,
            "rows_per_block": self.rows_per_block,
            "sequence": hashlib.sha256(beginning.tobytes()).hexdigest()[:16],
        }

    @classmethod
    def described(cls, description: Description, samples: int) -> Design:
        """The design that a description came from."""
        inputs = tuple(described_input(d) for d in description["inputs"])
        groups = tuple(description["groups"])
        return cls(inputs, samples, description["seed"], groups, description["second_order"])


@lru_cache(maxsize=8)
def _sobol_sequence(dimensions: int, samples: int, seed: int) -> np.ndarray:
    """Points of the scrambled Sobol sequence (Owen), shape (samples, dimensions)."""
    from scipy.stats import qmc

    # `seed` and not `rng`: SALib passes it so, and the two scramble differently.
    sequence = qmc.Sobol(d=dimensions, scramble=True, seed=seed).random(samples)  # pyright: ignore[reportCallIssue]  # old name
    sequence.flags.writeable = False
    return sequence
