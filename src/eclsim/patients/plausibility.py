"""What the fields of a case say together: contradictions (errors) and doubts (warnings).

Works on whatever fields were right, so that one mistake does not hide another.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from eclsim.parameters.anthropometry import body_mass_index
from eclsim.patients.device_plausibility import check_devices
from eclsim.patients.mistakes import Mistake, shown

_BIRTH_DATE = re.compile(r"(19|20)\d\d[-./ ]?\d\d[-./ ]?\d\d|\d{1,2}[-./]\d{1,2}[-./](19|20)?\d\d")
_RECORD_NUMBER = re.compile(r"\d{6,}")
_WORD_LIKE = r"[^\W\d_]{2,}(?:['-][^\W\d_]+)*"
_LONGEST_LOOKED_AT = 100
_PERSON = re.compile(rf"{_WORD_LIKE},\s*{_WORD_LIKE}|[A-ZÀ-Þ]\w+\s+[A-ZÀ-Þ]\w+|[A-Z]\.\s*[A-ZÀ-Þ]\w+")


@dataclass(slots=True)
class Doubts:
    """Errors, warnings and notes about a case as a whole."""

    mistakes: list[Mistake] = field(default_factory=list)
    warnings: list[Mistake] = field(default_factory=list)
    notes: list[Mistake] = field(default_factory=list)


def check_plausibility(values: Mapping[str, Any]) -> Doubts:
    """All checks that need more than one field, or that only warn.

    Args:
        values: Sections with those of their values that are right; a section is absent exactly
            if the case does not have it.
    """
    doubts = Doubts()
    _check_patient(values.get("patient", {}), doubts)
    _check_arterial_pressures(values, doubts)
    _check_pulmonary_pressures(values.get("measurements", {}), doubts)
    _check_flows(values, doubts)
    check_devices(values, doubts.mistakes, doubts.warnings, doubts.notes)
    return doubts


def looks_identifiable(text: Any) -> bool:
    """Whether an id looks like a name, a birth date or a record number of a hospital."""
    if not isinstance(text, str):
        return False
    written = text.strip()[:_LONGEST_LOOKED_AT]
    if re.search(r"@|\b(mrn|born|geb|dob|name)\b", written, re.IGNORECASE):
        return True
    return bool(_BIRTH_DATE.search(written) or _RECORD_NUMBER.search(written) or _PERSON.search(written))


def _check_patient(patient: Mapping[str, Any], doubts: Doubts) -> None:
    if looks_identifiable(patient.get("id")):
        message = "looks like a name, birth date or record number; use a pseudonym"
        doubts.warnings.append(Mistake("patient.id", message, "(hidden)"))
    height, weight = patient.get("height_cm"), patient.get("weight_kg")
    if height is not None and weight is not None:
        _check_body_size(height, weight, doubts)
    elif height is not None or weight is not None:
        lacking, given = ("weight_kg", "height_cm") if weight is None else ("height_cm", "weight_kg")
        message = f"missing, while {given} is there"
        allowed = "both, or neither (then the mean of sex and age is taken)"
        doubts.mistakes.append(Mistake(f"patient.{lacking}", message, allowed=allowed))
    elif patient:
        doubts.notes.append(
            Mistake("patient.height_cm", "height and weight: the mean of sex and age is taken")
        )


def _check_body_size(height: float, weight: float, doubts: Doubts) -> None:
    index = body_mass_index(height, weight)
    if 12.0 <= index <= 60.0 and 130.0 <= height <= 215.0:
        return
    swapped = body_mass_index(weight, height)
    message = f"with weight_kg = {weight:g} the body mass index is {index:.0f} kg/m^2"
    likely = height < weight and 12.0 <= swapped <= 60.0
    hint = f"height_cm = {weight:g} and weight_kg = {height:g} (likely swapped)" if likely else ""
    doubts.warnings.append(Mistake("patient.height_cm", message, f"{height:g}", suggestion=hint))


def _check_arterial_pressures(values: Mapping[str, Any], doubts: Doubts) -> None:
    measured = values.get("measurements", {})
    systolic, diastolic, mean = (measured.get(name) for name in ("SP", "DP", "MAP"))
    if systolic is not None and diastolic is not None:
        if systolic < diastolic:
            message = f"systolic pressure {systolic:g} mmHg is below diastolic pressure {diastolic:g} mmHg"
            hint = f"SP = {diastolic:g} and DP = {systolic:g} (swapped)"
            doubts.mistakes.append(Mistake("measurements.SP", message, shown(systolic), "SP above DP", hint))
            return
        if systolic == diastolic and not ("ecmo" in values or "lvad" in values):
            message = "no pulse (SP = DP) without ECMO or LVAD"
            doubts.warnings.append(Mistake("measurements.SP", message, shown(systolic)))
    if mean is None:
        return
    below = diastolic is not None and mean < diastolic
    above = systolic is not None and mean > systolic
    if below or above:
        given = [f"{name} {measured[name]:g}" for name in ("SP", "DP", "MAP") if name in measured]
        message = f"mean pressure outside of diastolic to systolic pressure: {', '.join(given)} mmHg"
        doubts.mistakes.append(Mistake("measurements.MAP", message, shown(mean), "DP <= MAP <= SP"))
    elif systolic is not None and diastolic is not None:
        expected = diastolic + (systolic - diastolic) / 3.0
        if abs(mean - expected) > max(8.0, 0.25 * (systolic - diastolic)):
            message = f"far from DP + (SP - DP) / 3 = {expected:.0f} mmHg"
            doubts.warnings.append(Mistake("measurements.MAP", message, shown(mean)))


def _check_pulmonary_pressures(measured: Mapping[str, float], doubts: Doubts) -> None:
    wedge, mean = measured.get("PCWP"), measured.get("MPAP")
    if wedge is not None and mean is not None and wedge > mean + 5.0:
        message = (
            f"above the mean pulmonary artery pressure {mean:g} mmHg by more than 5: physiologically doubtful"
        )
        doubts.warnings.append(Mistake("measurements.PCWP", message, shown(wedge)))


def _check_flows(values: Mapping[str, Any], doubts: Doubts) -> None:
    measured = values.get("measurements", {})
    output, pump_flow = measured.get("CO"), measured.get("PF")
    if pump_flow is not None and "ecmo" not in values:
        message = "a pump flow was measured, but the case has no [ecmo] section"
        doubts.warnings.append(Mistake("measurements.PF", message, shown(pump_flow)))
    if output is not None and pump_flow is not None and output < pump_flow:
        message = (
            f"below the pump flow {pump_flow:g} L/min; it is read as the native output, through the lungs"
        )
        hint = "a total that includes the pump flow"
        doubts.warnings.append(Mistake("measurements.CO", message, shown(output), suggestion=hint))
