"""Case files as bytes: encodings, syntax, places; and what mode fills in."""

import os
import re
import sys

import pytest

from eclsim.cases import CaseError, CaseReading, read_case, read_mapping
from eclsim.inputs.numbers import number_meant

PATIENT = """format = 1
[patient]
id = "P01"
sex = "female"
age_years = 70
heart_rate_bpm = 120
"""


def read_bytes(tmp_path, data: bytes) -> CaseReading:
    file = tmp_path / "case.toml"
    file.write_bytes(data)
    return read_case(file)


def refusal(tmp_path, data: bytes) -> str:
    with pytest.raises(CaseError) as caught:
        read_bytes(tmp_path, data)
    return str(caught.value)


@pytest.mark.parametrize(
    "data",
    [
        b"\xef\xbb\xbf" + PATIENT.encode(),
        PATIENT.replace("\n", "\r\n").encode(),
        PATIENT.replace("\n", "\r").encode(),
        PATIENT.rstrip().encode(),
        (PATIENT + "\n\n\n# a note in Füßen\n").encode(),
    ],
    ids=["byte order mark", "CRLF", "CR", "no final newline", "blank lines and comments"],
)
def test_reads_text_in_utf_8_however_its_lines_end(tmp_path, data):
    assert read_bytes(tmp_path, data).case.patient.heart_rate_bpm == 120


def test_names_other_encodings(tmp_path):
    assert "UTF-16" in refusal(tmp_path, PATIENT.encode("utf-16"))
    message = refusal(tmp_path, PATIENT.replace("P01", "Jürgen").encode("latin-1"))
    assert "case.toml:3: not UTF-8: byte 0xfc" in message


@pytest.mark.parametrize("data", [b"", b"\n\n", b"format = 1\n"])
def test_an_empty_file_says_what_is_needed(tmp_path, data):
    assert "[patient] with id, sex, age_years, heart_rate_bpm" in refusal(tmp_path, data)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("heart_rate_bpm = ", "case.toml:7"),
        ("weight_kg = 60 kg", "weight_kg = 60 kg: text with a unit; write only the number [kg]"),
        ("sex = female", 'sex = "female" (text in quotes)'),
        ("note = hello there", "patient.note = hello there: unknown key"),
        ('id = "P02"', "case.toml:7"),
        ("x = " + "[" * 5000, "nested too deeply"),
        ("sex = 2024-13-45", "not valid TOML"),
    ],
)
def test_syntax_errors_name_the_line_and_the_usual_slip(tmp_path, line, message):
    assert message in refusal(tmp_path, (PATIENT + line + "\n").encode())


def test_values_that_are_no_toml_are_refused_all_at_once_with_their_unit(tmp_path):
    """Only the first was named, and for 130 lb and 0.2 mg/kg/min the digits alone were offered."""
    text = "format = 1\n[patient]\nid = first\nsex = 'male'\nage_years = 70\nheart_rate_bpm = 7O # pulse\n"
    text += "height_cm = 170\nweight_kg = 130 lb\n[drugs]\nnoradrenaline = 0.2 mg/kg/min\n[ecmo\n"
    assert len(refusal(tmp_path, text.encode()).splitlines()) == 5
    lines = refusal(tmp_path, text.removesuffix("[ecmo\n").encode()).splitlines()
    assert [line.partition("case.toml:")[2].partition(";")[0] for line in lines] == [
        "3: id = first: not valid TOML: Invalid value",
        '6: patient.heart_rate_bpm = 7O: not a number: "O" follows it',
        "8: patient.weight_kg = 130 lb: in lb, but weight_kg is in kg",
        "10: drugs.noradrenaline = 0.2 mg/kg/min: in mg/kg/min, but noradrenaline is in ug/kg/min: 0.2 "
        "mg/kg/min = 200 ug/kg/min",
    ]
    assert lines[2].endswith("did you mean 130 lb = 58.97 kg?")
    assert "did you mean" not in lines[3]


def test_a_huge_file_is_refused_unread(tmp_path):
    assert "at most 200 kB" in refusal(tmp_path, b"#" * 2_000_000)


def test_missing_files_and_folders_are_named(tmp_path):
    with pytest.raises(CaseError, match=r"none\.toml: no such file"):
        read_case(tmp_path / "none.toml")
    with pytest.raises(CaseError, match="a folder, not a case file"):
        read_case(tmp_path)
    with pytest.raises(CaseError, match="not a path"):
        read_case("a\0b")
    with pytest.raises(CaseError, match="cannot be read: File name too long"):
        read_case("x" * 300)


@pytest.mark.skipif(sys.platform == "win32" or os.geteuid() == 0, reason="root reads every file")
def test_a_file_without_permission_is_named(tmp_path):
    file = tmp_path / "case.toml"
    file.write_text(PATIENT)
    file.chmod(0)
    with pytest.raises(CaseError, match="no permission"):
        read_case(file)


def test_paths_with_spaces_umlauts_and_emoji(tmp_path):
    file = tmp_path / "Fälle 🫀 2024" / "mit Leerzeichen.toml"
    file.parent.mkdir()
    file.write_text(PATIENT, encoding="utf-8")
    assert read_case(file).file == str(file)


@pytest.mark.parametrize("format_line", ["format = 2", 'format = "1"', "format = true"])
def test_another_format_is_refused(tmp_path, format_line):
    assert "format" in refusal(tmp_path, PATIENT.replace("format = 1", format_line).encode())


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("heart_rate_bpm = true", "= true: true and false are not numbers"),
        ("heart_rate_bpm = [80]", "= [a list of 1]: a list where a number belongs"),
        ("heart_rate_bpm = {a = 1}", "= {a}: a table where a number belongs"),
        ("heart_rate_bpm = 1979-05-27", "= 1979-05-27: a date value"),
        ('heart_rate_bpm = "80"', '= "80": text in quotes'),
    ],
)
def test_wrong_types_are_refused(tmp_path, line, message):
    text = PATIENT.replace("heart_rate_bpm = 120", line)
    assert f"patient.heart_rate_bpm {message}" in refusal(tmp_path, text.encode())


def test_sections_must_be_sections(tmp_path):
    message = refusal(tmp_path, b"format = 1\npatient = 3\necmo = []\nparameters = 1\n")
    assert "patient = 3: a section belongs here" in message
    assert "ecmo: given 0 times" in message
    assert "parameters = 1: a section belongs here" in message


@pytest.mark.parametrize(
    ("mode", "sites", "sizes"),
    [
        ("VA", ("ra", "venous", "ao", "arterial"), (21, 17)),
        ("VV", ("svn", "venous", "ra", "venous"), (25, 21)),
    ],
)
def test_mode_fills_in_the_usual_sites_and_cannulae_and_says_so(tmp_path, mode, sites, sizes):
    ecmo = f'[ecmo]\npump = "Rotaflow"\nspeed_rpm = 3000\noxygenator = "Nautilus MC3"\nmode = "{mode}"\n'
    reading = read_bytes(tmp_path, (PATIENT + ecmo).encode())
    ecmo = reading.case.ecmo
    assert (ecmo.drainage_site, ecmo.drainage_cannula, ecmo.return_site, ecmo.return_cannula) == sites
    assert (ecmo.drainage_fr, ecmo.return_fr) == sizes
    (note,) = [note for note in reading.notes if note.key == "ecmo.mode"]
    assert f'return_site = "{sites[2]}"' in note.message


def test_what_is_given_wins_over_mode(tmp_path):
    ecmo = (
        '[ecmo]\npump = "DP3"\nspeed_rpm = 6000\noxygenator = "Nautilus MC3"\nmode = "VA"\ndrainage_fr = 25\n'
    )
    case = read_bytes(tmp_path, (PATIENT + ecmo + 'return_site = "sart"\n').encode()).case
    assert (case.ecmo.drainage_fr, case.ecmo.return_site, case.ecmo.return_fr) == (25, "sart", 17)


def test_published_names_are_read_as_the_canonical_ones():
    case = read_mapping(
        {
            "format": 1,
            "patient": {"id": "P01", "sex": "male", "age_years": 50, "heart_rate_bpm": 80},
            "lvad": {"pump": "HeartMate 3", "speed_rpm": 5400, "inlet_site": "lv", "outlet_site": "ao"},
            "crrt": {"flow_ml_min": 150, "access_site": "svn", "return_site": "ra"},
            "parameters": {"ηB": 0.004},
        }
    ).case
    assert case.lvad.pump == "HM3"
    assert case.parameters == {"etaB": 0.004}


def test_a_parameter_of_an_absent_circuit_is_told_to_do_nothing(tmp_path):
    reading = read_bytes(tmp_path, (PATIENT + "[parameters]\nRecmooxy = 0.5\n").encode())
    (warning,) = reading.warnings
    assert warning.key == "parameters.Recmooxy"
    assert "without effect" in warning.message


def test_messages_stay_on_one_line_whatever_the_values_hold(tmp_path):
    text = PATIENT.replace('"P01"', r'"a\nb\u0000"') + '[ecmo]\n"x\\ny" = "\\u001b[31m"\n'
    with pytest.raises(CaseError) as caught:
        read_bytes(tmp_path, text.encode())
    assert all(str(mistake).isprintable() for mistake in caught.value.mistakes)


@pytest.mark.parametrize(
    ("written", "suggestion"),
    [
        ("7O", "70"),
        ("2 725", "2725"),
        ("1. Feb", ""),
        ("3 Nov", ""),
        ("70 y", "70"),
        ("60 kg", "60"),
        ("7l", ""),
        ("1-2", ""),
        ("12:30", ""),
    ],
)
def test_a_number_is_offered_only_where_it_is_no_guess(written, suggestion):
    assert number_meant(written) == suggestion


def test_a_wrong_height_does_not_make_it_missing(tmp_path):
    sized = PATIENT + "height_cm = 165\nweight_kg = 60\n"
    for key, wrong in (("height_cm", "500"), ("weight_kg", "7000")):
        text = re.sub(f"{key} = .*", f"{key} = {wrong}", sized)
        with pytest.raises(CaseError) as caught:
            read_bytes(tmp_path, text.encode())
        (only,) = caught.value.mistakes
        assert only.key == f"patient.{key}"
        assert "outside the allowed range" in only.message


def test_a_look_alike_digit_is_named_in_a_case_file(tmp_path):
    with pytest.raises(CaseError, match=r"patient\.heart_rate_bpm = 7O: .* did you mean 70\?"):
        read_bytes(tmp_path, PATIENT.replace("heart_rate_bpm = 120", "heart_rate_bpm = 7O").encode())


def test_an_lvad_that_drains_the_right_heart_into_the_arteries_is_doubted():
    def doubts(inlet: str, outlet: str) -> list[str]:
        lvad = {"pump": "HVAD", "speed_rpm": 2600, "inlet_site": inlet, "outlet_site": outlet}
        patient = {"id": "P01", "sex": "male", "age_years": 50, "heart_rate_bpm": 80}
        reading = read_mapping({"format": 1, "patient": patient, "lvad": lvad})
        return [str(w) for w in reading.warnings if "bypasses the lungs" in str(w)]

    assert 'lvad.inlet_site = "ra"' in doubts("ra", "ao")[0]
    assert doubts("lv", "ao") == doubts("rv", "pas") == []


def test_a_key_given_twice_is_said_in_plain_words(tmp_path):
    file = tmp_path / "twice.toml"
    file.write_text('format = 1\n[patient]\nsex = "male"\nsex = "female"\n', encoding="utf-8")
    with pytest.raises(CaseError, match="this key already has a value"):
        read_case(file)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "[dialysed_drug.vancomycin]\ndose_mg = 500\n",
            "one [dialysed_drug] section, and for a further",
        ),
        ("[[dialysed_drug]]\n[[dialysed_drug]]\n", "in single brackets, and for a further drug a case file"),
        ("[gas.left]\nfio2 = 0.5\n", "without a name; allowed: one [gas] section\n"),
        (
            "[lvad]\npump = 'HM3'\n[lvad.left]\n",
            "did you mean [lvad.one] and [lvad.left], where two are connected?",
        ),
    ],
)
def test_what_is_said_of_a_second_section_is_possible(tmp_path, text, said):
    """[dialysed_drug.one] and [dialysed_drug.vancomycin] were proposed, which a case cannot have."""
    assert said in refusal(tmp_path, (PATIENT + text).encode()) + "\n"
