"""Which outputs and waveforms a circuit has, what they need, and how waveforms are labelled."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from eclsim.beat.recording import MEAN, RATE, all_signals, has_mean, has_rate
from eclsim.circuit.assembly import assemble
from eclsim.circuit.network import Circuit, StartPressure
from eclsim.components.base import Values, value_of
from eclsim.outputs.registry import available, output

BLOOD_VOLUME = "total_blood_volume_ml"
UNITS = {"P": "mmHg", "Q": "mL/s", "V": "mL"}
WORDS = {"P": "pressure in", "Q": "flow through", "V": "blood volume of"}


def output_names(circuit: Circuit) -> tuple[str, ...]:
    """All outputs that a circuit has, in the order of the registry."""
    return tuple(o.name for o in available(all_signals(assemble(circuit))))


def needed_signals(
    circuit: Circuit, outputs: Sequence[str], waveforms: Sequence[str] = ()
) -> tuple[str, ...]:
    """Signals that outputs and waveforms are computed from, with the rates that place extremes."""
    entries = [output(name) for name in outputs]
    signals = {*waveforms, *(signal for entry in entries for signal in entry.needs)}
    rates = {signal + RATE for entry in entries for signal in entry.extremes if has_rate(circuit, signal)}
    means = {signal + MEAN for signal in signals if has_mean(circuit, signal)}
    return tuple(sorted(signals | rates | means))


def signal_labels(circuit: Circuit, signal: str) -> dict[str, str]:
    """Unit and long name of a waveform: P or V + compartment, Q + connection, P + pump (head)."""
    kind, place = signal[0], signal[1:]
    head = kind == "P" and all(c.name != place for c in circuit.compartments)
    return {"units": UNITS[kind], "long_name": f"head of {place}" if head else f"{WORDS[kind]} {place}"}


def unstressed_volume(circuit: Circuit, signal: str, values: Values) -> float | np.ndarray:
    """What a waveform of a volume adds to the stressed volume [mL]; 0 for other waveforms.

    It is what a vessel holds at zero pressure: its share of all blood less the stressed start. Zero for
    chambers and extracorporeal compartments, whose stressed volume is all they hold.
    """
    compartment = circuit.compartment(signal[1:]) if signal[0] == "V" else None
    if (
        compartment is None
        or compartment.total_fraction is None
        or not isinstance(compartment.start, StartPressure)
    ):
        return 0.0
    total = value_of(values, compartment.total_fraction) * values[BLOOD_VOLUME]
    law = compartment.component
    with np.errstate(divide="ignore"):
        own = law.constants({n: np.asarray(values[n], dtype=float) for n in law.parameter_names()})
    shift = total - value_of(values, compartment.start.pressure) / law.pressure(0.0, 0.0, own)[1]
    return np.asarray(shift, dtype=float)
