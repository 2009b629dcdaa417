import numpy as np
import pytest

import eclsim
from eclsim.crrt_study.schemes import SpeedError, StudyError, default_speeds, parse_speeds
from eclsim.crrt_study.study import crrt_study
from eclsim.paper.crrt import paper_case


def test_a_range_holds_both_ends():
    assert parse_speeds("1000:5000:250") == tuple(np.arange(1000.0, 5001.0, 250.0))


@pytest.mark.parametrize(("pump", "text"), [("Rotaflow", "1000:5000:250"), ("DP3", "4000:8000:250")])
def test_the_usual_speeds_are_those_of_the_pump(pump, text):
    case = paper_case()
    case = case.model_copy(update={"ecmo": case.ecmo.model_copy(update={"pump": pump})})
    assert default_speeds(case) == parse_speeds(text)


def test_a_step_that_does_not_divide_the_range_stops_before_its_end():
    assert parse_speeds("1000:2000:300") == (1000.0, 1300.0, 1600.0, 1900.0)


def test_ranges_and_single_speeds_are_merged_in_order():
    assert parse_speeds("3425,1000:2000:500,1500") == (1000.0, 1500.0, 2000.0, 3425.0)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "fast",
        "1000:2000",
        "2000:1000:100",
        "1000:2000:0",
        "0",
        "-100",
        "nan",
        "1e400",
        "1:9:1:1",
        "1:1e9:1",
    ],
)
def test_what_are_no_speeds_is_refused(text):
    with pytest.raises(SpeedError, match="allowed"):
        parse_speeds(text)


def test_a_speed_far_above_the_pump_s_is_refused():
    """It was simulated, and its pressures shown."""
    with pytest.raises(
        StudyError, match="speed_rpm = 90000: far above the speed of a Rotaflow; allowed: 1000"
    ):
        crrt_study(paper_case(), schemes="g", speeds=[3000, 90000])


def test_a_table_of_speeds_is_refused():
    """It was flattened."""
    assert eclsim.SpeedError is SpeedError
    with pytest.raises(SpeedError, match="an array of 2 x 2; allowed: a list of speeds"):
        crrt_study(paper_case(), schemes="g", speeds=[[3000, 3200], [3400, 3600]])  # pyright: ignore[reportArgumentType]
