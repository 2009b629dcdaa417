"""The rules of the code base: layers, start-up imports, file sizes and clean texts."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from architecture_checker import (
    ALLOWED,
    HEAVY,
    LIGHT,
    heavy_start_up_imports,
    layer_violations,
    lines_with_machine_paths,
    unknown_layers,
)

REPOSITORY = Path(__file__).parents[1]
SOURCE = REPOSITORY / "src"

LONGEST_FILE = 600  # long enough for one idea: a limit of 300 scattered every topic over many files
LONGER_FILES: dict[str, int] = {
    # path in the repository: its limit; section, circuit, outputs, drawing and knobs of a device are one file
    "src/eclsim/devices/ecmo.py": 850,
}


def repository_files() -> list[Path]:
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"],
        cwd=REPOSITORY,
        capture_output=True,
        check=False,
    )
    if listed.returncode != 0:
        pytest.skip("not a git checkout: the list of the repository's files comes from git")
    names = os.fsdecode(listed.stdout).split("\0")
    return [path for name in names if name and (path := REPOSITORY / name).is_file()]


def test_imports_follow_the_layers():
    assert layer_violations(SOURCE) == []


def test_every_module_belongs_to_a_layer():
    assert unknown_layers(SOURCE) == [], "add the new name to ALLOWED, with what it may import"


def test_layers_form_no_cycle():
    waiting = dict(ALLOWED)
    while ready := [layer for layer, allowed in waiting.items() if not allowed & set(waiting)]:
        for layer in ready:
            del waiting[layer]
    assert waiting == {}


@pytest.mark.slow
def test_nothing_heavy_is_imported_at_start_up():
    assert heavy_start_up_imports(LIGHT, SOURCE) == []


def test_files_are_short():
    lengths = {
        str(path.relative_to(REPOSITORY)): len(path.read_text(encoding="utf-8").splitlines())
        for path in [*SOURCE.rglob("*.py"), *(REPOSITORY / "tests").rglob("*.py")]
    }
    too_long = {
        name: length for name, length in lengths.items() if length > LONGER_FILES.get(name, LONGEST_FILE)
    }
    assert too_long == {}
    assert all(lengths[name] > LONGEST_FILE for name in LONGER_FILES), "an exception is no longer needed"


def test_no_module_is_called_utils():
    names = {"utils.py", "util.py", "helpers.py", "misc.py", "common.py"}
    assert [path for path in SOURCE.rglob("*.py") if path.name in names] == []


def test_no_file_names_a_path_of_one_machine():
    result = {path: lines for path in repository_files() if (lines := lines_with_machine_paths(path))}
    assert result == {}


@pytest.mark.parametrize(
    "program",
    ["import eclsim", "import sys; sys.argv = ['eclsim', '--help']; from eclsim.cli import main; main()"],
    ids=["import", "help"],
)
def test_start_up_loads_no_heavy_module(program: str):
    report = subprocess.run(
        [sys.executable, "-X", "importtime", "-c", program], capture_output=True, text=True, check=False
    )
    assert report.returncode == 0, report.stderr
    loaded = {line.rpartition("|")[2].strip().partition(".")[0] for line in report.stderr.splitlines()}
    assert "eclsim" in loaded
    assert loaded & HEAVY == set()


# --- the checker itself ---------------------------------------------------------------------------


@pytest.fixture
def planted(tmp_path: Path):
    """Write a small package of the given files and return its source folder."""

    def write(**files: str) -> Path:
        for name, text in files.items():
            path = tmp_path / "eclsim" / (name.replace("__in__", "/") + ".py")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        return tmp_path

    return write


@pytest.mark.parametrize(
    "statement",
    [
        "import eclsim.orbit",
        "from eclsim.orbit.steady import solve",
        "from eclsim import orbit",
        "from .. import orbit",
        "from ..orbit import steady",
        "def build():\n    from eclsim.orbit import steady",
        "if True:\n    class A:\n        import eclsim.orbit",
    ],
)
def test_checker_finds_a_planted_back_import(planted, statement: str):
    source = planted(components__in__valves=statement)
    (result,) = layer_violations(source)
    assert "components imports orbit" in result


def test_checker_lets_a_forward_import_pass(planted):
    source = planted(orbit__in__steady="from ..components import valves\nfrom eclsim.orbit import search")
    assert layer_violations(source) == []


def test_checker_finds_a_layer_without_rules(planted):
    assert unknown_layers(planted(extras__in__tricks="")) == ["extras"]


def test_checker_finds_a_heavy_import_behind_another_module(planted):
    source = planted(
        units__in____init__="from eclsim.units.table import X",
        units__in__table="import jax.numpy\nX = 1",
        cli="def main():\n    import scipy",
        patients="from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import xarray",
    )
    assert heavy_start_up_imports(("eclsim.units", "eclsim.cli", "eclsim.cases"), source) == [
        "eclsim/units/table.py:1: imports jax.numpy"
    ]


def test_checker_finds_a_machine_path(tmp_path: Path):
    page = tmp_path / "page.md"
    page.write_text("see\n/" + "work/data.csv\n")
    assert lines_with_machine_paths(page) == [2]
