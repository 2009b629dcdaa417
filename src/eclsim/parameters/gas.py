"""Parameters of gas exchange: blood, metabolism, lungs and ventilator; a device has its own.

Those of the section [gas] are keys of that section in a case file; the others are set in [parameters]. The
defaults are those of an adult on protective ventilation; nothing was fitted.
"""

from __future__ import annotations

from types import MappingProxyType

from eclsim.parameters.parameter import Bounds, Parameter

PREFIX = "gas."
LUNG_VOLUME = "gas.lung_volume_ml"
VO2_PER_DEGREE = "gas.vo2_percent_per_c"
NORMAL_C = 37.0
"""Temperature [C] to which a consumption that follows the temperature refers."""
TEMPERATURE_DOUBT_C = 1.5
"""Deviation from it above which consumption, and blood gases of an analyser at 37 C, are doubted [C]."""
_SETTING = "setting; default assumed (protective ventilation on extracorporeal support)"
_PATIENT = "of the patient; default assumed"

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
        VO2_PER_DEGREE, 0.0, "%/C",
        "Rise of the oxygen consumption for each degree (0: none); vo2_ml_min is that at 37 C",
        "0: consumption is as given; 8.5 in 12 ventilated patients cooled from 39.4 to 37.0 C (359 to 295 "
        "mL/min): Manthous et al. 1995 (doi 10.1164/ajrccm.151.1.7812538)", 0.0, 15.0, "gas",
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
        LUNG_VOLUME, 2000.0, "mL", "Gas that the alveoli hold (BTPS), followed in courses beat by beat",
        "of the patient; default assumed (functional residual capacity of a supine adult; in severe lung "
        "injury half of it or less)", 100.0, 6000.0, "gas",
    ),
    (
        "gas.oxygen_capacity_ml_g", 1.34, "mL/g", "Oxygen that a gram of haemoglobin binds",
        "1.34 to 1.39 are in use", 1.30, 1.40, "gas",
    ),
)  # fmt: skip
_BOUNDS = MappingProxyType(
    {
        "gas.shunt_fraction": Bounds(0.4, 0.0, 1.0), "gas.vo2_ml_min": Bounds(220.0, 60.0, 800.0),
        "gas.alveolar_ventilation_l_min": Bounds(2.0, 0.2, 20.0),
    }
)  # fmt: skip
"""Bounds, wide on purpose: an interval that ends at one shows that the measurements do not determine it."""
_HALF_WIDTHS = MappingProxyType(
    {
        "gas.base_excess_mmol_l": 5.0, "gas.temperature_c": 1.5, "gas.respiratory_quotient": 0.1,
        "gas.shunt_fraction": 0.2,
    }
)  # fmt: skip
PARAMETERS = MappingProxyType(
    {
        row[0]: Parameter(*row, bounds=_BOUNDS.get(row[0]), half_width=_HALF_WIDTHS.get(row[0]), clipped=True)
        for row in _TABLE
    }
)
"""All parameters by name, including keys of case files."""
