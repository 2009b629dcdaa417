"""Trial of a user's device when it is registered: its circuit is built once from its `usual` section.

A mistake in the circuit is then said by name and at once, not as a traceback out of the first beat.
"""

from __future__ import annotations

import inspect
import itertools
from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from pydantic import ValidationError

from eclsim.devices.device import AnyDevice, DeviceError, Instance
from eclsim.inputs.mistakes import ListedError
from eclsim.parameters import patient_parameters
from eclsim.spelling import spelling_hint

if TYPE_CHECKING:
    from eclsim.circuit.network import Circuit
    from eclsim.inputs.sections import Section


def try_device(device: AnyDevice, others: Sequence[AnyDevice], sections: Collection[str]) -> None:
    """Build circuit and values of a device from its `usual` section; nothing is done if it has none.

    Args:
        device: the device.
        others: all other devices; their sites may be named, and their parameters read.
        sections: other sections of a case, whose values may be read.

    Raises:
        DeviceError: The circuit is not consistent, a parameter has no value, or a law cannot be used.
    """
    section = _usual_section(device)
    if section is None:
        return
    from eclsim.circuit.own_laws import mistakes_of_own_laws

    instance = Instance(device, section=section)
    circuit, values = _built(device, instance)
    where = f"device {device.key}, {type(device).__name__}.circuit"
    if mistakes := _mistakes_of_circuit(circuit, others):
        raise DeviceError(f"{where}: {'; '.join(mistakes)}")
    known = values | {p.key: p.value for p in patient_parameters().values()}
    known |= {p.key: p.value for other in others for p in other.parameters}
    elsewhere = (*sections, *(other.key for other in others))
    if mistakes := _without_value(circuit, known, elsewhere):
        raise DeviceError(f"{where}: {'; '.join(mistakes)}")
    if mistakes := mistakes_of_own_laws(circuit, known):
        raise DeviceError(f"device {device.key}, {'; '.join(mistakes)}")


def _usual_section(device: AnyDevice) -> Section | None:
    """The section with which the page connects the device; None if there is none."""
    if not device.usual:
        return None
    try:
        return device.section.model_validate(dict(device.usual))
    except ValidationError as error:
        found = [one.get("ctx", {}).get("error", one["msg"]) for one in error.errors()]
        mistakes = (m for e in found for m in (e.mistakes if isinstance(e, ListedError) else [e]))
        raise DeviceError(f"device {device.key}, usual: {'; '.join(map(str, mistakes))}") from None


def _built(device: AnyDevice, instance: Instance) -> tuple[Circuit, dict[str, float]]:
    from eclsim.circuit.network import Circuit
    from eclsim.circuit.own_laws import cause

    what = "circuit"
    try:
        circuit = device.circuit(instance.section)
        if isinstance(circuit, Circuit):
            circuit, what = instance.circuit(), "values"
            return circuit, instance.values(gases=True)
    except DeviceError:
        raise
    except Exception as error:
        file = inspect.getsourcefile(type(device)) or ""
        name = f"{type(device).__name__}.{what}"
        raise DeviceError(
            f"device {device.key}, {name} of the `usual` section: {cause(error, file)}"
        ) from error
    raise DeviceError(f"device {device.key}, {type(device).__name__}.circuit must return a Circuit")


def _mistakes_of_circuit(circuit: Circuit, others: Sequence[AnyDevice]) -> list[str]:
    """Mistakes of a device's circuit, connected to a patient and to what it names of other devices."""
    from eclsim.circuit.network import Circuit, Compartment, sites_of
    from eclsim.circuit.validation import CircuitError, validate
    from eclsim.components import ElasticVessel
    from eclsim.patient.circulation import Anatomy, circulation

    named = {site for c in circuit.connections for end in c.sites for site in sites_of(end)}
    places = {place for other in others for place in (*other.positions, *other.compartments)}
    elsewhere = places | {place for other in others for place in other.connections}
    exchanges = tuple(e for e in circuit.exchanges if e.at not in elsewhere)
    own = replace(circuit, controllers=(), exchanges=exchanges)
    mistakes = list[str]()
    for regional, soft in itertools.product((False, True), repeat=2):
        patient = circulation(Anatomy(regional=regional, bronchial=True, collapsible_veins=soft))
        present = {c.name for c in (*patient.compartments, *circuit.compartments)}
        added = tuple(Compartment(name, ElasticVessel(1.0)) for name in sorted(named & places - present))
        try:
            validate(patient + Circuit(added) + own)
        except CircuitError as error:
            mistakes = mistakes or error.mistakes
        else:
            return []
    return mistakes


def _without_value(circuit: Circuit, known: Collection[str], elsewhere: Collection[str]) -> list[str]:
    """One sentence for each parameter that the circuit reads and nothing gives."""
    from eclsim.circuit.network import BLOOD_VOLUME, HEART_RATE

    read = dict.fromkeys((*circuit.parameter_names(), *circuit.content_names()))
    missing = [n for n in read if n not in known and n not in (HEART_RATE, BLOOD_VOLUME)]
    way = "give it in `values` or `parameters` of the device"
    return [
        f"no value for {name!r}, which {_reader(circuit, name)} reads: {way}{spelling_hint(name, known)}"
        for name in missing
        if name.partition(".")[0] not in elsewhere
    ]


def _reader(circuit: Circuit, name: str) -> str:
    """Part of the circuit that reads a parameter, in words."""
    tables = {"compartment": circuit.compartments, "connection": circuit.connections}
    read = {
        f"{what} '{part.name}'": (*part.parameter_names(), *part.content_names())
        for what, table in tables.items()
        for part in table
    } | {f"exchange '{e.name}'": e.content_names() for e in circuit.exchanges}
    return next((part for part, names in read.items() if name in names), "it")
