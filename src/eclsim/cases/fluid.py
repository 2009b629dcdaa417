"""Sections [fluid], [solutes] and [dialysed_drug]: blood, interstitium, and what is dissolved in them."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any

from eclsim.devices.dialysed_blood import HAEMATOCRIT_IN, HAEMOGLOBIN, USUAL_HAEMOGLOBIN, check_red_cells
from eclsim.inputs.fields import Field, setting
from eclsim.inputs.mistakes import Remarks, shown
from eclsim.inputs.sections import Raw, Section, read_share, switch
from eclsim.parameters import dialysed_drug as keys
from eclsim.parameters import fluid, regulation
from eclsim.parameters.gas import PARAMETERS as GAS
from eclsim.patient.anthropometry import body_water_ml
from eclsim.units import RED_CELL_HAEMOGLOBIN

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eclsim.cases.case import Case


INTERSTITIAL_PROTEIN = 0.4
"""Ratio of interstitial to plasma protein concentration; textbook value, not verified."""
BICARBONATE_SPACE, CARBON_DIOXIDE_STORE = 500.0, 1.5
"""Bicarbonate space [mL/kg] and carbon dioxide store [mL/mmHg/kg]; sources are given with the parameters."""

USUAL_BICARBONATE = 24.0
"""Bicarbonate [mmol/L] if a case does not give it."""
SAME_BASE = 1.0
"""Largest difference [mmol/L] of base excesses that count as equal, as analysers' formulas differ."""


def _share(key: str) -> Field:
    return setting((fluid.PARAMETERS | keys.PARAMETERS)[key], read=read_share)


class Fluid(Section):
    """Blood given or (if negative) lost before the steady beat, and fluid exchange during a course."""

    section = fluid.SECTION
    parameters = fluid.PARAMETERS | regulation.PARAMETERS
    extra_volume_ml: float = 0.0
    capillary_refill: Annotated[bool, switch("Fluid crosses the capillary wall, in courses")] = True
    haematocrit: Annotated[float | None, _share("fluid.haematocrit")] = None
    reference_haematocrit: Annotated[float | None, _share("fluid.reference_haematocrit")] = None
    plasma_protein_g_dl: float = 6.0
    interstitial_protein_g_dl: float | None = None
    interstitial_volume_ml: float | None = None
    filtration_ml_min_mmHg: float = 10.0  # noqa: N815
    reflection: float = 0.9
    lymph_ml_min: float = 5.6
    lymph_pump: float = 1.0
    pericapillary_share: float = 1.0
    venular_tone: float = 0.0

    @classmethod
    def check(cls, sections: Mapping[str, Raw], remarks: Remarks) -> None:
        """Check that the haematocrit agrees with the haemoglobin."""
        haematocrit, gas = sections.get(cls.section, {}).get("haematocrit"), sections.get("gas")
        if haematocrit and gas is not None:
            grams = gas.get("haemoglobin_g_dl", USUAL_HAEMOGLOBIN)
            check_red_cells(f"{cls.section}.haematocrit", haematocrit, grams, remarks)

    @classmethod
    def complete(cls, raw: Raw, values: dict[str, Any], key: str, remarks: Remarks) -> None:
        """Check that the proteins and the reflection coefficient keep protein in the plasma."""
        inside, outside = values.get("plasma_protein_g_dl", 6.0), values.get("interstitial_protein_g_dl")
        if isinstance(outside, float) and isinstance(inside, float) and outside >= inside:
            message = (
                f"not below that of the plasma, {inside:g} g/dL: nothing would hold water in the vessels"
            )
            remarks.error(
                f"{key}.interstitial_protein_g_dl", message, shown(outside), f"below {inside:g} g/dL"
            )
            return
        reflection = values.get("reflection", fluid.PARAMETERS[f"{fluid.SECTION}.reflection"].value)
        outside = INTERSTITIAL_PROTEIN * inside if outside is None else outside
        if isinstance(outside, float) and isinstance(inside, float):
            least = (inside - outside) / (inside + outside)
            if isinstance(reflection, float) and reflection < least:
                message = "water that leaves would carry more protein out than lymph brings back at the start"
                allowed = f"at least {least:.2f} with proteins of {inside:g} and {outside:g} g/dL"
                remarks.error(f"{key}.reflection", message, shown(reflection), allowed)


FLUID_POTASSIUM = "fluid_potassium_mmol_l"
HYPERKALAEMIA = 6.0
"""Potassium above which a filter is meant to lower it [mmol/L] (moderate: UK Kidney Association 2023)."""


class Solutes(Section):
    """Solutes cleared by dialysis: start values and generation by the body; followed in courses."""

    section = fluid.SOLUTES
    parameters = fluid.PARAMETERS
    urea_mmol_l: float = 25.0
    creatinine_umol_l: float = 300.0
    potassium_mmol_l: float = 4.5
    bicarbonate_mmol_l: float | None = None
    urea_generation_mmol_h: float = 15.0
    creatinine_generation_umol_h: float = 400.0
    potassium_generation_mmol_h: float = 0.0
    potassium_store_l: float = 150.0
    acid_generation_mmol_h: float = 0.0
    fluid_potassium_mmol_l: float = 4.0
    kidney_clearance_ml_min: float = 0.0
    body_water_ml: float | None = None
    bicarbonate_space_ml: float | None = None
    carbon_dioxide_store_ml_mmHg: float | None = None  # noqa: N815

    @classmethod
    def check(cls, sections: Mapping[str, Raw], remarks: Remarks) -> None:
        """Note defaults in use; warn of a bicarbonate and a base excess that disagree about the same base."""
        stated = sections.get(cls.section)
        if stated is not None:
            _note_defaults(stated, remarks)
        bicarbonate, gas = (stated or {}).get("bicarbonate_mmol_l"), sections.get("gas")
        if bicarbonate is None or gas is None:
            return
        from eclsim.fluid.solutes import standard_base_excess, standard_bicarbonate

        key = f"{cls.section}.bicarbonate_mmol_l"
        grams = gas.get("haemoglobin_g_dl", GAS["gas.haemoglobin_g_dl"].value)
        stated, meant = gas.get("base_excess_mmol_l", 0.0), float(standard_base_excess(bicarbonate, grams))
        if stated == 0.0:
            message = f"gas.base_excess_mmol_l is set to {meant:.1f}, its equivalent at a PCO2 of 40 mmHg"
            remarks.note(key, message, shown(bicarbonate))
        elif abs(stated - meant) > SAME_BASE:
            other = standard_bicarbonate(stated, grams)
            message = (
                f"gas.base_excess_mmol_l = {stated:g} corresponds to another bicarbonate, {other:.1f} "
                "mmol/L at a PCO2 of 40 mmHg: blood gases and filter use the base excess, and a course "
                "adds to it only the change of the bicarbonate; leave one out, or write base_excess_mmol_l "
                f"= {meant:.1f}"
            )
            remarks.warning(key, message, shown(bicarbonate))


def _note_defaults(stated: Raw, remarks: Remarks) -> None:
    """Note what is assumed of the body and of the fluids of a filter; a warning at a high potassium."""
    fields, section = Solutes.model_fields, Solutes.section
    potassium, of_fluid = stated.get("potassium_mmol_l"), fields[FLUID_POTASSIUM].default
    assumed = [
        f"{name} = {field.default:g}" for name, field in fields.items()
        if name not in stated and field.default is not None and not (name == FLUID_POTASSIUM and potassium)
    ]  # fmt: skip
    if assumed:
        remarks.note(section, f"left out, so assumed: {', '.join(assumed)}")
    if potassium and FLUID_POTASSIUM not in stated:
        message = f"left out, so {of_fluid:g} mmol/L are assumed in the fluids of a filter"
        if potassium > HYPERKALAEMIA:
            message += f", which lower {potassium:g} mmol/L slowly; write what the bags hold (often 0 to 2)"
            remarks.warning(f"{section}.{FLUID_POTASSIUM}", message)
        else:
            remarks.note(f"{section}.{FLUID_POTASSIUM}", message)


def fluid_values(
    case: Case, values: Mapping[str, float], height_cm: float, weight_kg: float
) -> dict[str, float]:
    """Return the parameters of both sections that the case has; omitted values are derived from the patient.

    Args:
        case: the case.
        values: the other parameters of the case, by key.
        height_cm: height [cm].
        weight_kg: weight [kg].
    """
    result: dict[str, float] = {}
    if (section := case.fluid) is not None:
        grams = None if case.gas is None else case.gas.haemoglobin_g_dl
        usual = values.get(HAEMATOCRIT_IN) or fluid.USUAL_HAEMATOCRIT
        haematocrit = section.haematocrit or (usual if grams is None else grams / RED_CELL_HAEMOGLOBIN)
        inferred = {
            "haematocrit": haematocrit, "reference_haematocrit": haematocrit,
            "interstitial_protein_g_dl": INTERSTITIAL_PROTEIN * section.plasma_protein_g_dl,
            "interstitial_volume_ml": fluid.INTERSTITIUM_TO_BLOOD * values["total_blood_volume_ml"],
        }  # fmt: skip
        content = inferred | section.model_dump(exclude_none=True)
        result |= {f"{fluid.SECTION}.{name}": float(value) for name, value in content.items()}
    if (solutes := case.solutes) is not None:
        patient = case.patient
        water = body_water_ml(patient.sex, patient.age_years, height_cm, weight_kg)
        inferred = {
            "followed": 1.0,
            "bicarbonate_mmol_l": USUAL_BICARBONATE,
            "body_water_ml": water,
            "bicarbonate_space_ml": min(BICARBONATE_SPACE * weight_kg, water),
            "carbon_dioxide_store_ml_mmHg": CARBON_DIOXIDE_STORE * weight_kg,
        }
        if case.gas is not None:
            from eclsim.fluid.solutes import standard_bicarbonate

            excess, grams = case.gas.base_excess_mmol_l, case.gas.haemoglobin_g_dl
            inferred["bicarbonate_mmol_l"] = standard_bicarbonate(excess, grams)
        content = inferred | solutes.model_dump(exclude_none=True)
        result |= {f"{fluid.SOLUTES}.{name}": float(value) for name, value in content.items()}
        result |= _same_start(case, content["bicarbonate_mmol_l"])
    return result


def _same_start(case: Case, bicarbonate: float) -> dict[str, float]:
    """Return other start values that follow from a given bicarbonate, unless the case states them itself."""
    assert case.solutes is not None
    if case.solutes.bicarbonate_mmol_l is None:
        return {}
    from eclsim.blood.acid_base import carbon_dioxide_solubility
    from eclsim.fluid.solutes import STANDARD_PCO2, standard_base_excess

    key = "plasma_bicarbonate_mmol_l"
    total = float(bicarbonate + carbon_dioxide_solubility() * STANDARD_PCO2)
    if case.gas is None:
        unset = (one for one in case.instances() if getattr(one.section, key, 0.0) is None)
        return {f"{one.key}.{key}": total for one in unset}
    if case.gas.base_excess_mmol_l != 0.0:
        return {}
    excess = standard_base_excess(bicarbonate, case.gas.haemoglobin_g_dl)
    return {"gas.base_excess_mmol_l": float(excess)}


def remarks_on_viscosity(varied: Collection[str]) -> list[str]:
    """A remark if the haemoglobin varies without the haematocrit.

    Args:
        varied: names of the varied numbers.
    """
    if HAEMOGLOBIN not in varied or fluid.HAEMATOCRIT in varied:
        return []
    return [
        f"{HAEMOGLOBIN} varies what blood carries, not its viscosity: pressures and flows stay; vary "
        f"{fluid.HAEMATOCRIT} with it, in about the same ratio, and give {fluid.REFERENCE}"
    ]


def base_excess_of_bicarbonate(case: Case) -> dict[str, float]:
    """Return the base excess that follows from the case's bicarbonate and haemoglobin; empty if none does."""
    if case.solutes is None or case.gas is None or case.solutes.bicarbonate_mmol_l is None:
        return {}
    return _same_start(case, case.solutes.bicarbonate_mmol_l)


def haemoglobin(case: Case) -> float | None:
    """Return the haemoglobin [g/dL] of [gas], or that of the haematocrit of [fluid]; None without both."""
    if case.gas is not None:
        return case.gas.haemoglobin_g_dl
    if case.fluid is None:
        return None
    return RED_CELL_HAEMOGLOBIN * (case.fluid.haematocrit or fluid.USUAL_HAEMATOCRIT)


# --- section [dialysed_drug] ----------------------------------------------------------------------


MOST_SIEVED = 1.25
"""Ratio of sieving coefficient to unbound share above which one of them is probably wrong."""
ASSUMED = ("central_volume_l", "body_clearance_ml_min", "koa_ml_min")
"""Constants of drug and patient that differ so much that a value which is left out is named."""


def _given(name: str, typical: float) -> Field:
    """Field of what is given, with the usual amount of an antibiotic, from which a wrong unit is guessed."""
    return replace(setting(keys.PARAMETERS[f"{keys.SECTION}.{name}"]), typical=typical)


class DialysedDrug(Section):
    """A drug that dialysis removes: doses and kinetics; followed in courses."""

    section = keys.SECTION
    parameters = keys.PARAMETERS
    second = ", and for a further drug a case file of its own (eclsim course one.toml other.toml)"
    name: Annotated[str | None, Field("Name of the drug", "text", required=False)] = None
    dose_mg: Annotated[float, _given("dose_mg", 1000.0)] = 0.0
    every_h: float = 8.0
    over_min: float = 30.0
    infusion_mg_h: Annotated[float, _given("infusion_mg_h", 125.0)] = 0.0
    start_mg_l: Annotated[float, _given("start_mg_l", 20.0)] = 0.0
    central_volume_l: float = 15.0
    peripheral_volume_l: float = 0.0
    transfer_ml_min: float = 100.0
    body_clearance_ml_min: float = 50.0
    unbound_fraction: Annotated[float, _share("dialysed_drug.unbound_fraction")] = 1.0
    sieving: Annotated[float | None, _share("dialysed_drug.sieving")] = None
    koa_ml_min: float = 200.0
    target_mg_l: float = 0.0

    @classmethod
    def complete(cls, raw: Raw, values: dict[str, Any], key: str, remarks: Remarks) -> None:
        """Check doses against their interval and sieving against binding; name assumed constants."""
        over, every = values.get("over_min", 30.0), values.get("every_h", 8.0)
        if values.get("dose_mg") and over >= 60.0 * every:
            message = f"not below the {every:g} h from one dose to the next: doses run side by side"
            remarks.warning(f"{key}.over_min", message, shown(over), "infusion_mg_h")
        idle = [name for name in ("every_h", "over_min") if name in values and not values.get("dose_mg")]
        for name in idle:
            remarks.warning(f"{key}.{name}", "has no effect without dose_mg", shown(values[name]))
        sieving, unbound = values.get("sieving"), values.get("unbound_fraction", 1.0)
        if sieving is not None and sieving > MOST_SIEVED * unbound:
            message = f"more passes the membrane than is unbound ({unbound:g}): one of them is wrong"
            remarks.warning(f"{key}.sieving", message, shown(sieving))
        left_out = [name for name in ASSUMED if name not in raw]
        if left_out:
            usual = (f"{name} = {keys.PARAMETERS[f'{key}.{name}'].value:g}" for name in left_out)
            message = f"left out, so assumed: {', '.join(usual)}; give those of the drug and the patient"
            remarks.note(key, message)

    @property
    def label(self) -> str:
        """Name of the drug, or "drug"."""
        return self.name or "drug"

    def values(self) -> dict[str, float]:
        """Return the values of the parameters; sieving that is left out is the unbound share."""
        stated = {"sieving": self.unbound_fraction} | self.model_dump(exclude_none=True, exclude={"name"})
        return {keys.FOLLOWED: 1.0} | {f"{self.section}.{key}": float(v) for key, v in stated.items()}
