"""From a case to the flat dictionary of numbers that the models run on."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eclsim.devices.constants import OXYGENATORS, PUMPS
from eclsim.parameters import thiel2025
from eclsim.patient.anthropometry import mean_height_weight, total_blood_volume_ml

if TYPE_CHECKING:
    from eclsim.cases.case import Case, Ecmo, Patient


def resolve_parameters(case: Case) -> dict[str, float]:
    """Every number of a case, by name and in the units of the tables and of the devices' makers.

    Defaults are those of `eclsim.parameters.thiel2025`; the oxygenator of the case sets Recmooxy,
    and the case's own parameters override both. Keys `ecmo.*`, `crrt.*` and `lvad.*` are there
    exactly if that circuit is connected.

    Raises:
        UnsolvedFlowError: The case names a pump flow in place of a speed.
    """
    values = {key: parameter.value for key, parameter in thiel2025.PARAMETERS.items()}
    values["heart_rate_bpm"] = case.patient.heart_rate_bpm
    values["total_blood_volume_ml"] = blood_volume_ml(case.patient)
    if case.ecmo is not None:
        values["Recmooxy"] = OXYGENATORS[case.ecmo.oxygenator].resistance
        values["ecmo.drainage_fr"] = case.ecmo.drainage_fr
        values["ecmo.return_fr"] = case.ecmo.return_fr
        if isinstance(case.ecmo.pump, str):
            values |= {
                f"ecmo.pump.{name}": number for name, number in PUMPS[case.ecmo.pump].constants.items()
            }
            values["ecmo.speed_rpm"] = _speed(case.ecmo)
        else:
            values["ecmo.roller_l_min"] = case.ecmo.pump.roller_l_min
    if case.crrt is not None:
        values["crrt.flow_ml_min"] = case.crrt.flow_ml_min
    if case.lvad is not None:
        values |= {f"lvad.pump.{name}": number for name, number in PUMPS[case.lvad.pump].constants.items()}
        values["lvad.speed_rpm"] = case.lvad.speed_rpm
    return values | case.parameters


class UnsolvedFlowError(ValueError):
    """A case that names the pump flow wanted, and no speed yet; says how to get it."""


def _speed(ecmo: Ecmo) -> float:
    if ecmo.speed_rpm is None and ecmo.flow_l_min is not None:
        raise UnsolvedFlowError(
            f"ecmo.flow_l_min = {ecmo.flow_l_min:g} is a target: solve for the pump speed first, "
            "with eclsim.simulation.target_flow.with_speed"
        )
    return ecmo.speed_rpm or 0.0


def height_weight(patient: Patient) -> tuple[float, float]:
    """Height [cm] and weight [kg]: the patient's own, or the mean of their sex and age."""
    if patient.height_cm is not None and patient.weight_kg is not None:
        return patient.height_cm, patient.weight_kg
    return mean_height_weight(patient.sex, patient.age_years)


def blood_volume_ml(patient: Patient) -> float:
    """Total blood volume of a patient [mL]."""
    return total_blood_volume_ml(patient.sex, patient.age_years, *height_weight(patient))
