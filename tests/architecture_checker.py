"""Reads the imports of a package from its syntax trees and holds them against the layers.

Imports inside functions count too. The rules themselves are at the top; test_architecture.py applies them.
"""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

# Rooms in order: each may import those before it. `eclsim` itself re-exports names of all of them.
ROOMS = (
    "units", "execution", "blood", "components", "circuit", "gas", "parameters", "slow", "patient",
    "regulation",
    "drugs", "fluid",
    "inputs", "devices", "cases", "beat", "orbit", "outputs", "reporting", "simulation", "goals",
    "course", "sensitivity", "identification", "crrt_study", "paper", "validation", "app", "cli",
)  # fmt: skip
PHYSICS = {"units", "components", "circuit"}
ALLOWED = {room: set(ROOMS[:place]) for place, room in enumerate(ROOMS)} | {
    "blood": {"units"},
    "gas": {*PHYSICS, "blood"},
    "parameters": {"units", "components"},
    "inputs": {"units", "parameters"},
    "slow": {"units", "components", "parameters"},
    "beat": {*PHYSICS, "execution"},
    "__main__": {"cli"},
}
ANY_LAYER_MAY_IMPORT = {"_version", "arguments", "files", "front_door", "runtime", "spelling"}

# Imported before the first line of `eclsim --help` or of an input error is printed.
LIGHT = (
    "eclsim", "eclsim.cli", "eclsim.units", "eclsim.parameters", "eclsim.inputs", "eclsim.devices.registry",
    "eclsim.cases",
)  # fmt: skip
HEAVY = {
    "jax",
    "equinox",
    "diffrax",
    "xarray",
    "pandas",
    "scipy",
    "matplotlib",
    "pyarrow",
    "SALib",
    "nicegui",
    "jinja2",
}

# Written in pieces, so that this file does not find itself.
MACHINE_PATHS = re.compile("|".join(("/" + "work/", "/" + "root/", "opt/" + "pypi", "/" + "home/[a-z]")))


class Import(NamedTuple):
    """One imported module, with the place that imports it."""

    path: Path
    line: int
    module: str
    at_import_time: bool


def module_name(path: Path, source: Path) -> str:
    parts = path.relative_to(source).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imported_modules(node: ast.Import | ast.ImportFrom, importer: str, is_package: bool) -> list[str]:
    """Absolute names; `from a import b` gives a.b too, since b may be a module."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    base = node.module or ""
    if node.level:
        parts = importer.split(".")
        kept = parts[: len(parts) - node.level + is_package]
        base = ".".join([*kept, base] if base else kept)
    return [base, *(f"{base}.{alias.name}" for alias in node.names)]


def is_type_checking(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and ast.unparse(node.test) in {"TYPE_CHECKING", "typing.TYPE_CHECKING"}


def walk_imports(
    node: ast.AST, at_import_time: bool = True
) -> Iterator[tuple[ast.Import | ast.ImportFrom, bool]]:
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Import | ast.ImportFrom):
            yield child, at_import_time
            continue
        deferred = isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
        yield from walk_imports(child, at_import_time and not deferred and not is_type_checking(child))


@cache
def read_imports(source: Path) -> list[Import]:
    return list(_read_imports(source))


def _read_imports(source: Path) -> Iterator[Import]:
    for path in sorted(source.rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"), filename=str(path))
        importer = module_name(path, source)
        for node, at_import_time in walk_imports(tree):
            for module in imported_modules(node, importer, path.name == "__init__.py"):
                yield Import(path, node.lineno, module, at_import_time)


def layer_of(module: str) -> str | None:
    """The part after `eclsim`: None outside the package, "" for the package itself."""
    first, _, rest = module.partition(".")
    return rest.partition(".")[0] if first == "eclsim" else None


def layer_violations(source: Path) -> list[str]:
    result = []
    for one in read_imports(source):
        importer, imported = layer_of(module_name(one.path, source)), layer_of(one.module)
        if not importer or not imported or imported == importer or imported in ANY_LAYER_MAY_IMPORT:
            continue
        if importer in ANY_LAYER_MAY_IMPORT or imported not in ALLOWED.get(importer, set()):
            result.append(f"{one.path.relative_to(source)}:{one.line}: {importer} imports {imported}")
    return sorted(set(result))


def unknown_layers(source: Path) -> list[str]:
    names = {layer_of(module_name(path, source)) for path in source.rglob("*.py")}
    return sorted(name for name in names if name and name not in {*ALLOWED, *ANY_LAYER_MAY_IMPORT})


def modules_loaded_with(module: str, source: Path) -> set[str]:
    """The modules of the package that importing one of them loads."""
    files = {module_name(path, source): path for path in source.rglob("*.py")}
    eager: dict[str, set[str]] = {name: set() for name in files}
    for one in read_imports(source):
        if one.at_import_time:
            eager[module_name(one.path, source)].add(one.module)
    loaded: set[str] = set()
    waiting = [module]
    while waiting:
        name = waiting.pop()
        if name in loaded or name not in files:
            continue
        loaded.add(name)
        parents = {name.rsplit(".", depth)[0] for depth in range(1, name.count(".") + 1)}
        waiting += [*eager[name], *parents]
    return loaded


def heavy_start_up_imports(light: tuple[str, ...], source: Path) -> list[str]:
    loaded = set().union(*(modules_loaded_with(module, source) for module in light))
    return [
        f"{one.path.relative_to(source)}:{one.line}: imports {one.module}"
        for one in read_imports(source)
        if one.at_import_time
        and module_name(one.path, source) in loaded
        and one.module.partition(".")[0] in HEAVY
    ]


def lines_with_machine_paths(path: Path) -> list[int]:
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError:  # a picture or another binary file
        return []
    return [number for number, line in enumerate(lines, start=1) if MACHINE_PATHS.search(line)]
