"""Python's front door: what is of another kind is refused with what is allowed."""

import numpy as np
import pytest

import eclsim
from eclsim.cases.reading import read_mapping
from eclsim.inputs.mistakes import CaseError

CASE = read_mapping(
    {
        "format": 1,
        "patient": {"id": "P", "sex": "male", "age_years": 50, "heart_rate_bpm": 95},
        "measurements": {"MAP": 70.0, "CO": 3.0},
    }
).case


@pytest.mark.parametrize("points", ["series.csv", CASE, [CASE], [("a", CASE, 1)], [(1, CASE)]])
def test_what_is_no_series_of_names_and_cases_is_refused(points):
    with pytest.raises(CaseError, match="no name with a case; allowed: a list of names with cases"):
        eclsim.track(points)


@pytest.mark.parametrize(
    ("ask", "kind"),
    [
        (lambda given: eclsim.fit(CASE, settings=given), "FitSettings"),
        (lambda given: eclsim.track([("a", CASE)], settings=given), "TrackSettings"),
        (lambda given: eclsim.sensitivity(CASE, settings=given), "SobolSettings"),
        (
            lambda given: eclsim.posterior(CASE, settings=given),  # pyright: ignore[reportArgumentType]
            "PosteriorSettings",
        ),
    ],
)
def test_settings_of_another_kind_are_refused(ask, kind):
    with pytest.raises(TypeError, match=rf"a dict is no {kind}; allowed: eclsim\.{kind}\(\.\.\.\)"):
        ask({"parameters": ("Rmc",)})


def test_a_posterior_is_that_of_a_fit():
    with pytest.raises(TypeError, match=r"a Case is no fit; allowed: what eclsim\.fit\(case\) returns"):
        eclsim.posterior(CASE)  # pyright: ignore[reportArgumentType]  # on purpose


def test_variants_have_one_dimension():
    with pytest.raises(ValueError, match="Rmc: an array of 2 x 3; allowed: a number, or one for each"):
        eclsim.simulate_many(CASE, {"Rmc": np.full((2, 3), 0.5)})


@pytest.mark.parametrize("changes", [[1, 2], None, "ecmo.speed_rpm=3000", [{"Rmc": 1.0}]])
def test_changes_are_numbers_by_parameter(changes):
    """It was "'int' object has no attribute 'strip'"."""
    with pytest.raises(TypeError, match=r"changes: .* names no parameter; allowed: numbers by parameter"):
        eclsim.simulate_many(CASE, changes)


def test_a_change_that_is_no_number_is_named():
    with pytest.raises(ValueError, match=r"Rmc: \[a list of 1\] is no number"):
        eclsim.simulate_many(CASE, {"Rmc": ["a"]}, outputs=["MAP"])


def test_one_text_is_one_name():
    """It was read letter by letter: 'R' is no parameter."""
    slopes = eclsim.derivatives(CASE, "MAP", "Rmc")
    assert slopes.shape == (1, 1)
    assert slopes.coords["parameter"].values.tolist() == ["Rmc"]
    assert eclsim.identifiability(CASE, parameters="Rmc", outputs="MAP").scaled.parameters == ("Rmc",)
    assert eclsim.FitSettings(parameters="Rmc").names == ("Rmc",)  # pyright: ignore[reportArgumentType]
    assert eclsim.SobolSettings(parameters="Rmc", outputs="MAP").parameters == ("Rmc",)


@pytest.mark.parametrize("names", [None, 5, [5]])
def test_what_is_no_name_is_refused(names):
    with pytest.raises(TypeError, match="is no name; allowed: names such as"):
        eclsim.derivatives(CASE, ["MAP"], names)


def test_derivatives_of_nothing_are_refused():
    """It was "cannot reshape array of size 0"."""
    with pytest.raises(ValueError, match="derivatives of nothing"):
        eclsim.derivatives(CASE, [], [])
