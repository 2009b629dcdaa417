"""The checks of this machine, of the hosted workflow and before a commit are the same."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

yaml = pytest.importorskip("yaml")

REPOSITORY = Path(__file__).parents[1]
RUN = (REPOSITORY / ".ci/run").read_text(encoding="utf-8")
STEPS = re.findall(r"^(?:step|finish) (\w+)", RUN, re.MULTILINE)
WORKFLOW = yaml.safe_load((REPOSITORY / ".github/workflows/ci.yml").read_text(encoding="utf-8"))
HOOKS = yaml.safe_load((REPOSITORY / ".pre-commit-config.yaml").read_text(encoding="utf-8"))


def test_the_hosted_workflow_runs_the_steps_of_ci_run_in_their_order():
    steps = [step for step in WORKFLOW["jobs"]["checks"]["steps"] if "run" in step]
    assert [step["name"] for step in steps] == STEPS
    for step in steps:
        assert step["run"].removeprefix("sudo ") == f"bash .ci/run {step['name']}"


def test_the_hosted_workflow_runs_every_python_that_is_said_to_work():
    project = (REPOSITORY / "pyproject.toml").read_text(encoding="utf-8")
    message = re.findall(r"Python :: (3\.\d+)", project)
    assert WORKFLOW["jobs"]["checks"]["strategy"]["matrix"]["python"] == message


@pytest.mark.skipif(sys.platform == "win32", reason="a script of bash")
def test_one_step_can_be_run_without_the_others(tmp_path: Path):
    folder = tmp_path / ".ci"
    folder.mkdir()
    (folder / "run").write_text(
        re.sub(r"^(step|begin) (\w+) .*$", r"\1 \2 echo did \2", RUN, flags=re.MULTILINE)
    )
    (tmp_path / ".venv-ci").mkdir()

    def did(*names: str) -> list[str]:
        done = subprocess.run(["bash", folder / "run", *names], capture_output=True, text=True, check=False)
        assert "in all" in done.stdout, done.stderr
        return re.findall(r"^did (\w+)$", done.stdout, re.MULTILINE)

    assert did("lint", "types") == ["types", "lint"]
    assert (tmp_path / ".venv-ci").exists()
    assert did() == STEPS
    assert not (tmp_path / ".venv-ci").exists()


@pytest.mark.parametrize("name", ["lint", "types"])
@pytest.mark.parametrize("alone", [True, False])
def test_a_step_that_fails_is_the_exit_status(tmp_path: Path, name: str, alone: bool):
    (tmp_path / ".ci").mkdir()
    passing = re.sub(r"^(step|begin) (\w+) .*$", r"\1 \2 true", RUN, flags=re.MULTILINE)
    failing = re.sub(rf"^(step|begin) {name} .*$", rf"\1 {name} false", passing, flags=re.MULTILINE)
    (tmp_path / ".ci/run").write_text(failing)
    given = [name] if alone else []
    done = subprocess.run(["bash", tmp_path / ".ci/run", *given], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert re.findall(r"^(\w+) .* FAILED$", done.stdout, re.MULTILINE) == [name]


def test_hooks_come_from_the_locked_environment():
    assert {one["repo"] for one in HOOKS["repos"]} == {"local"}
    programs = {hook["entry"].split()[0] for one in HOOKS["repos"] for hook in one["hooks"]}
    assert all(program.startswith(".venv/bin/") for program in programs)
    missing = [p for p in programs if not (Path(sys.executable).parent / Path(p).name).exists()]
    assert missing == []
