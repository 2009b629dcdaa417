"""Running the model for the points of a design."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from eclsim.circuit.network import Circuit
from eclsim.sensitivity.design import Design


@dataclass(frozen=True)
class Evaluated:
    """What some runs gave.

    Args:
        values: outputs, shape (runs, outputs).
        status: 0 where a run succeeded, shape (runs,).
        beats: beats computed for each run.
        residual: largest relative change of a state over the beat.
    """

    values: np.ndarray
    status: np.ndarray
    beats: np.ndarray
    residual: np.ndarray

    @classmethod
    def of(cls, values: np.ndarray) -> Evaluated:
        """Outputs of a function that needs no solver; what is not finite has failed."""
        failed = ~np.isfinite(values).all(axis=1)
        zeros = np.zeros(len(values))
        return cls(values, np.where(failed, 3, 0), zeros.astype(int), zeros)


class Evaluator(Protocol):
    """Anything that a design can be run on."""

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs."""
        ...

    def __call__(self, settings: Mapping[str, np.ndarray], count: int) -> Evaluated:
        """Run `count` points; `settings` holds an array (count,) for each parameter that is varied."""
        ...

    def description(self) -> dict[str, Any]:
        """As plain data: all that the outputs follow from, besides the settings."""
        ...


@dataclass(frozen=True)
class SteadyBeatEvaluator:
    """The steady beat of a circuit around base values.

    Args:
        circuit: the circuit; sites that are inputs are choices in it.
        base: a number for every parameter.
        outputs: names of the registry of outputs.
        policy: blood volume policy.
        resolution: of the phase grid, the same for all runs: two runs that differ in one input must not
            differ in their grids as well.
        name: of the case.
    """

    circuit: Circuit
    base: Mapping[str, float] = field(hash=False)
    outputs: tuple[str, ...]
    policy: str
    resolution: int
    name: str = "model"

    def __call__(self, settings: Mapping[str, np.ndarray], count: int) -> Evaluated:
        """Run some points."""
        from eclsim.haemodynamics.evaluation import batch_outputs
        from eclsim.solver.status import Status
        from eclsim.solver.steady import Batch, steady_beats

        batch = Batch(self.circuit, {**self.base, **settings}, count, self.policy)
        steady = steady_beats(batch, near=self.base, resolution=self.resolution)
        values = batch_outputs(steady, self.outputs).T
        orbits = steady.orbits
        lost = ~np.isfinite(values).all(axis=1) & (orbits.status == Status.CONVERGED)
        status = np.where(lost, Status.NOT_FINITE, orbits.status)
        return Evaluated(values, status, orbits.beats, orbits.residual)

    def description(self) -> dict[str, Any]:
        """As plain data."""
        return {
            "case": self.name,
            "circuit": str(self.circuit).splitlines(),
            "base": {k: float(v) for k, v in sorted(self.base.items())},
            "outputs": list(self.outputs),
            "blood_volume_policy": self.policy,
            "resolution": self.resolution,
        }


def design_resolution(circuit: Circuit, base: Mapping[str, float], design: Design) -> int:
    """Resolution of the grid that the most demanding run of a design needs."""
    from eclsim.circuit.assembly import assemble
    from eclsim.solver.resolution import needed_resolution

    values = {**base, **design.settings(design.unit())}
    return int(np.max(needed_resolution(assemble(circuit), values)))


def evaluate_block(design: Design, evaluator: Evaluator, block: int) -> Evaluated:
    """Run one block of a design."""
    unit = design.unit(*design.block_rows(block))
    return evaluator(design.settings(unit), len(unit))


@contextmanager
def one_thread_each() -> Iterator[None]:
    """Blocks run side by side, each in one thread: the same bits however many processors there are."""
    before = os.environ.get("ECLSIM_THREADS")
    os.environ["ECLSIM_THREADS"] = "1"
    try:
        yield
    finally:
        if before is None:
            os.environ.pop("ECLSIM_THREADS", None)
        else:
            os.environ["ECLSIM_THREADS"] = before
