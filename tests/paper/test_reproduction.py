from dataclasses import replace

import numpy as np
import pytest

from eclsim.paper.claims import CLAIMS
from eclsim.paper.crrt import compute, reproduce_crrt, table_rows
from eclsim.paper.patient import paper_case, tolerance_of
from eclsim.paper.published_crrt import ALL_PRINTED
from eclsim.paper.rows import Row, Verdict, statement

NUMBER = Row("3.3", "a pressure", "mmHg", 70.3, 71.0, None, 1, 0.05)


def test_every_value_of_tables_s1_to_s4_is_used_as_printed():
    rows = table_rows()
    assert len(rows) == 36 + 13 + 11 + 7
    assert [row.quantity for row in rows if not row.as_printed] == []


def test_every_printed_number_can_be_computed(study):
    needed = [p for p in ALL_PRINTED if p.key[0] not in ("first", "low")]
    values = [compute(printed, study) for printed in needed]
    assert len(values) > 50
    assert all(value == value for value in values)


def test_an_unknown_way_to_compute_is_an_error(study):
    with pytest.raises(ValueError, match="no way to compute"):
        compute(replace(ALL_PRINTED[0], key=("guess",)), study)


@pytest.mark.parametrize(
    ("row", "verdict"),
    [
        (replace(NUMBER, ours=70.34), Verdict.AS_PRINTED),
        (NUMBER, Verdict.DIFFERS),
        (replace(NUMBER, explained=70.3), Verdict.EXPLAINED),
        (replace(NUMBER, explained=72.0), Verdict.DIFFERS),
        (replace(NUMBER, other_data=True), Verdict.OTHER_DATA),
        (statement("3.3", "so it is", True), Verdict.AS_PRINTED),
        (statement("3.3", "so it is", False, "because", True), Verdict.EXPLAINED),
    ],
)
def test_a_row_knows_what_the_comparison_came_to(row, verdict):
    assert row.verdict is verdict


def test_statements_of_the_text_hold_and_some_that_it_does_not_make_do_not(study):
    assert [claim.words for claim in CLAIMS if not claim.holds(study)] == []
    turned = replace(study, means=study.means.copy(deep=True), summary=study.summary.copy(deep=True))
    turned.means["Psart"] = -turned.means["Psart"]
    turned.means["Pcrrttuout"] = turned.means["Pcrrttuout"] - 400.0
    turned.summary["Psart_highest"] = turned.summary["Psart_lowest"]
    broken = {claim.words for claim in CLAIMS if not claim.holds(turned)}
    assert {
        "arterial pressure rises with flow in every scheme",
        "all line pressures are within the usual alarms",
        "a line pressure is negative in scheme h alone",
        "the scheme of the highest arterial pressure is h",
        "return pressures are positive in all schemes at 3425 rpm",
    } <= broken


def bar(printed) -> float:
    """What a number of section 3.3 or 4 is held to once the unstated blood volume is filled in."""
    if printed.section.startswith("4,"):
        return 1.5
    lines = printed.section == "3.3, 3425 rpm" and printed.words.startswith(("access", "return"))
    return (0.01 if lines else 0.02) * abs(printed.value) + 0.5 * 10.0**-printed.digits


@pytest.mark.slow
def test_one_unstated_number_explains_what_differs():
    result = reproduce_crrt()
    found = result.unstated
    assert found.blood_volume_ml == pytest.approx(3247.0, abs=10.0)
    assert found.heart_rate_bpm == pytest.approx(118.0, abs=4.0)
    assert found.misfit < 0.6 < found.assumed_misfit
    assert result.explained.case.patient.age_years == 69.0
    text = {(p.section, p.words): p for p in ALL_PRINTED if not p.other_data}
    compared = 0
    for row in result.rows:
        printed = text.get((row.section, row.quantity))
        if printed is None or printed.key[0] in ("first", "low"):
            continue
        compared += 1
        assert abs(row.explained - row.paper) <= bar(printed), row
        if not printed.remark:
            assert abs(row.explained - row.paper) <= tolerance_of(printed), row.quantity
            assert row.verdict in (Verdict.AS_PRINTED, Verdict.EXPLAINED)
    assert compared == 51
    low = next(row for row in result.rows if row.quantity.endswith("the return line's low alarm"))
    assert np.isfinite(low.ours)


def test_the_assumed_patient_is_the_one_of_table_s4():
    assert paper_case().parameters["Emaxrv"] == 0.10791
