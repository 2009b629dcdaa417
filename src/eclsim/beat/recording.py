"""What to write down while a beat runs."""

from __future__ import annotations

import difflib
from typing import Any

import jax.numpy as jnp

from eclsim.circuit.assembly import Assembly, Constants
from eclsim.circuit.network import Circuit

RATE = "'"
"""Suffix of a signal's change per unit of phase."""
MEAN = "~"
"""Suffix of a flow's mean over the step that ends here: what moved, whatever a valve did meanwhile."""


class UnknownSignalError(KeyError):
    """A signal that the circuit does not have."""

    def __str__(self) -> str:
        return str(self.args[0])


def all_signals(assembly: Assembly) -> tuple[str, ...]:
    """P and V of every compartment, Q of every connection, P (head) of connections without a namesake."""
    stores = [c.name for c in assembly.circuit.compartments]
    paths = [c.name for c in assembly.circuit.connections]
    heads = [name for name in paths if name not in stores]
    return (
        *("P" + n for n in stores),
        *("P" + n for n in heads),
        *("Q" + n for n in paths),
        *("V" + n for n in stores),
    )


def has_rate(circuit: Circuit, signal: str) -> bool:
    """Whether a signal's rate follows from the flows: a volume, or the pressure of a passive compartment."""
    passive = [c.name for c in circuit.compartments if c.component.constant_stiffness]
    return signal[1:] in (
        passive if signal[0] == "P" else [c.name for c in circuit.compartments if signal[0] == "V"]
    )


def has_mean(circuit: Circuit, signal: str) -> bool:
    """Whether a signal is a flow that opens and shuts, so that its values at the steps' ends do not do."""
    laws = {c.name: c.component for c in circuit.connections}
    return signal[0] == "Q" and signal[1:] in laws and laws[signal[1:]].one_way


def with_means(circuit: Circuit, signals: tuple[str, ...]) -> tuple[str, ...]:
    """Signals, followed by the means of those that have one."""
    return signals + tuple(s + MEAN for s in signals if has_mean(circuit, s))


def with_rates(circuit: Circuit, signals: tuple[str, ...]) -> tuple[str, ...]:
    """Signals, followed by the rates of those that have one."""
    return signals + tuple(s + RATE for s in signals if has_rate(circuit, s))


class Recorder:
    """Picks signals by name: P or V + compartment, Q + connection, P + pump (pressure gained across it).

    Pressures in mmHg, stressed volumes in mL, flows in mL/s, all at the end of a step. `RATE` behind P or V
    of a compartment means its change per unit of phase, which follows from the flows (`has_rate`).
    """

    def __init__(self, assembly: Assembly, signals: tuple[str, ...]):
        self.assembly = assembly
        self.signals = signals
        self._stores = [c.name for c in assembly.circuit.compartments]
        self._paths = [c.name for c in assembly.circuit.connections]
        self._wants_rates = any(signal.endswith(RATE) for signal in signals)
        known = all_signals(assembly)
        for signal in signals:
            plain = signal.removesuffix(RATE).removesuffix(MEAN)
            exists = {RATE: has_rate, MEAN: has_mean}.get(signal[-1])
            if plain not in known or (exists is not None and not exists(assembly.circuit, plain)):
                near = difflib.get_close_matches(signal, known, n=3)
                hint = f"; did you mean {', '.join(near)}?" if near else ""
                raise UnknownSignalError(
                    f"'{signal}' is no signal of this circuit; allowed: {', '.join(known)}{hint}"
                )

    def pick(
        self,
        volumes: Any,
        flows: Any,
        activations: Any,
        constants: Constants,
        period: Any,
        means: Any = None,
    ) -> Any:
        """The signals of one moment, stacked; shape (signals[, patients]).

        `period` of the beat in s; `means` of the flows over the step that ends here.
        """
        pressures, stiffness = self.assembly.pressures(volumes, activations, constants)
        zero = jnp.zeros_like(volumes[0])
        rates = self._volume_rates(flows, constants) if self._wants_rates else []
        found = []
        for signal in self.signals:
            if signal.endswith(RATE):
                position = self._stores.index(signal[1:].removesuffix(RATE))
                value = rates[position] * period * (stiffness[position] if signal[0] == "P" else 1.0)
            elif signal.endswith(MEAN):
                value = self._one(signal.removesuffix(MEAN), volumes, means, pressures, constants)
            else:
                value = self._one(signal, volumes, flows, pressures, constants)
            found.append(value + zero)
        return jnp.stack(found) if found else jnp.zeros((0, *zero.shape))

    def _volume_rates(self, flows: Any, constants: Constants) -> list[Any]:
        """Change of every compartment's volume [mL/s]."""
        rates = [jnp.zeros_like(flows[0]) for _ in self._stores]
        for flow, (source, target) in zip(flows, self.assembly.ends, strict=True):
            self.assembly.add_at(source, rates, -flow, constants)
            self.assembly.add_at(target, rates, flow, constants)
        return rates

    def _one(self, signal: str, volumes: Any, flows: Any, pressures: Any, constants: Constants) -> Any:
        kind, name = signal[0], signal[1:]
        if kind == "Q":
            return flows[self._paths.index(name)]
        if name in self._stores:
            return (volumes if kind == "V" else pressures)[self._stores.index(name)]
        source, target = self.assembly.ends[self._paths.index(name)]
        return self.assembly.at(target, pressures, constants) - self.assembly.at(source, pressures, constants)
