"""Compile a whole beat into one machine-code function and store it on disk.

On the CPU, XLA runs a loop as a sequence of small functions at a cost of about 50 ns each. A step of a
circuit has hundreds, so a beat of one patient would take 17 ms. With the loop marked as a small call, XLA
compiles it into one function, which takes 0.4 ms; a batch is five times faster as well (docs, page Numerics).
The optimiser's first level compiles such a function three times faster than its last level, and the code is
as fast. Vectors of 512 bits make a batch 1.5 times faster on processors that have them.

A new process neither traces nor lowers a function that an earlier process compiled. JAX's own cache is looked
up only after tracing, which takes 0.4 s for a beat and 3 s for its tangents. Here the key is known before
tracing: it consists of the source files of the program, the circuit, the requested outputs and the shapes.
The source files include those of all classes and functions in the key, such as those of a reflex. Only
circuits made of eclsim's own components are stored: the name of a user's class does not determine its code.

An edit of a source file, be it of a comment, changes the key. The function is then traced again, but compiled
only if what was traced has changed: what is stored under the key is the name of a program, and this name is
the hash of what the compiler reads. So an update of eclsim, too, compiles only what it changes.
"""

from __future__ import annotations

import dataclasses
import hashlib
import os
import pickle
import re
import sys
import threading
from collections.abc import Callable, Hashable, Iterable
from contextlib import suppress
from enum import Enum
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from types import FunctionType
from typing import NamedTuple, ParamSpec, TypeVar

import jax
import numpy as np
from jax.experimental.compilation_cache import compilation_cache
from jax.experimental.xla_metadata import set_xla_metadata
from jax.stages import Compiled, Lowered, Wrapped
from numpy.typing import ArrayLike

from eclsim.runtime import cache_folder, on_cpu, refuse_single_precision  # before the first array

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")
Key = tuple[Hashable, ...]
Shapes = tuple[tuple[int, ...], ...]
COMPILER_OPTIONS = {
    "xla_cpu_prefer_vector_width": 512,
    "xla_cpu_experimental_ynn_fusion_type": "",
    "xla_disable_hlo_passes": "while-loop-invariant-code-motion",
}
"""Matrix products must not be left to a library, whose calls cannot be part of one function. XLA must not
move constants out of loops: in nested loops that takes a fifth of the compile time; LLVM does it anyway."""
COMPILER_VERSION = f"{version('jax')} {version('jaxlib')}"
PROGRAM = "program-"
"""Beginning of the names of files that hold a program; those that hold such a name begin with `eclsim-`."""
PACKAGE = Path(__file__).parents[1]


def compiled(
    function: Callable[Arguments, Result],
    key: Key | None = None,
    level: int = 1,
    law: Callable[..., object] | None = None,
) -> Callable[Arguments, Result]:
    """The function compiled on first use, on the CPU as one machine-code function, elsewhere as usual.

    Args:
        function: function of arrays that are passed by position.
        key: identifies the function among all others in the store on disk (see `StoredProgram`).
        level: level of the compiler's optimiser.
        law: function of another module that `function` calls.
    """
    inner = jax.jit(function)
    if not on_cpu():
        return inner

    def call(*arguments: jax.Array) -> object:
        result = inner(*arguments)  # pyright: ignore[reportCallIssue]  # arrays, as the function takes them
        return set_xla_metadata(result, inlineable="false", xla_cpu_small_call="true")

    options = {**COMPILER_OPTIONS, "xla_backend_optimization_level": level}
    modules = {one.__module__ for one in (function, law) if one is not None}
    program = StoredProgram(jax.jit(call, compiler_options=options), key, modules, repr(options))
    return program  # pyright: ignore[reportReturnType]  # takes and returns what the function does


class StoredProgram:
    """A compiled function, loaded from disk if it is stored there, for each shape of its arguments.

    Args:
        function: function to be compiled, wrapped in `jax.jit`; takes and returns arrays.
        key: hashable identifier of the function; with None it is not stored.
        modules: names of the modules that hold its code; the modules that they import are part of the key, as
            are the modules of the classes and functions in the key itself.
        options: options of the compiler, as text.
    """

    def __init__(
        self, function: Wrapped, key: Key | None, modules: Iterable[str] = (__name__,), options: str = ""
    ):
        self.function = function
        self.key = key
        self.modules = frozenset(modules)
        self.options = options
        self._ready: dict[Shapes, Wrapped | Compiled] = {}
        self._lock = threading.Lock()

    def __call__(self, *arguments: ArrayLike) -> object:
        """Run the function; raises a `RuntimeError` if double precision has been turned off."""
        refuse_single_precision()
        shapes = tuple([np.shape(a) for a in arguments])
        program = self._ready.get(shapes)
        if program is None:
            with self._lock:
                program = self._ready.get(shapes) or self._get(shapes, arguments)
                self._ready[shapes] = program
        return program(*arguments)

    def _get(self, shapes: Shapes, arguments: tuple[ArrayLike, ...]) -> Wrapped | Compiled:
        file = _file(self.key, shapes, self.modules)
        if file is None:
            return self.function
        return _named_program(file) or self._traced(file, arguments)

    def _traced(self, file: Path, arguments: tuple[ArrayLike, ...]) -> Compiled:
        """The program of the traced function, loaded if an earlier function was the same to the compiler."""
        lowered = self.function.lower(*arguments)
        read = (COMPILER_VERSION, self.options, lowered.in_tree, lowered.out_tree, lowered.as_text())
        place = file.with_name(f"{PROGRAM}{_hash(*map(str, read))}")
        program = _load(place)
        if program is None:
            _remove_origins(lowered)
            program = _compiled_without_cache(lowered)
            _write(place, lambda: _serialised(program))
        _write(file, place.name.encode)
        return program


class KeyDescription(NamedTuple):
    """Text that identifies a part of a key, and the modules whose code it depends on."""

    text: str
    modules: frozenset[str]


@lru_cache(maxsize=1024)
def _described(part: Hashable) -> KeyDescription | None:
    """Description of a part of a key; None if it contains a value that is not eclsim's own."""
    modules = set[str]()
    try:
        return KeyDescription(_text(part, modules), frozenset(modules))
    except _ForeignError:
        return None


class _ForeignError(Exception):
    """Raised for a value that its text does not identify."""


def _text(value: object, modules: set[str]) -> str:
    """Text of a value and all its parts; adds the modules of its classes and functions to `modules`."""
    kind = type(value)
    if isinstance(value, FunctionType):
        modules.add(_module_of_package(value.__module__))
        if getattr(sys.modules[value.__module__], value.__qualname__, None) is not value:
            raise _ForeignError  # the name of a nested function does not determine it
        return f"{value.__module__}.{value.__qualname__}"
    if value is None or (isinstance(value, (str, int, float)) and not isinstance(value, Enum)):
        return repr(value)
    if kind not in (tuple, list):
        modules.add(_module_of_package(kind.__module__))
    name = f"{kind.__module__}.{kind.__qualname__}"
    if isinstance(value, Enum):
        return f"{name}.{value.name}"
    if isinstance(value, (tuple, list)):
        return f"{name}({', '.join([_text(item, modules) for item in value])})"
    if not dataclasses.is_dataclass(value):
        raise _ForeignError
    entries = [(f.name, getattr(value, f.name)) for f in dataclasses.fields(value)]
    return f"{name}({', '.join([f'{field}={_text(entry, modules)}' for field, entry in entries])})"


def _module_of_package(module: str) -> str:
    """Return the name of a module of eclsim; raise `_ForeignError` for any other."""
    if module.partition(".")[0] != "eclsim":
        raise _ForeignError
    return module


def _file(key: Key | None, shapes: Shapes, modules: Iterable[str] = (__name__,)) -> Path | None:
    folder = cache_folder() if key is not None else None
    described = [_described(part) for part in key or ()]
    known = [part for part in described if part is not None]
    if folder is None or len(known) < len(described):
        return None
    sources = _sources(frozenset(modules).union(*(part.modules for part in known)))
    return folder / f"eclsim-{_hash(sources, str(shapes), str([part.text for part in known]))}"


def _hash(*texts: str) -> str:
    return hashlib.sha256("\n".join(texts).encode()).hexdigest()[:40]


@lru_cache(maxsize=64)
def _sources(modules: frozenset[str]) -> str:
    """Hash of the source files of some modules, of all that they import, and of the compiler's version."""
    digest = hashlib.sha256(COMPILER_VERSION.encode())
    for file in with_tables(imported_files(*modules)):
        digest.update(file.relative_to(PACKAGE).as_posix().encode() + file.read_bytes())
    return digest.hexdigest()


def with_tables(modules: Iterable[Path]) -> list[Path]:
    """Source files, each followed by the table beside it, such as `gas.csv` of `gas.py`, if it has one."""
    kinds = (".py", ".csv", ".toml")
    return [file for module in modules for kind in kinds if (file := module.with_suffix(kind)).is_file()]


IMPORTS = re.compile(r"^from (eclsim[\w.]*) import (\([^)]*\)|[^\n]*)|^import (eclsim[\w.]*)", re.MULTILINE)


def imported_files(*modules: str) -> list[Path]:
    """Source files of eclsim that modules import when loaded, including their own, sorted by name."""
    waiting, files = list(modules), dict[Path, None]()
    while waiting:
        name = waiting.pop()
        file = _file_of(name)
        if file is None or file in files:
            continue
        files[file] = None
        waiting += [name.rpartition(".")[0]]
        for base, names, plain in IMPORTS.findall(file.read_text(encoding="utf-8")):
            waiting += [plain or base, *(f"{base}.{part}" for part in re.findall(r"\w+", names))]
    return sorted(files)


def _file_of(module: str) -> Path | None:
    """File of a module of eclsim; None if there is no such module."""
    head, _, rest = module.partition(".")
    path = PACKAGE.joinpath(*rest.split(".")) if rest else PACKAGE
    files = (path / "__init__.py", path.with_suffix(".py"))
    return next((f for f in files if head == "eclsim" and f.is_file()), None)


def _remove_origins(lowered: Lowered) -> None:
    """Remove from each operation where it was written: a quarter of a program's size, for no number."""
    try:
        from jax.extend.mlir import passmanager  # its package takes 50 ms to import
    except ImportError:  # a JAX without this interface: programs are larger
        return
    module = lowered.compiler_ir()
    if module is None:
        return
    with module.context:
        passmanager.PassManager.parse("builtin.module(strip-debuginfo)").run(module.operation)


_COMPILING = threading.Lock()


def _compiled_without_cache(lowered: Lowered) -> Compiled:
    """Compile without JAX's own cache: a program from that cache lacks its kernels when serialised again."""
    with _COMPILING:
        jax.config.update("jax_enable_compilation_cache", False)
        compilation_cache.reset_cache()
        try:
            return lowered.compile()
        finally:
            jax.config.update("jax_enable_compilation_cache", True)
            compilation_cache.reset_cache()


def _named_program(file: Path) -> Compiled | None:
    """Load the program that a file names; None if there is no such file or program."""
    try:
        name = file.read_text(encoding="ascii")
    except (OSError, ValueError):
        return None
    return _load(file.with_name(name)) if re.fullmatch(f"{PROGRAM}[0-9a-f]+", name) else None


def _load(file: Path) -> Compiled | None:
    """Load the program in a file; None if there is no file or it cannot be read."""
    from jax.experimental.serialize_executable import deserialize_and_load

    try:
        return deserialize_and_load(*pickle.loads(file.read_bytes()))
    except FileNotFoundError:
        return None
    except Exception:  # a damaged file or one of another XLA version: compile again
        return None


def _serialised(program: Compiled) -> bytes:
    from jax.experimental.serialize_executable import serialize

    return pickle.dumps(serialize(program))


def _write(file: Path, content: Callable[[], bytes]) -> None:
    """Write a file so that readers never see it incomplete; a full or read-only disk is ignored."""
    part = file.with_name(f"{file.name}.{os.getpid()}.part")
    try:
        part.write_bytes(content())
        os.replace(part, file)
    except (OSError, ValueError, NotImplementedError):
        with suppress(OSError):
            part.unlink(missing_ok=True)
