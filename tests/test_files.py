"""Files appear whole or not at all; JSON is finite, CSV is guarded, names of files are safe."""

import errno
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import eclsim
from eclsim.files import (
    csv_text,
    file_stem,
    file_stems,
    finite,
    frame_text,
    guarded,
    json_text,
    unguarded,
    whole_file,
    write_json,
    write_netcdf,
    write_text,
)


def test_a_full_disk_names_the_file_and_leaves_what_was_there(tmp_path: Path):
    target = tmp_path / "results.json"
    target.write_text("before")

    def fill_the_disk() -> None:
        with whole_file(target) as partial:
            partial.write_text("half")
            raise OSError(errno.ENOSPC, "No space left on device")

    with pytest.raises(OSError, match="No space") as caught:
        fill_the_disk()
    assert caught.value.filename == str(target)
    assert target.read_text() == "before"
    assert list(tmp_path.iterdir()) == [target]


def test_a_folder_that_is_not_there_names_the_target(tmp_path: Path):
    with pytest.raises(FileNotFoundError) as caught, whole_file(tmp_path / "none" / "a.json"):
        pass
    assert caught.value.filename == str(tmp_path / "none" / "a.json")


def test_a_file_that_is_written_is_there_alone(tmp_path: Path):
    with whole_file(tmp_path / "a.txt") as partial:
        partial.write_text("all")
        assert not (tmp_path / "a.txt").exists()
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("a.txt", "all")]


@pytest.mark.parametrize("kind", [OSError, RuntimeError])
def test_the_page_of_text_of_hdf5_becomes_the_systems_own_words(tmp_path: Path, kind: type[Exception]):
    text = "Can't write data (file write failed: time = x\n, filename = '/tmp/y', errno = 28, buf = 0x5)"

    def fail_as_hdf5() -> None:
        with whole_file(tmp_path / "beat.nc"):
            raise kind(text)

    with pytest.raises(OSError, match="No space left on device") as caught:
        fail_as_hdf5()
    assert caught.value.filename == str(tmp_path / "beat.nc")
    assert list(tmp_path.iterdir()) == []


def test_a_disk_that_is_too_small_is_told_before_anything_is_written(tmp_path: Path):
    free = shutil.disk_usage(tmp_path).free
    with (
        pytest.raises(OSError, match="No space left on device") as caught,
        whole_file(tmp_path / "a", 2 * free),
    ):
        pytest.fail("must not be reached")
    assert caught.value.filename == str(tmp_path / "a")
    assert list(tmp_path.iterdir()) == []


def test_json_has_null_for_what_is_not_finite_and_rounds_nothing():
    data = {
        "a": [1.0, float("nan"), (float("inf"), np.float64(0.1) + 0.2)],
        "b": np.array([[1, 2], [3, 4]]),
        "c": np.bool_(True),
        "d": np.array([np.nan, 1e300]),
        3: "text",
    }
    assert json.loads(json_text([data])) == [{
        "a": [1.0, None, [None, 0.1 + 0.2]], "b": [[1, 2], [3, 4]], "c": True, "d": [None, 1e300],
        "3": "text",
    }]  # fmt: skip
    assert finite({"a": 1.23456789, "b": 7}, digits=3) == {"a": 1.23, "b": 7}


def test_what_json_has_no_word_for_is_an_error():
    with pytest.raises(TypeError, match="Path cannot be written as JSON"):
        finite({"a": Path()})


def test_json_and_text_go_to_standard_output_or_a_file(tmp_path: Path, capsys):
    write_json([{"a": 1}], "-")
    assert json.loads(capsys.readouterr().out) == [{"a": 1}]
    write_text("one\ntwo\n", tmp_path / "a.txt")
    assert (tmp_path / "a.txt").read_bytes() == b"one\ntwo\n"


@pytest.mark.slow
def test_writing_netcdf_does_not_load_dask(tmp_path: Path):
    code = "import sys, xarray; from pathlib import Path; from eclsim.files import write_netcdf; "
    code += f"write_netcdf({{'': xarray.Dataset({{'x': 1.0}})}}, Path({str(tmp_path / 'a.nc')!r})); "
    code += "sys.exit('distributed' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_json_and_netcdf_say_which_version_wrote_them(tmp_path: Path):
    assert json.loads(json_text({"a": 1})) == {"made_by": f"eclsim {eclsim.__version__}", "a": 1}
    data = xr.Dataset(
        {"x": ("k", np.array(["one", ""], dtype=object), {"units": "1"})}, attrs={"warnings": []}
    )
    said = data.assign_attrs(warnings=["first", "second"])
    write_netcdf({"": xr.Dataset(attrs={"id": "P"}), "below": data, "below/more": said}, tmp_path / "a.nc")
    for group, about in (
        ("", {"id": "P"}),
        ("below", {"warnings": ""}),
        ("below/more", {"warnings": "first\nsecond"}),
    ):
        with xr.open_dataset(tmp_path / "a.nc", group=group, engine="h5netcdf") as written:
            assert written.attrs == about | {
                "made_by": f"eclsim {eclsim.__version__}",
                "intended_use": "for research only, not for treatment",
            }
            if group:
                assert written["x"].values.tolist() == ["one", ""]
                assert written["x"].attrs == {"units": "1"}
    assert data.attrs == {"warnings": []}


def test_a_table_has_numbers_to_eight_digits_and_no_formula_anywhere():
    rows = [("=1+1", np.float64(1 / 3), None), ("b,c", float("nan"), 12), ("", -0.5, float("inf"))]
    assert csv_text(("id", "@x", "n"), rows) == ("id,'@x,n\n'=1+1,0.33333333,\n\"b,c\",,12\n,-0.5,inf\n")
    assert csv_text(("x",), [(1 / 3,)], digits=None) == f"x\n{1 / 3!r}\n"


def test_a_data_frame_has_no_formula():
    frame = pd.DataFrame({"id": ["=A1", "b"], "x": [1.5, float("nan")]})
    assert frame_text(frame) == "id,x\n'=A1,1.5\nb,\n"


@pytest.mark.parametrize("text", ["=1+1", "@SUM(A1)", "+1+A1", "-1-A1", "-A1", "\tx", "\rx"])
def test_texts_that_a_spreadsheet_would_run_are_guarded_and_come_back(text):
    assert guarded(text) == f"'{text}"
    assert unguarded(guarded(text)) == text


@pytest.mark.parametrize("value", ["P01", "", "'quoted'", 1.5, -2.0, None, "-50", "-2.5e-3", "+.5"])
def test_other_cells_stay_as_they_are(value):
    assert guarded(value) == value
    if isinstance(value, str):
        assert unguarded(value) == value


@pytest.mark.parametrize(
    "case_id", ["../../etc/x", "a/b", "", "..", "C:\\x", "NUL\0", "x" * 300, "患者", "\ud800"]
)
def test_file_names_are_safe(case_id: str):
    assert not file_stem(case_id).startswith(".")
    assert re.fullmatch(r"[\w.-]{1,70}", file_stem(case_id))


def test_file_names_of_different_ids_differ():
    ids = ["a b", "a/b", "a_b", "a  b", "A_B", "x" * 60, "x" * 61, "", "_", "P01/1", "P01_1", "a_b-2"]
    stems = file_stems(ids)
    assert len({stem.casefold() for stem in stems}) == len(ids)
    assert file_stem("P01-b_2") == "P01-b_2"


def test_an_id_has_one_readable_name_whichever_way_it_is_asked_for():
    """`course` wrote "_sterreich__i____x_2__50__314bdbf5" where `simulate` wrote "Österreich_i_x_2_50"."""
    name = "Österreich <i>& $x^2$ 50%"
    assert file_stem(name) == "Österreich_i_x_2_50" == file_stems([name, "P02"])[0]
    assert file_stem("Mu\N{COMBINING DIAERESIS}ller") == "Müller" == file_stem("Müller")
