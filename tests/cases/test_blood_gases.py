import json
from datetime import timedelta

import pytest

from eclsim.cases.cohort import read_cohort
from eclsim.cases.importing import as_table, import_cohort
from eclsim.cases.reading import read_mapping
from eclsim.cases.sections import MEASURED_GASES
from eclsim.inputs.mistakes import CaseError

RAW = {
    "format": 1,
    "patient": {"id": "P", "sex": "male", "age_years": 50, "heart_rate_bpm": 90},
    "gas": {"haemoglobin_g_dl": 10.0},
    "ecmo": {
        "pump": "Rotaflow", "speed_rpm": 3000, "oxygenator": "Quadrox-i Adult", "mode": "VV",
        "sweep_l_min": 4, "drainage_fr": 25, "return_fr": 21,
    },
}  # fmt: skip
HEAD = (
    "patient_id,measurement,sex,age_years,height_cm,weight_kg,heart_rate_bpm,SP,DP,MAP,MPAP,PCWP,CO,PF,"
    "ecmo_pump,ecmo_speed_rpm,oxygenator,drainage_fr,return_fr,ecmo_mode,SaO2,PaO2,PaCO2,sweep_l_min,"
    "haemoglobin_g_dl"
)
ROW = "P01,{},male,50,178,80,90,,,75,,,6,4.5,Rotaflow,3000,Quadrox-i Adult,25,21,VV,92,{},{},4,10"


def read(**measured):
    return read_mapping({**RAW, "measurements": measured})


@pytest.mark.parametrize(
    ("name", "value", "suggestion"),
    [
        ("SaO2", 0.93, "did you mean 0.93 = 93 %?"),
        ("SvO2", 0.7, "did you mean 0.7 = 70 %?"),
        ("PaO2", 10.5, "did you mean 10.5 kPa = 78.76 mmHg?"),
        ("PaCO2", 5.3, "did you mean 5.3 kPa = 39.75 mmHg?"),
        ("SpostO2", 101, "allowed: 5 to 100 %"),
    ],
)
def test_fractions_and_kilopascal_are_refused_in_one_line(name, value, suggestion):
    with pytest.raises(CaseError) as caught:
        read(**{name: value})
    (mistake,) = caught.value.mistakes
    assert str(mistake).startswith(f"measurements.{name} = {value}: outside the allowed range")
    assert suggestion in str(mistake)


def test_a_pressure_in_kilopascal_is_betrayed_by_its_saturation():
    with pytest.raises(CaseError) as caught:
        read(SaO2=99, PaO2=20)
    assert [str(m) for m in caught.value.mistakes] == [
        "measurements.PaO2 = 20: SaO2 = 99 % does not match it; about 32 % would; allowed: mmHg; did you "
        "mean 20 kPa = 150 mmHg?"
    ]
    doubtful = read(SaO2=70, PaO2=90).warnings
    assert [w.key for w in doubtful] == ["measurements.PaO2"]
    assert not read(SaO2=88, PaO2=58).warnings


def test_gases_without_their_section_are_not_fitted_and_a_warning_says_so():
    raw = {**RAW, "measurements": {"MAP": 75, "SaO2": 92}}
    del raw["gas"]
    warnings = {w.key: str(w) for w in read_mapping(raw).warnings}
    assert "no [gas] section: they are not fitted" in warnings["measurements.SaO2"]


def test_a_cohort_has_columns_of_gases_and_of_their_settings(tmp_path):
    table = tmp_path / "cohort.csv"
    table.write_text("\n".join([HEAD, ROW.format(1, 62, 40)]))
    (point,) = read_cohort(table).points
    assert (point.case.measurements.SaO2, point.case.measurements.PaO2) == (92, 62)
    assert point.case.setting("gas", "haemoglobin_g_dl") == 10
    assert point.case.setting("ecmo", "sweep_l_min") == 4


def test_gases_of_one_row_in_kilopascal_are_seen_among_the_others(tmp_path):
    table = tmp_path / "cohort.csv"
    rows = [ROW.format(k, 150, 70) for k in range(5)]
    table.write_text("\n".join([HEAD, *rows, ROW.format(9, 20, 9.3).replace(",92,", ",,")]))
    reading = read_cohort(table)
    assert len(reading.points) == 5
    assert "7.5 times smaller" in str(reading.refused[0])


def test_a_bundle_of_blood_gases_becomes_a_row(tmp_path):
    def entry(code, value, unit):
        coding = {"system": "http://loinc.org", "code": code} if "-" in code else {"code": code}
        return {"resource": {
            "resourceType": "Observation", "status": "final", "subject": {"reference": "Patient/P1"},
            "code": {"coding": [coding]}, "effectiveDateTime": "2024-03-01T08:00:00Z",
            "valueQuantity": {"value": value, "code": unit},
        }}  # fmt: skip

    about = {"resourceType": "Patient", "id": "P1", "gender": "male", "birthDate": "1974-01-01"}
    entries = [
        {"resource": about}, entry("2708-6", 93, "%"), entry("2703-7", 8.8, "kPa"),
        entry("2019-8", 41, "mm[Hg]"),
        entry("SpreO2", 0.7, "1"), entry("718-7", 98, "g/L"), entry("59408-5", 97, "%"),
        entry("19224-5", 66, "%"),
        entry("8478-0", 75, "mm[Hg]"), entry("8867-4", 90, "/min"),
    ]  # fmt: skip
    bundle = tmp_path / "bundle.json"
    bundle.write_text(json.dumps({"resourceType": "Bundle", "entry": entries}))
    read = import_cohort(bundle, read_mapping(RAW).case, timedelta(minutes=5))
    (row,) = read.rows
    assert (row["SaO2"], row["PaO2"], row["PaCO2"]) == ("93", "66.0054", "41")
    assert (row["SpreO2"], row["haemoglobin_g_dl"], row["sweep_l_min"]) == ("70", "9.8", "4")
    assert row["SvO2"] == "66"
    assert any("59408-5" in str(w) for w in read.warnings)
    table = tmp_path / "cohort.csv"
    table.write_text(as_table(read.rows))
    (point,) = read_cohort(table).points
    assert point.case.measurements.SpreO2 == 70
    assert set(MEASURED_GASES) > {"SaO2", "PexhaustCO2"}


COOLED = {"at_min": 5, "set": {"gas.temperature_c": 32}, "ramp_min": 60}
DIALYSIS = {"flow_ml_min": 200, "access_site": "svn", "return_site": "ra", "dialysate_ml_h": 1000}
DOUBTS = {
    "cold and no consumption": ({"gas": {"temperature_c": 28}}, "gas.temperature_c", "give vo2_ml_min"),
    "cold and its consumption": ({"gas": {"temperature_c": 28, "vo2_ml_min": 120}}, "", ""),
    "cold and it follows": ({"gas": {"temperature_c": 28, "vo2_percent_per_c": 8.5}}, "", ""),
    "a fraction": ({"gas": {"vo2_percent_per_c": 0.085}}, "gas.vo2_percent_per_c", "patients have 6 to 10"),
    "cooled and it follows": (
        {"gas": {"vo2_ml_min": 220, "vo2_percent_per_c": 8.5}, "events": [COOLED]}, "", "",
    ),
    "cooled": ({"gas": {}, "events": [COOLED]}, "events[1].set.gas.temperature_c", "give vo2_ml_min"),
    "cooled, consumption stays": (
        {"gas": {"vo2_ml_min": 220}, "events": [COOLED]}, "events[1].set.gas.temperature_c",
        "set gas.vo2_ml_min too",
    ),
    "cooled with its consumption": (
        {"gas": {}, "events": [COOLED | {"set": COOLED["set"] | {"gas.vo2_ml_min": 150}}]}, "", "",
    ),
    "cold and measured": (
        {"gas": {"temperature_c": 33, "vo2_ml_min": 150}, "measurements": {"SaO2": 97, "PaCO2": 38}},
        "measurements.PaCO2", "an analyser at 37 C shows another",
    ),
    "red cells too thin": (
        {"gas": {"haemoglobin_g_dl": 9}, "fluid": {"haematocrit": 0.45}}, "fluid.haematocrit", "hold 20 g/dL",
    ),
    "red cells as usual": ({"gas": {"haemoglobin_g_dl": 9}, "fluid": {"haematocrit": 0.28}}, "", ""),
    "red cells of the filter": (
        {"gas": {"haemoglobin_g_dl": 9}, "crrt": DIALYSIS | {"haematocrit_in": 0.45}}, "crrt.haematocrit_in",
        "hold 20 g/dL",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("sections", "key", "said"), DOUBTS.values(), ids=DOUBTS)
def test_what_does_not_follow_or_contradicts_is_a_warning(sections, key, said):
    raw = {"format": 1, "patient": RAW["patient"], **sections}
    found = [(w.key, w.message) for w in read_mapping(raw).warnings]
    assert [place for place, _ in found] == ([key] if key else [])
    assert all(said in message for _, message in found)


@pytest.mark.parametrize(
    ("sections", "noted"),
    [
        ({"gas": {}}, True),
        ({"gas": {"alveolar_ventilation_l_min": 4.5}}, False),
        ({"gas": {}, "ecmo": RAW["ecmo"]}, False),
        ({}, False),
    ],
)
def test_ventilation_at_rest_is_noted_where_nothing_else_takes_up_carbon_dioxide(sections, noted):
    """A patient without ECMO had a PaCO2 of 91 mmHg and an alarm, and no word of the reason."""
    patient = {"id": "P", "sex": "male", "age_years": 60, "heart_rate_bpm": 75}
    notes = [str(note) for note in read_mapping({"format": 1, "patient": patient} | sections).notes]
    assert any("2 L/min, as of lungs at rest on ECMO" in note for note in notes) == noted
