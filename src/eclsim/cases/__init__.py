"""Patients and their devices: case files read, checked, changed and written.

Reading a bad file imports nothing heavy: `Case` and its sections are loaded when first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from eclsim.cases.checking import check_case
from eclsim.cases.mistakes import CaseError, Mistake
from eclsim.cases.reading import CaseReading, read_case, read_mapping
from eclsim.cases.resolve import blood_volume_ml, height_weight, resolve_parameters
from eclsim.cases.settings import apply_settings
from eclsim.cases.writing import write_case

if TYPE_CHECKING:
    from eclsim.cases.case import Case, Crrt, Ecmo, Lvad, Measurements, Patient, RollerPump

_LAZY = ("Case", "Crrt", "Ecmo", "Lvad", "Measurements", "Patient", "RollerPump")

__all__ = [
    "Case",
    "CaseError",
    "CaseReading",
    "Crrt",
    "Ecmo",
    "Lvad",
    "Measurements",
    "Mistake",
    "Patient",
    "RollerPump",
    "apply_settings",
    "blood_volume_ml",
    "check_case",
    "height_weight",
    "read_case",
    "read_mapping",
    "resolve_parameters",
    "write_case",
]


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        from eclsim.cases import case

        return getattr(case, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
