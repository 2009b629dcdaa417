"""Outputs of dozens to thousands of parameter sets of one patient, all close to a known one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from eclsim.identification.objective import WORTH_SIDE_BY_SIDE
from eclsim.orbit.equation import OrbitOptions
from eclsim.orbit.execution import SIDE_BY_SIDE, Execution
from eclsim.orbit.model import AS_PUBLISHED, Model
from eclsim.orbit.steady import Batch
from eclsim.outputs.steady_beat import steady_beat

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
    """Outputs of members that share a circuit, shape (members, outputs); NaN where no beat is determined.

    Args:
        model: gives the circuit.
        values: a number or an array (members,) for every parameter.
        count: number of members.
        outputs: names of the registry.
        policy: blood volume policy.
        near: values that all members are close to.
    """
    batch = Batch(model.circuit, values, count, policy)
    execution = Execution(width=SIDE_BY_SIDE if count >= WORTH_SIDE_BY_SIDE else 1)
    beat = steady_beat(batch, outputs, options=SETTLED, start=near, execution=execution)
    return beat.determined_only().values.T
