"""Parameters published with the model of Thiel et al. (2025), Tables S-1 to S-4.

Origin of the values (measured, fitted or assumed):

- Table S-1 (circulation): assumed. Literature values of a healthy adult, most of them those of
  Shi, Lawford and Hose (2011) and Korakianitis and Shi (2006); none was measured in the patients.
- Table S-2 (ECMO): tube dimensions as installed, the oxygenator's resistance from its data sheet
  taken as linear; the compliances of tubes, cannulae and oxygenator are assumed. The printed
  diameter of 0.9625 cm is used although 3/8 inch is 0.9525 cm.
- Table S-3 (CRRT): the same; the dialyzer's resistance is from a data sheet of a filter that the paper
  calls Prismaflex M180 and the published parameter file M100.
- Table S-4: fitted, to one patient on veno-arterial ECMO with right heart failure.
- Initial pressures and volume fractions: assumed, from the published code. They fix how much
  blood is in the circulation, so they are parameters like the others.

The allowed ranges are this project's: wide enough for the identification bounds (a tenth to ten
times the start value) and for disease, narrow enough to catch a value in another unit.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from types import MappingProxyType
from typing import Any

from eclsim.parameters.parameter import Bounds, Parameter

_R, _C, _L = "mmHg s/mL", "mL/mmHg", "mmHg s^2/mL"
_E, _CQ = "mmHg/mL", "mL/(s mmHg^1/2)"
_S1 = "Thiel et al. 2025, Table S-1; assumed (literature, healthy adult)"
_CODE = "published code of Thiel et al. 2025; assumed"

# key, value, unit, description, minimum, maximum, group
_TABLE_S1 = (
    ("etaB", 0.003, "Pa s", "Dynamic viscosity of blood", 0.001, 0.01, "blood"),
    ("rhoB", 0.00106, "kg/mL", "Density of blood", 0.00095, 0.0012, "blood"),
    ("Rao", 0.003, _R, "Resistance of aorta", 3e-5, 0.3, "systemic"),
    ("Rsart", 0.05, _R, "Resistance of systemic artery", 5e-4, 5.0, "systemic"),
    ("Rmc", 0.5, _R, "Resistance of systemic microcirculation", 0.02, 8.0, "systemic"),
    ("Rsvn", 0.01, _R, "Resistance of systemic vein", 1e-4, 1.0, "systemic"),
    ("Rpas", 0.002, _R, "Resistance of pulmonary aortic sinus", 2e-5, 0.2, "pulmonary"),
    ("Rpart", 0.01, _R, "Resistance of pulmonary artery", 1e-4, 1.0, "pulmonary"),
    ("Rpmc", 0.05, _R, "Resistance of pulmonary microcirculation", 5e-4, 1.0, "pulmonary"),
    ("Rpvn", 0.006, _R, "Resistance of pulmonary vein", 6e-5, 0.6, "pulmonary"),
    ("Cao", 0.08, _C, "Compliance of aorta", 0.004, 8.0, "systemic"),
    ("Csart", 0.9, _C, "Compliance of systemic artery", 0.02, 20.0, "systemic"),
    ("Csvn", 20.5, _C, "Compliance of systemic vein", 1.0, 400.0, "systemic"),
    ("Cpas", 0.18, _C, "Compliance of pulmonary aortic sinus", 0.009, 18.0, "pulmonary"),
    ("Cpart", 3.8, _C, "Compliance of pulmonary artery", 0.1, 100.0, "pulmonary"),
    ("Cpvn", 20.5, _C, "Compliance of pulmonary vein", 0.5, 400.0, "pulmonary"),
    ("Lao", 0.000062, _L, "Inertance of aorta", 1e-6, 0.01, "systemic"),
    ("Lsart", 0.0017, _L, "Inertance of systemic artery", 1e-5, 0.1, "systemic"),
    ("Lpas", 0.000052, _L, "Inertance of pulmonary aortic sinus", 1e-6, 0.01, "pulmonary"),
    ("Lpart", 0.0017, _L, "Inertance of pulmonary artery", 1e-5, 0.1, "pulmonary"),
    ("CQtri", 400.0, _CQ, "Flow coefficient of tricuspid valve", 1.0, 5000.0, "heart"),
    ("CQpa", 350.0, _CQ, "Flow coefficient of pulmonary valve", 1.0, 5000.0, "heart"),
    ("CQmi", 400.0, _CQ, "Flow coefficient of mitral valve", 1.0, 5000.0, "heart"),
    ("CQao", 350.0, _CQ, "Flow coefficient of aortic valve", 1.0, 5000.0, "heart"),
    ("Emaxra", 0.225, _E, "Systolic elastance of right atrium", 0.01, 10.0, "heart"),
    ("Edra", 0.1575, _E, "Diastolic elastance of right atrium", 0.01, 10.0, "heart"),
    ("Emaxrv", 0.45, _E, "Systolic elastance of right ventricle", 0.02, 20.0, "heart"),
    ("RV_Pd_beta", 2.5, "mmHg", "Right ventricle diastolic curve, offset", 0.0, 25.0, "heart"),
    ("RV_Pd_kappa", 0.028, "1/mL", "Right ventricle diastolic curve, exponent", 0.002, 0.2, "heart"),
    ("RV_Pd_alpha", 0.047, "mmHg", "Right ventricle diastolic curve, factor", 1e-4, 5.0, "heart"),
    ("Emaxla", 0.45, _E, "Systolic elastance of left atrium", 0.01, 10.0, "heart"),
    ("Edla", 0.2125, _E, "Diastolic elastance of left atrium", 0.01, 10.0, "heart"),
    ("Emaxlv", 1.8, _E, "Systolic elastance of left ventricle", 0.05, 40.0, "heart"),
    ("LV_Pd_beta", 2.5, "mmHg", "Left ventricle diastolic curve, offset", 0.0, 25.0, "heart"),
    ("LV_Pd_kappa", 0.033, "1/mL", "Left ventricle diastolic curve, exponent", 0.002, 0.2, "heart"),
    ("LV_Pd_alpha", 0.064, "mmHg", "Left ventricle diastolic curve, factor", 1e-4, 5.0, "heart"),
)

BOUNDS: MappingProxyType[str, Bounds] = MappingProxyType(
    {
        "Csart": Bounds(0.9, 0.09, 9.0),
        "Edla": Bounds(0.2125, 0.02125, 2.125),
        "Emaxlv": Bounds(1.8, 0.18, 18.0),
        "Emaxrv": Bounds(0.45, 0.045, 4.5),
        "Rmc": Bounds(0.5, 0.05, 5.0),
        "Rpmc": Bounds(0.05, 0.005, 0.5),
        "Rsvn": Bounds(0.01, 0.001, 0.1),
    }
)
"""Bounds of the seven parameters fitted to a patient, selected by the paper's global sensitivity analysis.

The bounds of the published code run from a tenth to ten times the start value.
"""

# Vessel or chamber, what it is, initial pressure [mmHg] (vessels only), share of the blood volume.
_INITIAL = (
    ("ao", "aorta", 80.0, 0.035268497),
    ("sart", "systemic artery", 80.0, 0.094731503),
    ("svn", "systemic vein", 4.0, 0.64),
    ("ra", "right atrium", None, 0.00953929),
    ("rv", "right ventricle", None, 0.018438289),
    ("pas", "pulmonary aortic sinus", 12.0, 0.013),
    ("part", "pulmonary artery", 8.0, 0.023),
    ("pvn", "pulmonary vein", 6.0, 0.054),
    ("la", "left atrium", None, 0.013269714),
    ("lv", "left ventricle", None, 0.028752707),
    ("capillaries", "capillaries, which have no compartment (the rest to 1)", None, 0.07),
)


def _all_parameters() -> dict[str, Parameter]:
    result = [Parameter(*row[:4], _S1, *row[4:], BOUNDS.get(row[0])) for row in _TABLE_S1]
    for place, label, pressure, fraction in _INITIAL:
        if pressure is not None:
            text = f"Initial pressure of {label}"
            result.append(Parameter(f"P0{place}", pressure, "mmHg", text, _CODE, 0.0, 200.0, "initial"))
        text = f"Initial share of the total blood volume: {label}"
        result.append(Parameter(f"volume_fraction_{place}", fraction, "1", text, _CODE, 0.0, 1.0, "initial"))
    return {parameter.key: parameter for parameter in result}


def circuit_parameters(group: str, table: str, rows: Iterable[Sequence[Any]]) -> tuple[Parameter, ...]:
    """Parameters of a table of a device's circuit.

    Args:
        group: section of the device.
        table: number of the table.
        rows: key, value, unit, description, minimum, maximum, basis.
    """
    source = f"Thiel et al. 2025, Table {table}"
    return tuple(
        Parameter(key, value, unit, label, f"{source}; {basis}", low, high, group)
        for key, value, unit, label, low, high, basis in rows
    )


PARAMETERS: MappingProxyType[str, Parameter] = MappingProxyType(_all_parameters())
"""Table S-1 and the initial state, by key; Tables S-2 and S-3 are in the modules of their devices."""

ALIASES: MappingProxyType[str, str] = MappingProxyType({"ηB": "etaB", "ρB": "rhoB"})
"""Spellings of the printed paper that case files may also use."""

VOLUME_FRACTIONS: tuple[str, ...] = tuple(f"volume_fraction_{row[0]}" for row in _INITIAL)
"""Keys of the initial shares of the blood volume; they add to 1."""

TABLE_S4: MappingProxyType[str, float] = MappingProxyType(
    {
        "Csart": 3.1852,
        "Edla": 2.1167,
        "Emaxlv": 1.3297,
        "Emaxrv": 0.10791,
        "Rmc": 0.75989,
        "Rpmc": 0.3369,
        "Rsvn": 0.00304,
    }
)
"""Fitted values of the patient in whom the paper compares the CRRT connection schemes."""
