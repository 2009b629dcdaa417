"""Running the model for the points of a design."""

from __future__ import annotations

from collections.abc import Mapping
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

    It runs in one thread, as blocks run side by side: the same bits however many processors there are.

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
        from eclsim.orbit.status import Status
        from eclsim.orbit.steady import Batch, steady_beats
        from eclsim.outputs.evaluation import batch_outputs

        batch = Batch(self.circuit, {**self.base, **settings}, count, self.policy)
        steady = steady_beats(batch, near=self.base, resolution=self.resolution, threads=1)
        values = batch_outputs(steady, self.outputs, threads=1).T
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
    from eclsim.beat.resolution import needed_resolution
    from eclsim.circuit.assembly import assemble

    values = {**base, **design.settings(design.unit())}
    return int(np.max(needed_resolution(assemble(circuit), values)))


def evaluate_block(design: Design, evaluator: Evaluator, block: int) -> Evaluated:
    """Run one block of a design."""
    unit = design.unit(*design.block_rows(block))
    return evaluator(design.settings(unit), len(unit))
