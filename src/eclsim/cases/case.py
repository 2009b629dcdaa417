"""A case: one patient with the connected devices, checked and complete."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import ConfigDict, Field, SerializeAsAny, ValidationInfo, model_validator

from eclsim.cases.checking import check_case
from eclsim.cases.events import Event
from eclsim.cases.fit_mark import FitMark
from eclsim.cases.fluid import DialysedDrug, Fluid, Solutes
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
from eclsim.inputs.sections import CHECKED, Section, plain
from eclsim.patient.sites import patient_sites

__all__ = ["Case", "Measurements", "Patient"]

Policy = Literal["as_published", "patient_held"]


_PUBLISHED = tuple(PublishedDevices.model_fields)


class Case(PublishedDevices):
    """One patient with measurements and connected devices.

    A published device that is connected once is an attribute (`case.ecmo`, None if absent). All other devices
    are in `other_devices`, by section key ("lvad.left", or a device from outside the package). `instances()`
    returns all of them. `blood_volume_policy` is the policy with which the case was made or fitted, or None
    if not stated.

    Creating a `Case` runs all checks of a case file and raises `pydantic.ValidationError` with all errors;
    `eclsim.cases.read_case` also reports file and line, and keeps the warnings.
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
    dialysed_drug: DialysedDrug | None = None
    other_devices: Mapping[str, SerializeAsAny[Section]] = Field(default_factory=dict)
    parameters: dict[str, float] = Field(default_factory=dict)
    events: tuple[Event, ...] = ()
    as_written: Case | None = Field(default=None, exclude=True, repr=False)
    """The case of the file before settings changed it; open set points of reflexes refer to it."""
    changed: bool = Field(default=False, exclude=True, repr=False)
    """Whether settings changed the case of the file, so that its measurements are of other settings."""
    fit_mark: FitMark | None = Field(default=None, exclude=True, repr=False)
    """Verdict in the case file on the fit that gave the parameters."""

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
        """Blood volume policy to simulate the case with: its own if stated, else the published one."""
        return self.blood_volume_policy or "as_published"

    @property
    def doubts(self) -> tuple[str, ...]:
        """Warnings about the fit that gave the parameters, to be shown with results; empty for a good fit."""
        mark = self.fit_mark
        return () if mark is None or mark.level == "good" else (mark.sentence,)

    @property
    def refusal(self) -> str:
        """Reason why studies of many patients exclude this one (a poor fit); empty if they include it."""
        return "" if self.fit_mark is None else self.fit_mark.refusal

    def with_volume_policy(self, policy: str) -> Case:
        """Return the case with another blood volume policy, which says whose blood fills the circuits.

        Raises:
            CaseError: There is no such policy.
        """
        check_case(self.as_mapping() | {"blood_volume_policy": policy}).raise_mistakes()
        return self.model_copy(update={"blood_volume_policy": policy})

    def instances(self) -> tuple[Instance, ...]:
        """Return all connected devices, in the order of the registry."""
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
        """Return the device of a section such as "lvad" or "lvad.left"; None if it is not connected."""
        return next((instance for instance in self.instances() if instance.key == key), None)

    def with_section(self, key: str, **changes: object) -> Case:
        """Return the case with some keys of a device's section changed; the new values are not checked."""
        instance = self.instance(key)
        assert instance is not None
        section = instance.section.model_copy(update=changes)
        if key in _PUBLISHED:
            return self.model_copy(update={key: section})
        return self.model_copy(update={"other_devices": {**self.other_devices, key: section}})

    def targets(self) -> tuple[tuple[Instance, Target], ...]:
        """Return the devices with a target, such as a pump flow, in place of a setting, such as a speed."""
        return tuple(
            (instance, target)
            for instance in self.instances()
            if (target := instance.device.target) and getattr(instance.section, target.key) is not None
        )

    def sites(self) -> dict[str, str]:
        """Return the sites where a device can be connected, in other devices and the patient, with labels."""
        patient = patient_sites(self.physiology is not None and self.physiology.regional)
        return {
            k: label for instance in self.instances() for k, label in instance.site_words().items()
        } | patient

    @property
    def open_set_points(self) -> tuple[str, ...]:
        """Parameters of the reflex set points that the case leaves open; none without reflexes."""
        return () if self.regulation is None else self.regulation.open_set_points

    def at_rest(self) -> Case:
        """Return the case that open set points refer to: as written, without reflexes, [fluid] or events."""
        return (self.as_written or self).model_copy(
            update={"regulation": None, "fluid": None, "as_written": None, "events": ()}
        )

    def with_set_points(self, values: Mapping[str, float]) -> Case:
        """Return the case with its open reflex set points taken from `values`, by parameter key.

        Open set points of a changed case are those of the case as written, which cannot be derived from a
        file of the changed case.
        """
        if self.regulation is None:
            return self
        points = {key.partition(".")[2]: values[key] for key in self.regulation.open_set_points}
        return self.model_copy(
            update={"regulation": self.regulation.model_copy(update=points), "as_written": None}
        )

    def setting(self, section: str, name: str) -> Any:
        """Return a value of the case file, such as "speed_rpm" of "lvad.left"; None if absent."""
        part = within(self.as_mapping(), section)
        return None if part is None else part.get(name)

    def as_mapping(self, only_given: bool = False) -> dict[str, Any]:
        """Return the case as the mapping of its case file; absent sections and keys are left out.

        Args:
            only_given: whether to leave out the keys that nobody gave and that have their default values.
        """
        dumped = self.model_dump(exclude_none=True, exclude_unset=only_given)
        result = {key: dumped[key] for key in _BEFORE_DEVICES if key in dumped}
        result = _nested(
            result,
            {
                one.key: one.section.model_dump(exclude_none=True, exclude_unset=only_given)
                for one in self.instances()
            },
        )
        result |= {"parameters": self.parameters} if self.parameters else {}
        return result | ({"events": [event.as_object() for event in self.events]} if self.events else {})


_BEFORE_DEVICES = (
    "format", "blood_volume_policy", "patient", "measurements", *(one.section for one in PATIENT_SECTIONS)
)  # fmt: skip


def _nested(mapping: dict[str, Any], by_key: Mapping[str, Any]) -> dict[str, Any]:
    """Return the mapping with sections inserted, such as {"lvad": {"left": ...}} for "lvad.left"."""
    result = dict(mapping)
    for key, section in by_key.items():
        device, _, name = key.partition(".")
        result[device] = {**result.get(device, {}), name: section} if name else section
    return result


def _with_other_devices(values: dict[str, Any]) -> dict[str, Any]:
    """Return the values for `Case`: sections that are not its attributes are moved to `other_devices`."""
    result = {key: value for key, value in values.items() if key not in devices()}
    others: dict[str, Section] = {}
    for device, name, section in device_sections(values):
        if not name and device.key in _PUBLISHED:
            result[device.key] = section
        else:
            key = instance_key(device.key, name)
            others[key] = device.section.model_validate(section, context=CHECKED)
    return result | ({"other_devices": others} if others else {})
