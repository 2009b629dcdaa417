"""Programs that a later process finds on disk."""

import shutil
from dataclasses import dataclass, replace

import jax
import numpy as np
import pytest

from eclsim.beat import compilation
from eclsim.beat.compilation import StoredProgram
from eclsim.beat.heartbeat import beat_program
from eclsim.circuit.network import Circuit
from eclsim.components import Resistance
from eclsim.patient.circulation import circulation

KEY = ("doubled", 1)
X = np.arange(3.0)


def never(_):
    raise AssertionError("traced again")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(compilation, "cache_folder", lambda: tmp_path)
    return tmp_path


def test_a_program_is_traced_once_and_found_again(folder):
    first = StoredProgram(jax.jit(lambda x: 2.0 * x), KEY)
    np.testing.assert_array_equal(first(X), 2.0 * X)
    assert len(list(folder.iterdir())) == 1
    np.testing.assert_array_equal(StoredProgram(jax.jit(never), KEY)(X), 2.0 * X)


def test_other_shapes_and_other_keys_are_other_programs(folder):
    StoredProgram(jax.jit(lambda x: 2.0 * x), KEY)(X)
    for key, argument in ((KEY, np.arange(4.0)), (("doubled", 2), X)):
        with pytest.raises(AssertionError, match="traced again"):
            StoredProgram(jax.jit(never), key)(argument)


def test_other_sources_make_another_program(folder, monkeypatch):
    StoredProgram(jax.jit(lambda x: 2.0 * x), KEY)(X)
    monkeypatch.setattr(compilation, "_sources", lambda module: "edited")
    np.testing.assert_array_equal(StoredProgram(jax.jit(lambda x: 3.0 * x), KEY)(X), 3.0 * X)


@pytest.mark.parametrize(
    ("edited", "counts"),
    [
        ("units.py", True),
        ("components/valves.py", True),
        ("circuit/sweep.py", True),
        ("beat/heartbeat.py", True),
        ("outputs/registry.py", False),
        ("simulation/files.py", False),
    ],
)
def test_the_fingerprint_covers_whatever_the_code_imports(edited, counts, tmp_path, monkeypatch):
    package = tmp_path / "eclsim"
    shutil.copytree(
        compilation.PACKAGE, package, ignore=shutil.ignore_patterns("data", "static", "__pycache__")
    )
    monkeypatch.setattr(compilation, "PACKAGE", package)
    fingerprint = compilation._sources.__wrapped__
    before = fingerprint("eclsim.beat.heartbeat")
    with (package / edited).open("a", encoding="utf-8") as file:
        file.write("# another line\n")
    assert (fingerprint("eclsim.beat.heartbeat") != before) == counts


@pytest.mark.parametrize("damage", [b"", b"no program", None])
def test_a_damaged_file_is_compiled_again(folder, damage):
    StoredProgram(jax.jit(lambda x: 2.0 * x), KEY)(X)
    (file,) = folder.iterdir()
    file.write_bytes(file.read_bytes()[:-100] if damage is None else damage)
    np.testing.assert_array_equal(StoredProgram(jax.jit(lambda x: 2.0 * x), KEY)(X), 2.0 * X)
    np.testing.assert_array_equal(StoredProgram(jax.jit(never), KEY)(X), 2.0 * X)


def test_a_folder_that_cannot_be_written_is_no_mistake(tmp_path, monkeypatch):
    monkeypatch.setattr(compilation, "cache_folder", lambda: tmp_path / "missing")
    np.testing.assert_array_equal(StoredProgram(jax.jit(lambda x: 2.0 * x), KEY)(X), 2.0 * X)


@dataclass(frozen=True)
class Narrowed(Resistance):
    """A component of a user's own."""


def test_circuits_with_components_of_others_are_not_kept(folder):
    own = circulation()
    path = next(c for c in own.connections if type(c.component) is Resistance)
    other = replace(path, component=Narrowed(**vars(path.component)))
    circuit = Circuit(own.compartments, tuple(other if c is path else c for c in own.connections))
    assert compilation._file(("beat", beat_program(own)), ()) is not None
    assert compilation._file(("beat", beat_program(circuit)), ()) is None


def test_different_circuits_have_different_descriptions():
    found = {compilation._described(beat_program(circulation(), level)) for level in (1, 2)}
    assert len(found) == 2
    assert None not in found
