"""Parameters of the patient: values with unit, meaning, origin and allowed range.

Those of a device stand with it. One module per published set, named author and year.
"""

from __future__ import annotations

from eclsim.parameters import fluid, gas, physiology, regulation, thiel2025
from eclsim.parameters.parameter import Bounds, Parameter

__all__ = ["Bounds", "Parameter", "patient_parameters"]


def patient_parameters() -> dict[str, Parameter]:
    """All that a case file may set of the patient: the paper's tables, then what goes beyond them."""
    tables = (thiel2025, physiology, regulation, fluid, gas)
    return {key: parameter for table in tables for key, parameter in table.PARAMETERS.items()}
