"""Files appear whole or not at all, and an error names the file."""

import errno
import shutil
from pathlib import Path

import pytest

from eclsim.atomic import whole_file


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
