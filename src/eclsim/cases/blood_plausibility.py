"""Plausibility of the blood that parameters put into the circulation at the start."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from eclsim.cases.mistakes import Mistake, shown
from eclsim.parameters import thiel2025
from eclsim.patient.anthropometry import mean_height_weight, total_blood_volume_ml

_VESSELS = ("ao", "sart", "svn", "pas", "part", "pvn")
_CHAMBERS = ("ra", "rv", "la", "lv")
_LARGEST_SHARE = 0.5
_LEAST_VENOUS_ML = 20.0


def check_blood(
    patient: Mapping[str, Any], given: Mapping[str, float], mistakes: list[Mistake], warnings: list[Mistake]
) -> None:
    """Stressed volumes against the blood volume: more than all is an error, more than a half a doubt.

    Args:
        patient: The values of [patient] that are right.
        given: The parameters of the case.
        mistakes: Gets what cannot be.
        warnings: Gets doubts.
    """
    named = [key for key in given if (key[2:] in _VESSELS and key[:2] == "P0") or key[1:] in _VESSELS]
    total = _blood_volume(patient)
    if not named or total is None:
        return
    values = {key: parameter.value for key, parameter in thiel2025.PARAMETERS.items()} | dict(given)
    stressed = {place: values[f"P0{place}"] * values[f"C{place}"] for place in _VESSELS}
    chambers = sum(values[f"volume_fraction_{place}"] for place in _CHAMBERS) * total
    whole = sum(stressed.values()) + chambers
    key = max(named, key=lambda name: stressed[name.removeprefix("P0") if name[1] == "0" else name[1:]])
    words = f"the stressed volume is {whole:.0f} mL of a blood volume of {total:.0f} mL"
    if whole > total:
        message = f"{words}: more than there is"
        mistakes.append(Mistake(f"parameters.{key}", message, shown(given[key]), "less than all of it"))
    elif whole > _LARGEST_SHARE * total:
        message = f"{words}, {100.0 * whole / total:.0f} %; about 25 to 30 % is usual"
        warnings.append(Mistake(f"parameters.{key}", message, shown(given[key])))
    else:
        _check_empty_vein(named, given, stressed["svn"], warnings)
        _check_vessels(
            named, given, stressed, {p: values[f"volume_fraction_{p}"] * total for p in _VESSELS}, warnings
        )


def _check_empty_vein(
    named: list[str], given: Mapping[str, float], stressed: float, warnings: list[Mistake]
) -> None:
    keys = [key for key in named if key in ("P0svn", "Csvn")]
    if keys and stressed < _LEAST_VENOUS_ML:
        usual = thiel2025.PARAMETERS["P0svn"].value * thiel2025.PARAMETERS["Csvn"].value
        message = (
            f"Csvn times P0svn is a stressed volume of {stressed:.0f} mL in the systemic veins ({usual:.0f} "
            "as published): a patient short of blood. These veins do not collapse: drainage that would fail "
            "at the bedside goes on, and with the arterial pressure falling the pump flow may even rise"
        )
        warnings.append(Mistake(f"parameters.{keys[0]}", message, shown(given[keys[0]])))


def _check_vessels(
    named: list[str],
    given: Mapping[str, float],
    stressed: Mapping[str, float],
    held: Mapping[str, float],
    warnings: list[Mistake],
) -> None:
    for place in _VESSELS:
        keys = [key for key in named if key in (f"P0{place}", f"C{place}")]
        if keys and stressed[place] > held[place]:
            message = (
                f"C{place} times P0{place} is a stressed volume of {stressed[place]:.0f} mL, more than the "
                f"{held[place]:.0f} mL that this vessel holds"
            )
            warnings.append(Mistake(f"parameters.{keys[0]}", message, shown(given[keys[0]])))


def _blood_volume(patient: Mapping[str, Any]) -> float | None:
    sex, age = patient.get("sex"), patient.get("age_years")
    if sex is None or age is None:
        return None
    height, weight = patient.get("height_cm"), patient.get("weight_kg")
    if height is None or weight is None:
        height, weight = mean_height_weight(sex, age)
    return total_blood_volume_ml(sex, age, height, weight)
