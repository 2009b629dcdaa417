"""One case, one steady beat: what `eclsim simulate` runs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eclsim.haemodynamics.dataset import simulate
from eclsim.solver.model import AS_PUBLISHED, model_of

if TYPE_CHECKING:
    import xarray as xr

    from eclsim.patients.case import Case


def simulate_case(case: Case, *, volume_policy: str = AS_PUBLISHED, solver: str = "semi-implicit") -> xr.Dataset:
    """The steady beat of a case.

    Args:
        case: patient, devices and parameters.
        volume_policy: "as_published" or "patient_held".
        solver: "semi-implicit" (the orbit is solved) or "adaptive" (Dopri8 with tight tolerance, the orbit is
            waited for: slow, for verification).
    """
    model = model_of(case)
    if solver == "adaptive":
        from eclsim.haemodynamics.adaptive import simulate_adaptive

        return simulate_adaptive(model, volume_policy)
    return simulate(model, volume_policy)
