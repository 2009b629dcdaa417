"""Suction against measurements: nothing is fitted, and without collapse the rows would miss."""

import numpy as np
import pytest

from eclsim.outputs.results import simulate_many
from eclsim.validation.fluid import SHORT_L_MIN, patient, suction_check

pytestmark = pytest.mark.slow


def test_the_rows_hold_and_are_not_required():
    check = suction_check()
    assert not check.required
    assert [row.holds for row in check.rows] == [True, True]
    assert check.rows[0].got == pytest.approx(-103.0, abs=3.0)


def test_without_collapse_no_loss_of_blood_lowers_the_flow_so_far():
    lost = {"fluid.extra_volume_ml": [-300.0, -700.0, -900.0], "ecmo.speed_rpm": 2670.0}
    flows = simulate_many(patient(False), lost, ["PF"])["PF"].values
    assert np.all(flows > SHORT_L_MIN + 1.0)
