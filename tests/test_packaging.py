"""What users install: locked versions, public names, version."""

import importlib
import re
import tomllib
from pathlib import Path

import pytest

import eclsim

REPOSITORY = Path(__file__).parents[1]
PROJECT = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def distribution(requirement: str) -> str:
    name = re.match(r"[A-Za-z0-9._-]+", requirement)
    assert name, requirement
    return re.sub(r"[-_.]+", "-", name[0]).lower()


def requirements() -> set[str]:
    groups = [PROJECT["dependencies"], *PROJECT["optional-dependencies"].values()]
    return {distribution(requirement) for group in groups for requirement in group}


def test_every_dependency_has_a_locked_version():
    lines = (REPOSITORY / "constraints.txt").read_text(encoding="utf-8").splitlines()
    assert requirements() - {distribution(line) for line in lines if "==" in line} == set()


@pytest.mark.parametrize("lock", ["uv.lock", "constraints.txt"])
def test_locks_name_no_other_registry_than_pypi(lock: str):
    hosts = set(re.findall(r"[a-z+]+://[^/\s\"]*", (REPOSITORY / lock).read_text(encoding="utf-8")))
    assert hosts <= {"https://pypi.org", "https://files.pythonhosted.org"}


@pytest.mark.parametrize("name", eclsim.__all__)
def test_every_public_name_can_be_imported(name: str):
    assert getattr(eclsim, name) is not None
    assert name in dir(eclsim)


def test_an_unknown_public_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'simulat'"):
        _ = eclsim.simulat  # pyright: ignore[reportAttributeAccessIssue]


def test_public_names_come_from_the_module_that_the_table_names(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(eclsim._EXPORTS, "fmean", "statistics")
    assert eclsim.fmean is importlib.import_module("statistics").fmean  # pyright: ignore
    monkeypatch.delattr(eclsim, "fmean")
