"""Rows 25, 26 and 55 of the list of bad inputs: targets and bounds of an identification."""

import pytest

from eclsim.cases import read_mapping
from eclsim.identification.multi_start import MultiStart
from eclsim.identification.settings import FitSettings, check_fit, checked_fit
from eclsim.outputs.uncertainty import Uncertainty
from eclsim.parameters.thiel2025 import BOUNDS

ALL = {"SP": 101, "DP": 47, "MAP": 70, "MPAP": 26, "PCWP": 9, "CO": 5.8, "PF": 2.2}


def case_with(measured, speed=2725):
    return read_mapping(
        {
            "format": 1,
            "patient": {"id": "P01", "sex": "male", "age_years": 42, "heart_rate_bpm": 83},
            "measurements": measured,
            "ecmo": {"pump": "Rotaflow", "speed_rpm": speed, "oxygenator": "Quadrox-i Adult", "mode": "VA"},
        }
    ).case


def test_seven_targets_for_seven_parameters_are_fine():
    checked = check_fit(case_with(ALL), BOUNDS)
    assert (checked.mistakes, checked.warnings, checked.notes) == ([], [], [])
    assert checked.targets == ALL
    assert set(checked.free) == set(BOUNDS)


@pytest.mark.parametrize(("speed", "errors"), [(2.725, 1), (99, 1), (100, 0), (0, 0)])
def test_a_patient_measured_on_a_pump_that_hardly_turns_is_not_fitted(speed, errors):
    """A speed in krpm was fitted as so many rpm: a patient without support."""
    messages = [str(m) for m in check_fit(case_with(ALL, speed), BOUNDS).mistakes]
    assert len(messages) == errors
    assert all("no pump runs as slowly in a patient who is measured" in m for m in messages)


def test_25_without_targets_there_is_nothing_to_fit():
    (mistake,) = check_fit(case_with({"SP": "NA", "MAP": "nan"}), BOUNDS).mistakes
    assert mistake.message == "nothing to fit"


def test_26_fewer_targets_than_free_parameters():
    checked = check_fit(case_with({"MAP": 70, "CO": 5.8}), BOUNDS)
    assert "2 targets for 7 free parameters" in checked.warnings[0].message
    assert {note.key for note in checked.notes} == {
        f"measurements.{name}" for name in set(ALL) - {"MAP", "CO"}
    }


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ((0.5, 5.0, 0.05), "lower bound above upper bound"),
        ((6.0, 0.05, 5.0), "start value outside"),
        ((0.5, 0.001, 5.0), "allowed: 0.02 to 8"),
        ((0.5, float("nan"), 5.0), "finite"),
    ],
)
def test_55_bounds_that_make_no_sense(limits, message):
    (mistake,) = check_fit(case_with(ALL), {**BOUNDS, "Rmc": limits}).mistakes
    assert mistake.key == "Rmc"
    assert message in str(mistake)


def test_55_equal_bounds_fix_a_parameter_and_say_so():
    checked = check_fit(case_with(ALL), {**BOUNDS, "Rmc": (0.6, 0.6, 0.6)})
    assert checked.fixed == {"Rmc": 0.6}
    assert "Rmc" not in checked.free
    assert checked.notes[0].key == "Rmc"


def test_a_value_of_the_case_outside_of_the_bounds_is_said_with_wider_ones():
    case = case_with(ALL).model_copy(update={"parameters": {"Rpvn": 0.09, "Rmc": 0.8}})
    (warning,) = checked_fit(case, FitSettings(("Rpvn", "Rmc"))).warnings
    assert warning.key == "Rpvn"
    assert "the case's own value is not within its bounds: the search starts at 0.006" in str(warning)
    assert "--bounds Rpvn=0.0006:0.09" in str(warning)
    wider = checked_fit(case, FitSettings(("Rpvn", "Rmc"), {"Rpvn": (0.0006, 0.2)}))
    assert wider.warnings == []
    assert wider.free["Rpvn"] == (0.09, 0.0006, 0.2)


def test_unknown_parameters_get_a_suggestion():
    (mistake,) = check_fit(case_with(ALL), {"Emaxl": (1, 0.1, 10)}).mistakes
    assert "Emaxlv" in mistake.suggestion


@pytest.mark.parametrize(
    ("cvp", "mistakes", "warnings"),
    [
        (0.0, ["10 % of a value of 0 is no uncertainty; give it in mmHg, such as CVP=2"], []),
        (0.3, [], ["uncertainty 0.03 mmHg at the measured 0.3: far below the usual 2"]),
        (6.0, [], []),
    ],
)
def test_a_percentage_of_a_pressure_near_zero_is_refused_or_warned_of(cvp, mistakes, warnings):
    """CVP=10% at a CVP of 0 was 0.01 mmHg without a word."""
    settings = FitSettings(("Rmc",), uncertainties={"CVP": Uncertainty(relative=0.1)})
    checked = checked_fit(case_with({"MAP": 70, "CVP": cvp}), settings)
    for found, expected in ((checked.mistakes, mistakes), (checked.warnings, warnings)):
        assert len(found) == len(expected)
        assert all(text in str(each) for text, each in zip(expected, found, strict=True))


def test_an_uncertainty_that_switches_its_measurement_off_is_warned_of():
    """A fit with MAP 28 instead of the 80 mmHg measured was good, "all measurements are met"."""
    settings = FitSettings(("Rmc",), uncertainties={"MAP": Uncertainty(absolute=300.0)})
    (warning,) = checked_fit(case_with({"MAP": 80, "CO": 4}), settings).warnings
    assert "far above the usual 3, so this measurement hardly counts, met or not" in str(warning)


def test_settings_that_give_other_numbers_are_other_settings():
    """Fits with fewer polishing steps were continued as if they were the same."""
    rough = FitSettings(multi_start=MultiStart(polishing=0))
    assert rough.as_object() != FitSettings().as_object()
