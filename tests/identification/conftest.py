"""A patient whose parameters are known, and what would be measured of them."""

import pytest

from eclsim.cases.case import Case, Measurements, Patient
from eclsim.identification.objective import Box, Objective, Target
from eclsim.orbit.model import model_of
from eclsim.outputs.results import simulate
from eclsim.parameters.thiel2025 import BOUNDS
from known_posteriors import CurvedPosterior

TRUTH = {"Rmc": 0.85, "Emaxlv": 1.3}
MEASURED = ("SP", "DP", "MAP", "MPAP", "PCWP", "CO")


@pytest.fixture(scope="session")
def twin() -> Case:
    """A case without devices whose measurements are what the model gives with `TRUTH`."""
    patient = Patient(id="T01", sex="female", age_years=60, heart_rate_bpm=80)
    beat = simulate(model_of(Case(patient=patient, parameters=TRUTH)))
    return Case(patient=patient, measurements=Measurements(**{n: float(beat[n]) for n in MEASURED}))


@pytest.fixture(scope="session")
def box() -> Box:
    return Box.of({name: BOUNDS[name] for name in TRUTH})


@pytest.fixture(scope="session")
def objective(twin: Case, box: Box) -> Objective:
    assert twin.measurements is not None
    measured = {n: getattr(twin.measurements, n) for n in MEASURED}
    return Objective([Target(model_of(twin), measured, measured)], box.names)


@pytest.fixture
def curved() -> CurvedPosterior:
    return CurvedPosterior(bend=0.8)
