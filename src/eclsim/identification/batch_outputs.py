"""Outputs of dozens to thousands of parameter sets of one patient, all close to a known one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from eclsim.beat.vectorisation import WORTH_LANES
from eclsim.orbit.equation import OrbitOptions
from eclsim.orbit.model import AS_PUBLISHED, Model
from eclsim.orbit.status import Status
from eclsim.orbit.steady import Batch, steady_beats
from eclsim.outputs.evaluation import batch_outputs

SETTLED = OrbitOptions(tolerance=1e-5, error_tolerance=1e-4, newton_iterations=6)
"""Enough for a density: outputs differ from those of the exact orbit by 1e-4 of their uncertainty."""


def simulate_members(
    model: Model,
    values: Mapping[str, Any],
    count: int,
    outputs: tuple[str, ...],
    policy: str = AS_PUBLISHED,
    near: Mapping[str, float] | None = None,
) -> np.ndarray:
    """Outputs of members that share a circuit, shape (members, outputs); NaN without a steady beat.

    Args:
        model: gives the circuit.
        values: a number or an array (members,) for every parameter.
        count: number of members.
        outputs: names of the registry.
        policy: blood volume policy.
        near: values that all members are close to.
    """
    batch, wide = Batch(model.circuit, values, count, policy), count >= WORTH_LANES
    steady = steady_beats(batch, SETTLED, near, wide=wide, lone=True)
    found = batch_outputs(steady, outputs, wide).T.copy()
    found[steady.orbits.status != Status.CONVERGED] = np.nan
    return found
