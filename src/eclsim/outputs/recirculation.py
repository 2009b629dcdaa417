"""How much of the blood that a device with movable lines draws, such as a CRRT, has just been through it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from eclsim.circuit.network import Circuit
from eclsim.devices.device import Naming
from eclsim.devices.registry import devices, instances_in
from eclsim.units import ML_S_PER_L_MIN

DEFINITION = "share of the access flow that left the return line and did not pass the patient (steady mixing)"


Labelled = tuple[float, dict[str, str]]
"""A number, with unit, long name and definition."""


def recirculated_fractions(circuit: Circuit, mean_flows: Mapping[str, float]) -> dict[str, float]:
    """Share of the access flow of each device with lines that came out of its return line.

    A tracer of concentration 1 leaves the return line; blood of the patient has none; every extracorporeal
    compartment mixes what flows in. Steady balance: sum(Q_in c_upstream) = c sum(Q_in).

    Args:
        circuit: with fixed sites; a device whose lines have none is left out.
        mean_flows: mean flow of each connection [mL/s]; a negative one runs backwards.

    Returns:
        By the key of the device's section; 0 where it draws from the patient.
    """
    shares = {names.key: _share(circuit, names, mean_flows) for names in instances_in(circuit)}
    return {key: share for key, share in shares.items() if share is not None}


def recirculation(circuit: Circuit, mean_flows: Mapping[str, float]) -> dict[str, Labelled]:
    """Share and flow [L/min] of each device by the name of the number, with its labels."""
    result: dict[str, Labelled] = {}
    shares = recirculated_fractions(circuit, mean_flows)
    for names in instances_in(circuit):
        if names.key in shares:
            share, drawn = shares[names.key], mean_flows[names.pumps()[0]] / ML_S_PER_L_MIN
            values = (share, share * drawn)
            result |= {n: (v, about) for (n, about), v in zip(_labels(names).items(), values, strict=True)}
    return result


def recirculation_labels() -> dict[str, dict[str, str]]:
    """Units, long names and definitions of all such numbers by name."""
    alone = map(Naming, devices().values())
    return {name: about for names in alone if names.device.lines for name, about in _labels(names).items()}


def _labels(names: Naming) -> dict[str, dict[str, str]]:
    units = {
        "fraction": ("1", "recirculated share of the {} flow"),
        "flow": ("L/min", "recirculated {} flow"),
    }
    return {
        names.output(f"{names.device.key}_recirculated_{what}"): {
            "units": unit, "long_name": words.format(names.label), "definition": DEFINITION,
        }
        for what, (unit, words) in units.items()
    }  # fmt: skip


def _share(circuit: Circuit, names: Naming, mean_flows: Mapping[str, float]) -> float | None:
    lines = [circuit.connection(names.place(line)) for line in names.device.lines.values()]
    groups = {c.name: c.group for c in circuit.compartments}
    drawing = [c for c in lines if groups.get(str(c.target)) == names.key]
    returning = [c for c in lines if groups.get(str(c.source)) == names.key]
    ends = (c.name for c in (*drawing, *returning))
    if len(drawing) != 1 or len(returning) != 1 or not isinstance(returning[0].target, str):
        return None
    access, line_in, line_out = drawing[0].source, *ends
    if not isinstance(access, str):
        return None
    mixed_in = groups[access]
    if mixed_in not in {other.key for other in instances_in(circuit)}:
        return 0.0
    place = {name: i for i, name in enumerate(n for n, group in groups.items() if group == mixed_in)}
    balance, inflow = np.zeros((len(place), len(place))), np.zeros(len(place))
    for connection in circuit.connections:
        flow = mean_flows[connection.name]
        up, down = connection.source, connection.target
        if not isinstance(up, str) or not isinstance(down, str):
            return None
        if flow < 0.0:
            up, down, flow = down, up, -flow
        if down not in place or connection.name == line_in:
            continue
        balance[place[down], place[down]] += flow
        if connection.name == line_out:
            inflow[place[down]] += flow
        elif up in place:
            balance[place[down], place[up]] -= flow
    return float(np.linalg.lstsq(balance, inflow, rcond=None)[0][place[access]])
