"""Opening and exporting files: bad ones say why, good ones come back the same."""

import csv
import io
import re
import zipfile

import pytest

import eclsim
from collapsing_veins import TWO_BEATS, collapsible
from eclsim.app.beat import compute_beat
from eclsim.app.course import compute_course, with_event
from eclsim.app.files import (
    LARGEST_CASE_TEXT,
    LARGEST_FILE,
    MOST_LINES,
    ExportError,
    export,
    parse_file,
    shortened,
    with_speeds,
)
from eclsim.app.knobs import connect, turn
from eclsim.app.provenance import opened_state
from eclsim.app.state import PageState, preset_state
from eclsim.app.texts import text
from eclsim.cases.fit_mark import FitMark
from eclsim.cases.presets import PRESETS
from eclsim.cases.reading import MAXIMUM_BYTES, case_text
from eclsim.cases.sections import Measurements
from eclsim.course.engine import CourseOptions
from eclsim.crrt_study.schemes import StudyError
from eclsim.files import file_stem
from eclsim.inputs.mistakes import CaseError
from small_cohort import HEADER, cohort


@pytest.mark.parametrize("key", PRESETS)
def test_a_case_file_comes_back_as_it_was(key):
    state = PageState(PRESETS[key].case())
    name, content = export(state, "case")
    opened = parse_file(name, content)
    assert opened.cases[0][1] == state.case


@pytest.mark.slow
def test_a_file_with_a_pump_flow_opens_at_the_speed_that_gives_it():
    name, content = export(PageState(PRESETS["paper"].case()), "case")
    text = re.sub(r"(?m)^speed_rpm = .*$", "flow_l_min = {}", content.decode())
    opened = with_speeds(parse_file(name, text.format(3.0).encode()))
    ((_, case),) = opened.cases
    assert case.ecmo is not None
    assert (case.ecmo.flow_l_min, 2000 < (case.ecmo.speed_rpm or 0) < 4500) == (None, True)
    assert any("ecmo.flow_l_min = 3 needs" in line for line in opened.remarks)
    with pytest.raises(CaseError, match="highest flow reached"):
        with_speeds(parse_file(name, text.format(9.0).encode()))


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("x.csv.exe", b"format = 1", "not a case file"),
        ("archive.zip", b"PK\x03\x04", "not a case file"),
        ("noname", b"format = 1", "not a case file"),
        ("empty.toml", b"", "empty"),
        ("large.csv", b"x" * (LARGEST_FILE + 1), "larger than"),
        ("large.toml", b"#" * 2_000_000, "too large"),
        ("utf16.toml", "format = 1".encode("utf-16"), "UTF-16"),
        ("broken.toml", b"format = = 1", "not valid TOML"),
        ("header.csv", (",".join(HEADER) + "\n").encode(), "no"),
        ("binary.csv", bytes(range(256)) * 20, "."),
    ],
)
def test_what_cannot_be_used_says_why(name, content, message):
    with pytest.raises(CaseError, match=message) as refused:
        parse_file(name, content)
    assert "/tmp" not in str(refused.value)


def test_the_limit_of_case_files_that_the_page_names_is_the_one_that_holds():
    """The dialog promised 5 MB and refused a case of 3 MB."""
    with pytest.raises(CaseError, match=f"at most {LARGEST_CASE_TEXT}"):
        parse_file("large.toml", b"#" * (MAXIMUM_BYTES + 1))
    assert LARGEST_CASE_TEXT in text("open_text", case=LARGEST_CASE_TEXT, rows=1, size="")


@pytest.mark.parametrize("key", ["paper", "vv-ecmo"])
def test_a_turned_case_names_no_clamp_of_a_cannula_that_is_not_there(key):
    state = PageState(turn(PRESETS[key].case(), "ecmo.speed_rpm", 3000))
    name, content = export(state, "case")
    assert b"second_return_clamp" not in content
    assert parse_file(name, content).cases[0][1] == state.case
    for clamp in (0.0, 0.5):
        there = turn(turn(state.case, "ecmo.second_return_site", "pas"), "ecmo.second_return_clamp", clamp)
        name, content = export(PageState(there), "case")
        assert f"second_return_clamp = {clamp:g} ".encode() in content
        assert parse_file(name, content).cases[0][1] == there


def test_mistakes_name_the_file_as_the_user_knows_it():
    wrong = case_text(PRESETS["paper"].case()).replace("3425", "-5").encode()
    with pytest.raises(CaseError, match=r"^mine\.toml:\d+: ecmo\.speed_rpm"):
        parse_file("C:\\Users\\somebody\\mine.toml", wrong)


def test_a_cohort_gives_its_good_rows_and_says_what_is_wrong_with_the_others():
    opened = parse_file(
        "ward.csv", cohort({}, {"patient_id": "P02", "SP": "20", "DP": "90"}, {"patient_id": "P03"})
    )
    assert [name for name, _ in opened.cases] == ["P01/1", "P03/1"]
    assert any("below diastolic" in line for line in opened.remarks)


def test_long_lists_are_cut_with_a_count():
    assert shortened([str(k) for k in range(100)])[-1] == f"… {100 - MOST_LINES} more"
    assert shortened(["a"]) == ["a"]


@pytest.mark.parametrize(
    "name", ["../../etc/passwd", "<script>alert(1)</script>", "a b/c\\d", "Übel 1", "", "x" * 300]
)
def test_file_names_hold_no_path_and_no_markup(name):
    stem = file_stem(name)
    assert stem
    assert len(stem) <= 80
    assert not set(stem) & set("/\\<>:\"' ")
    assert not stem.startswith(".")


def test_tables_have_units_and_the_values_of_the_page():
    state = PageState(PRESETS["paper"].case())
    name, content = export(state, "outputs")
    (values,) = csv.DictReader(io.StringIO(content.decode()))
    assert name.endswith("_outputs.csv")
    assert float(values["MAP [mmHg]"]) == pytest.approx(70.37, abs=0.05)
    _, content = export(state, "waveforms")
    assert "Pcrrttuin [mmHg]" in content.decode().splitlines()[0]


def test_the_exported_case_and_study_keep_the_policy_of_the_page(monkeypatch):
    requests = {}

    def study(case, **options):
        requests.update(options)
        raise StudyError("not here")

    monkeypatch.setattr("eclsim.crrt_study.study.crrt_study", study)
    state = PageState(PRESETS["paper"].case(), "patient_held", "paper")
    assert 'blood_volume_policy = "patient_held"' in export(state, "case")[1].decode()
    with pytest.raises(ExportError, match="not here"):
        export(state, "study")
    assert requests == {"volume_policy": "patient_held"}


@pytest.mark.slow
def test_figures_come_as_an_archive():
    name, content = export(PageState(PRESETS["healthy"].case()), "svg")
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        names = archive.namelist()
        assert names
        assert all(n.endswith(".svg") for n in names)
        assert archive.read(names[0]).lstrip().startswith(b"<?xml")
    assert name.endswith(".zip")


def test_the_crrt_study_needs_ecmo_and_says_so():
    with pytest.raises(ExportError, match="ECMO"):
        export(PageState(PRESETS["healthy"].case()), "study")
    with pytest.raises(ExportError, match="no such file"):
        export(PageState(PRESETS["healthy"].case()), "../x")


def test_what_was_changed_by_hand_is_called_so_in_every_file():
    state = preset_state("paper")
    turned = state.with_case(turn(state.case, "ecmo.speed_rpm", 3000))
    name, content = export(turned, "case")
    assert name == "Thiel_2025_section_3.3_changed.toml"
    ((_, case),) = parse_file(name, content).cases
    assert case.patient.id == "Thiel 2025, section 3.3 (changed)"
    again = PageState(case, origin="file").with_case(turn(case, "ecmo.speed_rpm", 2000))
    assert b"(changed) (changed)" not in export(again, "case")[1]
    assert export(state, "case")[0] == "Thiel_2025_section_3.3.toml"


BLEEDING = {"at_min": 5, "give": {"bleed_ml": 400}, "over_min": 10}


def test_an_exported_case_with_events_names_the_command_that_gives_the_course_of_the_page():
    state = PageState(with_event(PRESETS["healthy"].case(), BLEEDING))
    for minutes, how in ((0, "--until 360 --steady-only"), (30, "--until 30 --beats")):
        name, content = export(state, "case", minutes)
        line = content.decode().splitlines()[1]
        assert line.endswith(f"eclsim course {name} {how} --out {name.removesuffix('.toml')}")
        assert parse_file(name, content).cases[0][1].events == state.case.events
    assert "eclsim course" not in export(PageState(PRESETS["healthy"].case()), "case")[1].decode()


@pytest.mark.slow
def test_the_case_beside_an_exported_course_says_all_that_the_exported_case_says():
    """It lacked the verdict on the fit, and that its measurements are of before the change."""
    case = PRESETS["paper"].case().model_copy(update={"measurements": Measurements(MAP=80.0, CO=1.4)})
    state = opened_state(with_event(case, BLEEDING), "p.toml", FitMark("doubtful", is_changed=False))
    state = state.with_case(turn(state.case, "ecmo.speed_rpm", 3000))
    name, content = export(state, "case", 30)
    with zipfile.ZipFile(io.BytesIO(export(state, "course", 30)[1])) as archive:
        beside = archive.read(name)
    lines = [line for line in content.decode().splitlines() if line.startswith("# ")]
    assert beside.decode().splitlines()[: len(lines)] == lines
    assert "Fit: doubtful" in lines[0]
    assert lines[1] == f"# {text('export_measured_before')}"
    assert lines[2].startswith(f"# {text('export_replay')} eclsim course {name}")


@pytest.mark.parametrize("value", ["nan", '"NA"', '"-"'])
def test_an_opened_file_says_which_measurements_are_left_out(value):
    """The command line noted it; the page took the value for not measured and said nothing."""
    written = case_text(PRESETS["paper"].case()) + f"\n[measurements]\nCO = 1.4\nMAP = {value}\n"
    opened = parse_file("p.toml", written.encode())
    assert any(f"measurements.MAP = {value}: not measured, so not fitted" in line for line in opened.remarks)


@pytest.mark.slow
def test_the_exported_case_gives_the_course_of_the_page_to_the_last_bit(tmp_path):
    state = preset_state("cardiogenic-shock")
    state = state.with_case(connect(state.case, "regulation"))
    state = state.with_case(turn(state.case, "parameters.Rmc", 0.8))  # after which set points are of the past
    state = state.with_case(with_event(state.case, BLEEDING))
    page = compute_course(state, 60).computed.result
    _, content = export(state, "course", 60)
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        (name,) = (file for file in archive.namelist() if file.endswith(".toml"))
        archive.extract(name, tmp_path)
    again = eclsim.course(tmp_path / name, minutes=60, options=CourseOptions(hand_over=False))
    for output in ("time_min", "MAP", "CO", "heart_rate", "fluid.plasma_ml"):
        assert page[output].to_numpy().tolist() == again[output].to_numpy().tolist(), output


@pytest.mark.slow
def test_an_export_says_if_the_page_came_to_a_steady_beat_that_the_file_does_not_give():
    """From a faster pump the page came to collapsed veins; the file of its knobs begins with full ones."""
    state = PageState(with_event(collapsible(TWO_BEATS), BLEEDING), origin="file")
    beat, speed = None, float(state.case.setting("ecmo", "speed_rpm"))
    for share in (1.6, 1.3, 1.0):
        case = turn(state.case, "ecmo.speed_rpm", share * speed)
        beat = compute_beat(PageState(case, origin="file"), beat)
    anew = compute_beat(state)
    assert beat is not None
    assert beat.outputs["PF"] < 0.9 * anew.outputs["PF"]
    said = export(state, "case", 60, beat)[1].decode().splitlines()[2]
    of_page, _, of_file = said.partition("than one computed anew")
    assert f"ECMO {beat.outputs['PF']:.2f} L/min" in of_page
    assert f"ECMO {anew.outputs['PF']:.2f} L/min" in of_file
    assert "another steady beat" not in export(state, "case", 60, anew)[1].decode()
