"""What the ECMO circuit says of a beat besides limits."""

from pathlib import Path

import numpy as np
import pytest

import eclsim
from eclsim.components.exchangers import FLOWMETER_TO_STPD

LOW_SWEEP = Path(__file__).parents[2] / "examples/veno_venous_low_sweep.toml"


def used_up(sweep: float, fdo2: float = 1.0):
    """The beat at a sweep, and the warnings that say its gas is used up."""
    case = eclsim.read_case(LOW_SWEEP).case.with_section("ecmo", sweep_l_min=sweep, fdo2=fdo2)
    beat = eclsim.simulate(case)
    return beat, [text for text in beat.attrs["warnings"] if "sweep gas" in text]


@pytest.mark.parametrize("sweep", [0.05, 0.17, 0.2])
def test_a_sweep_that_the_blood_takes_up_is_said_where_no_carbon_dioxide_leaves(sweep):
    beat, (said,) = used_up(sweep)
    brought = 1000.0 * FLOWMETER_TO_STPD * sweep
    assert float(beat["VO2_oxygenator"]) == pytest.approx(brought, rel=0.01)
    assert float(beat["VCO2_oxygenator"]) < 0.1
    assert np.isnan(float(beat["PexhaustCO2"]))
    assert f"of {brought:.0f} mL/min STPD" in said
    assert "removes 0 mL/min of carbon dioxide; raise the sweep" in said


@pytest.mark.parametrize(("sweep", "fdo2"), [(0.0, 1.0), (0.3, 1.0), (0.17, 0.21)])
def test_nothing_is_said_of_a_sweep_that_is_off_or_leaves_the_oxygenator(sweep, fdo2):
    beat, said = used_up(sweep, fdo2)
    assert beat.attrs["converged"]
    assert said == []
