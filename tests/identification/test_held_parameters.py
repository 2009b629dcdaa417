"""What follows from parameters that a fit holds."""

import re

import numpy as np
import pytest
from scipy.optimize import brentq

from eclsim.cases.reading import read_mapping
from eclsim.identification.fit import fit
from eclsim.identification.held_parameters import undetermined_outputs
from eclsim.identification.multi_start import MultiStart
from eclsim.identification.objective import NORMAL_90
from eclsim.identification.settings import FitSettings
from eclsim.outputs.results import derivatives, simulate
from eclsim.parameters.thiel2025 import BOUNDS

CASE = read_mapping(
    {"format": 1, "patient": {"id": "P", "sex": "male", "age_years": 60, "heart_rate_bpm": 75}}
).case
FREE = {"Rmc": tuple(BOUNDS["Rmc"])[:3]}


@pytest.mark.slow
def test_an_output_that_held_parameters_carry_is_left_open_as_far_as_the_measurement_allows():
    """One measurement, two parameters: by hand, elastance at its bounds, and the resistance that meets it."""
    others = {name: bounds.start for name, bounds in BOUNDS.items() if name not in ("Rmc", "Emaxlv")}
    case = CASE.model_copy(update={"parameters": others})
    at = derivatives(case, ("MAP", "CO"), ("Rmc", "Emaxlv"))["value"].to_numpy()
    found = undetermined_outputs(case, FREE, {"MAP": at[0]}, {"MAP": 2.0}, "as_published")
    assert found is not None
    assert found.why == "compensates for errors in Emaxlv, which is held"
    assert "Emaxlv is held at the usual value" in found.sentence
    ends = [
        flow
        for held, solved in (("Emaxlv", "Rmc"), ("Rmc", "Emaxlv"))
        for bound in BOUNDS[held][1:3]
        for pressure in (at[0] - 2.0 * NORMAL_90, at[0] + 2.0 * NORMAL_90)
        for flow in _flows_that_meet(case, {**others, held: bound}, solved, pressure)
    ]
    reach = found.outputs["CO"]
    assert reach.high == pytest.approx(max(ends), rel=1e-3)
    assert reach.open_below
    assert min(ends) < reach.low == pytest.approx(at[1] / 6.0, rel=1e-3)


def _flows_that_meet(case, values, solved, pressure):
    """Cardiac output where a mean arterial pressure is met within the bounds of one parameter, if it is."""

    def beat(log):
        parameters = {**values, solved: float(np.exp(log))}
        found = simulate(case.model_copy(update={"parameters": parameters}))
        return float(found["MAP"]) - pressure, float(found["CO"])

    ends = np.log(BOUNDS[solved][1:3])
    if beat(ends[0])[0] * beat(ends[1])[0] > 0.0:
        return []
    return [beat(brentq(lambda log: beat(log)[0], *ends, xtol=1e-4))[1]]


@pytest.mark.slow
def test_a_failing_right_heart_that_is_held_at_its_usual_strength_is_within_what_is_left_open():
    """To first order a cardiac output of 3.2 L/min was outside 5 to 17, and wide vessels were determined."""
    given = {
        "format": 1,
        "patient": {"id": "P", "sex": "male", "age_years": 50, "heart_rate_bpm": 95},
    }
    failing = {
        "Emaxlv": 1.2,
        "Emaxrv": 0.155,
        "RV_Pd_kappa": 0.025,
        "Rpmc": 0.408,
        "Rmc": 0.872,
        "P0svn": 16.0,
    }
    truth = simulate(read_mapping({**given, "parameters": failing}).case)
    measured = {name: float(truth[name]) for name in ("MAP", "SP", "DP")}
    result = fit(
        read_mapping({**given, "measurements": measured}).case,
        settings=FitSettings(("Rmc", "Csart"), multi_start=MultiStart.quick(200)),
    )
    (doubt,) = [
        reason.sentence for reason in result.verdict.reasons if "held at the usual" in reason.sentence
    ]
    low, high = re.search(r"CO ([0-9.]+)(?: or less)? to ([0-9.]+)", doubt).groups()
    assert float(low) < float(truth["CO"]) < float(high)
    assert not result.parameters["Rmc"].identifiable
    assert result.parameters["Rmc"].lower < 0.872 < result.parameters["Rmc"].upper


@pytest.mark.parametrize(
    ("given", "errors"),
    [(dict.fromkeys(BOUNDS), {"MAP": 2.0}), ({}, {"MAP": 2.0, "CO": 0.3, "PCWP": 2.0, "MPAP": 2.0})],
)
def test_nothing_is_left_open_where_parameters_are_given_or_outputs_measured(given, errors):
    values = {name: BOUNDS[name].start for name in given}
    case = CASE.model_copy(update={"parameters": values})
    assert undetermined_outputs(case, FREE, dict.fromkeys(errors, 5.0), errors, "as_published") is None


def test_where_all_seven_are_free_nothing_is_held():
    free = {name: tuple(bounds)[:3] for name, bounds in BOUNDS.items()}
    assert undetermined_outputs(CASE, free, {"MAP": 80.0}, {"MAP": 2.0}, "as_published") is None
