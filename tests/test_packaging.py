"""What users install: locked versions, public names, version."""

import importlib
import inspect
import pydoc
import re
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

import eclsim
from architecture_checker import read_imports
from eclsim.front_door import public_names

REPOSITORY = Path(__file__).parents[1]
PROJECT = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
NOT_FOR_USERS = {"dev", "docs", "optimagic"}  # the last is what a benchmark compares with
LOADED_BY_NAME = {"h5netcdf", "h5py"}  # xarray's NetCDF engine and what that reads with


def distribution(requirement: str) -> str:
    name = re.match(r"[A-Za-z0-9._-]+", requirement)
    assert name, requirement
    return re.sub(r"[-_.]+", "-", name[0]).lower()


def requirements() -> set[str]:
    groups = [PROJECT["dependencies"], *PROJECT["optional-dependencies"].values()]
    return {distribution(requirement) for group in groups for requirement in group} - {PROJECT["name"]}


def distributions_imported() -> dict[str, set[str]]:
    """Third-party modules that the package imports, with the distributions they come from."""
    modules = {one.module.partition(".")[0] for one in read_imports(REPOSITORY / "src")}
    owners = packages_distributions()
    return {
        module: {distribution(owner) for owner in owners.get(module, ())}
        for module in modules - sys.stdlib_module_names - {"eclsim"}
    }


def needed_at_run_time() -> set[str]:
    extras = [group for name, group in PROJECT["optional-dependencies"].items() if name not in NOT_FOR_USERS]
    return {distribution(one) for group in [PROJECT["dependencies"], *extras] for one in group}


@pytest.mark.slow
def test_every_import_is_declared():
    declared = needed_at_run_time()
    assert [module for module, owners in distributions_imported().items() if not owners & declared] == []


@pytest.mark.slow
def test_every_declared_dependency_is_imported():
    imported = set().union(*distributions_imported().values())
    assert needed_at_run_time() - imported - LOADED_BY_NAME == set()


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


@pytest.mark.parametrize("name", sorted(set(eclsim.__all__) - {"__version__"}))
def test_help_says_what_a_public_name_does_and_how_it_is_called(name: str):
    value = getattr(eclsim, name)
    shown = pydoc.render_doc(value, renderer=pydoc.plaintext)
    assert inspect.getdoc(value), name
    assert str(inspect.getdoc(value)).splitlines()[0] in shown
    defined = getattr(importlib.import_module(public_names()[name]), name)
    if inspect.isfunction(defined):
        assert inspect.signature(value) == inspect.signature(defined)
        assert _on_one_line(f"{name}{inspect.signature(defined)}") in _on_one_line(shown)


def _on_one_line(text: str) -> str:
    """Text without spaces and quotes: later versions of Python write long signatures on several lines."""
    return re.sub(r"[\s']", "", text)


def test_an_unknown_public_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'simulat'"):
        _ = eclsim.simulat  # pyright: ignore[reportAttributeAccessIssue]


def test_public_names_come_from_the_module_that_the_table_names(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(eclsim._EXPORTS, "fmean", "statistics")
    assert eclsim.fmean is importlib.import_module("statistics").fmean  # pyright: ignore
    monkeypatch.delattr(eclsim, "fmean")
