"""A case: one patient with the devices connected, checked and complete."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import ConfigDict, Field, SerializeAsAny, ValidationInfo, model_validator

from eclsim.cases.checking import check_case
from eclsim.cases.events import Event
from eclsim.cases.fit_mark import FitMark
from eclsim.cases.fluid import Fluid, Solutes
from eclsim.cases.regulation import Drugs, Regulation
from eclsim.cases.sections import (
    PATIENT_SECTIONS,
    Gas,
    Measurements,
    Patient,
    Physiology,
    device_sections,
    within,
)
from eclsim.devices.description import Target
from eclsim.devices.device import Instance, device_key, instance_key
from eclsim.devices.registry import PublishedDevices, devices
from eclsim.inputs.mistakes import CaseError
from eclsim.inputs.sections import CHECKED, Section, plain
from eclsim.patient.sites import patient_sites

__all__ = ["Case", "Measurements", "Patient"]

Policy = Literal["as_published", "patient_held"]


_PUBLISHED = tuple(PublishedDevices.model_fields)


class Case(PublishedDevices):
    """One patient, the measurements and the devices connected.

    The only instance of a published device is an attribute (`case.ecmo`, None where it is absent); all others
    are `other_devices` by the key of their section ("lvad.left", or a device from outside the package).
    `instances()` lists all. `blood_volume_policy` is the one that the case was made or fitted with, None
    where it does not say.

    Building one checks everything a case file is checked for and raises `pydantic.ValidationError`
    with all mistakes; `eclsim.cases.read_case` also tells file and line, and keeps the warnings.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")
    format: Literal[1] = 1
    blood_volume_policy: Policy | None = None
    patient: Patient
    measurements: Measurements | None = None
    physiology: Physiology | None = None
    gas: Gas | None = None
    regulation: Regulation | None = None
    drugs: Drugs | None = None
    fluid: Fluid | None = None
    solutes: Solutes | None = None
    other_devices: Mapping[str, SerializeAsAny[Section]] = Field(default_factory=dict)
    parameters: dict[str, float] = Field(default_factory=dict)
    events: tuple[Event, ...] = ()
    as_written: Case | None = Field(default=None, exclude=True, repr=False)
    """The case of the file where settings were put over it; what open set points of reflexes refer to."""
    fit_mark: FitMark | None = Field(default=None, exclude=True, repr=False)
    """Verdict of its file on the fit that gave its parameters."""

    @model_validator(mode="before")
    @classmethod
    def _check(cls, data: object, info: ValidationInfo) -> object:
        if not isinstance(data, dict):
            return data
        if info.context != CHECKED:
            others = data.get("other_devices", {})
            written = plain({key: value for key, value in data.items() if key != "other_devices"})
            checked = check_case({"format": 1} | _nested(written, plain(others)))
            checked.raise_mistakes()
            data = checked.values
        return _with_other_devices(data)

    @property
    def volume_policy(self) -> Policy:
        """The blood volume policy to simulate the case with: its own, else the published one."""
        return self.blood_volume_policy or "as_published"

    @property
    def doubts(self) -> tuple[str, ...]:
        """Doubts about the fit that gave its parameters, for its results; empty where it is good."""
        mark = self.fit_mark
        return () if mark is None or mark.level == "good" else (mark.sentence,)

    @property
    def refusal(self) -> str:
        """Why studies of many leave it out: its fit is poor; empty where they do not."""
        return "" if self.fit_mark is None else self.fit_mark.refusal

    def with_volume_policy(self, policy: str) -> Case:
        """The same case, saying how its circuits are filled.

        Raises:
            CaseError: If there is no such policy.
        """
        checked = check_case(self.as_mapping() | {"blood_volume_policy": policy})
        if checked.mistakes:
            raise CaseError(checked.mistakes)
        return self.model_copy(update={"blood_volume_policy": policy})

    def instances(self) -> tuple[Instance, ...]:
        """All devices connected, in the order of the registry."""
        sections = {key: section for key in _PUBLISHED if (section := getattr(self, key)) is not None}
        sections |= self.other_devices
        known = devices()
        order = list(known.values())
        result = [
            Instance(known[device_key(key)], key.partition(".")[2], section=section)
            for key, section in sections.items()
            if device_key(key) in known
        ]
        return tuple(sorted(result, key=lambda instance: order.index(instance.device)))

    def instance(self, key: str) -> Instance | None:
        """The device of a section such as "lvad" or "lvad.left"; None where it is not connected."""
        return next((instance for instance in self.instances() if instance.key == key), None)

    def with_section(self, key: str, **changes: object) -> Case:
        """The same case with some keys of a device's section changed; the values are right."""
        instance = self.instance(key)
        assert instance is not None
        section = instance.section.model_copy(update=changes)
        if key in _PUBLISHED:
            return self.model_copy(update={key: section})
        return self.model_copy(update={"other_devices": {**self.other_devices, key: section}})

    def targets(self) -> tuple[tuple[Instance, Target], ...]:
        """Devices that name a value in place of a setting, such as a pump flow in place of a speed."""
        return tuple(
            (instance, target)
            for instance in self.instances()
            if (target := instance.device.target) and getattr(instance.section, target.key) is not None
        )

    def sites(self) -> dict[str, str]:
        """Where a device can be connected, in words: positions in other devices, and the patient."""
        patient = patient_sites(self.physiology is not None and self.physiology.regional)
        return {
            k: label for instance in self.instances() for k, label in instance.site_words().items()
        } | patient

    def at_rest(self) -> Case:
        """The case that open set points refer to: as it was written, unregulated, without extra volume."""
        return (self.as_written or self).model_copy(
            update={"regulation": None, "fluid": None, "as_written": None, "events": ()}
        )

    def with_set_points(self, values: Mapping[str, float]) -> Case:
        """The same case with the set points that its reflexes leave open, of `values` by key.

        A case that was changed keeps those of the case as it was written, which a file of it cannot tell.
        """
        if self.regulation is None:
            return self
        points = {key.partition(".")[2]: values[key] for key in self.regulation.open_set_points}
        return self.model_copy(
            update={"regulation": self.regulation.model_copy(update=points), "as_written": None}
        )

    def setting(self, section: str, name: str) -> Any:
        """A value as a case file holds it, such as "speed_rpm" of "lvad.left"; None if absent."""
        part = within(self.as_mapping(), section)
        return None if part is None else part.get(name)

    def as_mapping(self) -> dict[str, Any]:
        """The case as a case file holds it: sections and keys that are absent are left out."""
        dumped = self.model_dump(exclude_none=True)
        result = {key: dumped[key] for key in _BEFORE_DEVICES if key in dumped}
        result = _nested(
            result,
            {instance.key: instance.section.model_dump(exclude_none=True) for instance in self.instances()},
        )
        result |= {"parameters": self.parameters} if self.parameters else {}
        return result | ({"events": [event.as_object() for event in self.events]} if self.events else {})


_BEFORE_DEVICES = (
    "format", "blood_volume_policy", "patient", "measurements", *(one.section for one in PATIENT_SECTIONS)
)  # fmt: skip


def _nested(mapping: dict[str, Any], by_key: Mapping[str, Any]) -> dict[str, Any]:
    """The mapping with sections put in, such as {"lvad": {"left": ...}} for "lvad.left"."""
    result = dict(mapping)
    for key, section in by_key.items():
        device, _, name = key.partition(".")
        result[device] = {**result.get(device, {}), name: section} if name else section
    return result


def _with_other_devices(values: dict[str, Any]) -> dict[str, Any]:
    """Values as `Case` has them: sections that are no attributes of it are among `other_devices`."""
    result = {key: value for key, value in values.items() if key not in devices()}
    others: dict[str, Section] = {}
    for device, name, section in device_sections(values):
        if not name and device.key in _PUBLISHED:
            result[device.key] = section
        else:
            key = instance_key(device.key, name)
            others[key] = device.section.model_validate(section, context=CHECKED)
    return result | ({"other_devices": others} if others else {})
