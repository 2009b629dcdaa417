"""In which order the connections of a circuit are solved, one after the other.

A step solves each flow against the latest pressures at its ends (Gauss-Seidel), so its result depends on the
order a little, within the error of the step. The order follows from what is joined to what and from the
names, never from where a connection stands in the table.
"""

from __future__ import annotations

from eclsim.circuit.network import Circuit, Connection, sites_of


def sweep_order(circuit: Circuit) -> tuple[int, ...]:
    """Positions of all connections in the order in which they are solved.

    Group by group, the one with most connections first: the patient, ECMO, CRRT, an assist device. Within a
    group with the flow, from where blood enters it. A loop has no such place; it is cut behind the
    connection whose name is the last in the alphabet, which is the systemic vein (`svn`) in a patient.
    """
    groups: dict[str, dict[str, Connection]] = {}
    for connection in circuit.connections:
        groups.setdefault(connection.group, {})[connection.name] = connection
    place = {connection.name: k for k, connection in enumerate(circuit.connections)}
    own = {c.name: c.group for c in circuit.compartments}
    order: list[int] = []
    for group in sorted(groups, key=lambda g: (-len(groups[g]), g)):
        inside = {name for name, of in own.items() if of == group}
        order += [place[name] for name in _with_the_flow(groups[group], inside)]
    return tuple(order)


def _with_the_flow(connections: dict[str, Connection], inside: set[str]) -> list[str]:
    """Names of the connections of a group, each behind one that ends where it begins if there is one."""
    ends = {name: set(sites_of(c.target)) & inside for name, c in connections.items()}
    begins = {name: set(sites_of(c.source)) & inside for name, c in connections.items()}
    left, order = set(connections), list[str]()
    while left:
        behind = [name for name in left if order and ends[order[-1]] & begins[name]]
        chosen = min(behind or _entrances(left, begins, ends))
        order.append(chosen)
        left.remove(chosen)
    return order


def _entrances(left: set[str], begins: dict[str, set[str]], ends: dict[str, set[str]]) -> list[str]:
    """Connections that none of the others leads to; in a loop those behind the last name of the alphabet."""
    after = {name: [other for other in left if ends[name] & begins[other]] for name in left}
    led_to = {other for others in after.values() for other in others}
    return sorted(left - led_to) or after[max(name for name in left if after[name])]
