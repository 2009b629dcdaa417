"""All 26 reference cases of the published code: outputs and waveforms."""

import pytest

from eclsim.validation.reference_cases import QUICK, case_names, output_rows, reference_result, waveform_rows

CASES = [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in case_names()]


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_outputs_and_volumes_are_those_of_the_published_code(name: str):
    assert reference_result(name).attrs["converged"]
    rows = output_rows(name)
    assert len(rows) in (16, 17)
    assert [(row.name, row.expected, row.got) for row in rows if not row.holds] == []


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_waveforms_are_those_of_the_published_code_or_the_difference_is_explained(name: str):
    rows = waveform_rows(name)
    assert len(rows) >= 90
    assert [(r.name, r.expected, r.got) for r in rows if not r.holds and not r.explained] == []
