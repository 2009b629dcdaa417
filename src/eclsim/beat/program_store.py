"""Compiled programs kept on disk: a new process neither traces nor lowers what an earlier one compiled.

JAX's own cache is asked after tracing, which costs 0.4 s for a beat and 3 s for its tangents. Here the key is
known before: the sources that make a program, the circuit, what is asked of it and the shapes. Only circuits
of eclsim's own components are kept: what a user's class computes cannot be read off its name.
"""

from __future__ import annotations

import dataclasses
import hashlib
import os
import pickle
import re
import threading
from collections.abc import Callable, Iterator
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jax.experimental.compilation_cache import compilation_cache

from eclsim.runtime import cache_folder

PACKAGE = Path(__file__).parents[1]


class StoredProgram:
    """A compiled function that is taken from disk where it lies there, for each shape of its arguments.

    Args:
        function: to be compiled, already wrapped in `jax.jit`; takes and returns arrays.
        key: what tells it from all others, hashable; None keeps it out of the store.
        module: name of the module whose code it is; what that imports is part of the key.
    """

    def __init__(self, function: Any, key: tuple[Any, ...] | None, module: str = __name__):
        self.function = function
        self.key = key
        self.module = module
        self._ready: dict[Any, Any] = {}
        self._lock = threading.Lock()

    def __call__(self, *arguments: Any) -> Any:
        """Run it."""
        shapes = tuple([np.shape(a) for a in arguments])
        program = self._ready.get(shapes)
        if program is None:
            with self._lock:
                program = self._ready.get(shapes) or self._get(shapes, arguments)
                self._ready[shapes] = program
        return program(*arguments)

    def lower(self, *arguments: Any) -> Any:
        """As `jax.jit` has it: for those who look at the compiled code."""
        return self.function.lower(*arguments)

    def _get(self, shapes: Any, arguments: tuple[Any, ...]) -> Callable[..., Any]:
        file = _file(self.key, shapes, self.module)
        if file is None:
            return self.function
        return _load(file) or _save(file, _compiled_afresh(self.function.lower(*arguments)))


@lru_cache(maxsize=1024)
def _described(part: Any) -> str | None:
    """All there is to say of a part of a key; None if something in it is not eclsim's own."""
    return repr(part) if all(map(_is_ours, _parts(part))) else None


def _parts(value: Any) -> Iterator[Any]:
    """A value and everything in it."""
    yield value
    if isinstance(value, (tuple, list)):
        for item in value:
            yield from _parts(item)
    elif dataclasses.is_dataclass(value):
        for entry in dataclasses.fields(value):
            yield from _parts(getattr(value, entry.name))


def _is_ours(value: Any) -> bool:
    """Whether a value is plain, or of a class that is part of eclsim: its text says all about it."""
    if value is None or isinstance(value, (str, int, float, tuple, list)):
        return True
    return dataclasses.is_dataclass(value) and type(value).__module__.partition(".")[0] == "eclsim"


def _file(key: tuple[Any, ...] | None, shapes: Any, module: str = __name__) -> Path | None:
    folder = cache_folder() if key is not None else None
    parts = [_described(part) for part in key or ()]
    if folder is None or None in parts:
        return None
    text = f"{_sources(module)}\n{shapes}\n{parts}"
    return folder / f"eclsim-{hashlib.sha256(text.encode()).hexdigest()[:40]}"


@lru_cache(maxsize=16)
def _sources(module: str) -> str:
    """Fingerprint of all code that the programs of a module are made by, and of what compiles it."""
    found = hashlib.sha256(f"{version('jax')} {version('jaxlib')}".encode())
    for file in imported_files(module):
        found.update(file.relative_to(PACKAGE).as_posix().encode() + file.read_bytes())
    return found.hexdigest()


IMPORTS = re.compile(r"^from (eclsim[\w.]*) import (\([^)]*\)|[^\n]*)|^import (eclsim[\w.]*)", re.MULTILINE)


def imported_files(module: str) -> list[Path]:
    """Files of eclsim that a module imports when it is loaded, itself included, in alphabetical order."""
    waiting, found = [module], dict[Path, None]()
    while waiting:
        name = waiting.pop()
        file = _file_of(name)
        if file is None or file in found:
            continue
        found[file] = None
        waiting += [name.rpartition(".")[0]]
        for base, names, plain in IMPORTS.findall(file.read_text(encoding="utf-8")):
            waiting += [plain or base, *(f"{base}.{part}" for part in re.findall(r"\w+", names))]
    return sorted(found)


def _file_of(module: str) -> Path | None:
    """File of a module of eclsim; None for a name that is none."""
    head, _, rest = module.partition(".")
    path = PACKAGE.joinpath(*rest.split(".")) if rest else PACKAGE
    files = (path / "__init__.py", path.with_suffix(".py"))
    return next((f for f in files if head == "eclsim" and f.is_file()), None)


_COMPILING = threading.Lock()


def _compiled_afresh(lowered: Any) -> Any:
    """Compile past JAX's own cache: what comes from there lacks its kernels when it is written again."""
    with _COMPILING:
        jax.config.update("jax_enable_compilation_cache", False)
        compilation_cache.reset_cache()
        try:
            return lowered.compile()
        finally:
            jax.config.update("jax_enable_compilation_cache", True)
            compilation_cache.reset_cache()


def _load(file: Path) -> Callable[..., Any] | None:
    """The program in a file; None where there is none or it cannot be read."""
    from jax.experimental.serialize_executable import deserialize_and_load

    try:
        return deserialize_and_load(*pickle.loads(file.read_bytes()))
    except FileNotFoundError:
        return None
    except Exception:  # whatever a damaged file or another XLA raises, compiling again is the answer
        return None


def _save(file: Path, program: Any) -> Callable[..., Any]:
    """Write a program so that no reader ever sees half of it; a full or read-only disk is no mistake."""
    from jax.experimental.serialize_executable import serialize

    part = file.with_name(f"{file.name}.{os.getpid()}.part")
    try:
        part.write_bytes(pickle.dumps(serialize(program)))
        os.replace(part, file)
    except (OSError, ValueError, NotImplementedError):
        part.unlink(missing_ok=True)
    return program
