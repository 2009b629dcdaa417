"""Checks of a case given as nested mappings: each field by itself, then the case as a whole.

The checks of the fields with each other, for contradictions (errors) and doubts (warnings), use whichever
fields are valid, so that one error does not hide another. Those that concern a single device or a single
section of the patient are in their own modules.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from eclsim.cases.doubts import check_doubtful_units
from eclsim.cases.events import check_events
from eclsim.cases.quantities import PARAMETERS, section_and_key
from eclsim.cases.resolve import blood_volume_ml
from eclsim.cases.sections import (
    PATIENT_SECTIONS,
    POLICY,
    POLICY_KEY,
    Measurements,
    Patient,
    device_sections,
    is_instance_name,
    places_of,
    sections,
)
from eclsim.devices.device import CaseValues, device_key, instance_key
from eclsim.devices.registry import device_of, devices, parameter_of, parameters
from eclsim.inputs.fields import setting
from eclsim.inputs.mistakes import Remarks, shown
from eclsim.inputs.numbers import suspected_unit
from eclsim.inputs.sections import Raw, check_field, check_section, looks_identifiable, short
from eclsim.parameters import physiology, thiel2025
from eclsim.parameters.parameter import Parameter
from eclsim.parameters.physiology import SECTION
from eclsim.parameters.regulation import DRUG_DOSES, DRUGS, REGULATION
from eclsim.patient.anthropometry import body_mass_index, delivery_limits, greatest_heart_rate
from eclsim.patient.sites import ONLY_REGIONAL, SAME_IN_REGIONS, patient_sites
from eclsim.spelling import did_you_mean
from eclsim.units import MMHG_PER_KPA

FORMAT = 1


@dataclass(slots=True)
class Checked(Remarks):
    """Result of checking a case.

    Attributes:
        values: Sections and their values, with canonical names and defaults filled in; missing values are
            left out.
    """

    values: dict[str, Any] = field(default_factory=dict)


def check_case(raw: object) -> Checked:
    """Check a whole case: each field, then the consistency of fields with each other.

    Args:
        raw: Mapping with the content of a case file.

    Returns:
        All errors at once, and the values that are valid. Nothing is raised.
    """
    checked = Checked()
    if not isinstance(raw, Mapping):
        checked.error("", "a case is a table of sections", shown(raw))
        return checked
    _check_format(raw, checked)
    top_level = ("format", POLICY_KEY, *sections(), "parameters", "events")
    for key in raw:
        if key not in top_level:
            hint = did_you_mean(str(key), top_level) or other_place(str(key))
            message = _WITHOUT_DATA.get(str(key), "unknown key or section")
            checked.error(short(key), message, shown(raw[key]), ", ".join(top_level), hint)
    if POLICY_KEY in raw:
        check_field(POLICY_KEY, raw[POLICY_KEY], POLICY, checked.values, checked)
    for section in (Patient, Measurements, *PATIENT_SECTIONS):
        if section.section in raw:
            key = section.section
            checked.values[key] = check_section(section, raw[key], key, checked, other_place)
    connected = _check_devices(raw, checked)
    if "patient" not in raw:
        needed = ", ".join(name for name, item in Patient.fields().items() if item.required)
        checked.error("patient", "this section is missing", allowed=f"[patient] with {needed}")
    parameters = check_parameters(raw.get("parameters", {}), connected, checked)
    found = checked.values
    extensions = {one.section: found[one.section] for one in PATIENT_SECTIONS if one.section in found}
    values = CaseValues(found.get("patient", {}), found.get("measurements", {}), connected, extensions)
    found["parameters"] = parameters
    check_plausibility(values, parameters, checked)
    if "events" in raw:
        without_events = {key: value for key, value in raw.items() if key != "events"}
        extra, blood_ml = found.get("fluid", {}).get("extra_volume_ml", 0.0), None
        if not checked.mistakes and (before := _blood_volume(found["patient"])) is not None:
            blood_ml = before + extra
        found["events"] = check_events(raw["events"], without_events, blood_ml, check_case, checked)
    return checked


_WITHOUT_DATA = {
    "impella": "not available: no pressure-flow curves of these pumps are openly published. What drains a "
    "left ventricle here: [lvad] (pump HMII, HM3, HVAD or Incor), [vent], [septostomy]; with your own "
    "curves, register a device of your own (eclsim.register_device, page Add a device of the documentation)"
}
"""Requested sections that the package cannot offer, with the reason."""


def other_place(key: str) -> str:
    """Return where a key found in the wrong section belongs; empty if nowhere."""
    return " or ".join(places_of(key))


def _check_devices(raw: Raw, checked: Checked) -> dict[str, Raw]:
    """Check the section of each connected device, and return its values by section key."""
    connected: dict[str, Raw] = {}
    for device, name, section in device_sections(raw):
        key = instance_key(device.key, name)
        if name and not is_instance_name(name):
            allowed = f"letters, digits, _ and -, such as [{device.key}.left]"
            checked.error(short(key), "not a valid name for one of several devices", allowed=allowed)
            continue
        values = check_section(device.section, section, key, checked, other_place, several=True)
        connected[key] = values
        if name:
            checked.values.setdefault(device.key, {})[name] = values
        else:
            checked.values[device.key] = values
    return connected


def _check_format(raw: Raw, checked: Checked) -> None:
    written = raw.get("format")
    if written is None:
        checked.error("format", "missing", allowed=f"format = {FORMAT} at the top of the file")
    elif isinstance(written, bool) or written != FORMAT:
        message = "a case file format that this version does not read"
        checked.error("format", message, shown(written), str(FORMAT))
    checked.values["format"] = FORMAT


# --- the section [parameters] -------------------------------------------------------------------

_FRACTION_TOLERANCE = 1e-6


def check_parameters(raw: object, connected: Mapping[str, Raw], remarks: Remarks) -> dict[str, float]:
    """Check the parameter overrides of a case; nothing is raised.

    Args:
        raw: The [parameters] section.
        connected: Sections of the connected devices, by key; parameters of other devices have no effect.
        remarks: Collects errors, warnings and notes.

    Returns:
        Values by canonical key, in the units of the parameter tables.
    """
    values: dict[str, float] = {}
    if not isinstance(raw, Mapping):
        allowed = "[parameters] and its keys on the lines below"
        remarks.error("parameters", "a section belongs here", shown(raw), allowed)
        return values
    for written, value in _flat(raw):
        key = thiel2025.ALIASES.get(written, written)
        parameter = parameter_of(key, connected)
        if (place := section_and_key(key)) is not None and place[0] != PARAMETERS:
            section, name = place
            message, allowed = f"is set in the section [{section}], not here", f"{name} in [{section}]"
            remarks.error(f"parameters.{written}", message, shown(value), allowed, f"{section}.{name}")
        elif parameter is None:
            _refuse_unknown(written, value, remarks)
        elif key in values:
            remarks.error(f"parameters.{written}", f"given twice, also as {key}", shown(value))
        else:
            _check_value(key, parameter, value, values, remarks)
    _warn_without_effect(values, connected, remarks)
    _check_fractions(values, remarks)
    _check_atria(values, remarks)
    return values


def _flat(raw: Raw) -> Iterator[tuple[str, object]]:
    """Yield keys and values; a dotted key such as `ecmo.left.Recmooxy` may be written without quotes."""
    for key, value in raw.items():
        if isinstance(value, Mapping) and device_key(str(key)) in devices():
            yield from ((f"{key}.{inner}", result) for inner, result in _flat(value))
        else:
            yield str(key), value


def _check_value(
    key: str, parameter: Parameter, value: object, values: dict[str, float], remarks: Remarks
) -> None:
    place, typical = f"parameters.{key}", parameter.value or 1.0
    check_field(place, value, replace(setting(parameter), name=key), values, remarks)
    if key in values and parameter.value and not typical / 12.0 <= values[key] <= typical * 12.0:
        hint = suspected_unit(values[key], parameter.unit, typical, (typical / 3.0, typical * 3.0))
        remarks.warning(place, f"far from the usual {typical:g} {parameter.unit}", shown(value), hint)


def _refuse_unknown(written: str, value: object, remarks: Remarks) -> None:
    short = written if len(written) <= 64 else written[:60] + "..."
    hint = did_you_mean(written, (*parameters(), *thiel2025.ALIASES))
    places = [place for place in places_of(written) if place.endswith(f".{written}")]
    allowed = "names of the parameter tables (eclsim parameters lists them)"
    key = f"parameters.{short}"
    remarks.error(key, "unknown parameter", shown(value), allowed, places[0] if places else hint)


def _warn_without_effect(values: Mapping[str, float], connected: Mapping[str, Raw], remarks: Remarks) -> None:
    present = {device_key(key) for key in connected}
    for name, device in devices().items():
        read_by_device = {parameter.key for parameter in device.parameters}
        for key, value in values.items():
            if key in read_by_device and name not in present:
                message = f"without effect: the case has no [{name}] section"
                remarks.warning(f"parameters.{key}", message, shown(value))


def _check_atria(values: Mapping[str, float], remarks: Remarks) -> None:
    """Warn of an atrium that is stiffer at rest than in contraction, if the case states one of the two."""
    for resting, message in thiel2025.stiff_atria(values).items():
        stated = next((key for key in (resting, f"Emax{resting[2:]}") if key in values), None)
        if stated is not None:
            remarks.warning(f"parameters.{stated}", message, shown(values[stated]))


def _check_fractions(values: Mapping[str, float], remarks: Remarks) -> None:
    stated = [key for key in thiel2025.VOLUME_FRACTIONS if key in values]
    if not stated:
        return
    for key in stated:
        place = key.removeprefix("volume_fraction_")
        if f"P0{place}" in thiel2025.PARAMETERS or place == "capillaries":
            message = "without effect on pressures and flows: it only shifts the volume shown for a vessel"
            if place != "capillaries":
                message += f"; its stressed volume is C{place} times P0{place}"
            remarks.warning(f"parameters.{key}", message, shown(values[key]))
    total = sum(values.get(key, thiel2025.PARAMETERS[key].value) for key in thiel2025.VOLUME_FRACTIONS)
    if abs(total - 1.0) > _FRACTION_TOLERANCE:
        message = f"the shares of the blood volume add to {total:.6g}, not to 1"
        allowed = "shares that add to 1: " + ", ".join(thiel2025.VOLUME_FRACTIONS)
        remarks.error(f"parameters.{stated[0]}", message, shown(values[stated[0]]), allowed)


# --- consistency of the fields with each other ----------------------------------------------------


_VESSELS = ("ao", "sart", "svn", "pas", "part", "pvn")
_CHAMBERS = ("ra", "rv", "la", "lv")
_LARGEST_SHARE = 0.5
_LEAST_VENOUS_ML = 20.0
_SMALLEST_RATE_CHANGE = 0.5
"""Change of the heart rate by drugs [bpm] that a monitor shows."""
RATE_PLACE = "patient.heart_rate_bpm"
_LARGEST_SATURATION_DIFFERENCE = 15.0
"""Difference [%] of a saturation from that of its PO2 which pH and temperature hardly explain."""


def contradicted_wedge(measured: Mapping[str, Any]) -> str:
    """What contradicts a measured wedge pressure; empty if nothing does."""
    wedge, mean = measured.get("PCWP"), measured.get("MPAP")
    if wedge is None or mean is None or wedge <= mean + 5.0:
        return ""
    return f"above the mean pulmonary artery pressure {mean:g} mmHg by more than 5: physiologically doubtful"


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
    if message := contradicted_wedge(case.measurements):
        remarks.warning("measurements.PCWP", message, shown(case.measurements["PCWP"]))
    for device in devices().values():
        for name in (entry.name for entry in device.outputs if entry.in_contract):
            if name in case.measurements and not case.of(device.key):
                message = f"a pump flow was measured, but the case has no [{device.key}] section"
                remarks.warning(f"measurements.{name}", message, shown(case.measurements[name]))
    _check_rate_before_drugs(case, remarks)
    _check_blood(case, parameters, remarks)
    _check_blood_gases(case, remarks)
    check_doubtful_units(case, remarks)
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
        "2001): an arrhythmia or a pacemaker?"
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
