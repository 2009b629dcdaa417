"""Simulator of a patient's circulation on extracorporeal life support (ECMO, CRRT, LVAD).

The public names are declared in `__init__.pyi`, which type checkers read. Each is imported from its module on
first use, so that ``import eclsim`` and ``eclsim --help`` stay fast: importing JAX alone takes over a second.
"""

import sys
from importlib import import_module

from eclsim._version import __version__ as __version__
from eclsim.front_door import public_names

_EXPORTS = public_names()
__all__ = sorted(("__version__", *_EXPORTS))  # pyright: ignore[reportUnsupportedDunderAll] - checkers read the stub


def __getattr__(name: str) -> object:
    """Import a public name on first use (PEP 562)."""
    if name not in _EXPORTS:
        message = f"module {__name__!r} has no attribute {name!r}"
        raise AttributeError(message, name=name, obj=sys.modules[__name__])
    if _EXPORTS[name] == __name__:
        return import_module(f"{__name__}.{name}")
    value = getattr(import_module(_EXPORTS[name]), name)
    # Importing a package of the same name binds that package here; the package is callable.
    return globals().setdefault(name, sys.modules.get(f"{__name__}.{name}", value))


def __dir__() -> list[str]:
    return sorted({*globals(), *_EXPORTS})
