"""What the fields of a case say together: contradictions (errors) and doubts (warnings).

Works on whatever fields were right, so that one mistake does not hide another.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

from eclsim.cases.blood_plausibility import check_blood
from eclsim.cases.device_plausibility import check_devices
from eclsim.cases.fields import ARTERIAL_SITES
from eclsim.cases.mistakes import Mistake, shown
from eclsim.patient.anthropometry import body_mass_index, body_surface
from eclsim.units import ML_S_PER_L_MIN

_BIRTH_DATE = re.compile(r"(19|20)\d\d[-./ ]?\d\d[-./ ]?\d\d|\d{1,2}[-./]\d{1,2}[-./](19|20)?\d\d")
_RECORD_NUMBER = re.compile(r"\d{6,}")
_WORD_LIKE = r"[^\W\d_]{2,}(?:['-][^\W\d_]+)*"
_LONGEST_LOOKED_AT = 100
_PERSON = re.compile(rf"{_WORD_LIKE},\s*{_WORD_LIKE}|[A-ZÀ-Þ]\w+\s+[A-ZÀ-Þ]\w+|[A-Z]\.\s*[A-ZÀ-Þ]\w+")

# Beyond these a cardiac output on V-A ECMO is rather a total with the pump flow in it.
_LARGEST_INDEX = 5.5  # L/min/m^2
_LARGEST_COMPLIANCE = 5.0  # mL/mmHg, stroke volume per pulse pressure


@dataclass(slots=True)
class Doubts:
    """Errors, warnings and notes about a case as a whole."""

    mistakes: list[Mistake] = field(default_factory=list)
    warnings: list[Mistake] = field(default_factory=list)
    notes: list[Mistake] = field(default_factory=list)


def check_plausibility(values: Mapping[str, Any], refused: Collection[str] = ()) -> Doubts:
    """All checks that need more than one field, or that only warn.

    Args:
        values: Sections with those of their values that are right; a section is absent exactly
            if the case does not have it.
        refused: Keys that are given with a wrong value ("patient.weight_kg"): they are not missing.
    """
    doubts = Doubts()
    _check_patient(values.get("patient", {}), refused, doubts)
    _check_arterial_pressures(values, doubts)
    _check_pulmonary_pressures(values.get("measurements", {}), doubts)
    _check_flows(values, doubts)
    check_blood(values.get("patient", {}), values.get("parameters", {}), doubts.mistakes, doubts.warnings)
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


def _check_patient(patient: Mapping[str, Any], refused: Collection[str], doubts: Doubts) -> None:
    if looks_identifiable(patient.get("id")):
        message = "looks like a name, birth date or record number; use a pseudonym"
        doubts.warnings.append(Mistake("patient.id", message, "(hidden)"))
    height, weight = patient.get("height_cm"), patient.get("weight_kg")
    if height is not None and weight is not None:
        _check_body_size(height, weight, doubts)
    elif height is not None or weight is not None:
        lacking, given = ("weight_kg", "height_cm") if weight is None else ("height_cm", "weight_kg")
        if f"patient.{lacking}" in refused:
            return
        message = f"missing, while {given} is there"
        allowed = "both, or neither (then the mean of sex and age is taken)"
        doubts.mistakes.append(Mistake(f"patient.{lacking}", message, allowed=allowed))
    elif patient and not {"patient.height_cm", "patient.weight_kg"} & set(refused):
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
    if output is None or pump_flow is None or "ecmo" not in values:
        return
    if values["ecmo"].get("return_site") not in ARTERIAL_SITES:
        if output < pump_flow:
            message = (
                f"below the pump flow {pump_flow:g} L/min: where ECMO returns before the lungs, CO is all "
                "that the body gets, and the pump would draw again what it has just returned"
            )
            doubts.warnings.append(Mistake("measurements.CO", message, shown(output)))
        return
    if why := _looks_total(values, output, pump_flow):
        hint = f"CO = {output - pump_flow:.3g}, a total less the pump flow {pump_flow:g} L/min"
        message = f"is read as the native output, through the lungs; {why}"
        doubts.warnings.append(Mistake("measurements.CO", message, shown(output), suggestion=hint))
    else:
        message = "is read as the native output, through the lungs; with the pump flow the organs get "
        doubts.notes.append(
            Mistake("measurements.CO", f"{message}{output + pump_flow:.3g} L/min", shown(output))
        )


def _looks_total(values: Mapping[str, Any], output: float, pump_flow: float) -> str:
    """Why an output on V-A ECMO is rather a total, or nothing; a total is never below the pump flow."""
    if output <= pump_flow:
        return ""
    measured, patient = values.get("measurements", {}), values.get("patient", {})
    height, weight = patient.get("height_cm"), patient.get("weight_kg")
    if height is not None and weight is not None:
        index = (output + pump_flow) / body_surface(height, weight)
        if index > _LARGEST_INDEX:
            return (
                f"with the pump flow {pump_flow:g} L/min the organs would get {output + pump_flow:.3g} "
                f"L/min, {index:.1f} L/min/m^2, where above {_LARGEST_INDEX:g} is hardly ever seen"
            )
    systolic, diastolic, rate = measured.get("SP"), measured.get("DP"), patient.get("heart_rate_bpm")
    if systolic is None or diastolic is None or not rate or systolic <= diastolic:
        return ""
    stroke = output * ML_S_PER_L_MIN * 60.0 / rate
    compliance = stroke / (systolic - diastolic)
    if compliance <= _LARGEST_COMPLIANCE:
        return ""
    return (
        f"a stroke volume of {stroke:.0f} mL with a pulse pressure of {systolic - diastolic:g} mmHg means an "
        f"arterial compliance of {compliance:.1f} mL/mmHg, where 1 to 2 is usual and above "
        f"{_LARGEST_COMPLIANCE:g} hardly ever seen"
    )
