"""Section [dialysed_drug]: a drug, such as an antibiotic, that blood carries and dialysis removes."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any

from eclsim.inputs.fields import Field, setting
from eclsim.inputs.mistakes import Remarks, shown
from eclsim.inputs.sections import Raw, Section, read_share
from eclsim.parameters import dialysed_drug as keys

MOST_SIEVED = 1.25
"""Ratio of sieving coefficient to unbound share above which one of them is probably wrong."""
ASSUMED = ("central_volume_l", "body_clearance_ml_min", "koa_ml_min")
"""Constants of drug and patient that differ so much that a value which is left out is named."""


def _share(name: str) -> Field:
    return setting(keys.PARAMETERS[f"{keys.SECTION}.{name}"], read=read_share)


def _given(name: str, typical: float) -> Field:
    """Field of what is given, with the usual amount of an antibiotic, from which a wrong unit is guessed."""
    return replace(setting(keys.PARAMETERS[f"{keys.SECTION}.{name}"]), typical=typical)


class DialysedDrug(Section):
    """A drug that dialysis removes: doses and kinetics; followed in courses."""

    section = keys.SECTION
    parameters = keys.PARAMETERS
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
    unbound_fraction: Annotated[float, _share("unbound_fraction")] = 1.0
    sieving: Annotated[float | None, _share("sieving")] = None
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
