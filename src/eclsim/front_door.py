"""The public names of `eclsim`, and packages that can be called like the function of their name."""

from __future__ import annotations

import os
import sys
from importlib import import_module
from inspect import Signature, getdoc, signature
from types import FunctionType, ModuleType


def public_names() -> dict[str, str]:
    """The module that defines each public name: the lines `from module import name as name` of the stub."""
    stub = os.path.join(os.path.dirname(__file__), "__init__.pyi")
    with open(stub, encoding="utf-8") as file:
        imports = [line.split() for line in file if line.startswith("from ")]
    return {name: module for _, module, _, name, *_ in imports}


class CallablePackage(ModuleType):
    """A package whose call goes to the function of its own name, and whose help is that function's.

    Importing any of its modules binds the package to its name in `eclsim`, where users look for the function.
    """

    function_module: str

    def __call__(self, *arguments: object, **options: object) -> object:
        """Call the function."""
        return self._function()(*arguments, **options)

    @property
    def __signature__(self) -> Signature:
        """Signature of the function, for `inspect.signature`, notebooks and editors."""
        return signature(self._function())

    @property
    def __doc__(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride] - read when help is asked for
        """What the function does, how it is called, and its arguments: what `help` shows of a package."""
        function = self._function()
        first, _, rest = (getdoc(function) or "").partition("\n")
        return f"{first}\n\neclsim.{function.__name__}{signature(function)}\n{rest}"

    def _function(self) -> FunctionType:
        name = self.__name__.rpartition(".")[2]
        return getattr(import_module(self.function_module), name)


def make_callable(package: str, module: str) -> None:
    """Let a call of a package go to the function of its name in a module."""
    room = sys.modules[package]
    room.__class__ = CallablePackage
    setattr(room, "function_module", module)  # noqa: B010 - no attribute of the class that it had
