"""One case: its steady beat and its course in time, what `eclsim simulate` runs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eclsim.haemodynamics.dataset import simulate
from eclsim.solver.model import AS_PUBLISHED, model_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    import xarray as xr

    from eclsim.patients.case import Case


def simulate_case(
    case: Case,
    *,
    volume_policy: str = AS_PUBLISHED,
    solver: str = "semi-implicit",
    check_grid: bool = False,
) -> xr.Dataset:
    """The steady beat of a case.

    Args:
        case: patient, devices and parameters.
        volume_policy: "as_published" or "patient_held".
        solver: "semi-implicit" (the orbit is solved) or "adaptive" (Dopri8 with tight tolerance, the orbit is
            waited for: slow, for verification).
        check_grid: solve once more with half the step and say how much the outputs change.
    """
    model = model_of(case)
    if solver == "adaptive":
        from eclsim.haemodynamics.adaptive import simulate_adaptive

        return simulate_adaptive(model, volume_policy)
    result = simulate(model, volume_policy)
    if check_grid:
        from eclsim.haemodynamics.grid_check import with_grid_check

        return with_grid_check(model, result)
    return result


def simulate_transient(
    case: Case,
    seconds: float,
    *,
    volume_policy: str = AS_PUBLISHED,
    solver: str = "semi-implicit",
    names: Sequence[str] | None = None,
) -> xr.Dataset:
    """The course of a case from the published initial state, over `time` [s].

    Args:
        case: patient, devices and parameters.
        seconds: how long [s].
        volume_policy: "as_published" or "patient_held" (the circuits start primed).
        solver: "semi-implicit" or "adaptive".
        names: waveforms to keep; left out, all.
    """
    from eclsim.haemodynamics.transient import simulate_course

    return simulate_course(model_of(case), seconds, policy=volume_policy, solver=solver, names=names)
