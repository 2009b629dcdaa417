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


@pytest.mark.parametrize("address", ["ward.example", "127.0.0.1:80", "10.0.0.0/8"])
def test_a_proxy_is_named_by_its_address(address):
    result = run("--proxy", address)
    assert result.exit_code == 2
    assert f"--proxy {address}: allowed: the IP address" in result.output


def test_an_address_of_another_machine_is_named_with_its_option(tmp_path):
    file = tmp_path / "password"
    file.write_text("correct horse battery")
    file.chmod(0o600)
    result = run("--host", "192.0.2.77", "--password-file", str(file))
    assert result.exit_code == 2
    assert "--host 192.0.2.77: not an address of this machine" in result.output
    assert "http://" not in result.output
