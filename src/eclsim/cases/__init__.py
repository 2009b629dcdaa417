"""Patients and their devices: reading, checking, changing and writing of case files."""

from eclsim.cases.case import Case, Measurements, Patient
from eclsim.cases.checking import check_case
from eclsim.cases.reading import CaseReading, read_case, read_mapping, write_case
from eclsim.cases.resolve import blood_volume_ml, height_weight, resolve_parameters
from eclsim.cases.settings import apply_settings
from eclsim.inputs.mistakes import CaseError, Mistake

__all__ = [
    "Case", "CaseError", "CaseReading", "Measurements", "Mistake", "Patient", "apply_settings",
    "blood_volume_ml", "check_case", "height_weight", "read_case", "read_mapping", "resolve_parameters",
    "write_case",
]  # fmt: skip
