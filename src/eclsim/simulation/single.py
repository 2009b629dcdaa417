"""One case: its steady beat and its course in time, what `eclsim simulate` runs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import xarray as xr

from eclsim.orbit.equation import OrbitOptions
from eclsim.orbit.model import Model, ModelSource, as_case, model_of
from eclsim.orbit.steady import ADAPTIVE, SEMI_IMPLICIT
from eclsim.outputs import results
from eclsim.simulation.target_flow import FlowNotReachedError, with_speed

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eclsim.cases.case import Case

NOT_REACHED = "flow_not_reached"
"""Status of a case whose target pump flow no speed gives."""
FLOW_WANTED = "target_ecmo_flow_l_min"
SPEED_FOUND = "solved_ecmo_speed_rpm"
"""Attributes of the beat of a case whose pump speed was solved for."""


def simulate(
    case: ModelSource,
    volume_policy: str | None = None,
    options: OrbitOptions | None = None,
    resolution: int | None = None,
    *,
    solver: str = SEMI_IMPLICIT,
    check_grid: bool = False,
) -> xr.Dataset:
    """The steady beat of a case or a model.

    Args:
        case: path of a case file, what `read_case` returned, a case or a model. Of a case that names a pump
            flow (`ecmo.flow_l_min`) the speed is solved for; a model has its speed.
        volume_policy: blood volume policy, "as_published" or "patient_held"; left out, the case's.
        options: accuracy and effort of the search.
        resolution: of the phase grid; left out, what the circuit's time constants need.
        solver: "semi-implicit" (the orbit is solved) or "adaptive" (Dopri8 with tight tolerance, the orbit is
            waited for: slow, for verification; without options and resolution).
        check_grid: solve once more with half the step and say how much the outputs change.

    Returns:
        Waveforms over `phase`, scalar outputs, and in the attributes whether and how it converged; NaN where
        it did not. With `ecmo.flow_l_min` also the flow wanted (`FLOW_WANTED`) and the pump speed solved for
        it (`SPEED_FOUND`); if no speed gives the flow, a Dataset without numbers whose status is
        "flow_not_reached" and whose message says why.
    """
    if isinstance(case, Model):
        return _beat(case, volume_policy, options, resolution, solver, check_grid)
    case = as_case(case)
    try:
        solved, found = with_speed(case, volume_policy)
    except FlowNotReachedError as error:
        return not_reached(case, volume_policy or case.volume_policy, str(error))
    result = _beat(model_of(solved), volume_policy, options, resolution, solver, check_grid)
    if found is not None:
        result.attrs |= {FLOW_WANTED: found.flow_l_min, SPEED_FOUND: found.speed_rpm}
    return result


def _beat(
    model: Model, policy: str | None, options: OrbitOptions | None, resolution: int | None, solver: str,
    check_grid: bool,
) -> xr.Dataset:  # fmt: skip
    if solver == ADAPTIVE:
        from eclsim.outputs.independent import simulate_adaptive

        return simulate_adaptive(model, policy)
    result = results.simulate(model, policy, options, resolution)
    return results.with_grid_check(model, result) if check_grid else result


def not_reached(case: Case, policy: str, sentence: str) -> xr.Dataset:
    """What stands for the beat of a case whose target flow cannot be had: the reason and no numbers."""
    attributes = {
        "id": case.patient.id,
        "converged": 0,
        "status": NOT_REACHED,
        "message": sentence,
        "beats": 0,
        "residual": float("nan"),
        "blood_volume_policy": policy,
        "warnings": [],
    }
    return xr.Dataset(attrs=attributes)


def simulate_transient(
    case: Case,
    seconds: float,
    *,
    volume_policy: str | None = None,
    solver: str = "semi-implicit",
    names: Sequence[str] | None = None,
) -> xr.Dataset:
    """The course of a case from the published initial state, over `time` [s].

    Args:
        case: patient, devices and parameters.
        seconds: how long [s].
        volume_policy: "as_published" or "patient_held" (the circuits start primed); left out, the case's.
        solver: "semi-implicit" or "adaptive".
        names: waveforms to keep; left out, all.

    Raises:
        FlowNotReachedError: The case names a pump flow that no speed gives.
    """
    from eclsim.outputs.course import simulate_course

    solved, _ = with_speed(case, volume_policy)
    return simulate_course(model_of(solved), seconds, policy=volume_policy, solver=solver, names=names)
