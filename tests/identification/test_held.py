"""What follows from parameters that a fit holds."""

import numpy as np
import pytest

from eclsim.cases.reading import read_mapping
from eclsim.identification.held import left_open
from eclsim.identification.objective import NORMAL_90
from eclsim.outputs.results import derivatives
from eclsim.parameters.thiel2025 import BOUNDS

CASE = read_mapping(
    {"format": 1, "patient": {"id": "P", "sex": "male", "age_years": 60, "heart_rate_bpm": 75}}
).case
FREE = {"Rmc": tuple(BOUNDS["Rmc"])[:3]}


def test_an_output_that_held_parameters_carry_is_left_open_with_its_interval():
    """One measurement, two parameters: by hand from the two derivatives and the bounds as prior."""
    others = {name: bounds.start for name, bounds in BOUNDS.items() if name not in ("Rmc", "Emaxlv")}
    case = CASE.model_copy(update={"parameters": others})
    found = left_open(case, FREE, {"MAP": 2.0}, "as_published")
    assert found is not None
    assert found.held == ("Emaxlv",)
    assert "Emaxlv is held at the usual value" in found.sentence
    slopes = derivatives(case, ("MAP", "CO"), ("Rmc", "Emaxlv"))
    by_log = slopes.to_numpy() * [BOUNDS["Rmc"].start, BOUNDS["Emaxlv"].start]
    deviation = np.log(100.0) / np.sqrt(12.0)
    covariance = np.linalg.inv(np.outer(by_log[0], by_log[0]) / 4.0 + np.eye(2) / deviation**2)
    value = float(slopes["value"][1])
    reach = np.exp(NORMAL_90 * np.sqrt(by_log[1] @ covariance @ by_log[1]) / value)
    np.testing.assert_allclose(found.intervals["CO"], (value / reach, value * reach), rtol=1e-6)


@pytest.mark.parametrize(
    ("given", "errors"),
    [(dict.fromkeys(BOUNDS), {"MAP": 2.0}), ({}, {"MAP": 2.0, "CO": 0.3, "PCWP": 2.0, "MPAP": 2.0})],
)
def test_nothing_is_left_open_where_parameters_are_given_or_outputs_measured(given, errors):
    values = {name: BOUNDS[name].start for name in given}
    case = CASE.model_copy(update={"parameters": values})
    assert left_open(case, FREE, errors, "as_published") is None


def test_where_all_seven_are_free_nothing_is_held():
    free = {name: tuple(bounds)[:3] for name, bounds in BOUNDS.items()}
    assert left_open(CASE, free, {"MAP": 2.0}, "as_published") is None
