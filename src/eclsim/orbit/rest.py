"""The pressures of a patient at rest, at which their reflexes have nothing to do."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from eclsim.beat.heartbeat import beat_program
from eclsim.circuit.network import Circuit
from eclsim.orbit.model import Model, model_of
from eclsim.orbit.status import Status
from eclsim.orbit.steady import Batch, solve
from eclsim.parameters.regulation import SET_POINT, VENOUS_SET_POINT

if TYPE_CHECKING:
    from eclsim.cases.case import Case

READ = {SET_POINT: "Pao", VENOUS_SET_POINT: "Pra"}
"""Set points, and the waveforms whose means they are."""


def resting_pressures(case: Case) -> Mapping[str, float]:
    """Mean pressures [mmHg] of a case's steady beat without regulation, by the set point that they are.

    Of the case as it was written, with its devices, before settings were put over it and without extra
    volume. NaN where it has no steady beat, which no reflex can be computed with.
    """
    model = model_of(case.at_rest())
    return _means(model.circuit, tuple(model.values.items()), model.policy)


@lru_cache(maxsize=64)
def _means(circuit: Circuit, values: tuple[tuple[str, float], ...], policy: str) -> Mapping[str, float]:
    result = solve(Batch.of(Model(circuit, dict(values), policy=policy)))
    if result.status[0] != Status.CONVERGED:
        return MappingProxyType(dict.fromkeys(READ, float("nan")))
    program = beat_program(circuit, int(result.resolution[0]))
    _, recorded = program.trace(tuple(READ.values()))(result.states[:, 0], result.batch.packed(program)[:, 0])
    widths = np.diff(program.grid.phases)
    means = 0.5 * (widths + np.roll(widths, -1)) @ np.asarray(recorded)
    return MappingProxyType(dict(zip(READ, means.tolist(), strict=True)))
