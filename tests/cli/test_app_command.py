"""`eclsim app`: what it refuses before anything is served."""

import pytest
from typer.testing import CliRunner

from eclsim.cli.application import app


def run(*arguments: str):
    return CliRunner().invoke(app, ["app", *arguments])


def test_others_are_let_in_with_a_password_only():
    result = run("--host", "0.0.0.0")
    assert result.exit_code == 2
    assert "--password-file" in result.output


@pytest.mark.parametrize("path", ["/a b", "/../x", "/x?y", "/<x>"])
def test_root_paths_are_paths(path):
    result = run("--root-path", path)
    assert result.exit_code == 2
    assert "--root-path" in result.output


def test_a_password_file_that_cannot_be_used_says_why(tmp_path):
    file = tmp_path / "password"
    file.write_text("short")
    file.chmod(0o600)
    for path, message in ((file, "10 characters"), (tmp_path / "none", "cannot be read")):
        result = run("--password-file", str(path))
        assert result.exit_code == 2
        assert message in result.output


def test_a_case_that_cannot_be_used_is_refused(tmp_path):
    result = run(str(tmp_path / "none.toml"))
    assert result.exit_code == 2
    assert "no such file" in result.output


def test_ports_are_ports():
    assert run("--port", "70000").exit_code == 2
