"""Whether the grid was fine enough: the same steady beat on a grid of half the step."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eclsim.beat.resolution import RESOLUTIONS
from eclsim.outputs.dataset import simulate
from eclsim.outputs.registry import contract

if TYPE_CHECKING:
    import xarray as xr

    from eclsim.orbit.model import Model

STEPS_AT_1 = 400
ALLOWED_PERCENT = 0.5


def with_grid_check(model: Model, result: xr.Dataset) -> xr.Dataset:
    """A result that knows how much its outputs change on a grid of half the step.

    Adds the attributes `grid_error_percent` and `grid_error_output`, the output that changes most; a change
    of more than 0.5 % becomes a warning.

    Args:
        model: what was simulated.
        result: its steady beat by the semi-implicit solver.
    """
    resolution = int(result.attrs["steps_per_beat"]) // STEPS_AT_1
    finer = min((r for r in RESOLUTIONS if r >= 2 * resolution), default=2 * resolution)
    fine = simulate(model, result.attrs["blood_volume_policy"], resolution=finer)
    errors = {
        o.name: 100.0 * abs(float(result[o.name]) / float(fine[o.name]) - 1.0)
        for o in contract()
        if o.name in result and float(fine[o.name]) != 0.0
    }
    worst = max(errors, key=lambda name: errors[name])
    checked = result.assign_attrs(grid_error_percent=errors[worst], grid_error_output=worst)
    if errors[worst] > ALLOWED_PERCENT:
        sentence = f"{worst} changes by {errors[worst]:.2f} % on a grid of half the step"
        checked.attrs["warnings"] = [*result.attrs["warnings"], sentence]
    return checked
