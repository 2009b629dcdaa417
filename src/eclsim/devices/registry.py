"""All devices: those of the package, a line each, those of installed packages, and those registered."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from types import MappingProxyType

from pydantic import BaseModel

from eclsim.devices.crrt import CRRT, Crrt
from eclsim.devices.device import AnyDevice, device_key
from eclsim.devices.ecmo import ECMO, Ecmo
from eclsim.devices.lvad import LVAD, Lvad
from eclsim.devices.products import Product
from eclsim.parameters import thiel2025
from eclsim.parameters.parameter import Parameter

_REGISTERED: dict[str, AnyDevice] = {
    device.key: device
    for device in (
        ECMO,
        CRRT,
        LVAD,
    )
}


class PublishedDevices(BaseModel):
    """The sections of the published devices, for typed access to the only instance of each."""

    ecmo: Ecmo | None = None
    crrt: Crrt | None = None
    lvad: Lvad | None = None


def devices() -> Mapping[str, AnyDevice]:
    """All devices by the name of their section, in the order in which case files are written."""
    return MappingProxyType(_REGISTERED)


def device_of(key: str) -> AnyDevice | None:
    """The device of a section or of a group of compartments, such as "lvad" or "lvad.left"; None if none."""
    return devices().get(device_key(key))


def parameters() -> Mapping[str, Parameter]:
    """Every parameter that a case file may set, of the patient and of all devices."""
    return thiel2025.PARAMETERS | {p.key: p for device in devices().values() for p in device.parameters}


def parameter_of(name: str, connected: Collection[str]) -> Parameter | None:
    """The parameter of a name, also of a named instance (`ecmo.left.Recmooxy`); None if there is none.

    Args:
        name: as a case file holds it.
        connected: keys of the sections of the devices connected.
    """
    section, dot, own = name.rpartition(".")
    device = device_of(section) if dot and section in connected and section not in devices() else None
    if device is None:
        return parameters().get(name)
    return next((parameter for parameter in device.parameters if parameter.key == own), None)


def products() -> dict[str, Product]:
    """What devices are made of, by the name users write."""
    return {product.key: product for device in devices().values() for product in device.products}


def nominal_value(name: str) -> float | None:
    """The usual value of a parameter of a device, also of a named instance; None where there is none."""
    for key, device in devices().items():
        values = {parameter.key: parameter.value for parameter in device.parameters} | dict(device.nominal)
        own = name.removeprefix(f"{key}.").partition(".")[2] if name.startswith(f"{key}.") else ""
        for candidate in (name, f"{key}.{own}", own):
            if candidate in values:
                return values[candidate]
    return None
