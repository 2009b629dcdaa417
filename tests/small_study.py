"""One small study, shared: the paper's patient, nine schemes, both volume policies, speeds of the text."""

import pytest

from eclsim.crrt_study.study import CrrtStudy, crrt_study
from eclsim.paper.crrt import paper_case

HOSTILE = "<script>alert('x')</script> & \"$\\alpha\""


@pytest.fixture(scope="session")
def study() -> CrrtStudy:
    return crrt_study(paper_case(), speeds="1000,1750,3000:5000:500")


@pytest.fixture(scope="session")
def hostile_study() -> CrrtStudy:
    """Three schemes at four speeds, of a patient whose id is an attack."""
    case = paper_case()
    patient = case.patient.model_copy(update={"id": HOSTILE})
    return crrt_study(case.model_copy(update={"patient": patient}), schemes="a,g,h", speeds="1000:5000:2000")
