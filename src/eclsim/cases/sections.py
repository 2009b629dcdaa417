"""Sections of a case file: the patient, the measurements, and those of the devices."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from eclsim.cases.fluid import DialysedDrug, Fluid, Solutes
from eclsim.cases.regulation import Drugs, Regulation
from eclsim.devices.device import AnyDevice, device_key
from eclsim.devices.registry import device_of, devices
from eclsim.inputs.fields import Field, measured, number, one_of, setting
from eclsim.inputs.mistakes import Remarks, shown
from eclsim.inputs.sections import Raw, Section, switch
from eclsim.parameters import physiology
from eclsim.parameters.gas import NORMAL_C, PARAMETERS, PREFIX, TEMPERATURE_DOUBT_C, VO2_PER_DEGREE
from eclsim.patient.anthropometry import MAXIMUM_AGE_YEARS, MINIMUM_AGE_YEARS

GRAMS_PER_MMOL = 1.6114
"""Conversion factor for haemoglobin from mmol/L of the monomer to g/dL."""
RISE = VO2_PER_DEGREE.removeprefix(PREFIX)
"""Key of the rise of the oxygen consumption with the temperature."""
SMALLEST_RISE = 1.0
"""Rise [%/C] below which the number may be a fraction instead."""
LOW_HAEMOGLOBIN = 7.0
"""Haemoglobin [g/dL] below which the number may be in mmol/L instead."""


class Gas(Section):
    """Gas exchange of the patient; omitted values have the defaults of the parameter table.

    Haemoglobin is in g/dL, base excess in mmol/L, temperature in C, oxygen consumption in mL/min (STPD;
    derived from the body surface area if omitted) and its rise in % per degree, ventilation in L/min (BTPS)
    and lung volume in mL; the others are dimensionless.
    """

    section = "gas"
    parameters = PARAMETERS
    haemoglobin_g_dl: float = 10.0
    base_excess_mmol_l: float = 0.0
    temperature_c: float = 37.0
    vo2_ml_min: float | None = None
    vo2_percent_per_c: float = 0.0
    respiratory_quotient: float = 0.8
    fio2: float = 0.5
    alveolar_ventilation_l_min: float = 2.0
    shunt_fraction: float = 0.4
    lung_volume_ml: float = 2000.0

    @classmethod
    def complete(cls, raw: Raw, values: dict[str, Any], key: str, remarks: Remarks) -> None:
        """Warn of a haemoglobin that may be in mmol/L."""
        if "vo2_ml_min" not in raw:
            remarks.note(f"{key}.vo2_ml_min", "left out, so 126 mL/min per m2 of body surface (Dehmer 1982)")
        haemoglobin = values.get("haemoglobin_g_dl")
        if haemoglobin is not None and haemoglobin < LOW_HAEMOGLOBIN:
            conversion = f"{haemoglobin:g} mmol/L = {haemoglobin * GRAMS_PER_MMOL:.1f} g/dL"
            message = f"below {LOW_HAEMOGLOBIN:g} g/dL, the usual threshold of transfusion; used as g/dL"
            remarks.warning(f"{key}.haemoglobin_g_dl", message, shown(haemoglobin), conversion)

    @classmethod
    def check(cls, sections: Mapping[str, Raw], remarks: Remarks) -> None:
        """Note defaults in use; warn of consumption that ignores temperature and of gases not computed."""
        stated = sections.get(cls.section, {})
        _consumption_at_temperature(stated, remarks)
        given_by_solutes = (
            "base_excess_mmol_l" if "bicarbonate_mmol_l" in sections.get(Solutes.section, {}) else ""
        )
        silent = {"vo2_ml_min", RISE, "lung_volume_ml", given_by_solutes}
        known = silent | set(sections.get(cls.section, cls.fields()))
        refused = {key.removeprefix(PREFIX) for key in remarks.refused()}
        if left_out := [name for name in cls.fields() if name not in known | refused]:
            used = (f"{name} = {PARAMETERS[PREFIX + name].value:g}" for name in left_out)
            remarks.note(cls.section, f"left out, so assumed: {', '.join(used)}")
        measurements = sections.get(Measurements.section, {})
        gases = [name for name in MEASURED_GASES if name in measurements]
        if gases and cls.section not in sections:
            message = "blood gases were measured, but the case has no [gas] section: they are not fitted"
            remarks.warning(f"measurements.{gases[0]}", message, shown(measurements[gases[0]]))
        elif (name := next((n for n in _PRESSURES_OF_GASES if n in measurements), None)) is not None:
            _measured_at_temperature(name, measurements[name], stated, remarks)


def _measured_at_temperature(name: str, pressure: float, stated: Raw, remarks: Remarks) -> None:
    """Warn of a gas pressure of cold or hot blood that may not have been corrected to the temperature."""
    temperature = stated.get("temperature_c", NORMAL_C)
    if abs(temperature - NORMAL_C) > TEMPERATURE_DOUBT_C:
        message = (
            f"is compared with blood of {temperature:g} C: an analyser at {NORMAL_C:g} C shows another "
            "pressure unless it corrects to the patient's temperature"
        )
        remarks.warning(f"{Measurements.section}.{name}", message, shown(pressure))


def _consumption_at_temperature(stated: Raw, remarks: Remarks) -> None:
    """Warn of consumption that ignores a fever or cooling; tell it where it follows and was given."""
    temperature, rise = (stated.get(key, usual) for key, usual in (("temperature_c", NORMAL_C), (RISE, 0.0)))
    given = stated.get("vo2_ml_min")
    if 0.0 < rise < SMALLEST_RISE:
        message = f"below {SMALLEST_RISE:g} % for each degree; patients have 6 to 10; used as %"
        remarks.warning(f"{Gas.section}.{RISE}", message, shown(rise), f"{rise:g} = {100.0 * rise:g} %")
    if given is not None and rise and temperature != NORMAL_C:
        consumed = given * (1.0 + 0.01 * rise) ** (temperature - NORMAL_C)
        message = f"is that at 37 C; at {temperature:g} C the tissues want {consumed:.0f} mL/min"
        remarks.note(f"{Gas.section}.vo2_ml_min", message)
    elif given is None and not rise and abs(temperature - NORMAL_C) > TEMPERATURE_DOUBT_C:
        message = (
            "consumption is that of 37 C and does not follow the temperature (it falls by 6 to 10 % for "
            f"each degree of cooling): give vo2_ml_min, or {RISE}; heart rate, contractility, vessels and "
            "drugs do not follow it in any case"
        )
        remarks.warning(f"{Gas.section}.temperature_c", message, shown(temperature))


POLICY_KEY = "blood_volume_policy"
AS_PUBLISHED, PATIENT_HELD = POLICIES = ("as_published", "patient_held")
"""Source of the blood in extracorporeal circuits: the patient (as in the published code) or a priming volume,
so that the patient keeps the stressed volume of the start."""
POLICY = Field(
    "Filling of the circuits: with the patient's blood (as_published) or primed (patient_held)", "name",
    required=False, names=POLICIES, name=POLICY_KEY,
)  # fmt: skip
"""The blood volume policy, written above the sections; "as_published" if omitted."""
_INSTANCE = re.compile(r"[A-Za-z0-9_-]{1,30}")


class Patient(Section):
    """The patient: age in years, height in cm, weight in kg, heart rate in beats per minute."""

    section = "patient"
    id: Annotated[str, Field("Pseudonym of the patient", "text")]
    sex: Annotated[Literal["female", "male"], one_of("Sex", ("female", "male"))]
    age_years: Annotated[float, number("Age", "years", MINIMUM_AGE_YEARS, MAXIMUM_AGE_YEARS, 60)]
    height_cm: Annotated[float | None, measured("Height", "cm", 50, 250, 170)] = None
    weight_kg: Annotated[float | None, measured("Weight", "kg", 25, 350, 75)] = None
    heart_rate_bpm: Annotated[float, number("Heart rate", "bpm", 20, 250, 80)]


def _saturation(where: str, typical: float) -> Field:
    return measured(f"Oxygen saturation {where}", "%", 5, 100, typical)


class Measurements(Section):
    """Measurements: pressures in mmHg, flows in L/min, saturations in %; None if not measured.

    CO is the native output, which flows through the lungs; PF is the flow of the ECMO pump. Circuit pressures
    are at the height of the heart. Measurements of gases are fitted if the case has the section [gas].
    """

    section = "measurements"
    SP: Annotated[float | None, measured("Systolic arterial pressure", "mmHg", 20, 300, 110)] = None
    DP: Annotated[float | None, measured("Diastolic arterial pressure", "mmHg", 10, 200, 70)] = None
    MAP: Annotated[float | None, measured("Mean arterial pressure", "mmHg", 15, 250, 80)] = None
    MPAP: Annotated[float | None, measured("Mean pulmonary artery pressure", "mmHg", 1, 120, 20)] = None
    PCWP: Annotated[float | None, measured("Pulmonary capillary wedge pressure", "mmHg", 0, 60, 11)] = None
    CO: Annotated[float | None, measured("Cardiac output: native, through the lungs", "L/min", 0, 20, 4)] = (
        None
    )
    PF: Annotated[float | None, measured("Flow of the extracorporeal pump", "L/min", 0, 10, 3)] = None
    CVP: Annotated[float | None, measured("Central venous pressure, mean", "mmHg", -10, 60, 10)] = None
    drainage_pressure: Annotated[
        float | None, measured("Mean pressure behind the drainage cannula (pVen)", "mmHg", -300, 100, -60)
    ] = None
    pump_inlet_pressure: Annotated[
        float | None, measured("Mean pressure before the pump (pVen or P1)", "mmHg", -300, 100, -60)
    ] = None
    pre_oxygenator_pressure: Annotated[
        float | None, measured("Mean pressure before the oxygenator (pInt or P2)", "mmHg", -50, 600, 220)
    ] = None
    post_oxygenator_pressure: Annotated[
        float | None, measured("Mean pressure behind the oxygenator (pArt or P3)", "mmHg", -50, 600, 190)
    ] = None
    crrt_access_pressure: Annotated[
        float | None, measured("Mean pressure in the access line of the CRRT", "mmHg", -400, 500, -100)
    ] = None
    crrt_return_pressure: Annotated[
        float | None, measured("Mean pressure in the return line of the CRRT", "mmHg", -150, 600, 150)
    ] = None
    crrt_filter_pressure_drop: Annotated[
        float | None, measured("Pressure drop across the filter of the CRRT", "mmHg", 0, 500, 60)
    ] = None
    SaO2: Annotated[float | None, _saturation("of the right radial artery", 95)] = None
    PaO2: Annotated[float | None, measured("PO2 of the right radial artery", "mmHg", 15, 700, 90)] = None
    PaCO2: Annotated[float | None, measured("PCO2 of the right radial artery", "mmHg", 8, 200, 40)] = None
    SvO2: Annotated[float | None, _saturation("in the pulmonary artery", 70)] = None
    SpreO2: Annotated[float | None, _saturation("before the oxygenator", 70)] = None
    SpostO2: Annotated[float | None, _saturation("behind the oxygenator", 100)] = None
    PpostO2: Annotated[float | None, measured("PO2 behind the oxygenator", "mmHg", 15, 760, 300)] = None
    PexhaustCO2: Annotated[
        float | None, measured("PCO2 of the gas that leaves the oxygenator", "mmHg", 1, 150, 30)
    ] = None


def _share(name: str) -> Field:
    parameter = physiology.PARAMETERS[f"{physiology.SECTION}.{name}"]
    return setting(parameter, f"{parameter.minimum:g} to {parameter.maximum:g}, a fraction, not a percentage")


class Physiology(Section):
    """Extensions of the published circulation; areas are effective orifice areas in cm^2."""

    section = physiology.SECTION
    parameters = physiology.PARAMETERS
    regional: Annotated[bool, switch("Regions: upper and lower body, aortic arch, two venae cavae")] = False
    upper_share: Annotated[float, _share("upper_share")] = 0.35
    bronchial_fraction: Annotated[float, _share("bronchial_fraction")] = 0.0
    collapsible_veins: Annotated[bool, switch("Vena cava that collapses where it is drained")] = False
    pericardium: Annotated[bool, switch("Pericardium that the four chambers share")] = False
    aortic_regurgitation_cm2: float = 0.0
    mitral_regurgitation_cm2: float = 0.0
    tricuspid_regurgitation_cm2: float = 0.0
    pulmonary_regurgitation_cm2: float = 0.0
    aortic_stenosis_cm2: float | None = None
    mitral_stenosis_cm2: float | None = None
    tricuspid_stenosis_cm2: float | None = None
    pulmonary_stenosis_cm2: float | None = None

    def values(self) -> dict[str, float]:
        """Return the values of the circuit parameters."""
        stated = self.model_dump(exclude_none=True)
        return {f"{self.section}.{k}": value for k, value in stated.items() if not isinstance(value, bool)}


PATIENT_SECTIONS: tuple[type[Section], ...] = (
    Physiology, Gas, Regulation, Drugs, Fluid, Solutes, DialysedDrug,
)  # fmt: skip
"""Optional sections that extend the published model of the patient."""
MEASURED = tuple(Measurements.fields())
"""Names of all measurements."""
MEASURED_GASES = MEASURED[MEASURED.index("SaO2") :]
_PRESSURES_OF_GASES = ("PaCO2", "PaO2", "PpostO2")
"""Names of the measurements of gas exchange."""
FURTHER_MEASUREMENTS = MEASURED[MEASURED.index("CVP") : MEASURED.index("SaO2")]
"""Pressures that the paper does not fit; they may be zero or negative."""


def sections() -> dict[str, type[Section]]:
    """Return all sections by name, in the order in which they are written."""
    result: dict[str, type[Section]] = {
        section.section: section for section in (Patient, Measurements, *PATIENT_SECTIONS)
    }
    return result | {key: device.section for key, device in devices().items()}


def section_of(key: str) -> type[Section] | None:
    """Return the class of a section such as "patient" or "lvad.left"; None if there is no such section."""
    device = device_of(key)
    return sections().get(key) if device is None else device.section


def places_of(name: str) -> list[str]:
    """Return the keys of a case file that end in a name, such as "ecmo.speed_rpm" for "speed_rpm"."""
    return [
        f"{key}.{item}"
        for key, section in sections().items()
        for item in section.fields()
        if item.lower() == name.lower()
    ]


def by_instance(device: AnyDevice, raw: object) -> Mapping[str, object]:
    """Return the section of each instance of a device, by name; a single instance has an empty name."""
    if isinstance(raw, Mapping) and not any(key in device.section.fields() for key in raw):
        by_name = {str(key): value for key, value in raw.items() if isinstance(value, Mapping)}
        if by_name and len(by_name) == len(raw):
            return by_name
    return {"": raw}


def device_sections(raw: Mapping[str, object]) -> Iterator[tuple[AnyDevice, str, object]]:
    """Yield device, instance name and section for each device of a case."""
    for key, device in devices().items():
        if key in raw:
            for name, section in by_instance(device, raw[key]).items():
                yield device, name, section


def is_instance_name(name: str) -> bool:
    """Whether a name is allowed in `[device.NAME]`."""
    return _INSTANCE.fullmatch(name) is not None


def within(raw: dict[str, Any], key: str) -> dict[str, Any] | None:
    """Return the section with a key in a case's mapping, created if missing; None if it is not a table."""
    for name in filter(None, (device_key(key), key.partition(".")[2])):
        inner = raw.setdefault(name, {})
        if not isinstance(inner, dict):
            return None
        raw = inner
    return raw
