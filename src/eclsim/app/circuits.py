"""The compiled circuit of a case: lines at another device sit on switches, so that moving one is data."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

from eclsim.cases.resolve import resolve_parameters, switched_circuit
from eclsim.orbit.model import values_of

if TYPE_CHECKING:
    from eclsim.cases.case import Case
    from eclsim.circuit import Circuit


def page_circuit(case: Case, at_rest: bool = True) -> tuple[Circuit, dict[str, float]]:
    """Circuit and values of a case.

    Args:
        case: `PageState.computed`.
        at_rest: whether the resting pressures that open set points refer to are computed; else they are NaN.

    Where all movable lines of a device are at positions of one other device, they are chosen by a value; else
    they are fixed, and moving one compiles another circuit.
    """
    circuit, chosen = switched_circuit(case)
    return _same(circuit), (values_of if at_rest else resolve_parameters)(case) | chosen


@lru_cache(maxsize=256)
def _same(circuit: Circuit) -> Circuit:
    """One object for each circuit, so that its compiled programs are found again."""
    return circuit
