"""Flows up to which limits are kept, at few speeds and at many."""

import numpy as np
import pytest
import xarray as xr

from eclsim.crrt_study.limits import BROKEN_ABOVE, LIMITS, largest_flows, limit_range

OF_LINES = [limit.name for limit in LIMITS if limit.of_crrt]
COARSE = np.array([1500.0, 3000.0, 4500.0])
# ECMO flow [L/min] and pressures [mmHg] of scheme b in a patient with a reflex
FLOW = np.array([0.494, 3.249, 5.581])
ACCESS, RETURN = np.array([-9.8, 111.5, 309.3]), np.array([77.2, 34.0, -45.0])


def means_of(access: np.ndarray, returned: np.ndarray, flow: np.ndarray, speeds: np.ndarray) -> xr.Dataset:
    dims = ("policy", "scheme", "speed")
    data = {
        "Pcrrttuin": access, "Pcrrttuout": returned, "lowest_drainage_pressure": np.full(len(speeds), -30.0),
        "PF": flow, "status": np.full(len(speeds), "converged"),
    }  # fmt: skip
    coordinates = {"policy": ["as_published"], "scheme": ["b"], "speed": speeds}
    return xr.Dataset({name: (dims, each[None, None]) for name, each in data.items()}, coordinates)


def test_all_limits_of_the_lines_are_kept_no_further_than_the_first_that_is_broken():
    rows = largest_flows(means_of(ACCESS, RETURN, FLOW, COARSE), 3000.0).isel(policy=0, scheme=0)
    single = rows.sel(limit=OF_LINES)
    first = single.isel(limit=int(np.argmin(single["largest_flow"].values)))
    assert float(first["largest_flow"]) < float(FLOW[-1])
    for name in ("largest_flow", "largest_speed", "flow_at_most", "state"):
        assert rows.sel(limit="crrt")[name].item() == first[name].item(), name


@pytest.mark.parametrize("seed", range(40))
def test_whatever_the_pressures_are_no_single_limit_is_contradicted(seed):
    numbers = np.random.default_rng(seed)
    speeds = np.sort(numbers.uniform(1000.0, 5000.0, 5))
    flow = np.sort(numbers.uniform(0.3, 6.0, 5))
    access, returned = numbers.uniform(-250.0, 320.0, 5), numbers.uniform(-50.0, 420.0, 5)
    rows = largest_flows(means_of(access, returned, flow, speeds), speeds[2]).isel(policy=0, scheme=0)
    combined = rows.sel(limit="crrt")
    if np.isfinite(combined["largest_flow"]):
        assert float(combined["largest_flow"]) <= float(rows["largest_flow"].sel(limit=OF_LINES).min())


def test_limits_that_are_kept_at_different_speeds_are_together_kept_at_none():
    early, late = np.array([5.0, -5.0, -5.0]), np.array([-5.0, 5.0, 5.0])
    assert limit_range(COARSE, FLOW, early).state == BROKEN_ABOVE
    assert limit_range(COARSE, FLOW, early, late).state == "never"


def test_a_limit_that_is_kept_again_further_up_does_not_lift_the_combined_one():
    again = np.array([10.0, 10.0, -10.0, 10.0])
    steady = np.array([10.0, 10.0, 5.0, -5.0])
    speeds, flow = np.array([1000.0, 2000.0, 3000.0, 4000.0]), np.array([1.0, 2.0, 3.0, 4.0])
    together = limit_range(speeds, flow, again, steady)
    assert together.state == BROKEN_ABOVE
    assert together.speed == pytest.approx(2500.0, abs=100.0)
