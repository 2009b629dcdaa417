"""Cohort tables: what is accepted, what is refused, and that a bad row stops no other."""

from pathlib import Path

import pytest

from eclsim.cases import CaseError, read_case
from eclsim.cases.cohort import COLUMNS, read_cohort

HEAD = (
    "patient_id,measurement,sex,age_years,height_cm,weight_kg,heart_rate_bpm,SP,DP,MAP,MPAP,PCWP,CO,PF,"
    "ecmo_pump,ecmo_speed_rpm,oxygenator,drainage_fr,return_fr"
)
ROW = "P01,1,male,42,187,73,83,101,47,70,26,9,5.8,2.2,Rotaflow,2725,Quadrox-i Adult,25,15"


def row(number: int = 1, patient: str = "P01", **changes: str) -> str:
    cells = dict(zip(HEAD.split(","), ROW.split(","), strict=True))
    return ",".join((cells | {"patient_id": patient, "measurement": str(number)} | changes).values())


@pytest.fixture
def write(tmp_path: Path):
    def written(*lines: str | bytes, end: bytes = b"\n") -> Path:
        path = tmp_path / "cohort.csv"
        path.write_bytes(end.join(x if isinstance(x, bytes) else x.encode() for x in lines))
        return path

    return written


def error_text(error: pytest.ExceptionInfo[CaseError]) -> str:
    return str(error.value)


def test_a_row_becomes_a_case(write):
    (point,) = read_cohort(write(HEAD, ROW)).points
    assert (point.name, point.line) == ("P01/1", 2)
    assert point.case.measurements is not None
    assert (point.case.measurements.SP, point.case.measurements.PF) == (101, 2.2)
    assert point.case.ecmo is not None
    assert (point.case.ecmo.drainage_site, point.case.ecmo.return_site) == ("ra", "ao")
    assert point.case.ecmo.speed_rpm == 2725


def test_without_a_device_the_patient_has_none(write):
    bare = row(ecmo_pump="", ecmo_speed_rpm="", oxygenator="", drainage_fr="", return_fr="", PF="")
    (point,) = read_cohort(write(HEAD, bare)).points
    assert point.case.ecmo is None


def test_a_row_that_says_how_the_crrt_is_connected_has_one(write):
    head = f"{HEAD},crrt_flow_ml_min,crrt_access_site,crrt_return_site,crrt_return_pressure"
    cohort = read_cohort(
        write(head, row() + ",150,post_oxy,pre_oxy,310", row(2) + ",,,,", row(3) + ",150,post_oxi,,")
    )
    with_crrt, without = cohort.points
    assert (with_crrt.case.crrt.flow_ml_min, with_crrt.case.crrt.access_site) == (150, "post_oxy")
    assert with_crrt.case.measurements.crrt_return_pressure == 310
    assert without.case.crrt is None
    assert {(m.key, m.line) for m in cohort.refused} == {("crrt_access_site", 4), ("crrt_return_site", 4)}


@pytest.mark.parametrize(
    ("column", "value", "text"),
    [
        ("SP", "3,5", "decimal comma"),
        ("SP", "40", "systolic"),
        ("SP", "120/80", "two pressures"),
        ("MAP", "#REF!", "spreadsheet"),
        ("CO", "#DIV/0!", "spreadsheet"),
        ("CO", "3400", "outside"),
        ("PCWP", "inf", "not a number"),
        ("ecmo_speed_rpm", "2,725", "did you mean 2725?"),
        ("ecmo_speed_rpm", "2.725", "0, or 100 to 10000 rpm; did you mean 2.725 krpm = 2725 rpm?"),
        ("ecmo_speed_rpm", "45", "no pump runs as slowly"),
        ("heart_rate_bpm", "", "missing"),
        ("sex", "M", "unknown name"),
        ("ecmo_pump", "0", "name"),
        ("ecmo_pump", "Rotaflo", "Rotaflow"),
        ("measurement", "", "empty"),
        ("measurement", "03/04/2024", "two ways"),
        ("patient_id", "", "empty"),
        ("patient_id", "x" * 10_000, "too long"),
        ("measurement", "y" * 10_000, "too long"),
        ("weight_kg", "", "missing"),
    ],
)
def test_a_bad_cell_refuses_its_row_alone_with_line_and_column(write, column, value, text):
    bad = row(2, **{column: f'"{value}"'})
    reading = read_cohort(write(HEAD, row(1), bad, row(3)))
    assert [p.measurement for p in reading.points] == ["1", "3"]
    messages = [m for m in reading.refused if m.key == column]
    assert messages, reading.refused
    assert all(m.line == 3 for m in reading.refused)
    assert text in str(messages[0])
    assert len(str(messages[0])) < 600


def test_reasons_of_refused_rows_are_told_by_line_and_patient(write):
    lines = (HEAD, ROW, row(2, CO="six", DP="-"), row(3, SP="200 kPa", CO="six"), "P01,4")
    assert {k: v.count("; allowed") for k, v in read_cohort(write(*lines)).refusals.items()} == {
        "line 3 (P01)": 1, "line 4 (P01)": 2, "line 5": 0,
    }  # fmt: skip


@pytest.mark.slow
def test_one_bad_row_among_a_thousand(write):
    rows = [row(k) for k in range(1000)]
    rows[500] = row(500, SP="high")
    reading = read_cohort(write(HEAD, *rows))
    assert len(reading.points) == 999
    (mistake,) = reading.refused
    assert (mistake.key, mistake.line) == ("SP", 502)


def test_nothing_measured_is_refused(write):
    empty = row(2, SP="", DP="", MAP="", MPAP="", PCWP="", CO="", PF="")
    reading = read_cohort(write(HEAD, row(1), empty))
    assert len(reading.points) == 1
    assert "nothing to fit" in str(reading.refused[0])


@pytest.mark.parametrize("text", ["", "NA", "n/a", "-", ".", "nan", "#N/A"])
def test_missing_measurements_are_left_out(write, text):
    (point,) = read_cohort(write(HEAD, row(1, MPAP=text))).points
    assert point.case.measurements is not None
    assert point.case.measurements.MPAP is None
    assert point.case.measurements.SP == 101


def test_decimal_commas_in_a_file_with_semicolons_are_refused_with_what_was_meant(write):
    reading = read_cohort(write(HEAD.replace(",", ";"), ROW.replace(",", ";").replace("5.8", "5,8")))
    assert reading.points == ()
    assert "5.8" in str(reading.refused[0])


@pytest.mark.parametrize("name", ["007", "1e5", "00123E4", "1_000"])
def test_ids_stay_text(write, name):
    (point,) = read_cohort(write(HEAD, row(1, name))).points
    assert point.patient_id == name


@pytest.mark.parametrize("other", ["p01", "P 01", "Ｐ01"])
def test_ids_that_look_the_same_are_named(write, other):
    reading = read_cohort(write(HEAD, row(1), row(1, other)))
    assert len(reading.points) == 2
    assert any("line 2" in str(w) and w.key == "patient_id" for w in reading.warnings)


def test_points_whose_names_would_be_the_same_are_refused(write):
    """Both got the fit of the second."""
    reading = read_cohort(write(HEAD, row(1, "A/B", measurement="C"), row(1, "A", measurement="B/C"), row()))
    assert [point.line for point in reading.points] == [4]
    assert [mistake.line for mistake in reading.refused] == [2, 3]


def test_a_table_where_a_case_file_is_needed_is_named_as_one(write):
    """It was called TOML that is not valid."""
    with pytest.raises(CaseError, match="a table of measurements; allowed: a case file; eclsim identify"):
        read_case(write(HEAD, ROW))


def test_a_repeated_point_is_refused_wherever_it_stands(write):
    reading = read_cohort(write(HEAD, row(1), row(2), row(1, "P01 ", SP="99")))
    assert [p.measurement for p in reading.points] == ["2"]
    assert sorted(m.line or 0 for m in reading.refused) == [2, 4]


@pytest.mark.parametrize("column", [*COLUMNS, "measurement"])
def test_a_missing_column_refuses_the_file(write, column):
    keep = [k for k, name in enumerate(HEAD.split(",")) if name != column]
    lines = [",".join(line.split(",")[k] for k in keep) for line in (HEAD, ROW)]
    with pytest.raises(CaseError, match=column):
        read_cohort(write(*lines))


def test_a_misspelt_column_is_named_with_the_one_it_is_near(write):
    with pytest.raises(CaseError, match=r"MPAP.*did you mean MPPA"):
        read_cohort(write(HEAD.replace("MPAP", "MPPA"), ROW))


def test_two_columns_of_one_name_refuse_the_file(write):
    with pytest.raises(CaseError, match="SP: more than one column"):
        read_cohort(write(HEAD + ",SP", ROW + ",99"))


def test_an_extra_column_is_not_read(write):
    reading = read_cohort(write(HEAD + ",lactate", ROW + ",2.1"))
    assert len(reading.points) == 1
    assert [w.key for w in reading.warnings] == ["lactate"]


def test_an_extra_column_that_tells_who_it_is_is_named_but_not_shown(write):
    reading = read_cohort(write(HEAD + ",name", ROW + ",Erika Mustermann"))
    (warning,) = reading.warnings
    assert "remove it" in str(warning)
    assert "Mustermann" not in str(warning)


@pytest.mark.parametrize(("change", "text"), [(ROW[:-3], "18 cells"), (ROW + ",7", "20 cells")])
def test_too_few_or_many_cells_refuse_the_row(write, change, text):
    reading = read_cohort(write(HEAD, row(1), change, row(3)))
    assert len(reading.points) == 2
    (mistake,) = reading.refused
    assert mistake.line == 3
    assert text in str(mistake)


def test_a_quote_that_is_never_closed_is_named_and_rows_before_it_stand(write):
    reading = read_cohort(write(HEAD, row(1), row(2, "P02").replace("male", '"male'), row(3)))
    assert [p.measurement for p in reading.points] == ["1"]
    (mistake,) = reading.refused
    assert mistake.line == 3
    assert "never closed" in str(mistake)


def units(**changes: str) -> str:
    usual = {"patient_id": "", "measurement": "", "sex": "", "age_years": "years", "height_cm": "cm"}
    usual |= {"weight_kg": "kg", "heart_rate_bpm": "bpm", **dict.fromkeys(("SP", "DP", "MAP"), "mmHg")}
    usual |= {"MPAP": "[mmHg]", "PCWP": "mmHg", "CO": "L/min", "PF": "L/min", "ecmo_speed_rpm": "rpm"}
    usual |= changes
    return ",".join(usual.get(name, "") for name in HEAD.split(","))


def test_a_row_of_the_usual_units_is_no_patient(write):
    reading = read_cohort(write(HEAD, units(), row(1)))
    assert len(reading.points) == 1
    assert not reading.refused
    assert any("row of units" in str(note) for note in reading.notes)


def test_a_row_of_other_units_refuses_the_file(write):
    with pytest.raises(CaseError, match="SP in kPa"):
        read_cohort(write(HEAD, units(SP="kPa"), row(1)))


def test_rows_in_kilopascal_are_found_among_the_others(write):
    rows = [row(k, MPAP=str(20 + k % 5), PCWP=str(8 + k % 4), SP="", DP="", MAP="") for k in range(10)]
    rows[4] = row(4, MPAP="2.8", PCWP="1.3", SP="", DP="", MAP="")
    reading = read_cohort(write(HEAD, *rows))
    assert [p.measurement for p in reading.points] == [str(k) for k in range(10) if k != 4]
    (mistake,) = reading.refused
    assert mistake.line == 6
    assert "2.8 kPa = 21 mmHg" in str(mistake)


def test_times_out_of_order_are_put_in_order_and_this_is_stated(write):
    lines = [row(1, measurement=f"2024-03-0{day}T08:00") for day in (3, 1, 2)]
    reading = read_cohort(write(HEAD, lines[0], row(1, "P02"), *lines[1:]))
    assert [p.measurement[8:10] for p in reading.points if p.patient_id == "P01"] == ["01", "02", "03"]
    assert any("order of time" in str(note) for note in reading.notes)


def test_times_with_and_without_a_time_zone_are_not_put_in_order_and_this_is_stated(write):
    lines = [row(1, measurement=text) for text in ("2024-03-01T08:00", "2024-03-01T09:30+02:00")]
    reading = read_cohort(write(HEAD, *lines))
    assert [point.line for point in reading.points] == [2, 3]
    assert any("without a time zone" in str(note) for note in reading.notes)


def test_a_patient_of_two_heights_or_sexes_is_doubted(write):
    rows = (
        row(1),
        row(2, sex="female", height_cm="167"),
        row(3, height_cm="187.0"),
        row(1, "P02", sex="female"),
    )
    result = [
        str(w) for w in read_cohort(write(HEAD, *rows)).warnings if "under the same patient_id" in str(w)
    ]
    assert [w.partition(": ")[2] for w in result] == [
        "sex = female: male in line 2, under the same patient_id: one patient, or two?",
        "height_cm = 167: 187 in line 2, under the same patient_id: one patient, or two?",
    ]


def test_a_missing_header_is_one_mistake_and_a_unit_in_a_column_name_is_understood(write):
    with pytest.raises(CaseError) as error:
        read_cohort(write("# my cohort", HEAD, ROW))
    (mistake,) = error.value.mistakes
    assert "its first line contains no column name of a cohort: # my cohort" in str(mistake)
    with pytest.raises(CaseError) as error:
        read_cohort(write(HEAD.replace(",MAP", ",MAP [mmHg]"), ROW))
    assert error_text(error).endswith("did you mean MAP for MAP [mmHg]?")


def test_the_header_again_is_one_refusal(write):
    reading = read_cohort(write(HEAD, ROW, HEAD, row(2)))
    assert len(reading.points) == 2
    (refused,) = reading.refused
    assert (refused.line, refused.message) == (3, "the header again, in the middle of the table")


def test_a_date_that_does_not_exist_and_a_time_in_two_spellings_are_refused(write):
    label = "2024-03-01T08:00"
    rows = [row(1).replace("P01,1,", f"P01,{name},") for name in ("2024-02-30T08:00", label, f"{label}:00")]
    reading = read_cohort(write(HEAD, *rows, row(4)))
    assert [(m.line, m.message) for m in reading.refused] == [
        (2, "no such date or time"),
        (3, "the same patient and measurement as in line 4: keep one of lines 3 and 4"),
        (4, "the same patient and measurement as in line 3: keep one of lines 3 and 4"),
    ]


def test_a_note_of_a_patient_is_said_once(write):
    """What gas exchange notes of a weight stood there for every morning."""
    head = f"{HEAD},sweep_l_min,haemoglobin_g_dl"
    size = {"weight_kg": "80", "height_cm": "178"}
    lines = [f"{row(k, name, **size)},3,9" for k, name in ((1, "P01"), (2, "P01"), (1, "P02"))]
    notes = [note for note in read_cohort(write(head, *lines)).notes if note.key == "weight_kg"]
    assert [note.line for note in notes] == [2, 4]


def test_a_cardiac_output_written_as_missing_is_noted_like_any_other(write):
    """Its notes are left out, as each row on ECMO has one, and this one was left out too."""
    notes = [str(note) for note in read_cohort(write(HEAD, row(CO="NA", PCWP="NA"))).notes]
    assert [note.partition(": ")[2] for note in notes if "not fitted" in note] == [
        'PCWP = "NA": not measured, so not fitted', 'CO = "NA": not measured, so not fitted',
    ]  # fmt: skip
    assert not any("native output" in str(note) for note in read_cohort(write(HEAD, row())).notes)
