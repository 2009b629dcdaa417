"""Parameters of gas exchange: settings of ventilator and sweep gas, blood, and constants of the oxygenator.

Those of the section [gas] and of the sweep are keys of a case file; the others stand in [parameters]. The
defaults of the section are those of an adult on protective ventilation; nothing was fitted.
"""

from __future__ import annotations

from types import MappingProxyType

from eclsim.parameters.parameter import Parameter
from eclsim.parameters.thiel2025 import Bounds

PREFIX = "gas."
_SETTING = "setting; default assumed (protective ventilation on ECMO)"
_PATIENT = "of the patient; default assumed"
_VASLEF = "form of Vaslef et al. 1994 (ASAIO J 40:990); default for 1.8 m2"
_FITTED = "fitted to Khadka et al. 2024 (doi 10.5772/intechopen.1006540)"

# key, value, unit, description, source, minimum, maximum, group
_TABLE = (
    ("gas.haemoglobin_g_dl", 10.0, "g/dL", "Haemoglobin", _PATIENT, 3.0, 25.0, "gas"),
    (
        "gas.base_excess_mmol_l", 0.0, "mmol/L", "Base excess of the fully oxygenated blood", _PATIENT,
        -30.0, 30.0, "gas",
    ),
    ("gas.temperature_c", 37.0, "C", "Temperature of the blood", _PATIENT, 25.0, 42.0, "gas"),
    (
        "gas.vo2_ml_min", 220.0, "mL/min", "Oxygen consumption that the tissues want (STPD)",
        "of the patient; left out, 126 mL/min per m2 of body surface: Dehmer, Firth and Hillis 1982 (doi "
        "10.1002/clc.4960050803; 126 +- 26 in 108 adults), surface by Mosteller 1987", 20.0, 1000.0, "gas",
    ),
    (
        "gas.respiratory_quotient", 0.8, "1", "Carbon dioxide given off for each oxygen consumed",
        "mixed diet; assumed", 0.6, 1.3, "gas",
    ),
    ("gas.fio2", 0.5, "1", "Fraction of oxygen from the ventilator", _SETTING, 0.21, 1.0, "gas"),
    (
        "gas.alveolar_ventilation_l_min", 2.0, "L/min", "Alveolar ventilation (BTPS); 0 acts as shunt 1",
        _SETTING, 0.0, 30.0, "gas",
    ),
    (
        "gas.shunt_fraction", 0.4, "1", "Share of the flow through the lungs that passes no alveolus",
        _PATIENT, 0.0, 1.0, "gas",
    ),
    (
        "gas.oxygen_capacity_ml_g", 1.34, "mL/g", "Oxygen that a gram of haemoglobin binds",
        "1.34 to 1.39 are in use", 1.30, 1.40, "gas",
    ),
    (
        "ecmo.sweep_l_min", 4.0, "L/min", "Sweep gas of the oxygenator; 0: it exchanges nothing",
        "setting", 0.0, 20.0, "ecmo",
    ),
    ("ecmo.fdo2", 1.0, "1", "Fraction of oxygen in the sweep gas", "setting", 0.21, 1.0, "ecmo"),
    (
        "ecmo.drainage_mixing", 1.0, "1",
        "Where drainage and return share a compartment: 1, its blood is drained; 0, that of its veins",
        "assumed; recirculation is m Qe / (CO + m Qe): medians of 9, 18 and 28 % mean 0.14, 0.32, 0.58",
        0.0, 1.0, "ecmo",
    ),
    (
        "ecmo.oxygenator.oxygen_transfer", 0.0518, "mL/min/mmHg",
        "Oxygen transfer of the oxygenator's membrane at 1 L/min", f"{_VASLEF}; {_FITTED}",
        0.001, 1.0, "ecmo",
    ),
    (
        "ecmo.oxygenator.oxygen_exponent", 0.74, "1", "Exponent of blood flow in the oxygen transfer",
        f"{_VASLEF}; {_FITTED}", 0.3, 1.0, "ecmo",
    ),
    (
        "ecmo.oxygenator.carbon_dioxide_transfer", 7.1, "mL/min/mmHg",
        "Carbon dioxide transfer of the oxygenator's membrane at 1 L/min",
        "648 mL/min at 7 L/min and 35 L/min of gas (Khadka et al. 2024), by membrane area", 0.1, 50.0, "ecmo",
    ),
    (
        "ecmo.oxygenator.clotted_fraction", 0.0, "1", "Share of the oxygenator's membrane that is clotted",
        "0 when new", 0.0, 0.99, "ecmo",
    ),
)  # fmt: skip
PARAMETERS = MappingProxyType({row[0]: Parameter(*row) for row in _TABLE})
"""By name, keys of case files among them."""

BOUNDS = MappingProxyType(
    {
        "gas.shunt_fraction": Bounds(0.4, 0.0, 1.0), "gas.vo2_ml_min": Bounds(220.0, 60.0, 800.0),
        "gas.alveolar_ventilation_l_min": Bounds(2.0, 0.2, 20.0),
        "ecmo.drainage_mixing": Bounds(0.5, 0.0, 1.0),
        "ecmo.oxygenator.oxygen_transfer": Bounds(0.0518, 0.00518, 0.518),
        "ecmo.oxygenator.clotted_fraction": Bounds(0.2, 0.0, 0.99),
    }
)  # fmt: skip
"""Where a fit looks; wide on purpose: intervals that end here say that the measurements leave it open."""

_ABSOLUTE = MappingProxyType(
    {
        "gas.base_excess_mmol_l": 5.0, "gas.temperature_c": 1.5, "gas.respiratory_quotient": 0.1,
        "gas.shunt_fraction": 0.2, "ecmo.fdo2": 0.25, "ecmo.drainage_mixing": 0.25,
        "ecmo.oxygenator.clotted_fraction": 0.25, "ecmo.oxygenator.oxygen_exponent": 0.1,
    }
)  # fmt: skip
"""Half widths that stand for 25 % where a percentage of the value says nothing, as of a base excess."""
SENSITIVITY = (
    "gas.haemoglobin_g_dl", "gas.base_excess_mmol_l", "gas.temperature_c", "gas.vo2_ml_min",
    "gas.respiratory_quotient", "gas.fio2", "gas.alveolar_ventilation_l_min", "gas.shunt_fraction",
    "ecmo.sweep_l_min", "ecmo.fdo2", "ecmo.drainage_mixing", "ecmo.oxygenator.oxygen_transfer",
)  # fmt: skip
"""Inputs of an analysis of gas exchange."""


def varied(name: str, value: float, share: float) -> tuple[float, float] | None:
    """Range of a parameter of gas exchange around a value, within what is allowed; None for others.

    Args:
        name: of the parameter.
        value: in its unit.
        share: half width as a share of the value, such as 0.25.
    """
    parameter = PARAMETERS.get(name)
    if parameter is None:
        return None
    half = _ABSOLUTE[name] * share / 0.25 if name in _ABSOLUTE else share * abs(value)
    return max(value - half, parameter.minimum), min(value + half, parameter.maximum)
