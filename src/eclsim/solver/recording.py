"""What to write down while a beat runs."""

from __future__ import annotations

import difflib
from typing import Any

import jax.numpy as jnp

from eclsim.circuit.assembly import Assembly, Constants


class UnknownSignalError(KeyError):
    """A signal that the circuit does not have."""

    def __str__(self) -> str:
        return str(self.args[0])


def all_signals(assembly: Assembly) -> tuple[str, ...]:
    """P and V of every compartment, Q of every connection, P (head) of every connection without a namesake."""
    stores = [c.name for c in assembly.circuit.compartments]
    paths = [c.name for c in assembly.circuit.connections]
    heads = [name for name in paths if name not in stores]
    return (*("P" + n for n in stores), *("P" + n for n in heads), *("Q" + n for n in paths), *("V" + n for n in stores))


class Recorder:
    """Picks signals by name: P or V + compartment, Q + connection, P + pump (pressure gained across it).

    Pressures in mmHg, stressed volumes in mL, flows in mL/s, all at the end of a step.
    """

    def __init__(self, assembly: Assembly, signals: tuple[str, ...]):
        self.assembly = assembly
        self.signals = signals
        known = all_signals(assembly)
        for signal in signals:
            if signal not in known:
                near = difflib.get_close_matches(signal, known, n=3)
                hint = f"; did you mean {', '.join(near)}?" if near else ""
                raise UnknownSignalError(f"'{signal}' is no signal of this circuit; allowed: {', '.join(known)}{hint}")

    def pick(self, volumes: Any, flows: Any, activations: Any, constants: Constants) -> Any:
        """The signals of one moment, stacked; shape (signals[, patients])."""
        pressures, _ = self.assembly.pressures(volumes, activations, constants)
        zero = jnp.zeros_like(volumes[0])
        found = [self._one(signal, volumes, flows, pressures, constants) + zero for signal in self.signals]
        return jnp.stack(found) if found else jnp.zeros((0, *zero.shape))

    def _one(self, signal: str, volumes: Any, flows: Any, pressures: Any, constants: Constants) -> Any:
        kind, name = signal[0], signal[1:]
        stores = [c.name for c in self.assembly.circuit.compartments]
        paths = [c.name for c in self.assembly.circuit.connections]
        if kind == "Q":
            return flows[paths.index(name)]
        if name in stores:
            return (volumes if kind == "V" else pressures)[stores.index(name)]
        source, target = self.assembly.ends[paths.index(name)]
        return self.assembly.at(target, pressures, constants) - self.assembly.at(source, pressures, constants)
