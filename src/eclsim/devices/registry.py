"""Registry of all devices: those of eclsim, those of installed packages, and registered ones."""

from __future__ import annotations

import hashlib
import itertools
import os
import re
import sys
import warnings
from collections.abc import Callable, Collection, Iterable, Mapping
from functools import lru_cache, wraps
from importlib.machinery import SourceFileLoader
from importlib.metadata import entry_points
from importlib.util import module_from_spec, spec_from_file_location
from types import CodeType, MappingProxyType
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from pydantic import BaseModel

from eclsim.devices.crrt import CRRT, Crrt
from eclsim.devices.description import GRAVEST_FIRST, SIDES, Output
from eclsim.devices.device import AnyDevice, Device, DeviceError, Naming, device_key
from eclsim.devices.ecmo import ECMO, Ecmo
from eclsim.devices.iabp import IABP, Iabp
from eclsim.devices.lvad import LVAD, Lvad
from eclsim.devices.products import Product
from eclsim.devices.renox import RENOX, Renox
from eclsim.devices.septostomy import SEPTOSTOMY, Septostomy
from eclsim.devices.trial import try_device
from eclsim.devices.vent import VENT, Vent
from eclsim.inputs.sections import Section
from eclsim.parameters import patient_parameters
from eclsim.parameters.parameter import Parameter
from eclsim.parameters.thiel2025 import ALIASES
from eclsim.patient.sites import ARTERIAL_SITES
from eclsim.spelling import nearest, spelling_hint

if TYPE_CHECKING:
    from eclsim.circuit.network import Circuit

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")
_PACKAGE: tuple[AnyDevice, ...] = (ECMO, CRRT, LVAD, RENOX, VENT, SEPTOSTOMY, IABP)
_OTHERS: dict[str, AnyDevice] = {}
_LOADED: set[str] = set()
"""Device files that were run, and the group of entry points once it was loaded."""
_FILE_OF: dict[str, tuple[str, str]] = {}
"""File that registered a user's device, and its SHA-256, by the device's key."""
ENTRY_POINTS = "eclsim.devices"
"""Group of entry points under which an installed package offers devices."""
FILES = "ECLSIM_DEVICES"
"""Environment variable with Python files of devices, separated as in PATH; worker processes inherit it."""
RESERVED = (
    "format", "blood_volume_policy", "patient", "measurements", "physiology", "gas", "regulation", "drugs",
    "fluid", "solutes", "dialysed_drug", "events", "parameters", "heart", "vessels",
)  # fmt: skip
SCHEME = "scheme"
"""Suffix after the key of a device with `schemes`: selects one of them."""
_KEY = re.compile(r"[a-z][a-z0-9_]*")


class UnknownParameterError(KeyError):
    """Raised for a name that is no parameter; suggests the nearest spellings."""

    def __init__(self, name: str):
        self.name, self.suggestions = name, nearest(name, parameters())
        super().__init__(name)

    def __str__(self) -> str:
        hint = f"; did you mean {' or '.join(self.suggestions)}?" if self.suggestions else ""
        return f"unknown parameter {self.name!r}{hint}"


class PublishedDevices(BaseModel):
    """Sections of eclsim's own devices, for typed access to the unnamed instance of each."""

    ecmo: Ecmo | None = None
    crrt: Crrt | None = None
    lvad: Lvad | None = None
    renox: Renox | None = None
    vent: Vent | None = None
    septostomy: Septostomy | None = None
    iabp: Iabp | None = None


def devices() -> Mapping[str, AnyDevice]:
    """All devices by the key of their section, in the order in which case files are written."""
    return _by_key(registered())


def registered() -> tuple[AnyDevice, ...]:
    """All devices at present."""
    _load_others()
    return _at_present()


@lru_cache(1)
def _at_present() -> tuple[AnyDevice, ...]:
    return (*_PACKAGE, *_OTHERS.values())


@lru_cache(8)
def _by_key(among: tuple[AnyDevice, ...]) -> Mapping[str, AnyDevice]:
    return MappingProxyType({device.key: device for device in among})


def cached_by_devices(maxsize: int) -> Callable[[Callable[Arguments, Result]], Callable[Arguments, Result]]:
    """Cache a function that depends on the registered devices, until another one is registered.

    Sequences and mappings among the arguments reach the function as tuples.
    """

    def decorate(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
        @lru_cache(maxsize)
        def result(among: tuple[AnyDevice, ...], /, *arguments: Any, **named: Any) -> Result:
            return function(*arguments, **named)

        @wraps(function)
        def cached(*arguments: Arguments.args, **named: Arguments.kwargs) -> Result:
            given: tuple[Any, ...] = arguments
            if None in [one.__hash__ for one in given]:
                given = tuple(tuple(one) if one.__hash__ is None else one for one in given)
            return result(registered(), *given, **named)

        return cached

    return decorate


def register_device(device: AnyDevice | type[AnyDevice]) -> AnyDevice:
    """Register a user's device, so that case files, outputs, figures and the page know it.

    Args:
        device: a device, or its class; a device with the same key, as in a rerun notebook, is replaced.

    Raises:
        DeviceError: The key, section, parameters, outputs, limits or waveforms are not valid, or the circuit
            of the `usual` section cannot be simulated.
    """
    made = device() if isinstance(device, type) else device
    _check(made)
    others = (*_PACKAGE, *(other for key, other in _OTHERS.items() if key != made.key))
    try_device(made, others, RESERVED)
    _OTHERS[made.key] = made
    _at_present.cache_clear()
    return made


def is_of_user(device: AnyDevice) -> bool:
    """Whether a device is registered from outside the package."""
    return device.key in _OTHERS


def forget_device(key: str) -> None:
    """Remove the registration of a user's device."""
    _OTHERS.pop(key, None)
    _at_present.cache_clear()


class _Uncached(SourceFileLoader):
    """Loads a file from its source: bytecode on disk is not renewed for an edit within the same second."""

    def get_code(self, fullname: str) -> CodeType:
        path = self.get_filename(fullname)
        return self.source_to_code(self.get_data(path), path)


def load_device_file(file: str) -> list[AnyDevice]:
    """Run a Python file that registers a user's devices; the file can do whatever a program can.

    Returns:
        The devices that it registered.

    Raises:
        DeviceError: The file cannot be read or run, or registers no device.
    """
    path = os.path.abspath(file)
    name = "eclsim_device_" + re.sub(r"\W", "_", os.path.splitext(os.path.basename(path))[0])
    before = dict(_OTHERS)
    spec = spec_from_file_location(name, path, loader=_Uncached(name, path))
    if not (os.path.isfile(path) and path.endswith(".py")) or spec is None or spec.loader is None:
        raise DeviceError(f"{file}: not a Python file")
    module = sys.modules[name] = module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        del sys.modules[name]
        what = str(error) if isinstance(error, DeviceError) else f"{type(error).__name__}: {error}"
        raise DeviceError(f"{file}: {what}") from error
    _LOADED.add(path)
    result = [device for key, device in _OTHERS.items() if before.get(key) is not device]
    if not result:
        raise DeviceError(f"{file}: registers no device; call eclsim.register_device(YourDevice) in it")
    with open(path, "rb") as handle:
        digest = hashlib.file_digest(handle, "sha256").hexdigest()[:16]
    _FILE_OF.update({device.key: (path, digest) for device in result})
    return result


def own_files(keys: Collection[str] | None = None) -> list[str]:
    """Paths of the files that registered the users' devices, of all or of those with the given keys."""
    files = {key: path for key, (path, _) in _FILE_OF.items() if key in _OTHERS}
    return sorted({path for key, path in files.items() if keys is None or key in keys})


def digests_of_own_files() -> dict[str, dict[str, str]]:
    """SHA-256 of the file of each user's device, by key: inputs of results besides the package.

    Empty if there is none. Part of the inputs of work that is stored and resumed.
    """
    digests = {key: digest for key, (_, digest) in sorted(_FILE_OF.items()) if key in _OTHERS}
    return {"device_files": digests} if digests else {}


def _load_others() -> None:
    """Load, once, the devices of installed packages and of the files that the environment names."""
    if ENTRY_POINTS in _LOADED:
        return
    _LOADED.add(ENTRY_POINTS)
    for entry in entry_points(group=ENTRY_POINTS):
        try:
            register_device(entry.load())
        except Exception as error:
            warnings.warn(f"device {entry.name} ({entry.value}) is left out: {error}", stacklevel=2)
    for file in filter(None, os.environ.get(FILES, "").split(os.pathsep)):
        if os.path.abspath(file) not in _LOADED:
            load_device_file(file)


def _check(device: AnyDevice) -> None:
    """Raise `DeviceError` for a device that is not valid."""
    if not isinstance(device, Device):
        raise DeviceError(f"{device!r} is not a device: make it a subclass of eclsim.devices.Device")
    key = getattr(device, "key", "")
    used = (*RESERVED, *(entry.key for entry in _PACKAGE))
    if not _KEY.fullmatch(key) or key in used:
        allowed = f"lower-case letters, digits and _, but none of {', '.join(used)}"
        raise DeviceError(f"device key {key!r}; allowed: {allowed}")
    section = getattr(device, "section", None)
    if not (isinstance(section, type) and issubclass(section, Section)):
        raise DeviceError(f"device {key}: `section` must be a subclass of eclsim.devices.Section")
    if getattr(section, "section", None) != key:
        raise DeviceError(
            f"device {key}: `section` of {section.__name__} must be its name in a case file, {key!r}"
        )
    try:
        section.fields()
    except ValueError:
        message = "each attribute must be annotated with its Field, as in Annotated[float, number(...)]"
        raise DeviceError(f"device {key}, {section.__name__}: {message}") from None
    _check_defaults(device)
    others = (*_PACKAGE, *(other for name, other in _OTHERS.items() if name != key))
    known = set(patient_parameters()) | {p.key for other in others for p in other.parameters}
    if taken := [p.key for p in device.parameters if p.key in known]:
        message = "the name of a parameter of the patient or of another device; choose a new name"
        raise DeviceError(f"device {key}, parameter {taken[0]!r}: {message}")
    _check_outputs(device, others)
    _check_waveforms(device, others)


def _check_defaults(device: AnyDevice) -> None:
    """Raise `DeviceError` for a key that may be left out and then has no value."""
    section = device.section
    filled_in = section.complete.__func__ is not Section.complete.__func__
    for name, entry in section.fields().items():
        if section.model_fields[name].is_required() and not (entry.required or filled_in):
            message = "may be left out, but has no default; write one behind it, such as `= None`"
            raise DeviceError(f"device {device.key}, {section.__name__}.{name}: {message}")


def _check_outputs(device: AnyDevice, others: Iterable[AnyDevice]) -> None:
    """Raise `DeviceError` for outputs with the name of another, and for limits of unknown outputs."""
    own = [entry.name for entry in device.outputs]
    known = {entry.name for other in others for entry in other.outputs}
    for name in own:
        if own.count(name) > 1 or name in known:
            message = "the name of another output; choose a new name"
            raise DeviceError(f"device {device.key}, output {name!r}: {message}")
    for limit in device.limits:
        where = f"device {device.key}, limit of {limit.quantity!r}"
        if limit.quantity not in own:
            hint = spelling_hint(limit.quantity, own)
            raise DeviceError(
                f"{where}: not an output of this device; allowed: {', '.join(own) or 'none'}{hint}"
            )
        if limit.side not in SIDES or limit.kind not in GRAVEST_FIRST:
            allowed = f"{', '.join(GRAVEST_FIRST)}; {', '.join(SIDES)}"
            raise DeviceError(f"{where}: {limit.kind!r}, {limit.side!r}; allowed: {allowed}")
    if device.assist_flow and device.assist_flow not in own:
        hint = spelling_hint(device.assist_flow, own)
        raise DeviceError(
            f"device {device.key}, assist_flow {device.assist_flow!r}: not an output of this device{hint}"
        )


def _check_waveforms(device: AnyDevice, others: Iterable[AnyDevice]) -> None:
    """Raise `DeviceError` for waveforms that no circuit has, as outputs that read them could not exist."""
    read = {f"output {e.name!r}": (*e.needs, *e.extremes) for e in device.outputs}
    read |= {f"trace {trace.label!r}": (trace.signal,) for trace in device.views.traces}
    read |= {f"panel {panel.title!r}": panel.names for panel in device.panels or ()}
    own = set(_signals(device.compartments, device.connections))
    if all(own.issuperset(names) for names in read.values()):
        return
    known = own | _patient_signals()
    known |= {s for other in others for s in _signals(other.compartments, other.connections)}
    for reader, names in read.items():
        for name in names:
            if name not in known:
                hint = spelling_hint(name, sorted(own)) or spelling_hint(name, sorted(known))
                allowed = f"P, V or Q before a place, such as {', '.join(sorted(own)[:6])}"
                raise DeviceError(
                    f"device {device.key}, {reader}: {name!r} is not a waveform; allowed: {allowed}{hint}"
                )


def _signals(compartments: Iterable[str], connections: Iterable[str]) -> list[str]:
    """Names of waveforms of compartments and connections; the P of a connection is the head of a pump."""
    of_compartments = [kind + place for place in compartments for kind in "PV"]
    return of_compartments + [kind + place for place in connections for kind in "QP"]


def _patient_signals() -> set[str]:
    """Names of all waveforms of the patient in any anatomy."""
    from eclsim.patient.circulation import Anatomy, circulation

    kinds = itertools.product((False, True), repeat=2)
    circuits = [
        circulation(Anatomy(regional=regional, bronchial=True, collapsible_veins=soft))
        for regional, soft in kinds
    ]
    return {
        signal
        for circuit in circuits
        for signal in _signals((c.name for c in circuit.compartments), (c.name for c in circuit.connections))
    }


def device_of(key: str) -> AnyDevice | None:
    """Device of a section's key or a group, such as "lvad" or "lvad.left"; None if there is none."""
    return devices().get(device_key(key))


@cached_by_devices(8)
def parameters() -> Mapping[str, Parameter]:
    """All parameters that a case file may set, of the patient and of all devices."""
    of_devices = {p.key: p for device in registered() for p in device.parameters}
    return MappingProxyType(patient_parameters() | of_devices)


def find_parameter(name: str) -> Parameter:
    """Find a parameter by its key in upper or lower case (`Rmc`, also `ηB`) or its exact description.

    Raises:
        UnknownParameterError: There is none; suggests the nearest spellings.
    """
    key = ALIASES.get(name.strip(), name.strip()).lower()
    for parameter in parameters().values():
        if key in (parameter.key.lower(), parameter.description.lower()):
            return parameter
    raise UnknownParameterError(name)


def parameter_of(name: str, connected: Collection[str] = ()) -> Parameter | None:
    """Parameter with a name, also of a named instance (`ecmo.left.Recmooxy`); None if there is none.

    Args:
        name: name as in a case file.
        connected: keys of the sections of the connected devices.
    """
    section, dot, key = name.rpartition(".")
    device = device_of(section) if dot and section in connected and section not in devices() else None
    if device is None:
        return parameters().get(name)
    return next((parameter for parameter in device.parameters if parameter.key == key), None)


def example_setting() -> str:
    """Key of a typical setting to adjust, such as the speed of a pump; for examples in messages."""
    return next(f"{key}.{device.adjusted[0]}" for key, device in devices().items() if device.adjusted)


def example_target() -> str:
    """Key of a target for which a setting is solved, such as the flow of a pump; for examples in messages."""
    return next(f"{key}.{device.target.key}" for key, device in devices().items() if device.target)


def line_keys() -> list[str]:
    """Keys of the sites of devices' lines: `scheme` for all lines of a device with schemes, and each line."""
    return [
        f"{key}.{name}"
        for key, device in devices().items()
        for name in (*((SCHEME,) if device.schemes else ()), *device.lines)
    ]


def products() -> dict[str, Product]:
    """Products of which devices consist, by key (the name in case files)."""
    return {product.key: product for device in devices().values() for product in device.products}


def nominal_value(name: str) -> float | None:
    """Usual value of a parameter of a device, also of a named instance; None if there is none."""
    for key, device in devices().items():
        values = {parameter.key: parameter.value for parameter in device.parameters} | dict(device.nominal)
        item = name.removeprefix(f"{key}.").partition(".")[2] if name.startswith(f"{key}.") else ""
        for candidate in (name, f"{key}.{item}", item):
            if candidate in values:
                return values[candidate]
    return None


def namings(groups: Iterable[str]) -> tuple[Naming, ...]:
    """Instances of devices among groups of compartments and connections, in the order of the registry."""
    left = dict.fromkeys(groups)
    return tuple(
        Naming(device, group.partition(".")[2])
        for key, device in devices().items()
        for group in left
        if device_key(group) == key
    )


def instances_in(circuit: Circuit) -> tuple[Naming, ...]:
    """Instances of devices in a circuit, in the order of the registry."""
    return namings(part.group for part in (*circuit.compartments, *circuit.connections))


def assist_connections(circuit: Circuit) -> tuple[str, ...]:
    """Names of connections of pumps that take over the left ventricle's work, such as an LVAD."""
    groups = {names.key for names in instances_in(circuit) if names.device.assist_flow}
    return tuple(c.name for c in circuit.connections if c.group in groups and c.target in ARTERIAL_SITES)


def assist_flows(outputs: Mapping[str, float], circuit: Circuit | None = None) -> dict[str, float]:
    """Flows of pumps that take over the left ventricle's work, by label of the device.

    Args:
        outputs: outputs of a beat, by name.
        circuit: circuit with fixed sites; without it every assist pump is assumed to be a left one.
    """
    left = None if circuit is None else set(assist_connections(circuit))
    result = {}
    for name, value in outputs.items():
        known = named_output(name)
        if known is None or known[1].name != known[0].device.assist_flow:
            continue
        names, entry = known
        if left is None or any(names.signal(signal)[1:] in left for signal in entry.needs):
            result[names.label] = value
    return result


@cached_by_devices(4096)
def named_output(name: str) -> tuple[Naming, Output] | None:
    """Instance and output with a name such as "lvad.left.flow"; None if it is no output of a device."""
    device = device_of(name)
    if device is None:
        owners = ((Naming(owner), entry) for owner in devices().values() for entry in owner.outputs)
        return next(((names, entry) for names, entry in owners if entry.name == name), None)
    names = Naming(device, name.removeprefix(f"{device.key}.").partition(".")[0])
    return next(((names, entry) for entry in device.outputs if names.output(entry.name) == name), None)


def flows_of_own_devices(outputs: Iterable[str]) -> tuple[str, ...]:
    """Mean flows of users' devices among the names of outputs; tables show them beside the patient's."""
    known = ((name, named_output(name)) for name in outputs)
    return tuple(name for name, one in known if one and is_of_user(one[0].device) and one[1].unit == "L/min")


def naming_of(group: str) -> Naming | None:
    """Instance of a device for a group such as "lvad.left"; None for the patient and users' groups."""
    return next(iter(namings([group])), None)
