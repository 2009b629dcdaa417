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

from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

from eclsim.parameters.parameter import Bounds, Parameter, read_parameters

PARAMETERS = read_parameters(__file__)
"""Table S-1 and the initial state, by key; Tables S-2 and S-3 are in the modules of their devices."""


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


BOUNDS: MappingProxyType[str, Bounds] = MappingProxyType(
    {key: bounds for key in sorted(PARAMETERS) if (bounds := PARAMETERS[key].bounds)}
)
"""Bounds of the seven parameters fitted to a patient, selected by the paper's global sensitivity analysis.

The bounds of the published code run from a tenth to ten times the start value.
"""

ALIASES: MappingProxyType[str, str] = MappingProxyType({"ηB": "etaB", "ρB": "rhoB"})
"""Spellings of the printed paper that case files may also use."""

VOLUME_FRACTIONS: tuple[str, ...] = tuple(key for key in PARAMETERS if key.startswith("volume_fraction_"))
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


def stiff_atria(values: Mapping[str, float]) -> dict[str, str]:
    """Sentences on atria that are stiffer at rest than in contraction, by the key of their resting elastance.

    Args:
        values: values by key; those left out are the published ones.
    """
    result = {}
    for side, name in (("la", "left"), ("ra", "right")):
        resting, most = (values.get(key, PARAMETERS[key].value) for key in (f"Ed{side}", f"Emax{side}"))
        if resting > most:
            result[f"Ed{side}"] = (
                f"Ed{side} = {resting:g} is above Emax{side} = {most:g} mmHg/mL: the {name} atrium is "
                "stiffer at rest than in contraction, so it fills when it should empty"
            )
    return result
