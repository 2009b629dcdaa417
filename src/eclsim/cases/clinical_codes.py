"""Codes of measurements in clinical data, and the units that they come in.

LOINC and SNOMED CT codes are those of public FHIR profiles (HL7 vital signs; the intensive care module of
the German Medical Informatics Initiative for PCWP and for the flow of an extracorporeal gas exchange, which
has no LOINC code; HL7's value set of oxygen saturations for that of arterial blood, DICOM's context group
3524 for its partial pressures; LOINC's own name for that of mixed venous blood). Pulse oximetry (59408-5) is
not taken for a blood gas.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType

from eclsim.cases.sections import MEASURED_GASES, Measurements
from eclsim.devices.registry import devices
from eclsim.units import convert, known_unit, quantity_of

LOINC, SNOMED = "http://loinc.org", "http://snomed.info/sct"


@dataclass(frozen=True, slots=True)
class Measurable:
    """A column of a cohort that clinical data may hold.

    Attributes:
        column: Name of the column.
        unit: Unit of the column.
        loinc: LOINC code, or empty.
        snomed: SNOMED CT code, or empty.
    """

    column: str
    unit: str
    loinc: str = ""
    snomed: str = ""


MEASURABLES = (
    Measurable("heart_rate_bpm", "bpm", "8867-4"),
    Measurable("SP", "mmHg", "8480-6"),
    Measurable("DP", "mmHg", "8462-4"),
    Measurable("MAP", "mmHg", "8478-0"),
    Measurable("MPAP", "mmHg", "8414-5"),
    Measurable("PCWP", "mmHg", "75994-4"),
    Measurable("CO", "L/min", "8741-1"),
    Measurable("PF", "L/min", "", "251288004"),
    Measurable("SaO2", "%", "2708-6"),
    Measurable("PaO2", "mmHg", "2703-7"),
    Measurable("PaCO2", "mmHg", "2019-8"),
    *(
        Measurable(name, Measurements.fields()[name].unit, "19224-5" if name == "SvO2" else "")
        for name in MEASURED_GASES
        if name not in ("SaO2", "PaO2", "PaCO2")
    ),
    Measurable("haemoglobin_g_dl", "g/dL", "718-7"),
    Measurable("height_cm", "cm", "8302-2"),
    Measurable("weight_kg", "kg", "29463-7"),
    *(
        Measurable(column, device.section.fields()[device.columns.needed[column]].unit)
        for device in devices().values()
        for column in device.columns.measured
    ),
)
"""What is read; a pump's speed and blood gases of the ECMO go by their names."""
BY_CODE: MappingProxyType[str, Measurable] = MappingProxyType(
    {m.loinc: m for m in MEASURABLES if m.loinc}
    | {m.snomed: m for m in MEASURABLES if m.snomed}
    | {m.column: m for m in MEASURABLES}
)
_UCUM = {
    "mm[Hg]": "mmHg", "cm[H2O]": "cmH2O", "{beats}/min": "bpm", "{Beats}/min": "bpm", "/min": "bpm",
    "1/min": "bpm", "[lb_av]": "lb", "[in_i]": "in", "{rpm}": "rpm", "{rev}/min": "rpm", "m[H2O]": "",
    "l/min": "L/min",
}  # fmt: skip


class UnitError(ValueError):
    """A unit that is missing, unknown or measures something else."""


def in_unit_of(value: float, unit: str, what: Measurable) -> tuple[float, str]:
    """A value in the unit of its column, and what was converted; empty if nothing was.

    Raises:
        UnitError: With what is allowed.
    """
    wanted = quantity_of(what.unit)
    if not unit.strip():
        raise UnitError(f"no unit; {what.column} needs one, such as {what.unit}")
    if wanted in ("rate", "speed") and unit.strip() in ("/min", "1/min"):
        return value, ""
    known = known_unit(_UCUM.get(unit.strip(), unit))
    if known is None or quantity_of(known) != wanted:
        raise UnitError(f"unit {unit!r} is no unit of a {wanted}; {what.column} is in {what.unit}")
    if known == what.unit:
        return value, ""
    converted = float(f"{convert(value, known, what.unit):.6g}")
    return converted, f"{value:g} {known} = {converted:g} {what.unit}"
