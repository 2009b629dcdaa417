"""Experiments with what they held: signs of the left ventricle on V-A ECMO, and the search for the animal."""

import pytest

from eclsim.outputs.results import simulate
from eclsim.validation import regulation, ventilation
from eclsim.validation.matching import UnreachableError, with_outputs


def test_curves_are_as_printed():
    assert all(row.holds for row in regulation.curve_rows())


@pytest.mark.slow
def test_a_patient_is_made_to_have_measured_values_or_it_is_said():
    plain = regulation.adult(75.0)
    result = with_outputs(plain, ("Rmc", regulation.EXTRA_VOLUME), {"MAP": 80.0, "CO": 5.0})
    assert float(simulate(result)["MAP"]) == pytest.approx(80.0, rel=1e-5)
    assert float(simulate(result)["CO"]) == pytest.approx(5.0, rel=1e-5)
    with pytest.raises(UnreachableError, match="no values of Emaxla result"):
        with_outputs(plain, ("Emaxla",), {"MAP": 200.0})


@pytest.mark.slow
def test_with_filling_held_all_signs_of_the_left_ventricle_are_measured_ones():
    rows = list(regulation.ecmo_rows())
    held = [row for row in rows if "right atrial pressure held: sign" in row.name]
    assert len(held) == 11
    assert all(row.holds for row in held)
    missed = [row for row in rows if not row.holds and "volume held: sign" in row.name]
    assert all(row.explained for row in missed)


@pytest.mark.slow
def test_nerves_that_answer_to_carbon_dioxide_have_the_wrong_signs_in_red_rows():
    """With the answer measured in patients in their place all but one are right."""
    rows = {row.name.removeprefix("hypercapnia, "): row for row in ventilation.healthy_rows()}
    wrong = {name for name, row in rows.items() if not row.holds}
    assert {
        f"chemoreflex: {of}: sign" for of in ("systemic resistance", "mean pulmonary artery pressure")
    } < wrong
    assert len(rows) == 15
    measured = {name for name in wrong if name.startswith("measured response")}
    assert measured == {"measured response: mean arterial pressure (test): sign"}
    (pressure,) = (rows[name] for name in measured)
    assert pressure.explanation is not None
    assert pressure.explained, "awake people: nerves and measured response together have all five signs"
    assert len(pressure.explanation.evidence) == 5


@pytest.mark.slow
def test_patients_whose_carbon_dioxide_rises_answer_as_measured():
    rows = list(ventilation.patient_rows())
    assert [row.name for row in rows if not row.holds] == []
    assert sum("(fit)" in row.name for row in rows) == 1
    assert len(rows) == 18


@pytest.mark.slow
def test_what_misses_of_a_loss_of_blood_assist_pumps_and_another_model_is_explained_by_experiment():
    rows = [*regulation.haemorrhage_rows(), *regulation.lvad_rows(), *regulation.donker_rows()]
    missed = [row for row in rows if not row.holds]
    assert missed
    assert [row.name for row in missed if not row.explained] == []
