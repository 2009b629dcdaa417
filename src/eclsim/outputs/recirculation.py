"""Recirculation: share of the blood drawn by a device with movable lines that has just passed it.

Blood is marked where it leaves the return line. The balances of `eclsim.gas.transport`, also used for oxygen
and solutes, give the share of it that reaches the access line. If this line is in another device, blood from
the patient counts as fresh; if it is in the patient, blood that has passed the systemic capillaries does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from eclsim.circuit.network import Circuit, Connection
from eclsim.devices.device import Naming
from eclsim.devices.registry import devices, instances_in
from eclsim.units import ML_S_PER_L_MIN

if TYPE_CHECKING:
    from eclsim.gas.transport import Flows

DEFINITION = (
    "share of the access flow that comes from the return line without having passed through the patient; "
    "with the access line on the patient, without having passed through capillaries of the body (steady "
    "mixing)"
)


Labelled = tuple[float, dict[str, str]]
"""A number and its labels: unit, long name and definition."""


def recirculated_fractions(circuit: Circuit, mean_flows: Mapping[str, float]) -> dict[str, float]:
    """Share of the access flow of each device with lines that came from its own return line.

    Args:
        circuit: circuit with fixed sites; devices whose lines have none are left out.
        mean_flows: mean flow of each connection [mL/s]; negative for backward flow.

    Returns:
        Shares by the key of the device's section.
    """
    shares = {names.key: _share(circuit, names, mean_flows) for names in instances_in(circuit)}
    return {key: share for key, share in shares.items() if share is not None}


def recirculation(circuit: Circuit, mean_flows: Mapping[str, float]) -> dict[str, Labelled]:
    """Share and flow [L/min] of each device with labels, by the name of the number."""
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
    single = map(Naming, devices().values())
    return {name: about for names in single if names.device.lines for name, about in _labels(names).items()}


def _labels(names: Naming) -> dict[str, dict[str, str]]:
    numbers = (
        ("fraction", "1", f"recirculated share of the {names.label} flow"),
        ("flow", "L/min", f"recirculated {names.label} flow"),
    )
    return {
        names.output(f"{names.device.key}_recirculated_{what}"): {
            "units": unit, "long_name": long_name, "definition": DEFINITION,
        }
        for what, unit, long_name in numbers
    }  # fmt: skip


def _share(circuit: Circuit, names: Naming, mean_flows: Mapping[str, float]) -> float | None:
    lines = [circuit.connection(names.place(line)) for line in names.device.lines.values()]
    groups = {c.name: c.group for c in circuit.compartments}
    drawing = [c for c in lines if groups.get(str(c.target)) == names.key]
    returning = [c for c in lines if groups.get(str(c.source)) == names.key]
    if len(drawing) != 1 or len(returning) != 1 or not isinstance(returning[0].target, str):
        return None
    access, line_out = drawing[0].source, returning[0].name
    if not isinstance(access, str):
        return None
    mixed_in = groups[access]
    if mixed_in not in {other.key for other in instances_in(circuit)}:
        return _share_of_patient(circuit, access, line_out, mean_flows)
    from eclsim.gas.transport import mixtures

    place = {name: k for k, name in enumerate(n for n, group in groups.items() if group == mixed_in)}
    touching = [c for c in circuit.connections if place.keys() & {c.source, c.target}]
    flows = _flows(touching, place, len(place) + 1, mean_flows)
    if flows is None:
        return None
    inside = [place.keys() >= {c.source, c.target} for c in touching]
    through = [k for k, c in enumerate(touching) if not inside[k] and c.name != line_out]
    returned = [k for k, c in enumerate(touching) if c.name == line_out]
    shares = mixtures(flows, [*returned, *through]).compartments[place[access]]
    return float(shares[: len(returned)].sum())


def _share_of_patient(
    circuit: Circuit, access: str, line_out: str, mean_flows: Mapping[str, float]
) -> float | None:
    """Share in a compartment of the patient that came from a line and has passed no capillaries since."""
    from eclsim.gas.tracers import sources
    from eclsim.gas.transport import mixtures

    place = {c.name: k for k, c in enumerate(circuit.compartments)}
    flows = _flows(circuit.connections, place, len(place), mean_flows)
    if flows is None:
        return None
    return float(mixtures(flows, sources(circuit, line_out)).compartments[place[access], -1])


def _flows(
    connections: Sequence[Connection], place: Mapping[str, int], count: int, mean_flows: Mapping[str, float]
) -> Flows | None:
    """Balanced flows between numbered compartments; None if a site is not fixed.

    In mL/s: the solver's exchange along standing blood is then below 1e-10 of these flows.

    Args:
        connections: connections between the compartments.
        place: number of each compartment; any other one has the last number.
        count: number of compartments.
        mean_flows: mean flow of each connection [mL/s].
    """
    from eclsim.gas.transport import Flows, balanced

    if any(not isinstance(site, str) for c in connections for site in c.sites):
        return None
    ends = np.array([[place.get(str(site), count - 1) for site in (c.source, c.target)] for c in connections])
    leaves, enters = (np.eye(count)[side].T for side in ends.T)
    flow = np.array([mean_flows[c.name] for c in connections])
    forward, backward = np.maximum(flow, 0.0), np.maximum(-flow, 0.0)
    return balanced(Flows(leaves, enters, forward, backward))  # pyright: ignore[reportArgumentType]  # NumPy's
