"""Whether a circuit hangs together: all mistakes at once, each with what is allowed."""

from __future__ import annotations

import difflib
from collections import Counter

from eclsim.circuit.network import Circuit, sites_of


class CircuitError(ValueError):
    """A circuit that cannot be simulated; `mistakes` holds one sentence each."""

    def __init__(self, mistakes: list[str]):
        self.mistakes = mistakes
        super().__init__("\n".join(mistakes))


def validate(circuit: Circuit) -> None:
    """Raise `CircuitError` with every mistake of the circuit."""
    mistakes = _duplicates(circuit) + _unknown_sites(circuit) + _loose_ends(circuit)
    if not circuit.compartments:
        mistakes.append("the circuit has no compartments: add at least one store of blood")
    if mistakes:
        raise CircuitError(mistakes)


def _duplicates(circuit: Circuit) -> list[str]:
    found = []
    for what, parts in (("compartment", circuit.compartments), ("connection", circuit.connections)):
        counts = Counter(part.name for part in parts)
        found += [
            f"{what} '{name}' appears {n} times: names are unique" for name, n in counts.items() if n > 1
        ]
    return found


def _unknown_sites(circuit: Circuit) -> list[str]:
    known = [c.name for c in circuit.compartments]
    found = []
    for connection in circuit.connections:
        for end, site in (("source", connection.source), ("target", connection.target)):
            for name in sites_of(site):
                if name not in known:
                    near = difflib.get_close_matches(name, known, n=1)
                    hint = f"; did you mean '{near[0]}'?" if near else ""
                    found.append(
                        f"connection '{connection.name}': {end} '{name}' is no compartment of the circuit; "
                        f"allowed: {', '.join(known)}{hint}"
                    )
        if connection.source == connection.target and isinstance(connection.source, str):
            found.append(
                f"connection '{connection.name}': source and target are both '{connection.source}': "
                "a connection joins two different compartments"
            )
    return found


def _loose_ends(circuit: Circuit) -> list[str]:
    if len(circuit.compartments) < 2:
        return []
    touched = {s for c in circuit.connections for s in (*sites_of(c.source), *sites_of(c.target))}
    return [
        f"compartment '{c.name}' has no connection: join it or leave it out"
        for c in circuit.compartments
        if c.name not in touched
    ]
