"""Clinical data into cohorts: bundles and long tables, conversions that are said, all mistakes at once."""

import json
import re
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest

from eclsim.cases.case import Case, Patient
from eclsim.cases.cohort import COLUMNS, OPTIONAL, read_cohort
from eclsim.cases.importing import as_table, import_cohort
from eclsim.cases.observations import BY_CODE, UnitError, in_unit_of
from eclsim.cases.reading import read_mapping
from eclsim.devices.ecmo import Ecmo
from eclsim.inputs.mistakes import CaseError

LOINC = "http://loinc.org"
NINE = "2024-03-01T09:00:00+01:00"


def observation(code: str, value: Any, unit: str, time: str = NINE, **more: Any) -> dict[str, Any]:
    return {
        "resourceType": "Observation",
        "status": "final",
        "subject": {"reference": "Patient/P01"},
        "effectiveDateTime": time,
        "code": {"coding": [{"system": LOINC, "code": code}]},
        "valueQuantity": {"value": value, "code": unit},
        **more,
    }


PATIENT = {
    "resourceType": "Patient",
    "id": "P01",
    "gender": "female",
    "birthDate": "1955-04-17",
    "name": [{"family": "Doe"}],
}
PANEL = {
    "component": [
        {
            "code": {"coding": [{"system": LOINC, "code": "8480-6"}]},
            "valueQuantity": {"value": 110, "code": "mm[Hg]"},
        },
        {
            "code": {"coding": [{"system": LOINC, "code": "8462-4"}]},
            "valueQuantity": {"value": 70, "code": "mm[Hg]"},
        },
    ]
}


def bundle(folder: Path, *resources: Any) -> Path:
    path = folder / "bundle.json"
    path.write_text(json.dumps({"resourceType": "Bundle", "entry": [{"resource": r} for r in resources]}))
    return path


def panel() -> dict[str, Any]:
    whole = observation("85354-9", 0, "") | PANEL
    del whole["valueQuantity"]
    return whole


def long_table(folder: Path, *rows: str) -> Path:
    path = folder / "long.csv"
    path.write_text("\n".join(("patient,time,code,value,unit", *rows)) + "\n")
    return path


def test_a_bundle_becomes_a_cohort_that_is_read(tmp_path):
    file = bundle(
        tmp_path,
        PATIENT,
        panel(),
        observation("8867-4", 82, "/min"),
        observation("8478-0", 11.2, "kPa"),
        observation("8741-1", 4100, "mL/min", "2024-03-01T09:03:00+01:00"),
        observation("8867-4", 88, "/min", "2024-03-01T12:00:00+01:00"),
        observation("8478-0", 79, "mm Hg", "2024-03-01T12:00:00+01:00"),
        observation("2524-7", 1.2, "mmol/L"),
    )
    result = import_cohort(file)
    message = "\n".join(map(str, result.notes))
    assert "11.2 kPa = 84.0069 mmHg" in message
    assert "4100 mL/min = 4.1 L/min" in message
    assert "5 min after the first" in message
    assert any("2524-7" in str(w) for w in result.warnings)
    table = tmp_path / "cohort.csv"
    table.write_text(as_table(result.rows))
    assert "Doe" not in table.read_text()
    assert "1955" not in table.read_text()
    reading = read_cohort(table)
    assert not reading.refused
    first, second = reading.points
    assert first.measurement == NINE
    assert first.case.patient.sex == "female"
    assert first.case.patient.age_years == 68
    measured = first.case.measurements
    assert measured is not None
    assert (measured.SP, measured.DP, measured.CO) == (110, 70, 4.1)
    assert pytest.approx(84.007, abs=1e-3) == measured.MAP
    assert second.case.patient.heart_rate_bpm == 88


def test_a_long_table_takes_codes_and_names_and_devices_of_a_base_case(tmp_path):
    file = long_table(
        tmp_path,
        "A,2024-03-01T08:00,sex,male,",
        "A,2024-03-01T08:00,age_years,61,",
        "A,2024-03-01T08:00,8867-4,90,bpm",
        "A,2024-03-01T08:00,MAP,100,cmH2O",
        "A,2024-03-01T08:00,PF,3.4,L/min",
        "A,2024-03-01T08:00,PCWP,n/a,mmHg",
    )
    patient = Patient(id="base", sex="female", age_years=50, heart_rate_bpm=70)
    ecmo = Ecmo(
        pump="Rotaflow",
        speed_rpm=3000,
        oxygenator="Quadrox-i Adult",
        drainage_site="ra",
        drainage_cannula="venous",
        drainage_fr=23,
        return_site="ao",
        return_cannula="arterial",
        return_fr=17,
    )
    result = import_cohort(file, Case(patient=patient, ecmo=ecmo))
    table = tmp_path / "cohort.csv"
    table.write_text(as_table(result.rows))
    (point,) = read_cohort(table).points
    assert (point.case.patient.sex, point.case.patient.age_years) == ("male", 61)
    assert point.case.ecmo is not None
    assert point.case.ecmo.speed_rpm == 3000
    assert point.case.measurements is not None
    assert pytest.approx(73.556, abs=1e-3) == point.case.measurements.MAP
    assert any("circuit of the base case" in str(n) for n in result.notes)


def test_what_a_base_case_has_and_a_cohort_cannot_hold_is_named(tmp_path):
    """A patient on ECMO and LVAD was imported, and then fitted, without the LVAD and without a word."""
    base = read_mapping({
        "format": 1, "blood_volume_policy": "patient_held",
        "patient": {"id": "base", "sex": "male", "age_years": 50, "heart_rate_bpm": 70},
        "regulation": {"baroreflex": 1.0}, "parameters": {"Csart": 3.0}, "gas": {"fio2": 0.4},
        "ecmo": {"mode": "VA", "pump": {"roller_l_min": 4.0}, "oxygenator": "Quadrox-i Adult",
                 "drainage_fr": 21, "return_fr": 17},
        "crrt": {"flow_ml_min": 200, "access_site": "post_oxy", "return_site": "pre_oxy",
                 "dialysate_ml_h": 1000},
        "lvad": {"pump": "HVAD", "speed_rpm": 2600, "inlet_site": "lv", "outlet_site": "ao"},
    }).case  # fmt: skip
    result = import_cohort(long_table(tmp_path, "A,2024-03-01T08:00,MAP,80,mmHg"), base)
    (warning,) = map(str, result.warnings)
    assert (
        "[regulation], ecmo.pump, crrt.dialysate_ml_h, [lvad], [parameters], blood_volume_policy: " in warning
    )
    assert "without them" in warning
    (assumed,) = [str(n) for n in result.notes if "assumed" in str(n)]
    assert "gas: left out of the base case, so assumed in the table: haemoglobin_g_dl = 10" in assumed
    assert "fio2" not in assumed


def test_times_that_have_no_order_are_named_and_no_conversion_is_called_an_error(tmp_path):
    rows = ("A,2024-03-01T08:00Z,MAP,11,kPa", "A,2024-03-01T09:00,CO,4,L/min")
    with pytest.raises(CaseError) as raised:
        import_cohort(long_table(tmp_path, *rows))
    (mistake,) = map(str, raised.value.mistakes)
    assert "A = 2024-03-01T08:00Z and 2024-03-01T09:00: times with and without a time zone" in mistake


def test_all_mistakes_are_said_at_once(tmp_path):
    file = long_table(
        tmp_path,
        "A,2024-03-01T08:00,MAP,80,",
        "A,2024-03-01T08:00,SP,120,L/min",
        "A,03/04/2024,DP,60,mmHg",
        "A,2024-03-01T08:00,CO,4,5 L/min",
        "A,2024-03-01T08:00,CO,high,L/min",
        "A,2024-03-01T09:00,MPAP,20,mmHg",
        "A,2024-03-01T09:00,MPAP,25,mmHg",
        ",2024-03-01T09:00,MAP,80,mmHg",
    )
    with pytest.raises(CaseError) as caught:
        import_cohort(file)
    messages = [str(m) for m in caught.value.mistakes]
    for text in (
        ":2: MAP = 80: no unit",
        ":3: SP = 120: unit 'L/min' is not a unit of pressure",
        ':4: DP = "03/04/2024"',
        ':6: CO = "high": not a number',
        ":8: A 2024-03-01T09:00 MPAP = 20 and 25",
        ":9: patient: empty",
    ):
        assert any(text in line for line in messages), (text, messages)


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


def test_what_lies_further_apart_is_another_data_point(tmp_path):
    rows = [f"A,2024-03-01T08:{m:02d},MAP,8{m % 10},mmHg" for m in (0, 3, 20)]
    with pytest.raises(CaseError, match="two values of one data point"):
        import_cohort(long_table(tmp_path, *rows))
    assert len(import_cohort(long_table(tmp_path, *rows), within=timedelta(minutes=1)).rows) == 3


def test_values_of_one_data_point_are_counted(tmp_path):
    """One was "1 values"."""
    rows = [f"A,2024-03-01T08:0{m},{code},80,mmHg" for m, code in ((0, "MAP"), (1, "SP"), (2, "DP"))]
    for count, words in ((2, "1 value up to 5 min"), (3, "2 values up to 5 min")):
        (note,) = import_cohort(long_table(tmp_path, *rows[:count])).notes
        assert words in str(note)


def test_units_are_converted_or_refused_never_guessed():
    assert in_unit_of(80.0, "mm[Hg]", BY_CODE["MAP"]) == (80.0, "")
    assert in_unit_of(90.0, "1/min", BY_CODE["heart_rate_bpm"]) == (90.0, "")
    assert in_unit_of(1.5, "Hz", BY_CODE["heart_rate_bpm"]) == (90.0, "1.5 Hz = 90 bpm")
    with pytest.raises(UnitError):
        in_unit_of(80.0, "", BY_CODE["MAP"])
    with pytest.raises(UnitError, match=r"is in g/dL \(of the monomer, 6 mmol/L = 9.67 g/dL\)"):
        in_unit_of(6.0, "mmol/L", BY_CODE["718-7"])


def test_where_nothing_is_left_it_is_said_what_was_left_out(tmp_path):
    with pytest.raises(CaseError, match="status entered-in-error: not read"):
        import_cohort(
            bundle(tmp_path, PATIENT, observation("8478-0", 80, "mm[Hg]", status="entered-in-error"))
        )


# --- whose values, and which ones --------------------------------------------------------------------

TWO = [observation("8867-4", 82, "/min"), observation("8478-0", 80, "mm[Hg]")]


def of(reference: str, *resources: dict[str, Any]) -> list[dict[str, Any]]:
    return [r | {"subject": {"reference": reference}} for r in resources]


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


def test_an_age_in_months_is_not_taken_for_years(tmp_path):
    file = long_table(tmp_path, "A,2024-03-01,age_years,30,months", "A,2024-03-01,MAP,80,mmHg")
    with pytest.raises(CaseError, match='age_years = "months": another unit; allowed: years'):
        import_cohort(file)


def test_negative_pressures_are_numbers_in_the_table(tmp_path):
    """They had an apostrophe before them, as formulas have, and were text in a spreadsheet or in pandas."""
    rows = ("=1+1,2024-03-01T08:00,CVP,-2,mmHg", "=1+1,2024-03-01T08:00,drainage_pressure,-50,mmHg")
    patient = Patient(id="b", sex="male", age_years=61, heart_rate_bpm=80)
    table = tmp_path / "cohort.csv"
    table.write_text(as_table(import_cohort(long_table(tmp_path, *rows), Case(patient=patient)).rows))
    for guard in ("", "'"):
        table.write_text(table.read_text().replace(",-", f",{guard}-"))
        (point,) = read_cohort(table).points
        assert (point.patient_id, point.case.measurements.CVP) == ("=1+1", -2)
        assert f",{guard}-50" in table.read_text()


# --- settings, and whose code it is -------------------------------------------------------------------


def named(column: str, value: Any, unit: str, system: str | None = None) -> dict[str, Any]:
    """A value under the name of a cohort column."""
    return observation("", value, unit) | {"code": {"coding": [{"system": system, "code": column}]}}


def test_settings_of_gas_and_devices_are_read_under_the_names_of_their_columns(tmp_path):
    """They were left out, and the table had the default: 50 % of oxygen where the data say 90."""
    values = (
        ("fio2", 90, "%", "0.9"), ("fdo2", 0.6, "1", "0.6"), ("shunt_fraction", 35, "%", "0.35"),
        ("sweep_l_min", 2000, "mL/min", "2"), ("crrt_flow_ml_min", 0.15, "L/min", "150"),
        ("drainage_fr", 23, "[Ch]", "23"), ("return_fr", 17, "Fr", "17"), ("temperature_c", 38, "Cel", "38"),
        ("vo2_percent_per_c", 7, "%/C", "7"), ("lung_volume_ml", 1.5, "L", "1500"),
    )  # fmt: skip
    resources = [named(column, value, unit) for column, value, unit, _ in values]
    rows = [f"P01,{NINE},{column},{value},{unit}" for column, value, unit, _ in values]
    results = [
        import_cohort(bundle(tmp_path, PATIENT, *resources, *TWO)),
        import_cohort(long_table(tmp_path, *rows, f"P01,{NINE},MAP,80,mmHg")),
    ]
    for result in results:
        (row,) = result.rows
        assert {column: row.get(column) for column, *_ in values} == {
            column: cell for column, *_, cell in values
        }
        assert not result.warnings
        assert any(str(note).endswith("fio2: 90 % = 0.9") for note in result.notes)


def test_every_column_of_numbers_is_read_and_every_other_one_is_named(tmp_path):
    names = [c for c in COLUMNS | OPTIONAL if c not in ("patient_id", "sex", "age_years")]
    texts = {name for name in names if name not in BY_CODE}
    assert texts == {
        "ecmo_pump", "oxygenator", "ecmo_mode", "drainage_site", "drainage_cannula", "return_site",
        "return_cannula", "crrt_access_site", "crrt_return_site",
    }  # fmt: skip
    rows = [f"A,2024-03-01T08:00,{name},x," for name in sorted(texts)]
    result = import_cohort(long_table(tmp_path, *rows, "A,2024-03-01T08:00,MAP,80,mmHg"))
    assert len(result.warnings) == len(texts)
    assert all("not read, as it is text; the cells have that of the base" in str(w) for w in result.warnings)
    pump = named("ecmo_pump", 0, "") | {"valueString": "Rotaflow"}
    del pump["valueQuantity"]
    (warning,) = import_cohort(bundle(tmp_path, PATIENT, pump, *TWO)).warnings
    assert 'code "ecmo_pump", once: not read, as it is text' in str(warning)


def test_a_fraction_needs_its_unit(tmp_path):
    rows = ("A,2024-03-01T08:00,fio2,0.9,", "A,2024-03-01T08:00,fdo2,0.9,mmHg")
    with pytest.raises(CaseError) as caught:
        import_cohort(long_table(tmp_path, *rows))
    first, second = map(str, caught.value.mistakes)
    assert "fio2 needs one, such as 1 or %" in first
    assert "unit 'mmHg' is not a unit of fraction; fdo2 is in fractions of 1" in second


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
