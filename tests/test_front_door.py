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
