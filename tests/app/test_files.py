"""Opening and exporting files: bad ones say why, good ones come back the same."""

import csv
import io
import re
import zipfile

import pytest

from eclsim.app.files import LARGEST_FILE, MOST_LINES, ExportError, export, parse_file, shortened, with_speeds
from eclsim.app.knobs import turn
from eclsim.app.state import PageState, preset_state
from eclsim.cases.presets import PRESETS
from eclsim.cases.reading import case_text
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
