"""What workers load before their first task exists."""

import ast
from importlib.util import find_spec
from pathlib import Path

import pytest

import eclsim


@pytest.mark.slow
def test_modules_that_workers_load_first_exist():
    preloaded = [
        name
        for path in Path(eclsim.__file__).parent.rglob("*.py")
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "PRELOAD"
        for name in ast.literal_eval(node.value)
    ]
    assert len(preloaded) > 6
    assert [name for name in preloaded if find_spec(name) is None] == []
