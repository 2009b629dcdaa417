"""Opening and exporting files: bad ones say why, good ones come back the same."""

import csv
import io
import zipfile

import pytest

from eclsim.app.exports import ExportError, export, file_stem
from eclsim.app.opening import LARGEST_FILE, MOST_SAID, brief, open_file
from eclsim.app.state import PageState
from eclsim.patients.cohort import COLUMNS, MEASUREMENT
from eclsim.patients.mistakes import CaseError
from eclsim.patients.presets import PRESETS
from eclsim.patients.writing import case_text

HEADER = ["patient_id", MEASUREMENT, *(c for c in COLUMNS if c != "patient_id")]


def cohort(*rows: dict[str, str]) -> bytes:
    usual = {
        "patient_id": "P01", MEASUREMENT: "1", "sex": "female", "age_years": "70", "heart_rate_bpm": "90",
        "SP": "100", "DP": "60", "MAP": "75", "CO": "3", "ecmo_pump": "Rotaflow", "ecmo_speed_rpm": "3000",
        "oxygenator": "Quadrox-i Adult", "drainage_fr": "21", "return_fr": "17",
    }  # fmt: skip
    lines = [",".join(HEADER)]
    lines += [",".join((usual | row).get(name, "") for name in HEADER) for row in rows]
    return "\n".join(lines).encode()


@pytest.mark.parametrize("key", PRESETS)
def test_a_case_file_comes_back_as_it_was(key):
    state = PageState(PRESETS[key].case())
    name, content = export(state, "case")
    opened = open_file(name, content)
    assert opened.cases[0][1] == state.case


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("x.csv.exe", b"format = 1", "not a case file"),
        ("archive.zip", b"PK\x03\x04", "not a case file"),
        ("noname", b"format = 1", "not a case file"),
        ("empty.toml", b"", "empty"),
        ("large.csv", b"x" * (LARGEST_FILE + 1), "larger than"),
        ("large.toml", b"#" * 2_000_000, "too large"),
        ("utf16.toml", "format = 1".encode("utf-16"), "UTF-16"),
        ("broken.toml", b"format = = 1", "no valid TOML"),
        ("header.csv", (",".join(HEADER) + "\n").encode(), "no"),
        ("binary.csv", bytes(range(256)) * 20, "."),
    ],
)
def test_what_cannot_be_used_says_why(name, content, said):
    with pytest.raises(CaseError, match=said) as refused:
        open_file(name, content)
    assert "/tmp" not in str(refused.value)


def test_mistakes_name_the_file_as_the_user_knows_it():
    wrong = case_text(PRESETS["paper"].case()).replace("3425", "-5").encode()
    with pytest.raises(CaseError, match=r"^mine\.toml:\d+: ecmo\.speed_rpm"):
        open_file("C:\\Users\\somebody\\mine.toml", wrong)


def test_a_cohort_gives_its_good_rows_and_says_what_is_wrong_with_the_others():
    opened = open_file(
        "ward.csv", cohort({}, {"patient_id": "P02", "SP": "20", "DP": "90"}, {"patient_id": "P03"})
    )
    assert [name for name, _ in opened.cases] == ["P01/1", "P03/1"]
    assert any("below diastolic" in line for line in opened.said)


def test_long_lists_are_cut_with_a_count():
    assert brief([str(k) for k in range(100)])[-1] == f"… {100 - MOST_SAID} more"
    assert brief(["a"]) == ["a"]


@pytest.mark.parametrize(
    "name", ["../../etc/passwd", "<script>alert(1)</script>", "a b/c\\d", "Übel 1", "", "x" * 300]
)
def test_file_names_hold_no_path_and_no_markup(name):
    stem = file_stem(name)
    assert stem
    assert len(stem) <= 60
    assert not set(stem) & set("/\\<>.:\"' ")


def test_tables_have_units_and_the_values_of_the_page():
    state = PageState(PRESETS["paper"].case())
    name, content = export(state, "outputs")
    (values,) = csv.DictReader(io.StringIO(content.decode()))
    assert name.endswith("_outputs.csv")
    assert float(values["MAP [mmHg]"]) == pytest.approx(70.37, abs=0.05)
    _, content = export(state, "waveforms")
    assert "Pcrrttuin [mmHg]" in content.decode().splitlines()[0]


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
