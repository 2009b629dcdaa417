"""Public names of `eclsim`, and packages that can be called like the function of the same name."""

from __future__ import annotations

import os
import sys
from importlib import import_module
from types import FunctionType, ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from inspect import Signature


def public_names() -> dict[str, str]:
    """Return the module of each public name, from the `from module import name as name` lines of the stub."""
    stub = os.path.join(os.path.dirname(__file__), "__init__.pyi")
    with open(stub, encoding="utf-8") as file:
        imports = [line.split() for line in file if line.startswith("from ")]
    return {name: module for _, module, _, name, *_ in imports}


class CallablePackage(ModuleType):
    """A package that, when called, calls the function of its own name, and that shows this function's help.

    Importing any module of the package binds the package to its name in `eclsim`, where users expect the
    function.
    """

    function_module: str

    def __call__(self, *arguments: object, **options: object) -> object:
        """Call the function."""
        return self._function()(*arguments, **options)

    @property
    def __signature__(self) -> Signature:
        """Signature of the function, for `inspect.signature`, notebooks and editors."""
        from inspect import signature

        return signature(self._function())

    @property
    def __doc__(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride] - read when help is asked for
        """Help of the function for `help`: its summary, how it is called, and its arguments."""
        from inspect import getdoc, signature

        function = self._function()
        first, _, rest = (getdoc(function) or "").partition("\n")
        return f"{first}\n\neclsim.{function.__name__}{signature(function)}\n{rest}"

    def _function(self) -> FunctionType:
        name = self.__name__.rpartition(".")[2]
        return getattr(import_module(self.function_module), name)


def make_callable(package: str, module: str) -> None:
    """Make a package callable: calls go to the function of its name in a module."""
    room = sys.modules[package]
    room.__class__ = CallablePackage
    setattr(room, "function_module", module)  # noqa: B010 - no attribute of the class that it had
