"""Outputs and waveforms of a circuit, the signals they need, and labels of waveforms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from eclsim.beat.recording import MEAN, RATE, all_signals, has_mean, has_rate
from eclsim.circuit import volumes
from eclsim.circuit.assembly import assemble
from eclsim.circuit.network import HEART_RATE, Circuit
from eclsim.circuit.signals import Kind, Signal
from eclsim.components.base import Number, Values
from eclsim.components.exchangers import GasExchanger
from eclsim.devices.description import GASES
from eclsim.devices.registry import cached_by_devices
from eclsim.gas.network import switches
from eclsim.outputs.alarms import watched_signals
from eclsim.outputs.registry import UnknownOutputError, available, output

KIND_WORDS = {Kind.PRESSURE: "pressure in", Kind.FLOW: "flow through", Kind.VOLUME: "blood volume of"}


@cached_by_devices(256)
def output_names(circuit: Circuit) -> tuple[str, ...]:
    """All outputs that a circuit has, in the order of the registry."""
    parameters = {HEART_RATE, *circuit.parameter_names(), *circuit.content_names()}
    return tuple(o.name for o in available(all_signals(assemble(circuit)), parameters))


def refuse_missing(outputs: Sequence[str], *circuits: Circuit) -> None:
    """Raise an error for the first output that none of the circuits has.

    Raises:
        UnknownOutputError: Says what a case with this output needs, or the nearest spellings.
    """
    had = dict.fromkeys(name for circuit in circuits for name in output_names(circuit))
    for name in outputs:
        if name not in had:
            raise UnknownOutputError(name, tuple(had))


@cached_by_devices(256)
def gas_dependent_outputs(circuit: Circuit, outputs: Sequence[str]) -> tuple[str, ...]:
    """The outputs that depend on the gases of the blood."""
    followed = GASES in circuit.content_names()
    entries = {name: output(name) for name in outputs}
    return tuple(n for n, o in entries.items() if GASES in o.parameters or (followed and o.by_gases))


@cached_by_devices(256)
def needed_signals(
    circuit: Circuit, outputs: Sequence[str], waveforms: Sequence[str] = ()
) -> tuple[str, ...]:
    """Signals needed to compute outputs and waveforms, with the rates that locate extremes."""
    refuse_missing(outputs, circuit)
    entries = [output(name) for name in outputs]
    signals = {*waveforms, *(signal for entry in entries for signal in entry.needs)}
    if any(entry.all_flows for entry in entries):
        signals |= {"Q" + connection.name for connection in circuit.connections}
    if any(entry.in_effect for entry in entries):
        from eclsim.regulation.effects import readings_of, steady_controls

        signals |= {str(reading.signal) for reading in readings_of(steady_controls(circuit))}
    rates = {signal + RATE for entry in entries for signal in entry.extremes if has_rate(circuit, signal)}
    means = {signal + MEAN for signal in signals if has_mean(circuit, signal)}
    return tuple(sorted(signals | rates | means))


@cached_by_devices(256)
def needed_parameters(circuit: Circuit, outputs: Sequence[str]) -> tuple[str, ...]:
    """Parameters that outputs need besides waveforms; with all flows, also those of blood contents."""
    entries = [output(name) for name in outputs]
    names = [name for entry in entries for name in entry.parameters]
    of_blood = dict.fromkeys(name for entry in entries for name in entry.blood_parameters)
    if of_blood:
        present = {*circuit.parameter_names(), *circuit.content_names()}
        names += [name for name in of_blood if name in present]
    if any(entry.all_flows for entry in entries):
        names += [*circuit.content_names(), *switches(circuit)]
    if any(entry.in_effect for entry in entries):
        from eclsim.regulation.effects import parameters_of, steady_controls

        names += parameters_of(steady_controls(circuit))
    return tuple(dict.fromkeys(names))


def watched_waveforms(circuit: Circuit) -> tuple[str, ...]:
    """Waveforms of a circuit whose extremes show whether a patient can have the beat."""
    return watched_signals(all_signals(assemble(circuit)))


def parameters_read(circuit: Circuit) -> tuple[str, ...]:
    """Parameters that a circuit's outputs depend on; those of gas exchange only if gases are computed."""
    read = circuit
    if GASES not in circuit.content_names():
        unmixed = tuple(replace(path, mixing=1.0) for path in circuit.connections)
        others = tuple(e for e in circuit.exchanges if not isinstance(e.component, GasExchanger))
        read = replace(circuit, connections=unmixed, exchanges=others)
    return tuple(dict.fromkeys((HEART_RATE, *circuit.parameter_names(), *read.content_names())))


def signal_labels(circuit: Circuit, name: str) -> dict[str, str]:
    """Unit and long name of a waveform: P or V + compartment, Q + connection, P + connection (head)."""
    signal = Signal.parse(name)
    words = f"{KIND_WORDS[signal.kind]} {signal.place}"
    stores = {compartment.name for compartment in circuit.compartments}
    path = next((c for c in circuit.connections if c.name == signal.place), None)
    if path is not None and signal.kind is Kind.PRESSURE and signal.place not in stores:
        source, target = path.sites
        ends = isinstance(source, str) and isinstance(target, str)
        words = f"head of {signal.place}" + (f": pressure gained from {source} to {target}" if ends else "")
    return {"units": signal.kind.unit, "long_name": words}


def unstressed_volume(circuit: Circuit, name: str, values: Values) -> Number:
    """Volume that is added to the stressed volume in the waveform of a volume [mL]; 0 for other waveforms."""
    signal = Signal.parse(name)
    return volumes.unstressed_volume(circuit, signal.place, values) if signal.kind is Kind.VOLUME else 0.0
