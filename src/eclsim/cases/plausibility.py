"""Consistency of the fields of a case with each other: contradictions (errors) and doubts (warnings).

The checks use whichever fields are valid, so that one error does not hide another. Checks that concern a
single device or a single section of the patient are in their own modules.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

from eclsim.cases.resolve import blood_volume_ml
from eclsim.cases.sections import PATIENT_SECTIONS, Measurements, Patient
from eclsim.devices.device import CaseValues, device_key
from eclsim.devices.registry import device_of, devices
from eclsim.inputs.mistakes import Remarks, shown
from eclsim.inputs.sections import Raw, looks_identifiable
from eclsim.parameters import physiology, thiel2025
from eclsim.parameters.physiology import SECTION
from eclsim.parameters.regulation import DRUG_DOSES, DRUGS, REGULATION
from eclsim.patient.anthropometry import body_mass_index, delivery_limits, greatest_heart_rate
from eclsim.patient.sites import ONLY_REGIONAL, SAME_IN_REGIONS, patient_sites
from eclsim.units import MMHG_PER_KPA

_VESSELS = ("ao", "sart", "svn", "pas", "part", "pvn")
_CHAMBERS = ("ra", "rv", "la", "lv")
_LARGEST_SHARE = 0.5
_LEAST_VENOUS_ML = 20.0
_SMALLEST_RATE_CHANGE = 0.5
"""Change of the heart rate by drugs [bpm] that a monitor shows."""
RATE_PLACE = "patient.heart_rate_bpm"
_LARGEST_SATURATION_DIFFERENCE = 15.0
"""Difference [%] of a saturation from that of its PO2 which pH and temperature hardly explain."""


def check_plausibility(case: CaseValues, parameters: Mapping[str, float], remarks: Remarks) -> None:
    """Run all checks that need more than one field, or that only warn.

    Args:
        case: Valid values of the case.
        parameters: Parameter overrides.
        remarks: Contains the fields already refused, which do not count as missing; collects errors, warnings
            and notes.
    """
    _check_patient(case.patient, remarks.refused(), remarks)
    _note_size(case, remarks)
    _check_arterial_pressures(case, remarks)
    wedge, mean = case.measurements.get("PCWP"), case.measurements.get("MPAP")
    if wedge is not None and mean is not None and wedge > mean + 5.0:
        message = (
            f"above the mean pulmonary artery pressure {mean:g} mmHg by more than 5: physiologically doubtful"
        )
        remarks.warning("measurements.PCWP", message, shown(wedge))
    for device in devices().values():
        for name in (entry.name for entry in device.outputs if entry.in_contract):
            if name in case.measurements and not case.of(device.key):
                message = f"a pump flow was measured, but the case has no [{device.key}] section"
                remarks.warning(f"measurements.{name}", message, shown(case.measurements[name]))
    _check_rate_before_drugs(case, remarks)
    _check_blood(case, parameters, remarks)
    _check_blood_gases(case, remarks)
    _note_ventilation(case, remarks)
    stated = {Measurements.section: case.measurements, **case.physiology}
    for section in PATIENT_SECTIONS:
        section.check(stated, remarks)
    _check_regions(case, parameters, remarks)
    for key, values in case.devices.items():
        device = device_of(device_key(key))
        assert device is not None  # a section that belongs to no device is an unknown key
        device.check(values, case, key, remarks)


def _check_blood_gases(case: CaseValues, remarks: Remarks) -> None:
    """Compare saturations with PO2: a PO2 that would fit in kPa is an error, any other mismatch a warning."""
    measured = case.measurements
    for saturation, pressure in (("SaO2", "PaO2"), ("SpostO2", "PpostO2")):
        if saturation not in measured or pressure not in measured:
            continue
        percent, mmhg = measured[saturation], measured[pressure]
        converted, doubt = mmhg * MMHG_PER_KPA, abs(_saturation(mmhg) - percent)
        if doubt < _LARGEST_SATURATION_DIFFERENCE:
            continue
        usual = f"{_saturation(mmhg):.0f} %"
        message = f"{saturation} = {percent:g} % does not match it; about {usual} would"
        if abs(_saturation(converted) - percent) < 0.25 * doubt:
            hint = f"{mmhg:g} kPa = {converted:.4g} mmHg"
            remarks.error(f"measurements.{pressure}", message, shown(mmhg), "mmHg", hint)
        else:
            remarks.warning(f"measurements.{pressure}", message, shown(mmhg))


def _note_ventilation(case: CaseValues, remarks: Remarks) -> None:
    """Note the default ventilation of a patient without an oxygenator: that of lungs at rest on ECMO."""
    gas = case.physiology.get("gas")
    if gas is None or "alveolar_ventilation_l_min" in gas or case.of("ecmo"):
        return
    message = (
        "left out, so 2 L/min, as of lungs at rest on ECMO; without an oxygenator PaCO2 is then near 90 "
        "mmHg, and adults breathe 4 to 5 L/min"
    )
    remarks.note("gas.alveolar_ventilation_l_min", message)


def _saturation(po2: float) -> float:
    """Return the saturation [%] at a PO2 [mmHg], pH 7.4 and 37 C (Severinghaus 1979)."""
    return 100.0 / (1.0 + 23400.0 / (po2**3 + 150.0 * po2))


_PARTS_MISSING = {
    "regional": "regions", "collapsible_veins": "veins that collapse", "pericardium": "pericardium",
}  # fmt: skip


def _check_regions(case: CaseValues, parameters: Mapping[str, float], remarks: Remarks) -> None:
    """Check sites and settings that need regions, collapsible veins or a pericardium."""
    section = case.physiology.get(SECTION, {})
    regional = section.get("regional", False)
    usual = physiology.PARAMETERS[physiology.UPPER_SHARE].value
    if not regional and section.get("upper_share", usual) != usual:
        message = "without effect: the patient has no regions; add regional = true"
        remarks.warning(f"{SECTION}.upper_share", message, shown(section["upper_share"]))
    for name in parameters:
        needed = physiology.NEEDS.get(name, "")
        if needed and not section.get(needed, False):
            missing = _PARTS_MISSING[needed]
            message = f"without effect: the patient has no {missing}; add [{SECTION}] {needed} = true"
            remarks.warning(f"parameters.{name}", message, shown(parameters[name]))
    for key, values in case.devices.items():
        for name, site in values.items():
            if not isinstance(site, str) or not name.endswith("site"):
                continue
            if regional and site in SAME_IN_REGIONS:
                message = f"is divided in a patient with regions: read as {shown(SAME_IN_REGIONS[site])}"
                remarks.note(f"{key}.{name}", message, shown(site))
            elif not regional and site in ONLY_REGIONAL:
                allowed = f"{', '.join(patient_sites())}, or add [{SECTION}] regional = true"
                message = "a site of a patient with regions"
                remarks.error(f"{key}.{name}", message, shown(site), allowed)


def _check_patient(patient: Raw, refused: Collection[str], remarks: Remarks) -> None:
    if looks_identifiable(patient.get("id")):
        message = "looks like a name, birth date or record number; use a pseudonym"
        remarks.warning("patient.id", message, "(hidden)")
    height, weight = patient.get("height_cm"), patient.get("weight_kg")
    _check_heart_rate(patient, remarks)
    if height is not None and weight is not None:
        _check_body_size(height, weight, remarks)
    elif height is not None or weight is not None:
        lacking, present = ("weight_kg", "height_cm") if weight is None else ("height_cm", "weight_kg")
        if f"patient.{lacking}" not in refused:
            allowed = "both, or neither (then the mean of sex and age is taken)"
            remarks.error(f"patient.{lacking}", f"missing, although {present} is given", allowed=allowed)
    elif patient and not {"patient.height_cm", "patient.weight_kg"} & set(refused):
        remarks.note("patient.height_cm", "height and weight: the mean of sex and age is taken")


def _check_heart_rate(patient: Raw, remarks: Remarks) -> None:
    """Warn of a heart rate faster than the sinus node of the patient's age."""
    rate, age = patient.get("heart_rate_bpm"), patient.get("age_years")
    if rate is None or age is None or rate <= (greatest := greatest_heart_rate(age)):
        return
    message = (
        f"faster than a sinus node of {age:g} years, about {greatest:g} bpm (208 - 0.7 age, Tanaka et al. "
        "2001): an arrhythmia or a pacemaker? Systole takes the same share of every beat here, so that the "
        "output at such a rate is too high"
    )
    remarks.warning(RATE_PLACE, message, shown(rate))


def _check_rate_before_drugs(case: CaseValues, remarks: Remarks) -> None:
    """Say that the heart rate is that before the drugs; a warning if the patient was measured on them."""
    rate, drugs = case.patient.get("heart_rate_bpm"), case.physiology.get(DRUGS, {})
    doses = {
        name: drugs[name] * drugs.get(f"{name}_sensitivity", 1.0)
        for name in DRUG_DOSES
        if drugs.get(name, 0.0) > 0.0
    }
    if rate is None or not doses:
        return
    from eclsim.drugs.published import heart_rate_on_drugs

    regulation = case.physiology.get(REGULATION, {})
    response = regulation.get("heart_rate_response", 1.0)
    raised = heart_rate_on_drugs(rate, doses, response)
    if abs(raised - rate) < _SMALLEST_RATE_CHANGE:
        return
    on = "with them, without reflexes," if {"baroreflex", "chemoreflex"} & regulation.keys() else "with them"
    message = (
        f"is taken as the rate before the drugs; {on} the beat has {raised:.1f} bpm. If {rate:g} was "
        f"measured on these doses, write {rate * rate / raised:.1f} instead, so that the beat has {rate:g}"
    )
    remark = remarks.warning if case.measurements else remarks.note
    remark(RATE_PLACE, message, shown(rate))


def _check_body_size(height: float, weight: float, remarks: Remarks) -> None:
    index = body_mass_index(height, weight)
    if 12.0 <= index <= 60.0 and 130.0 <= height <= 215.0:
        return
    swapped = body_mass_index(weight, height)
    message = f"with weight_kg = {weight:g} the body mass index is {index:.0f} kg/m^2"
    likely = height < weight and 12.0 <= swapped <= 60.0
    hint = f"height_cm = {weight:g} and weight_kg = {height:g} (likely swapped)" if likely else ""
    remarks.warning("patient.height_cm", message, f"{height:g}", hint)


def _note_size(case: CaseValues, remarks: Remarks) -> None:
    """Note the limits of oxygen delivery for the patient's body size, if gases are computed."""
    height, weight = (case.patient.get(name) for name in ("height_cm", "weight_kg"))
    if "gas" not in case.physiology or height is None or weight is None:
        return
    if limits := delivery_limits(height, weight):
        low, critical = limits
        message = f"oxygen delivery of a patient of this size is low below {low:g} and critical below"
        remarks.note("patient.weight_kg", f"{message} {critical:g} mL/min", shown(weight))


def _check_arterial_pressures(case: CaseValues, remarks: Remarks) -> None:
    measured = case.measurements
    systolic, diastolic, mean = (measured.get(name) for name in ("SP", "DP", "MAP"))
    if systolic is not None and diastolic is not None:
        if systolic < diastolic:
            message = f"systolic pressure {systolic:g} mmHg is below diastolic pressure {diastolic:g} mmHg"
            hint = f"SP = {diastolic:g} and DP = {systolic:g} (swapped)"
            remarks.error("measurements.SP", message, shown(systolic), "SP above DP", hint)
            return
        pumps = [device for device in devices().values() if device.carries_circulation]
        if systolic == diastolic and not any(case.of(device.key) for device in pumps):
            message = f"no pulse (SP = DP) without {' or '.join(device.name for device in pumps)}"
            remarks.warning("measurements.SP", message, shown(systolic))
    if mean is None:
        return
    below = diastolic is not None and mean < diastolic
    above = systolic is not None and mean > systolic
    if below or above:
        stated = [f"{name} {measured[name]:g}" for name in ("SP", "DP", "MAP") if name in measured]
        message = f"mean pressure is not between diastolic and systolic pressure: {', '.join(stated)} mmHg"
        remarks.error("measurements.MAP", message, shown(mean), "DP <= MAP <= SP")
    elif systolic is not None and diastolic is not None:
        expected = diastolic + (systolic - diastolic) / 3.0
        if abs(mean - expected) > max(8.0, 0.25 * (systolic - diastolic)):
            message = f"far from DP + (SP - DP) / 3 = {expected:.0f} mmHg"
            remarks.warning("measurements.MAP", message, shown(mean))


def _check_blood(case: CaseValues, stated: Mapping[str, float], remarks: Remarks) -> None:
    """Compare stressed volume and blood volume: more than all of it is an error, more than half a warning."""
    concerned = [key for key in stated if (key[2:] in _VESSELS and key[:2] == "P0") or key[1:] in _VESSELS]
    total = _blood_volume(case.patient)
    if not concerned or total is None:
        return
    values = {key: parameter.value for key, parameter in thiel2025.PARAMETERS.items()} | dict(stated)
    stressed = {place: values[f"P0{place}"] * values[f"C{place}"] for place in _VESSELS}
    chambers = sum(values[f"volume_fraction_{place}"] for place in _CHAMBERS) * total
    total_stressed = sum(stressed.values()) + chambers
    key = max(concerned, key=lambda name: stressed[name.removeprefix("P0") if name[1] == "0" else name[1:]])
    message = f"the stressed volume is {total_stressed:.0f} mL of a blood volume of {total:.0f} mL"
    if total_stressed > total:
        message += ": more than the patient has"
        remarks.error(f"parameters.{key}", message, shown(stated[key]), "less than the blood volume")
    elif total_stressed > _LARGEST_SHARE * total:
        message += f", {100.0 * total_stressed / total:.0f} %; about 25 to 30 % is usual"
        remarks.warning(f"parameters.{key}", message, shown(stated[key]))
    else:
        if not case.physiology.get(SECTION, {}).get("collapsible_veins", False):
            _check_empty_vein(concerned, stated, stressed["svn"], remarks)
        for place in _VESSELS:
            keys = [key for key in concerned if key in (f"P0{place}", f"C{place}")]
            if keys and stressed[place] > (capacity := values[f"volume_fraction_{place}"] * total):
                message = (
                    f"C{place} times P0{place} is a stressed volume of {stressed[place]:.0f} mL, more than "
                    f"the {capacity:.0f} mL that this vessel holds"
                )
                remarks.warning(f"parameters.{keys[0]}", message, shown(stated[keys[0]]))


def _check_empty_vein(
    concerned: list[str], stated: Mapping[str, float], stressed: float, remarks: Remarks
) -> None:
    keys = [key for key in concerned if key in ("P0svn", "Csvn")]
    if keys and stressed < _LEAST_VENOUS_ML:
        usual = thiel2025.PARAMETERS["P0svn"].value * thiel2025.PARAMETERS["Csvn"].value
        message = (
            f"Csvn times P0svn is a stressed volume of {stressed:.0f} mL in the systemic veins ({usual:.0f} "
            "as published): a patient short of blood. These veins do not collapse: drainage that would fail "
            "at the bedside goes on, and with the arterial pressure falling the pump flow may even rise "
            f"([{SECTION}] collapsible_veins = true lets them collapse)"
        )
        remarks.warning(f"parameters.{keys[0]}", message, shown(stated[keys[0]]))


def _blood_volume(patient: Raw) -> float | None:
    if "sex" not in patient or "age_years" not in patient:
        return None
    return blood_volume_ml(Patient.model_construct(**patient))
