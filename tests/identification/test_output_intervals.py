"""Intervals of the outputs of a fit end where no beat can be, which does not make them known."""

import numpy as np
import pytest

from eclsim.identification.output_intervals import OutputInterval, output_intervals, widened


def intervals_of(fitted, deviations, measured=("MAP",), others=()):
    rows = np.array(others, dtype=float).reshape(-1, len(fitted))
    return output_intervals(fitted, np.array(deviations), rows, measured, {})


def test_pressures_below_0_and_a_systolic_one_below_the_mean_are_left_out():
    """From a MAP of 83 alone SP was 149 (36.5 to 262) and DP 30.3 (-28.8 to 89.3) mmHg."""
    fitted = {"SP": 149.0, "DP": 30.3, "MAP": 83.0, "MPAP": 9.0, "CO": 5.0}
    found = intervals_of(fitted, [68.4, 36.0, 3.0, 10.0, 0.3])
    low, high = found["MAP"][:2]
    assert (low, high) == pytest.approx((78.07, 87.93), abs=0.01)
    assert found["SP"][:2] == pytest.approx((low, 261.5), abs=0.1)
    assert found["DP"][:2] == pytest.approx((0.0, high))
    assert found["MPAP"].low == 0.0
    assert not any(found[name].determined for name in ("SP", "DP", "MPAP"))


def test_a_mean_pressure_lies_between_measured_ones():
    found = intervals_of({"SP": 84.0, "DP": 80.0, "MAP": 82.0}, [3.0, 3.0, 9.0], ("SP", "DP"))
    assert found["MAP"][:2] == (found["DP"].low, found["SP"].high)


def test_saturations_and_partial_pressures_have_bounds_and_circuit_pressures_have_none():
    fitted = {"SaO2": 99.0, "SvO2": 3.0, "PaCO2": 4.0, "CVP": 2.0, "PF": -0.1, "CO": 0.2}
    found = intervals_of(fitted, [2.0, 4.0, 9.0, 3.0, 0.2, 0.5])
    assert found["SaO2"].high == 100.0
    assert found["SvO2"].low == found["PaCO2"].low == found["CO"].low == 0.0
    assert found["CVP"].low < 0.0
    assert found["PF"].low < -0.1


def test_an_interval_cut_at_a_bound_is_not_narrow():
    (found,) = intervals_of({"DP": 2.0}, [12.0], ()).values()
    assert found.low == 0.0
    assert found.high - found.low < 2.0 * 2.0 * 1.645 * 4.0
    assert not found.determined
    wider = widened({"DP": found}, {"DP": (1.0, 3.0)}, {"DP": 2.0}, (), {})
    assert wider["DP"] == OutputInterval(found.low, found.high, False)


def test_fits_that_meet_the_measurements_are_never_left_out():
    others = [[-0.5, 60.0], [1.0, 70.0]]
    found = intervals_of({"MPAP": 3.0, "MAP": 65.0}, [3.0, 1.0], others=others)
    assert found["MPAP"].low == -0.5
    assert found["MAP"][:2] == (60.0, 70.0)
