"""Files that are none, that lead elsewhere, or that a small size makes large."""

import os
import subprocess
import sys
import time

import pytest

from eclsim.cases import read_case
from eclsim.cases.cohort import read_cohort
from eclsim.cases.fhir import read_bundle
from eclsim.cases.importing import as_table, import_cohort, read_long_table
from eclsim.cases.settings import parse_settings
from eclsim.inputs.files import json_of, read_bytes
from eclsim.inputs.mistakes import CaseError

CASE = """format = 1
[patient] # {dots}
id = "P01"
sex = "female"
age_years = 70
heart_rate_bpm = 120
"""
COHORT = """patient_id,measurement,sex,age_years,height_cm,weight_kg,heart_rate_bpm,\
SP,DP,MAP,MPAP,PCWP,CO,PF,ecmo_pump,ecmo_speed_rpm,oxygenator,drainage_fr,return_fr
P01,1,male,42,187,73,83,101,47,70,26,9,5.8,,,,,,
"""
READERS = [read_case, read_cohort, read_bundle, read_long_table]


@pytest.mark.parametrize("read", READERS)
def test_a_named_pipe_is_refused_without_waiting(tmp_path, read):
    pipe = tmp_path / "pipe.toml"
    os.mkfifo(pipe)
    started = time.monotonic()
    with pytest.raises(CaseError, match="a named pipe") as refusal:
        read(pipe)
    assert str(refusal.value).count(str(pipe)) == 1
    assert "not a path" not in str(refusal.value)
    assert time.monotonic() - started < 5.0


@pytest.mark.parametrize("read", READERS)
def test_a_link_out_of_its_folder_is_refused_and_nothing_of_its_target_is_said(tmp_path, read):
    secret = tmp_path / "elsewhere" / "secret"
    secret.parent.mkdir()
    secret.write_text("root:secret-hash\n")
    folder = tmp_path / "patients"
    folder.mkdir()
    (folder / "P01.toml").symlink_to(secret)
    with pytest.raises(CaseError, match="a symbolic link out of its folder") as refusal:
        read(folder / "P01.toml")
    assert "secret-hash" not in str(refusal.value)


def test_a_link_within_its_folder_is_followed(tmp_path):
    (tmp_path / "first").write_bytes(b"text")
    (tmp_path / "second").symlink_to(tmp_path / "first")
    assert read_bytes(str(tmp_path / "second"), 10) == b"text"


def test_a_device_is_no_file():
    with pytest.raises(CaseError, match="a device"):
        read_bytes("/dev/zero", 10)


def test_deeply_dotted_keys_are_refused_before_they_take_memory(tmp_path):
    path = tmp_path / "deep.toml"
    path.write_text("format = 1\n" + "a." * 19_000 + "a = 1\n")
    code = (
        "import re, sys\n"
        "from eclsim.cases import read_case\n"
        "try:\n    read_case(sys.argv[1])\nexcept Exception as error:\n    print(error)\n"
        # The largest use of this process alone: ru_maxrss starts from what the parent had.
        "print(int(re.search(r'VmHWM:\\s*(\\d+)', open('/proc/self/status').read())[1]) // 1024)\n"
    )
    done = subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, text=True, check=True)
    message, megabytes = done.stdout.splitlines()
    assert "deep.toml:2: more than 16 dots: nested too deeply" in message
    assert int(megabytes) < 300


def test_a_setting_with_a_deep_key_stays_a_text():
    (key, value), *_ = parse_settings(["Rmc={" + "a." * 19_000 + "a=1}"]).items()
    assert isinstance(value, str), key


def test_dots_in_texts_and_comments_are_no_keys(tmp_path):
    path = tmp_path / "dots.toml"
    path.write_text(CASE.format(dots="." * 60))
    assert read_case(path).case.patient.id


def test_a_double_key_is_refused_and_not_the_last_one_taken(tmp_path):
    with pytest.raises(CaseError, match="the key 'value' occurs twice in one object"):
        json_of('{"value": 80, "unit": "mmHg", "value": 8}', "bundle.json")
    path = tmp_path / "bundle.json"
    path.write_text('{"resourceType": "Bundle", "entry": [], "entry": [{}]}')
    with pytest.raises(CaseError, match="the key 'entry' occurs twice"):
        read_bundle(path)


def test_an_imported_table_has_no_formulas(tmp_path):
    path = tmp_path / "long.csv"
    rows = ["sex,female,", "age_years,70,", "heart_rate_bpm,90,bpm", "MAP,80,mmHg"]
    lines = [f"=1+1,2024-03-01T08:00,{row}" for row in rows]
    path.write_text("patient,time,code,value,unit\n" + "\n".join(lines) + "\n")
    table = as_table(import_cohort(path).rows)
    assert "'=1+1" in table
    assert "\n=1+1" not in table


def test_digits_of_other_scripts_are_no_numbers(tmp_path):
    path = tmp_path / "cohort.csv"
    path.write_text(COHORT.replace(",70,", ",\u0667\u0660,"), encoding="utf-8")
    reading = read_cohort(path)
    assert reading.points == ()
    assert any("\u0667\u0660" in str(m) for m in reading.refused)
