"""The sentences of a CRRT study on what it assumes."""

from dataclasses import replace
from html import unescape

import pytest

from eclsim.cases.case import Case
from eclsim.crrt_study.assumptions import assumptions_in_words, model_in_words, models_in_words
from eclsim.crrt_study.files import DRAWINGS, study_object
from eclsim.crrt_study.report import study_page
from eclsim.paper.crrt import paper_case

PICTURES = dict.fromkeys(DRAWINGS, "<svg></svg>")


def case_with(**sections: object) -> Case:
    return Case.model_validate(paper_case().as_mapping() | sections)


def test_the_published_patient_has_neither_reflexes_nor_drugs_nor_regions_nor_gases():
    text = model_in_words(paper_case())
    for words in ("no reflexes", "no drugs", "all organs as one bed", "no gas exchange", "no fluid taken"):
        assert words in text
    assert "before" not in text


@pytest.mark.parametrize(
    ("section", "settings", "words", "absent"),
    [
        ("regulation", {"baroreflex": 0.5}, "reflexes (ursino1998: gain of all reflexes 0.5)", "no reflexes"),
        ("regulation", {"baroreflex": 1, "model": "heldt2010"}, "reflexes (heldt2010: ", "no reflexes"),
        ("regulation", {"baroreflex": 0}, "no reflexes", "reflexes ("),
        ("regulation", {"hypoxic_vasoconstriction": 1, "baroreflex": 0}, "no reflexes", "hypoxic"),
        ("drugs", {"noradrenaline": 0.2}, "infusions of noradrenaline 0.2 ug/kg/min", "no drugs"),
        ("physiology", {"regional": True}, "upper and lower body as regions", "one bed"),
        ("physiology", {"pericardium": True}, "one bed, a pericardium", "regions"),
        ("physiology", {"aortic_stenosis_cm2": 0.8}, "area of the open aortic valve 0.8 cm2", "mitral"),
        ("fluid", {"extra_volume_ml": -500}, "500 mL of blood lost before", "given"),
        ("gas", {}, "no reflexes", "no gas exchange"),
    ],
)
def test_the_sentence_follows_the_case(section, settings, words, absent):
    text = model_in_words(case_with(**{section: settings}))
    assert words in text
    assert absent not in text


def test_responses_to_gases_are_named_where_gases_are_computed():
    text = model_in_words(case_with(gas={}, regulation={"baroreflex": 1, "hypoxic_vasoconstriction": 0.7}))
    assert "strength of hypoxic pulmonary vasoconstriction 0.7" in text


def test_a_cohort_says_which_model_how_many_patients_have():
    without, regulated = paper_case(), case_with(regulation={"baroreflex": 1})
    assert models_in_words({"P1": without, "P2": without}) == [model_in_words(without)]
    first, second = models_in_words({"P1": without, "P2": regulated, "P3": without})
    assert first.startswith("In 2 of 3 data points: ")
    assert "no reflexes" in first
    assert "gain of all reflexes 1" in second


@pytest.mark.slow
def test_page_json_and_dataset_name_the_reflexes_of_the_case(hostile_study):
    study = replace(hostile_study, case=case_with(regulation={"baroreflex": 0.5}))
    sentences = assumptions_in_words(study)
    assert "gain of all reflexes 0.5" in sentences[0]
    page = unescape(study_page(study, PICTURES))
    assert all(sentence in page for sentence in sentences)
    assert "no reflexes" not in page
    assert study_object(study)["assumed"] == sentences == study.dataset.attrs["assumed"]
