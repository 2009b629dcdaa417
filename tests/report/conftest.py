"""One small study, shared by the tests of what is written about it."""

import pytest

from eclsim.studies.crrt_study import CrrtStudy, crrt_study
from eclsim.studies.paper_patient import paper_case

HOSTILE = "<script>alert('x')</script> & \"$\\alpha\""


@pytest.fixture(scope="session")
def hostile_study() -> CrrtStudy:
    """Three schemes at four speeds, of a patient whose id is an attack."""
    case = paper_case()
    patient = case.patient.model_copy(update={"id": HOSTILE})
    return crrt_study(case.model_copy(update={"patient": patient}), schemes="a,g,h", speeds="1000:5000:2000")
