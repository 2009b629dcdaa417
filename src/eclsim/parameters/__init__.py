"""Parameters of the patient: values with unit, meaning, source and allowed range.

Those of a device are in its module. There is one module per published set, named by author and year.
"""

from __future__ import annotations

from eclsim.parameters import dialysed_drug, fluid, gas, physiology, regulation, thiel2025
from eclsim.parameters.parameter import Bounds, Parameter

__all__ = ["Bounds", "Parameter", "patient_parameters"]


def patient_parameters() -> dict[str, Parameter]:
    """All parameters of the patient that a case file may set: the paper's tables, then extensions."""
    tables = (thiel2025, physiology, regulation, fluid, gas, dialysed_drug)
    return {key: parameter for table in tables for key, parameter in table.PARAMETERS.items()}
