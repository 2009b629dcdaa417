"""Parameters of the model: values with unit, meaning, origin and allowed range.

One module per published set, named author and year; `devices` holds pumps, cannulae, oxygenators
and the dialyzer, `anthropometry` height, weight and blood volume, `identification` the fit's bounds.
"""

from __future__ import annotations

from eclsim.parameters import fluid, gas, physiology, regulation, thiel2025
from eclsim.parameters.parameter import Parameter
from eclsim.parameters.spelling import did_you_mean, nearest

__all__ = [
    "Parameter",
    "UnknownParameterError",
    "all_parameters",
    "default",
    "did_you_mean",
    "find",
    "nearest",
    "usual_bounds",
]


class UnknownParameterError(KeyError):
    """A name that is no parameter; `suggestions` holds the nearest right spellings."""

    def __init__(self, name: str):
        self.name = name
        self.suggestions = nearest(name, all_parameters())
        super().__init__(name)

    def __str__(self) -> str:
        hint = f"; did you mean {' or '.join(self.suggestions)}?" if self.suggestions else ""
        return f"unknown parameter {self.name!r}{hint}"


def all_parameters() -> dict[str, Parameter]:
    """Every parameter a case file may set, by key: the paper's tables, then what goes beyond them."""
    beyond = (physiology, regulation, fluid, gas)
    return {**thiel2025.PARAMETERS} | {key: p for table in beyond for key, p in table.PARAMETERS.items()}


def default(key: str) -> Parameter:
    """The parameter of a key, exactly as written in its table (`Rmc`, also `ηB`).

    Raises:
        UnknownParameterError: With the nearest spellings.
    """
    parameter = all_parameters().get(thiel2025.ALIASES.get(key, key))
    if parameter is None:
        raise UnknownParameterError(key)
    return parameter


def usual_bounds(key: str) -> thiel2025.Bounds | None:
    """Start value and bounds that a fit looks between; None for a parameter without usual ones."""
    return thiel2025.BOUNDS.get(key) or gas.BOUNDS.get(key) or regulation.BOUNDS.get(key)


def find(name: str) -> Parameter:
    """The parameter of a key in any case, or of its exact description.

    Raises:
        UnknownParameterError: With the nearest spellings.
    """
    wanted = name.strip().lower()
    for parameter in all_parameters().values():
        if wanted in (parameter.key.lower(), parameter.description.lower()):
            return parameter
    return default(name)
