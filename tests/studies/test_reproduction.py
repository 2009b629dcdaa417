import pytest

from eclsim.studies.paper_patient import paper_case, tolerance_of
from eclsim.studies.published_crrt import ALL_PRINTED
from eclsim.studies.reproduction import compute, table_rows


def test_every_value_of_tables_s1_to_s4_is_used_as_printed():
    rows = table_rows()
    assert len(rows) == 36 + 13 + 11 + 7
    assert [row.quantity for row in rows if not row.as_printed] == []


def test_every_printed_number_can_be_computed(study):
    needed = [p for p in ALL_PRINTED if p.key[0] != "first"]
    values = [compute(printed, study) for printed in needed]
    assert len(values) > 50
    assert all(value == value for value in values)


def test_an_unknown_way_to_compute_is_an_error(study):
    from dataclasses import replace

    with pytest.raises(ValueError, match="no way to compute"):
        compute(replace(ALL_PRINTED[0], key=("guess",)), study)


@pytest.mark.slow
def test_one_unstated_number_explains_what_differs():
    from eclsim.studies.reproduction import reproduce

    result = reproduce()
    found = result.unstated
    assert found.blood_volume_ml == pytest.approx(3247.0, abs=10.0)
    assert found.heart_rate_bpm == pytest.approx(118.0, abs=4.0)
    assert found.misfit < 0.6 < found.assumed_misfit
    assert result.explained.case.patient.age_years == 69.0
    text = {(p.section, p.words): p for p in ALL_PRINTED}
    for row in result.rows:
        printed = text.get((row.section, row.quantity))
        if printed is not None and not printed.remark:
            assert abs(row.explained - row.paper) <= tolerance_of(printed), row.quantity
            assert row.as_printed or "it agrees" in row.why


def test_the_assumed_patient_is_the_one_of_table_s4():
    assert paper_case().parameters["Emaxrv"] == 0.10791
