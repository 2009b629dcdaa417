"""Programs that a later process finds on disk."""

import shutil
from dataclasses import dataclass, replace
from typing import NamedTuple

import jax
import numpy as np
import pytest

from eclsim.beat import compilation
from eclsim.beat.compilation import StoredProgram
from eclsim.beat.heartbeat import beat_program
from eclsim.circuit.network import Circuit
from eclsim.components import Resistance
from eclsim.outputs.measures import single
from eclsim.patient.circulation import circulation
from eclsim.regulation import heldt
from eclsim.regulation.attach import with_reflex, with_volume_offset
from eclsim.regulation.effects import effect_law, parameters_of, readings_of
from eclsim.regulation.heldt import HELDT_2010
from eclsim.regulation.oxygen import local_law

KEY = ("doubled", 1)
X = np.arange(3.0)


def never(_):
    raise AssertionError("traced again")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(compilation, "cache_folder", lambda: tmp_path)
    return tmp_path


def programs_in(folder):
    return list(folder.glob(f"{compilation.PROGRAM}*"))


def test_a_program_is_traced_once_and_found_again(folder):
    first = StoredProgram(jax.jit(lambda x: 2.0 * x), KEY)
    np.testing.assert_array_equal(first(X), 2.0 * X)
    assert len(programs_in(folder)) == 1
    np.testing.assert_array_equal(StoredProgram(jax.jit(never), KEY)(X), 2.0 * X)


def test_a_program_does_not_say_where_its_operations_come_from(folder):
    """A quarter of its size and an eighth of the time to load it were the origins of its operations."""
    StoredProgram(jax.jit(lambda x: 2.0 * x), KEY)(X)
    (program,) = programs_in(folder)
    assert b"/mul" not in program.read_bytes()  # as in "jit(<lambda>)/mul", the name of a product


def test_other_shapes_and_other_keys_are_other_programs(folder):
    StoredProgram(jax.jit(lambda x: 2.0 * x), KEY)(X)
    for key, argument in ((KEY, np.arange(4.0)), (("doubled", 2), X)):
        with pytest.raises(AssertionError, match="traced again"):
            StoredProgram(jax.jit(never), key)(argument)


def test_other_sources_make_another_program(folder, monkeypatch):
    StoredProgram(jax.jit(lambda x: 2.0 * x), KEY)(X)
    monkeypatch.setattr(compilation, "_sources", lambda modules: "edited")
    np.testing.assert_array_equal(StoredProgram(jax.jit(lambda x: 3.0 * x), KEY)(X), 3.0 * X)


def test_a_function_that_an_edit_leaves_the_same_to_the_compiler_is_traced_but_not_compiled(
    folder, monkeypatch
):
    """A corrected docstring had every program compiled again."""

    def doubled(x):
        return 2.0 * x

    StoredProgram(jax.jit(doubled), KEY)(X)
    monkeypatch.setattr(compilation, "_sources", lambda modules: "edited")
    with monkeypatch.context() as edited:
        edited.setattr(compilation, "_compiled_without_cache", never)
        np.testing.assert_array_equal(StoredProgram(jax.jit(doubled), KEY)(X), 2.0 * X)
    assert len(programs_in(folder)) == 1
    np.testing.assert_array_equal(StoredProgram(jax.jit(never), KEY)(X), 2.0 * X)


def table(change):
    return np.arange(20000.0) + change * (np.arange(20000) == 11111)


class Pair(NamedTuple):
    """Two results."""

    one: jax.Array
    other: jax.Array


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (lambda x: x.sum() + table(0.0), lambda x: x.sum() + table(1e-9)),
        (lambda x: (x, 2.0 * x), lambda x: Pair(x, 2.0 * x)),
    ],
    ids=["a number of a large table", "type of the result"],
)
def test_functions_that_differ_in_anything_are_other_programs(one, other, folder, monkeypatch):
    StoredProgram(jax.jit(one), KEY)(X)
    monkeypatch.setattr(compilation, "_sources", lambda modules: "edited")
    result = StoredProgram(jax.jit(other), KEY)(X)
    expected = other(X)
    assert type(result) is type(expected) or isinstance(result, jax.Array)
    np.testing.assert_array_equal(result, expected)
    assert len(programs_in(folder)) == 2


def test_other_options_of_the_compiler_make_another_program(folder, monkeypatch):
    for options in ("", "{'level': 3}"):
        StoredProgram(jax.jit(lambda x: 2.0 * x), ("doubled", options), options=options)(X)
    assert len(programs_in(folder)) == 2


@pytest.mark.parametrize(
    ("edited", "counts"),
    [
        ("units.py", True),
        ("components/valves.py", True),
        ("circuit/assembly.py", True),
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
    before = fingerprint(frozenset({"eclsim.beat.heartbeat"}))
    with (package / edited).open("a", encoding="utf-8") as file:
        file.write("# another line\n")
    assert (fingerprint(frozenset({"eclsim.beat.heartbeat"})) != before) == counts


@pytest.mark.parametrize("kind", ["program-*", "eclsim-*"])
@pytest.mark.parametrize("damage", [b"", b"no program", b"\xff\x00", b"program-../0", None])
def test_a_damaged_file_is_compiled_again(folder, kind, damage):
    StoredProgram(jax.jit(lambda x: 2.0 * x), KEY)(X)
    (file,) = folder.glob(kind)
    file.write_bytes(file.read_bytes()[:-20] if damage is None else damage)
    np.testing.assert_array_equal(StoredProgram(jax.jit(lambda x: 2.0 * x), KEY)(X), 2.0 * X)
    np.testing.assert_array_equal(StoredProgram(jax.jit(never), KEY)(X), 2.0 * X)


@pytest.mark.parametrize("place", ["missing", "file/within"])
def test_a_folder_that_cannot_be_written_is_no_mistake(place, tmp_path, monkeypatch):
    """`ECLSIM_CACHE_DIR` that names a file ended a simulation: Not a directory."""
    (tmp_path / "file").touch()
    monkeypatch.setattr(compilation, "cache_folder", lambda: tmp_path / place)
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


def regulated(model=HELDT_2010):
    return beat_program(with_reflex(with_volume_offset(circulation()), model))


@pytest.mark.parametrize(
    ("edited", "counts"),
    [("regulation/heldt.py", True), ("regulation/reflex.py", True), ("regulation/oxygen.py", False)],
)
def test_a_program_with_a_reflex_is_kept_until_the_code_of_the_reflex_changes(
    edited, counts, folder, tmp_path, monkeypatch
):
    package = tmp_path / "eclsim"
    shutil.copytree(
        compilation.PACKAGE, package, ignore=shutil.ignore_patterns("data", "static", "__pycache__")
    )
    monkeypatch.setattr(compilation, "PACKAGE", package)
    monkeypatch.setattr(compilation, "_sources", compilation._sources.__wrapped__)
    key = ("search", regulated())
    before = compilation._file(key, (), ("eclsim.orbit.iteration",))
    assert before is not None
    with (package / edited).open("a", encoding="utf-8") as file:
        file.write("# another line\n")
    assert (compilation._file(key, (), ("eclsim.orbit.iteration",)) != before) == counts


def test_a_description_is_that_of_every_process():
    text = compilation._described(regulated()).text
    assert "eclsim.regulation.heldt._drives" in text
    assert " at 0x" not in text


def test_what_functions_within_others_know_is_not_described():
    own = replace(HELDT_2010, drives=lambda deviations: HELDT_2010.drives(deviations))
    assert compilation._described(regulated(own)) is None
    assert compilation._described((Circuit, 1)) is None


def test_a_function_under_the_name_of_another_is_not_described(monkeypatch):
    program = regulated()
    monkeypatch.setattr(heldt, "_drives", lambda deviations: deviations)
    assert compilation._described.__wrapped__(program) is None


def test_a_law_is_kept_by_its_name_or_by_what_it_is_made_of(folder):
    controls = regulated().assembly.circuit.controllers
    single.cache_clear()  # another test of this process may have asked for the same
    for law, size in ((local_law, 8), (effect_law(controls, ("Rmc",)), None)):
        size = size or len(readings_of(controls)) + len(parameters_of(controls))
        numbers = np.linspace(1.0, 2.0, size)
        before = set(programs_in(folder))
        single(law, None)(numbers)
        assert len(set(programs_in(folder)) - before) == 1


def test_different_circuits_have_different_descriptions():
    result = {compilation._described(beat_program(circulation(), level)) for level in (1, 2)}
    assert len(result) == 2
    assert None not in result


def test_the_table_of_a_module_is_part_of_its_sources():
    gas = compilation.PACKAGE / "parameters" / "gas.py"
    lone = compilation.PACKAGE / "parameters" / "parameter.py"
    assert compilation.with_tables([lone, gas]) == [lone, gas, gas.with_suffix(".csv")]
