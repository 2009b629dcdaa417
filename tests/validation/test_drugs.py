"""Drugs against patients: the fit is repeated by what is published, tests stay tests."""

import numpy as np
import pytest

from eclsim.parameters.regulation import DRUG_DOSES, dose
from eclsim.validation import drugs


@pytest.fixture(scope="module")
def check():
    return drugs.drugs_check()


def test_a_study_is_either_fitted_or_a_test_but_for_pulmonary_resistance_and_every_drug_has_a_fit():
    uses = {}
    for arm in drugs.arms():
        assert set(arm.infusions) <= set(map(dose, DRUG_DOSES))
        for row in arm.rows:
            pulmonary = (
                row["quantity"] == "PVR" and arm.study == "Additive effects of milrinone and dobutamine"
            )
            uses.setdefault(row["use"], set()).add((arm.study, arm.arm, pulmonary))
    assert not uses["fit"] & uses["test"]
    assert {arm for _, arm, pulmonary in uses["fit"] if pulmonary} == {"dobutamine", "milrinone"}
    assert {arm for _, arm, _ in uses["fit"]} == set(DRUG_DOSES)
    assert {arm for _, arm, _ in uses["test"]} == (set(DRUG_DOSES) - {"noradrenaline", "nitroprusside"}) | {
        "both"
    }


@pytest.mark.slow
def test_a_study_that_prints_a_direction_alone_gives_a_row_of_its_sign(check):
    rows = [row for row in check.rows if "Moran 1993" in row.name and row.name.endswith("sign")]
    assert [row.expected for row in rows] == [1.0, 1.0, 1.0]
    assert all(row.holds for row in rows)


def test_the_patient_of_a_study_has_its_values_before_the_drug():
    arm = next(a for a in drugs.arms() if a.study == "Additive effects of milrinone and dobutamine")
    names = ("SVI", "PCWP", "SVR", "PVR", "HR")
    result = drugs.measured(drugs.patient_of(arm), {}, names)
    for name in names:
        np.testing.assert_allclose(result[name], arm.before[name], rtol=1e-5)


@pytest.mark.slow
def test_published_effects_are_those_of_the_fit(check):
    """Every fit row within its bar; the directions of change of all tests but the ones known to miss.

    Of those, the fit study of milrinone did not measure the heart rate; carvedilol blocks what dobutamine
    acts on elsewhere; dobutamine does not dilate anaesthetised patients with good hearts; levosimendan's
    heart rates differ between studies.
    """
    assert not check.required
    assert all(row.holds for row in check.rows if "(fit)" in row.name)
    wrong = {row.name for row in check.missed if row.name.endswith("sign")}
    known = (
        "Lowes 2001, dobutamine", "milrinone: heart rate", "Coronary surgery 1979, dobutamine",
        "Med Klin 2006, levosimendan: heart rate",
    )  # fmt: skip
    assert all(any(part in name for part in known) for name in wrong)
    unexplained = {row.name for row in check.missed if not row.explained}
    assert len(unexplained) == 9, unexplained
    assert {name for name in unexplained if name.endswith("sign")} == {
        "Lowes 2001, milrinone: heart rate (test): sign",
        "Med Klin 2006, levosimendan: heart rate (test): sign",
    }


def test_an_experiment_changes_the_effects_alone():
    patient = drugs.plain_patient(80.0)
    dose_of = dose("dobutamine")
    names, doses = ("MAP", "HR"), {dose_of: [0.0, 5.0, 10.0]}
    plain = drugs.measured(patient, doses, names)
    halved = drugs.measured(drugs.Experiment("", sensitivity=0.5).done(patient), doses, names)
    np.testing.assert_allclose(halved["MAP"][2], plain["MAP"][1], rtol=1e-6)
    none = drugs.Experiment("", acting=drugs.Effects(0.0, 0.0, 0.0, 0.0, 0.0)).done(patient)
    still = drugs.measured(none, doses, names)
    np.testing.assert_allclose(still["MAP"], plain["MAP"][0], rtol=1e-6)
    np.testing.assert_allclose(still["HR"], 80.0)
