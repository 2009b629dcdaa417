"""A case: one patient with the devices connected, checked and complete."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

from pydantic import BaseModel, ConfigDict, model_validator

from eclsim.cases.checking import check_case, check_section
from eclsim.cases.mistakes import CaseError


class _Section(BaseModel):
    """A section of a case file. Names, units and ranges stand in `eclsim.cases.fields`."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    section: ClassVar[str]

    @model_validator(mode="before")
    @classmethod
    def _check(cls, data: Any) -> Any:
        if isinstance(data, BaseModel) or not isinstance(data, dict):
            return data
        checked = check_section(cls.section, _plain(data))
        if checked.mistakes:
            raise CaseError(checked.mistakes)
        return checked.values


class Patient(_Section):
    """Who is simulated: age in years, height in cm, weight in kg, heart rate in beats per minute."""

    section: ClassVar[str] = "patient"
    id: str
    sex: Literal["female", "male"]
    age_years: float
    height_cm: float | None = None
    weight_kg: float | None = None
    heart_rate_bpm: float


class Measurements(_Section):
    """What was measured: pressures in mmHg, flows in L/min, None where not measured.

    CO is the native output, the flow through the lungs; PF is the flow of the ECMO pump.
    """

    section: ClassVar[str] = "measurements"
    SP: float | None = None
    DP: float | None = None
    MAP: float | None = None
    MPAP: float | None = None
    PCWP: float | None = None
    CO: float | None = None
    PF: float | None = None


class RollerPump(BaseModel):
    """A roller pump: it delivers its flow [L/min] whatever the pressures are."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    roller_l_min: float


class Ecmo(_Section):
    """The ECMO circuit: pump speed in rpm, cannula sizes in Fr.

    A rotary pump has its speed, or the flow [L/min] that `eclsim.simulation.target_flow` solves it for.
    """

    section: ClassVar[str] = "ecmo"
    pump: str | RollerPump
    speed_rpm: float | None = None
    flow_l_min: float | None = None
    oxygenator: str
    drainage_site: str
    drainage_cannula: str
    drainage_fr: float
    return_site: str
    return_cannula: str
    return_fr: float
    mode: Literal["VA", "VV"] | None = None


class Crrt(_Section):
    """The CRRT circuit: blood flow in mL/min, access and return where its lines are connected."""

    section: ClassVar[str] = "crrt"
    flow_ml_min: float
    access_site: str
    return_site: str


class Lvad(_Section):
    """A left ventricular assist device: speed in rpm."""

    section: ClassVar[str] = "lvad"
    pump: str
    speed_rpm: float
    inlet_site: str
    outlet_site: str


class Case(BaseModel):
    """One patient, the measurements and the devices connected; a device that is None is absent.

    `blood_volume_policy` is the one that the case was made or fitted with, None where it does not say.

    Building one checks everything a case file is checked for and raises `pydantic.ValidationError`
    with all mistakes; `eclsim.cases.read_case` also tells file and line, and keeps the warnings.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")
    format: Literal[1] = 1
    blood_volume_policy: Literal["as_published", "patient_held"] | None = None
    patient: Patient
    measurements: Measurements | None = None
    ecmo: Ecmo | None = None
    crrt: Crrt | None = None
    lvad: Lvad | None = None
    parameters: dict[str, float] = {}

    @model_validator(mode="before")
    @classmethod
    def _check(cls, data: Any) -> Any:
        if isinstance(data, BaseModel) or not isinstance(data, dict):
            return data
        checked = check_case({"format": 1} | _plain(data))
        if checked.mistakes:
            raise CaseError(checked.mistakes)
        return checked.values

    @property
    def volume_policy(self) -> Literal["as_published", "patient_held"]:
        """The blood volume policy to simulate the case with: its own, else the published one."""
        return self.blood_volume_policy or "as_published"

    def with_volume_policy(self, policy: str) -> Case:
        """The same case, saying how its circuits are filled.

        Raises:
            CaseError: If there is no such policy.
        """
        checked = check_case(self.as_mapping() | {"blood_volume_policy": policy})
        if checked.mistakes:
            raise CaseError(checked.mistakes)
        return self.model_copy(update={"blood_volume_policy": policy})

    def as_mapping(self) -> dict[str, Any]:
        """The case as a case file holds it: sections and keys that are absent are left out."""
        return {key: value for key, value in self.model_dump(exclude_none=True).items() if value != {}}


def _plain(data: dict[str, Any]) -> dict[str, Any]:
    """The mapping with models turned into mappings, and without sections and keys that are None."""
    plain = {}
    for key, value in data.items():
        if isinstance(value, BaseModel):
            value = value.model_dump(exclude_none=True)
        if value is not None:
            plain[key] = value
    return plain
