"""Clinical data into cohorts: conversions that are said, a base case, all mistakes at once."""

from datetime import timedelta

import pytest

from clinical_files import NINE, PATIENT, TWO, bundle, long_table, named, observation, panel
from eclsim.cases.case import Case, Patient
from eclsim.cases.cohort import COLUMNS, OPTIONAL, read_cohort
from eclsim.cases.importing import as_table, import_cohort
from eclsim.cases.observations import BY_CODE, UnitError, in_unit_of
from eclsim.cases.reading import read_mapping
from eclsim.devices.ecmo import Ecmo
from eclsim.inputs.mistakes import CaseError


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
