"""What type checkers see of eclsim in a user's own script."""

import ast
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import eclsim

SOURCE = Path(eclsim.__file__).parents[1]
STUB = SOURCE / "eclsim" / "__init__.pyi"
RIGHT = """from typing import assert_type

import xarray as xr

import eclsim
from eclsim import Circuit, circulation, ecmo, model_of, read_case, simulate_many
from eclsim import FitResult, PosteriorResult, TrackResult
from eclsim.crrt_study.study import CrrtStudy
from eclsim.sensitivity.identifiability import Identifiability
from eclsim.sensitivity.results import SensitivityResult

reading = read_case("patient.toml", ["ecmo.speed_rpm=3000"])
model = model_of(reading.case)
beat = eclsim.simulate(model, "patient_held")
assert_type(beat, xr.Dataset)
assert_type(simulate_many(model, {"Rmc": [0.8, 1.0]}), xr.Dataset)
assert_type(circulation() + ecmo("ra", "ao"), Circuit)
assert_type(eclsim.simulate("patient.toml"), xr.Dataset)
assert_type(eclsim.derivatives(reading, ("MAP",), ("Rmc",)), xr.DataArray)
eclsim.plot_waveforms(beat)

indices = eclsim.sensitivity("patient.toml", settings=eclsim.SobolSettings(samples=64))
assert_type(indices, SensitivityResult)
assert_type(indices.dataset, xr.Dataset)
assert_type(eclsim.identifiability(reading), Identifiability)
fit = eclsim.fit("patient.toml", settings=eclsim.FitSettings(("Rmc",)))
assert_type(fit, FitResult)
assert_type(fit.dataset, xr.Dataset)
chosen = eclsim.PosteriorSettings(method="importance")
draws = eclsim.posterior(fit, settings=chosen, predictions=[("", reading)])
assert_type(draws, PosteriorResult)
assert_type(draws.draws, xr.DataTree)
course = eclsim.track([("08:00", reading), ("12:00", reading.case)])
assert_type(course, TrackResult)
assert_type(course.dataset, xr.Dataset)
assert_type(eclsim.reach("patient.toml", "MAP > 65").reached, bool)
assert_type(eclsim.reach("patient.toml", ["MAP > 65", eclsim.Goal("CO", low=2.0)]).reached, bool)
study = eclsim.crrt_study(reading.case, speeds=[3000.0])
assert_type(study, CrrtStudy)
assert_type(study.means, xr.Dataset)
eclsim.blood.gases(po2=[95.0, 90.0], ph=7.4, haemoglobin=[10.0, 12.0])
"""
WRONG = "import eclsim\n\neclsim.simulate(3)\neclsim.simulat\n"


def run_checker(folder: Path, *command: str) -> subprocess.CompletedProcess[str]:
    (folder / "right.py").write_text(RIGHT)
    (folder / "wrong.py").write_text(WRONG)
    environment = os.environ | {"PYTHONPATH": str(SOURCE), "MYPYPATH": str(SOURCE)}
    return subprocess.run(
        [sys.executable, "-m", *command], cwd=folder, env=environment, capture_output=True, text=True
    )


def test_the_stub_is_the_one_list_of_public_names():
    imports = [n for n in ast.parse(STUB.read_text(encoding="utf-8")).body if isinstance(n, ast.ImportFrom)]
    names = {alias.name: node.module for node in imports for alias in node.names}
    assert names == eclsim._EXPORTS  # pyright: ignore[reportAttributeAccessIssue] - not public
    assert all(alias.asname == alias.name for node in imports for alias in node.names)
    assert eclsim.__all__ == sorted(("__version__", *names))  # pyright: ignore[reportAttributeAccessIssue]


@pytest.mark.slow
def test_pyright_follows_a_users_script(tmp_path: Path):
    pytest.importorskip("pyright")
    settings = f'{{"typeCheckingMode": "strict", "extraPaths": ["{SOURCE.as_posix()}"]}}'
    (tmp_path / "pyrightconfig.json").write_text(settings)
    done = run_checker(tmp_path, "pyright", "--pythonpath", sys.executable)
    result = re.findall(r"(\w+\.py:\d+):\d+ - error:", done.stdout)
    assert list(dict.fromkeys(result)) == ["wrong.py:3", "wrong.py:4"], done.stdout


@pytest.mark.slow
def test_mypy_follows_a_users_script(tmp_path: Path, cache: pytest.Cache):
    pytest.importorskip("mypy")
    kept = str(cache.mkdir("mypy"))  # what it knows of NumPy and xarray
    strict = ("--strict", "--follow-imports=silent", "--no-error-summary", "--cache-dir", kept)
    done = run_checker(tmp_path, "mypy", *strict, "right.py", "wrong.py")
    result = [line.partition(" error")[0] for line in done.stdout.splitlines() if "error" in line]
    assert result == ["wrong.py:3:", "wrong.py:4:"], done.stdout + done.stderr


@pytest.mark.slow
@pytest.mark.parametrize(
    "program",
    [
        "import eclsim; eclsim.sensitivity('x.toml')",
        "import eclsim, eclsim.sensitivity.design; eclsim.sensitivity('x.toml')",
        "from eclsim import sensitivity; import eclsim.sensitivity.design as d; sensitivity('x.toml')",
    ],
)
def test_a_package_of_a_functions_name_is_called_like_it(program: str):
    """Importing a module of a package binds the package to the name where users look for the function."""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert "CaseError: x.toml: no such file" in done.stderr
