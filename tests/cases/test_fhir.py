"""FHIR bundles: whose values are read, in which unit, and what is refused or named."""

import json
import re

import pytest

from clinical_files import LOINC, PATIENT, TWO, bundle, named, observation, of, panel
from eclsim.cases.case import Case, Patient
from eclsim.cases.importing import import_cohort
from eclsim.inputs.mistakes import CaseError


@pytest.mark.parametrize(
    ("resource", "text"),
    [
        (observation("8478-0", "80", "mm[Hg]"), "not a number"),
        (observation("8478-0", 80, "mg/dL"), "not a unit of pressure"),
        (observation("8478-0", 80, "mm[Hg]", ""), "no time"),
        (observation("8478-0", 80, "mm[Hg]", subject={}), "no subject"),
        (
            observation(
                "8478-0", 80, "mm[Hg]", valueQuantity={"value": 80, "code": "mm[Hg]", "comparator": ">"}
            ),
            "limit",
        ),
        ({"resourceType": "Patient", "id": "P01", "gender": "unknown", "birthDate": "1955"}, "female, male"),
        (observation("8478-0", 10**400, "mm[Hg]"), "not a number"),
        (observation("8478-0", float("inf"), "mm[Hg]"), "not a number"),
        (observation("8478-0", 80, "mm[Hg]", component=3), "component: not a list"),
        (observation("", 80, "mm[Hg]") | {"code": {"coding": {"code": "8478-0"}}}, "coding: not a list"),
        (observation("", 80, "mm[Hg]") | {"code": {"coding": 8478}}, "coding: not a list"),
    ],
)
def test_what_a_bundle_may_have_wrong(tmp_path, resource, text):
    with pytest.raises(CaseError, match=text):
        import_cohort(bundle(tmp_path, resource, observation("8480-6", 110, "mm[Hg]")))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "not valid JSON"),
        ("[]", "not a FHIR bundle"),
        ('{"resourceType": "Bundle"}', "with entries"),
        ('{"resourceType": "Patient"}', "not a FHIR bundle"),
        ("[" * 100_000, "deeply"),
    ],
)
def test_what_is_no_bundle(tmp_path, text, words):
    path = tmp_path / "x.json"
    path.write_text(text)
    with pytest.raises(CaseError, match=words):
        import_cohort(path)


def test_values_that_were_withdrawn_are_left_out(tmp_path):
    wrong = observation("8478-0", 400, "mm[Hg]", status="entered-in-error")
    result = import_cohort(bundle(tmp_path, PATIENT, wrong, observation("8478-0", 80, "mm[Hg]")))
    assert [row["MAP"] for row in result.rows] == ["80"]
    assert any("entered-in-error" in str(n) for n in result.notes)


def test_a_value_that_is_absent_for_a_reason_is_named(tmp_path):
    """Only one inside a panel was; a heart rate of its own was dropped without a word."""
    reason = {"dataAbsentReason": {"coding": [{"code": "unknown"}]}}
    absent = observation("8867-4", 0, "") | reason
    del absent["valueQuantity"]
    unread = observation("59408-5", 0, "") | reason
    del unread["valueQuantity"]
    result = import_cohort(bundle(tmp_path, PATIENT, panel(), absent, unread))
    assert "heart_rate_bpm: absent, with a reason: treated as missing" in "\n".join(map(str, result.notes))
    assert result.rows[0].get("heart_rate_bpm", "") == ""


def test_what_a_patient_leaves_out_is_that_of_the_base_case(tmp_path):
    """It was an error, although the base case gives sex and age where the data have none."""
    bare = {key: value for key, value in PATIENT.items() if key not in ("gender", "birthDate")}
    base = Case(patient=Patient(id="b", sex="male", age_years=61, heart_rate_bpm=80))
    (row,) = import_cohort(bundle(tmp_path, bare, *TWO), base=base).rows
    assert (row["sex"], row["age_years"]) == ("male", "61")


def test_a_wrong_time_of_a_value_does_not_make_the_birth_date_wrong(tmp_path):
    with pytest.raises(CaseError) as caught:
        import_cohort(bundle(tmp_path, PATIENT, observation("8480-6", 90, "mm[Hg]", "01.03.2026")))
    assert "ISO 8601" in str(caught.value)
    assert "birthDate" not in str(caught.value)


def test_the_age_is_that_at_each_data_point_whatever_else_a_bundle_holds(tmp_path):
    """The age was that at the earliest value, read or not, and left out if one of them had no time."""
    blood_group = observation("882-1", 1, "1", "1999-01-01T09:00:00+01:00")
    lactate = {k: v for k, v in observation("2524-7", 1, "mmol/L").items() if k != "effectiveDateTime"}
    later = observation("8478-0", 60, "mm[Hg]", "2026-04-17T09:00:00+01:00")
    rows = import_cohort(bundle(tmp_path, PATIENT, blood_group, lactate, *TWO, later)).rows
    assert [(row["age_years"], row["MAP"]) for row in rows] == [("68", "80"), ("71", "60")]


def test_no_message_shows_a_name_or_a_birth_date(tmp_path):
    person = PATIENT | {"address": [{"city": "Ulm"}], "birthDate": "2030-04-17"}
    unknown = observation("8478-0", 80, "kPa?") | {"subject": {"display": "Doe"}}
    named = [unknown | {"subject": {"reference": f"Patient/{of}", "display": "Doe"}} for of in ("P01", "P02")]
    with pytest.raises(CaseError) as caught:
        import_cohort(bundle(tmp_path, person, *TWO, unknown, *named))
    assert "before the patient's birth date" in str(caught.value)
    assert not re.search("Doe|Ulm|2030", str(caught.value))


def test_where_nothing_is_left_it_is_said_what_was_left_out(tmp_path):
    with pytest.raises(CaseError, match="status entered-in-error: not read"):
        import_cohort(
            bundle(tmp_path, PATIENT, observation("8478-0", 80, "mm[Hg]", status="entered-in-error"))
        )


@pytest.mark.parametrize("base", [None, 80.0])
def test_size_measured_at_admission_is_the_patients_in_every_data_point(tmp_path, base):
    admission = "2024-02-28T09:00:00+01:00"
    later = observation("29463-7", 47, "kg", "2024-03-02T09:00:00+01:00")
    file = bundle(
        tmp_path,
        PATIENT,
        *TWO,
        observation("8302-2", 150, "cm", admission),
        observation("29463-7", 45, "kg", admission),
        later,
        observation("8478-0", 70, "mm[Hg]", "2024-03-02T12:00:00+01:00"),
    )
    case = base and Case(
        patient=Patient(id="base", sex="female", age_years=50, heart_rate_bpm=70, height_cm=175, weight_kg=80)
    )
    result = import_cohort(file, case or None)
    assert [(r["MAP"], r["height_cm"], r["weight_kg"]) for r in result.rows] == [
        ("80", "150", "45"),
        ("70", "150", "47"),
    ]
    assert any(f"weight_kg: 45, measured {admission}" in str(n) for n in result.notes)


def test_a_reference_with_a_version_names_its_patient_and_not_the_version(tmp_path):
    other = PATIENT | {"id": "P02", "gender": "male"}
    low = observation("8478-0", 60, "mm[Hg]", "2024-03-01T12:00:00+01:00")
    values = [*of("Patient/P01/_history/1", *TWO), *of("https://x.org/fhir/Patient/P02/_history/1", low)]
    rows = import_cohort(bundle(tmp_path, PATIENT, other, *values)).rows
    assert [(r["patient_id"], r["sex"], r["MAP"]) for r in rows] == [
        ("P01", "female", "80"),
        ("P02", "male", "60"),
    ]


@pytest.mark.parametrize("named", [True, False])
def test_a_patient_is_one_whether_called_by_address_or_by_id(tmp_path, named):
    person = PATIENT if named else {k: v for k, v in PATIENT.items() if k != "id"}
    values = of("urn:uuid:11", *TWO) + of("Patient/P01", observation("8741-1", 4, "L/min")) * named
    entries = [{"fullUrl": "urn:uuid:11", "resource": person}, *({"resource": v} for v in values)]
    path = tmp_path / "bundle.json"
    path.write_text(json.dumps({"resourceType": "Bundle", "entry": entries}))
    (row,) = import_cohort(path).rows
    assert row["patient_id"] == ("P01" if named else "11")
    assert (row["sex"], row["age_years"], row["MAP"]) == ("female", "68", "80")


@pytest.mark.parametrize("bare", [True, False])
def test_one_id_on_two_servers_is_not_taken_for_one_patient(tmp_path, bare):
    """Two hospitals' patients of one id became one patient, with the sex and age of the first."""
    known = PATIENT["id"], *(() if bare else (PATIENT["gender"], PATIENT["birthDate"]))
    person = {key: value for key, value in PATIENT.items() if key == "resourceType" or value in known}
    at = [f"https://{hospital}.org/fhir/Patient/P01" for hospital in ("a", "b")]
    low = observation("8478-0", 60, "mm[Hg]", "2024-03-01T12:00:00+01:00")
    values = [*of(at[0], *TWO), *of(at[1], low)]
    entries = [{"fullUrl": at[0], "resource": person}, *({"resource": v} for v in values)]
    path = tmp_path / "bundle.json"
    path.write_text(json.dumps({"resourceType": "Bundle", "entry": entries}))
    with pytest.raises(CaseError, match="have one id and may be two patients"):
        import_cohort(path)
    entries.append({"fullUrl": at[1], "resource": person})
    path.write_text(json.dumps({"resourceType": "Bundle", "entry": entries[:3] + entries[-1:]}))
    with pytest.raises(CaseError, match=r"entry 4: .*have one id and may be two patients"):
        import_cohort(path)


@pytest.mark.parametrize(
    ("resources", "said"),
    [
        (of("Device/P01", *TWO), "the subject is a Device"),
        ([PATIENT | {"gender": "male"}, *TWO], "two Patient resources of this id"),
        ([TWO[0] | {"effectiveDateTime": "1950-01-01"}], "P01 1950-01-01: before the patient's birth date"),
        (
            [TWO[1] | {"valueQuantity": {"value": 10.7, "unit": "kPa", "code": "mm[Hg]"}}],
            "10.7 mm[Hg], 10.7 kPa: its code and its text give different units",
        ),
    ],
)
def test_doubt_whose_value_or_in_which_unit_is_refused(tmp_path, resources, said):
    with pytest.raises(CaseError, match=re.escape(said)):
        import_cohort(bundle(tmp_path, PATIENT, *resources))


def test_a_page_of_a_search_says_that_the_others_are_missing(tmp_path):
    path = bundle(tmp_path, PATIENT, *TWO)
    content = json.loads(path.read_text())
    path.write_text(json.dumps(content | {"total": 300, "link": [{"relation": "next", "url": "x"}]}))
    first, second = map(str, import_cohort(path).warnings)
    assert "one page of several" in first
    assert "total = 300: 3 entries are here" in second


def test_a_code_counts_only_in_its_own_system(tmp_path):
    """A code of any system was taken for that of LOINC, without a word."""
    foreign = [named("8478-0", 70, "mm[Hg]", "urn:x"), named("CVP", 7, "mm[Hg]", "urn:x")]
    mixed = named("251288004", 3, "L/min", LOINC)
    bare = [named("8480-6", 110, "mm[Hg]"), named("DP", 60, "mm[Hg]")]
    result = import_cohort(bundle(tmp_path, PATIENT, *foreign, mixed, *bare))
    (row,) = result.rows
    assert [row.get(name) for name in ("MAP", "CVP", "PF", "SP", "DP")] == [None, None, None, "110", "60"]
    assert list(map(str, result.warnings)) == [
        f'{tmp_path}/bundle.json: code "8478-0 of urn:x", once: not read',
        f'{tmp_path}/bundle.json: code "CVP of urn:x", once: not read',
        f'{tmp_path}/bundle.json: code "251288004 of http://loinc.org", once: not read',
    ]
    assert [str(n) for n in result.notes if "no system" in str(n)] == [
        f"{tmp_path}/bundle.json: code 8480-6 has no system: read as LOINC"
    ]


def test_a_code_of_another_system_beside_its_own_is_read(tmp_path):
    both = [{"system": "urn:x", "code": "8478-0"}, {"system": LOINC, "code": "8478-0"}]
    value = observation("", 70, "mm[Hg]") | {"code": {"coding": both}}
    result = import_cohort(bundle(tmp_path, PATIENT, value))
    assert (result.rows[0]["MAP"], result.warnings) == ("70", [])
