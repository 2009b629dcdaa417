"""Numbers that are allowed, but were probably meant in another unit or with another sign: warnings.

A number outside the allowed range is refused with the unit that was probably meant. These are inside it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from eclsim.devices.device import CaseValues
from eclsim.devices.dialysed_blood import FLUIDS, NET_ULTRAFILTRATION
from eclsim.inputs.mistakes import Mistake, Remarks, shown
from eclsim.inputs.numbers import suspected_unit
from eclsim.inputs.sections import Raw
from eclsim.parameters.fluid import SOLUTES
from eclsim.parameters.gas import NORMAL_C
from eclsim.parameters.gas import PARAMETERS as GAS
from eclsim.parameters.regulation import DRUG_DOSES, DRUGS
from eclsim.patient.anthropometry import body_surface, oxygen_consumption
from eclsim.patient.sites import ARTERIAL_SITES

if TYPE_CHECKING:
    from eclsim.cases.case import Case

LEAST_FLUID_ML_H, LEAST_ULTRAFILTRATION_ML_H = 60.0, 5.0
"""Flows of fluid below which a dose per body weight was probably meant: 20 to 60 mL/kg/h are prescribed as
dialysate and replacement fluid, 0.5 to 3 as net ultrafiltration (a convention of this project)."""
USUAL_CONSUMPTION = (0.6, 2.0)
"""Shares of the usual oxygen consumption between which patients are: 126 +- 26 mL/min/m2 in 108 adults
(Dehmer 1982), more in sepsis and burns. A consumption for each m2 is below them in most adults."""
LARGEST_BASE_EXCESS_MMOL_L = 15.0
"""Base excess above which a bicarbonate was probably meant; less is seen in chronic hypercapnia."""
LARGEST_UREA_MMOL_L = 60.0
"""Urea above which mg/dL were probably meant (a convention of this project)."""
UREA_MG_DL, UREA_NITROGEN_MG_DL = 6.006, 2.801
"""mg/dL of urea, and of its nitrogen, in one mmol/L."""
HIGH_DRAINAGE_MMHG = 20.0
"""Pressure behind a venous cannula or before the pump that is no suction (a convention of this project)."""
LEAST_DOSE_SHARE = 1.0 / 400.0
"""Share of the largest usual dose below which a thousand times as much was probably meant."""
LEAST_SPEED_RPM = 100.0
"""Speed below which no pump runs in a patient who is measured, unless it stands still (a convention of this
project)."""
_SUCTION = ("drainage_pressure", "pump_inlet_pressure")


def speeds_too_low(case: Case) -> Iterator[Mistake]:
    """Yield an error for each pump too slow for a patient who is measured, as of krpm.

    A simulation may have any speed: pumps are slowed down until they stand still.
    """
    for instance in case.instances():
        field = instance.device.section.fields().get("speed_rpm")
        speed = getattr(instance.section, "speed_rpm", None)
        if field is None or speed is None or not 0.0 < speed < LEAST_SPEED_RPM:
            continue
        hint = suspected_unit(speed, field.unit, field.typical, (LEAST_SPEED_RPM, field.maximum))
        allowed = f"0, or {LEAST_SPEED_RPM:g} to {field.maximum:g} {field.unit}"
        message = "no pump runs as slowly in a patient who is measured"
        yield Mistake(f"{instance.key}.speed_rpm", message, shown(speed), allowed, hint)


def check_doubtful_units(case: CaseValues, remarks: Remarks) -> None:
    """Warn of numbers that were probably meant in another unit.

    Args:
        case: Valid values of the case.
        remarks: Collects the warnings.
    """
    _fluids_per_weight(case, remarks)
    _consumption(case, remarks)
    _base_excess(case.physiology.get("gas", {}), remarks)
    _urea(case.physiology.get(SOLUTES, {}), remarks)
    _suction(case, remarks)
    _doses(case.physiology.get(DRUGS, {}), remarks)


def _fluids_per_weight(case: CaseValues, remarks: Remarks) -> None:
    """Warn of flows of dialysis fluids that look like a dose for each kg of body weight."""
    weight = case.patient.get("weight_kg")
    for key, values in case.devices.items():
        for name in FLUIDS:
            given = values.get(name) or 0.0
            least = LEAST_ULTRAFILTRATION_ML_H if name == NET_ULTRAFILTRATION else LEAST_FLUID_ML_H
            if not 0.0 < given < least:
                continue
            message = (
                "doses are prescribed in mL/kg/h, but this is the flow for the whole patient; used as mL/h"
            )
            per_weight = f"{given:g} mL/kg/h"
            hint = per_weight if weight is None else f"{per_weight} = {given * weight:.0f} mL/h"
            remarks.warning(f"{key}.{name}", message, shown(given), hint)


def _consumption(case: CaseValues, remarks: Remarks) -> None:
    """Warn of an oxygen consumption far from that of the patient's size."""
    gas = case.physiology.get("gas", {})
    given, height, weight = gas.get("vo2_ml_min"), *map(case.patient.get, ("height_cm", "weight_kg"))
    if given is None or height is None or weight is None:
        return
    usual, surface = oxygen_consumption(height, weight), body_surface(height, weight)
    least, most = USUAL_CONSUMPTION
    cold = gas.get("temperature_c", NORMAL_C) < NORMAL_C - 2.0
    if least <= given / usual <= most or (cold and given < usual):
        return
    message = (
        f"{100.0 * given / usual:.0f} % of the {usual:.0f} mL/min that adults of this size consume at rest "
        "(126 mL/min per m2, Dehmer 1982); used as mL/min for the whole patient"
    )
    hint = f"{given:g} mL/min/m2 = {given * surface:.0f} mL/min" if given < usual else ""
    remarks.warning("gas.vo2_ml_min", message, shown(given), hint)


def _base_excess(gas: Raw, remarks: Remarks) -> None:
    """Warn of a base excess that looks like a bicarbonate."""
    given = gas.get("base_excess_mmol_l", 0.0)
    if given <= LARGEST_BASE_EXCESS_MMOL_L:
        return
    from eclsim.fluid.solutes import standard_base_excess

    meant = float(standard_base_excess(given, gas.get("haemoglobin_g_dl", GAS["gas.haemoglobin_g_dl"].value)))
    message = "that of normal blood is 0, and 15 is a severe alkalosis; used as base excess"
    hint = f"a bicarbonate of {given:g} mmol/L = a base excess of {meant:.1f} mmol/L"
    remarks.warning("gas.base_excess_mmol_l", message, shown(given), hint)


def _urea(solutes: Raw, remarks: Remarks) -> None:
    """Warn of a urea that looks like mg/dL."""
    given = solutes.get("urea_mmol_l", 0.0)
    if given > LARGEST_UREA_MMOL_L:
        hint = (
            f"{given:g} mg/dL of urea = {given / UREA_MG_DL:.1f} mmol/L, or of urea nitrogen = "
            f"{given / UREA_NITROGEN_MG_DL:.1f} mmol/L"
        )
        message = f"above {LARGEST_UREA_MMOL_L:g} mmol/L, which few patients reach; used as mmol/L"
        remarks.warning(f"{SOLUTES}.urea_mmol_l", message, shown(given), hint)


def _suction(case: CaseValues, remarks: Remarks) -> None:
    """Warn of a pressure in the drainage line that is given without its minus sign."""
    circuits = case.of("ecmo").values()
    if any(each.get("drainage_site") in ARTERIAL_SITES for each in circuits):
        return
    usual = max(HIGH_DRAINAGE_MMHG, case.measurements.get("CVP", 0.0))
    for name in _SUCTION:
        given = case.measurements.get(name)
        if given is not None and given > usual:
            message = "above the pressure of the veins that are drained: suction is negative"
            remarks.warning(f"measurements.{name}", message, shown(given), f"{-given:g}")


def _doses(drugs: Raw, remarks: Remarks) -> None:
    """Warn of a dose that is far below any usual one, as of mg in place of ug."""
    for drug, (_, usual, unit) in DRUG_DOSES.items():
        given = drugs.get(drug, 0.0)
        if unit.startswith("ug") and 0.0 < given < LEAST_DOSE_SHARE * usual:
            message = (
                f"less than a {1.0 / LEAST_DOSE_SHARE:.0f}th of the usual {usual:g} {unit}: it hardly acts"
            )
            meant = f"{given:g} m{unit[1:]} = {1000.0 * given:g} {unit}"
            remarks.warning(f"{DRUGS}.{drug}", message, shown(given), meant)
