"""A fitted heart that no patient has."""

import pytest

from eclsim.cases.case import Measurements
from eclsim.cases.quantities import with_values
from eclsim.cases.reading import read_mapping
from eclsim.identification.fit import fit as fit_case
from eclsim.identification.multi_start import MultiStart
from eclsim.identification.settings import FitSettings
from eclsim.orbit.model import model_of
from eclsim.outputs.results import simulate
from shock_patient import SHOCK


@pytest.mark.slow
def test_a_fitted_heart_that_softens_as_it_contracts_is_doubted():
    """A second solution of the published law, with a fifth of the contractility of the first."""
    case = with_values(read_mapping(SHOCK).case, {"Emaxlv": 0.08})
    beat = simulate(model_of(case))
    values = {name: float(beat[name]) for name in ("SP", "DP", "MAP", "CO", "PCWP", "MPAP")}
    started = with_values(case, {"Emaxlv": 0.1})
    measured = started.model_copy(update={"measurements": Measurements(**values)})
    settings = FitSettings(
        ("Rmc", "Emaxlv"), weights="uncertainty", bounds={"Emaxlv": (0.05, 5.0)},
        multi_start=MultiStart.quick(60),
    )  # fmt: skip
    found = fit_case(measured, settings=settings)
    assert found.parameters["Emaxlv"].value == pytest.approx(0.08, rel=0.01)
    sentences = [reason.sentence for reason in found.verdict.doubts]
    assert any(s.startswith("the left ventricle is too weak for the 233 mL in it") for s in sentences)
    assert any("fit another patient, too: Emaxlv 0.4" in s for s in sentences)


@pytest.mark.slow
def test_a_fitted_atrium_that_is_stiffer_at_rest_than_in_contraction_is_said():
    """Only its case file, opened again, said so before."""
    case = with_values(read_mapping(SHOCK).case, {"Emaxlv": 1.0, "Edla": 1.2})
    beat = simulate(model_of(case))
    values = {name: float(beat[name]) for name in ("SP", "DP", "MAP", "CO", "PCWP", "MPAP")}
    started = with_values(case, {"Edla": 1.0})
    measured = started.model_copy(update={"measurements": Measurements(**values)})
    settings = FitSettings(("Rmc", "Edla"), weights="uncertainty", multi_start=MultiStart.quick(40))
    found = fit_case(measured, settings=settings)
    said = [reason.sentence for reason in found.verdict.reasons]
    assert found.parameters["Edla"].value > 0.45
    assert any("the left atrium is stiffer at rest than in contraction" in sentence for sentence in said)
    assert not any("the left atrium is stiffer" in reason.sentence for reason in found.verdict.doubts)
