"""One small study, shared: the paper's patient, nine schemes, both volume policies, speeds of the text."""

import pytest

from eclsim.crrt_study.study import CrrtStudy, crrt_study
from eclsim.paper.patient import paper_case


@pytest.fixture(scope="session")
def study() -> CrrtStudy:
    return crrt_study(paper_case(), speeds="1000,1750,3000:5000:500")
