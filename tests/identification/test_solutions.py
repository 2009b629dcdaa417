"""Further solutions of the measurements: sought, named, and part of the intervals where they fit as well."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from eclsim.cases import read_case
from eclsim.cases.case import Case, Measurements
from eclsim.cases.cohort import CohortPoint
from eclsim.identification import cohort
from eclsim.identification.fit import fit, fit_cases
from eclsim.identification.multi_start import MultiStart
from eclsim.identification.posterior import PosteriorSettings, posterior
from eclsim.identification.settings import FitSettings
from eclsim.identification.solutions import with_solutions_sought, words_on_fit
from eclsim.identification.verdict import Aspect, Level

EXAMPLES = Path(__file__).parents[2] / "examples"
NAMES = (
    "gas.shunt_fraction",
    "gas.vo2_ml_min",
    "ecmo.drainage_mixing",
    "ecmo.oxygenator.clotted_fraction",
    "Rmc",
)
SEARCH = MultiStart(points_per_parameter=36, round_size=2, rediscoveries=1)


@pytest.fixture(scope="module")
def veno_venous():
    """Simulated with a shunt of 0.55 and 230 mL/min, and measured with noise."""
    case: Case = read_case(EXAMPLES / "veno_venous_blood_gases.toml").case
    measured = Measurements(
        MAP=84.37, PF=4.882, SaO2=97.51, PaO2=81.01, PaCO2=36.8, SpreO2=79.16, PpostO2=328.9, PexhaustCO2=35.4
    )
    membrane = {"ecmo.oxygenator.oxygen_transfer": 0.0653}
    case = case.model_copy(update={"measurements": measured, "parameters": membrane})
    return fit_cases([("P", case)], FitSettings(NAMES, multi_start=SEARCH))[0]


@pytest.mark.slow
def test_a_second_solution_that_fits_as_well_is_named_and_widens_the_intervals(veno_venous):
    """VO2 was determined as 225 to 256 mL/min, although 156 with a shunt of 0.99 fits as well."""
    assert len(veno_venous.optimum.distinct_ends) == 1
    assert veno_venous.parameters["gas.vo2_ml_min"].lower > 200.0
    sought = with_solutions_sought(veno_venous)
    (reason,) = [r for r in sought.verdict.doubts if r.aspect is Aspect.SEARCH]
    assert reason.level is Level.DOUBTFUL
    assert reason.sentence.startswith("the measurements fit another patient, too: gas.shunt_fraction 0.99")
    vo2, shunt = (sought.parameters[n] for n in ("gas.vo2_ml_min", "gas.shunt_fraction"))
    assert vo2.lower == pytest.approx(156.0, abs=3.0)
    assert not vo2.identifiable
    assert "another solution fits the measurements equally well" in vo2.reason
    assert shunt.upper > 0.98
    assert sought.parameters["gas.vo2_ml_min"].value == veno_venous.parameters["gas.vo2_ml_min"].value


@pytest.mark.slow
def test_draws_cover_a_solution_that_no_start_ended_in(veno_venous):
    """All starts ended at a shunt of 0.5, and the draws said nothing of the second at 0.99."""
    result = posterior(veno_venous, settings=PosteriorSettings(method="importance"))
    assert len(result.gaussian.solutions) == 2
    share = np.mean(result.flat[:, NAMES.index("gas.shunt_fraction")] > 0.9)
    assert share == pytest.approx(0.04, abs=0.015)
    assert any(note.startswith("the measurements have 2 solutions") for note in result.notes)


@pytest.mark.slow
def test_a_fit_with_one_solution_stays_as_it_is(twin):
    settings = FitSettings(("Rmc", "Emaxlv"), multi_start=SEARCH)
    (alone,) = fit_cases([("P", twin)], settings)
    assert with_solutions_sought(alone) is alone


@pytest.mark.slow
def test_a_fit_from_python_and_one_of_a_cohort_name_the_second_solution_as_well(veno_venous, monkeypatch):
    """Only `eclsim identify` of a case did: `eclsim.fit` and cohorts gave the narrow intervals alone."""
    monkeypatch.setattr("eclsim.identification.fit.fit_cases", lambda *_: [veno_venous])
    monkeypatch.setattr(cohort, "fit_cases", lambda *_: [veno_venous])
    from_python = fit(veno_venous.case, settings=veno_venous.settings)
    point = CohortPoint("P", "1", 2, veno_venous.case)
    ((stored),) = cohort.FitGroup(veno_venous.settings)((point,))
    for verdict in (from_python.as_object()["verdict"], stored.numbers["verdict"]):
        assert any("the measurements fit another patient, too" in str(each) for each in verdict["reasons"])
    assert from_python.parameters["gas.vo2_ml_min"].lower == pytest.approx(156.0, abs=3.0)


def test_the_probability_is_not_set_beside_a_fit_far_from_the_likeliest_patient():
    """A solution of chi-square 23 had "10 % of the probability" beside a fit of 73: the rest was at 21."""
    density = SimpleNamespace(target=np.array([68.0, 97.0]), scale=np.array([3.0, 1.5]))
    likeliest = SimpleNamespace(outputs=np.array([68.0, 100.0]))
    assert words_on_fit(density, likeliest, 4.5) == "4.5 of this fit"
    said = words_on_fit(density, likeliest, 73.3)
    assert said.startswith("4.0 of the likeliest patient near this fit (73.3 of the fit itself")
