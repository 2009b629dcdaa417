"""Consistency checks of a circuit: report all mistakes at once, each with what is allowed."""

from __future__ import annotations

from collections import Counter

from eclsim.circuit.network import HEART_RATE, Circuit, Control, sites_of
from eclsim.circuit.signals import Form
from eclsim.spelling import spelling_hint


class CircuitError(ValueError):
    """Raised for a circuit that cannot be simulated; `mistakes` holds one sentence per mistake."""

    def __init__(self, mistakes: list[str]):
        self.mistakes = mistakes
        super().__init__("\n".join(mistakes))


def validate(circuit: Circuit) -> None:
    """Raise `CircuitError` with every mistake of the circuit."""
    mistakes = _duplicates(circuit) + _unknown_sites(circuit) + _loose_ends(circuit)
    mistakes += _controls(circuit) + _exchanges(circuit) + _surroundings(circuit)
    if not circuit.compartments:
        mistakes.append("the circuit has no compartments: add at least one store of blood")
    if mistakes:
        raise CircuitError(mistakes)


def _duplicates(circuit: Circuit) -> list[str]:
    tables = {
        "compartment": circuit.compartments,
        "connection": circuit.connections,
        "controller": circuit.controllers,
        "exchange": circuit.exchanges,
        "surrounding": circuit.surroundings,
    }
    return [
        f"{what} '{name}' appears {count} times: names are unique"
        for what, table in tables.items()
        for name, count in Counter(entry.name for entry in table).items()
        if count > 1
    ]


def _unknown_sites(circuit: Circuit) -> list[str]:
    known = [c.name for c in circuit.compartments]
    mistakes = []
    for connection in circuit.connections:
        for end, site in (("source", connection.source), ("target", connection.target)):
            mistakes += [
                f"connection '{connection.name}': {end} '{name}' is not a compartment of the circuit; "
                f"allowed: {', '.join(known)}{spelling_hint(name, known)}"
                for name in sites_of(site)
                if name not in known
            ]
        if connection.source == connection.target and isinstance(connection.source, str):
            mistakes.append(
                f"connection '{connection.name}': source and target are both '{connection.source}': "
                "a connection joins two different compartments"
            )
    return mistakes


def _loose_ends(circuit: Circuit) -> list[str]:
    if len(circuit.compartments) < 2:
        return []
    touched = {s for c in circuit.connections for s in (*sites_of(c.source), *sites_of(c.target))}
    return [
        f"compartment '{c.name}' has no connection: join it or leave it out"
        for c in circuit.compartments
        if c.name not in touched
    ]


def _controls(circuit: Circuit) -> list[str]:
    """Mistakes of controllers: unknown readings or parameters, and parameters that two controllers set."""
    signals, parameters = list(map(str, circuit.signals())), (HEART_RATE, *circuit.parameter_names())
    mistakes, acting = [], dict[str, Control]()
    for control in circuit.controllers:
        start = f"controller '{control.name}'"
        for reading in control.reads:
            if reading.signal.form is not Form.VALUE or str(reading.signal) not in signals:
                hint = spelling_hint(str(reading.signal), signals)
                mistakes.append(
                    f"{start}: '{reading.signal}' is not a signal of the circuit that it can read{hint}"
                )
        for name in control.acts_on:
            if name not in parameters:
                hint = spelling_hint(name, parameters)
                mistakes.append(
                    f"{start}: it acts on '{name}', which is not a parameter of the circuit{hint}"
                )
            elif name in acting and not (control.component.relative and acting[name].component.relative):
                mistakes.append(f"{start}: it acts on '{name}', and so does controller '{acting[name].name}'")
            acting[name] = control
    return mistakes


def _exchanges(circuit: Circuit) -> list[str]:
    """Mistakes of exchanges: a place that the circuit does not have."""
    places = dict.fromkeys(entry.name for entry in (*circuit.compartments, *circuit.connections))
    return [
        f"exchange '{e.name}': '{e.at}' is not a compartment or connection of the circuit"
        f"{spelling_hint(e.at, places)}"
        for e in circuit.exchanges
        if e.at not in places
    ]


def _surroundings(circuit: Circuit) -> list[str]:
    """Mistakes of surroundings: no members, unknown members, or the name of a compartment or connection."""
    known = [c.name for c in circuit.compartments]
    mistakes = list[str]()
    for around in circuit.surroundings:
        start = f"surrounding '{around.name}'"
        if not around.members:
            mistakes.append(f"{start} has no members: name compartments")
        mistakes += [
            f"{start}: '{name}' is not a compartment of the circuit{spelling_hint(name, known)}"
            for name in around.members
            if name not in known
        ]
        if around.name in (*known, *(c.name for c in circuit.connections)):
            mistakes.append(f"{start}: a compartment or connection has this name too: names are unique")
    return mistakes
