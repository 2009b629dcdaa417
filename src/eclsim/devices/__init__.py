"""Devices that are connected to a patient, one file each, and their registry.

These names serve to write a user's own device, which `eclsim.register_device` registers.
"""

from eclsim.devices.description import (
    CAUTION,
    GASES,
    Box,
    Columns,
    Curve,
    Finding,
    KeyFigure,
    Knob,
    Limit,
    Look,
    Mark,
    Output,
    Panel,
    Picker,
    Sweep,
    Target,
    Trace,
    Views,
    difference,
    gas_sample,
    highest,
    lowest,
    mean,
    mean_flow,
    picker,
)
from eclsim.devices.device import CaseValues, Device, Instance, Naming
from eclsim.devices.plausibility import check_cannula, check_sites, check_speed, patient_site
from eclsim.devices.products import CannulaType, Dialyzer, Oxygenator, Product, PumpCurve, by_key, pump_values
from eclsim.inputs.fields import Field, measured, number, one_of
from eclsim.inputs.mistakes import Remarks, shown
from eclsim.inputs.sections import Raw, Section
from eclsim.parameters.parameter import Parameter

__all__ = [
    "CAUTION", "GASES", "Box", "CannulaType", "CaseValues", "Columns", "Curve", "Device", "Dialyzer", "Field",
    "Finding", "Instance", "KeyFigure", "Knob", "Limit", "Look", "Mark", "Naming", "Output",
    "Oxygenator", "Panel", "Parameter", "Picker", "Product", "PumpCurve", "Raw", "Remarks", "Section",
    "Sweep", "Target", "Trace", "Views", "by_key", "check_cannula", "check_sites", "check_speed",
    "difference", "gas_sample", "highest", "lowest", "mean", "mean_flow", "measured", "number", "one_of",
    "patient_site", "picker", "pump_values", "shown",
]  # fmt: skip
