"""Geometry of the schematic: the printed figure's layout, as plain data for the browser."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any

from eclsim.parameters.positions import ECMO_POSITIONS
from eclsim.solver.model import circuit_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eclsim.circuit import Circuit
    from eclsim.circuit.network import Connection
    from eclsim.patients.case import Case
    from eclsim.plotting.schematic_layout import Layout


def drawing_of(case: Case) -> dict[str, Any]:
    """Boxes, lines, symbols and frames of a case's circuit, in millimetres, y downwards."""
    return _drawing(circuit_of(case))


@lru_cache(maxsize=512)
def _drawing(circuit: Circuit) -> dict[str, Any]:
    from eclsim.plotting.schematic_layout import FRAME, TITLE_HEIGHT, arrange
    from eclsim.plotting.schematic_routes import attachments_of, lanes_needed, route

    names = [c.name for c in circuit.compartments]
    attachments = attachments_of(circuit.connections, names)
    bands = [b for b, node in (("below_crrt", "crrttuin"), ("below_ecmo", "ecmodrain")) if node in names]
    page = arrange(names, lanes_needed(attachments, bands))
    paths = route(attachments, page)
    reach = [x for path in paths.values() for x, _ in path]
    left, right = min([FRAME[0], *reach]) - 3.0, max([FRAME[1], *reach]) + 3.0
    top = TITLE_HEIGHT - 2.0
    groups = {c.name: c.group for c in circuit.connections}
    return {
        "view": [left, top, right - left, page.height - top + 1.0],
        "frames": [
            {"group": g, "x": FRAME[0], "y": -y1 + 1.0, "w": FRAME[1] - FRAME[0], "h": y1 - y0 - 2.0}
            for g, (y0, y1) in page.frames.items()
        ],
        "boxes": _boxes(circuit, page),
        "wires": _wires(circuit.connections, page),
        "lines": [_line(a, groups[a.name], paths[a.name], page) for a in attachments]
        + _assist(circuit, page),
    }


def _boxes(circuit: Circuit, page: Layout) -> list[dict[str, Any]]:
    from eclsim.plotting.schematic_layout import NODES

    positions = {node: position for position, node in ECMO_POSITIONS.items()}
    found = []
    for compartment in circuit.compartments:
        left, bottom, right, top = page.box(compartment.name)
        place = NODES.get(compartment.name)
        found.append({
            "name": compartment.name, "group": compartment.group,
            "position": positions.get(compartment.name, ""),
            "words": place.words if place else compartment.name,
            "x": left, "y": -top, "w": right - left, "h": top - bottom,
        })  # fmt: skip
    return found


def _wires(connections: Sequence[Connection], page: Layout) -> list[dict[str, Any]]:
    """Lines between neighbours."""
    from eclsim.components import RollerPump
    from eclsim.plotting.schematic_layout import MIDDLE, NODES, WIRES

    found = []
    for connection in connections:
        wire = WIRES.get(connection.name)
        if wire is None or (connection.source, connection.target) != (wire.source, wire.target):
            continue
        start, stop = _between(page.box(wire.source), page.box(wire.target))
        level = start[1] == stop[1]
        row = NODES[wire.source].row
        x, y = 0.5 * (start[0] + stop[0]), -0.5 * (start[1] + stop[1])
        if level:
            label = (x, y + 8.4 if row == "body" else y - 11.6, "middle")
        else:
            label = (x + (5.0 if x < MIDDLE else -5.0), y - 1.0, "start" if x < MIDDLE else "end")
        found.append({
            "name": connection.name, "group": connection.group, "words": wire.words,
            "symbol": "roller" if isinstance(connection.component, RollerPump) else wire.symbol,
            "path": [_down(start), _down(stop)], "at": [x, y], "label": label,
        })  # fmt: skip
    return found


def _line(attachment: Any, group: str, path: Any, page: Layout) -> dict[str, Any]:
    """A device's line to its site, in the direction of flow; `site` is the end that can be moved."""
    from eclsim.plotting.schematic_layout import MIDDLE
    from eclsim.plotting.schematic_routes import stub_middle

    port = attachment.port
    points = [_down(p) for p in (path if port.into_device else path[::-1])]
    x, y = stub_middle(page, port)
    side = 5.0 if x < MIDDLE else -5.0
    return {
        "name": attachment.name, "group": group, "words": port.words, "symbol": port.symbol, "path": points,
        "at": [x, -y], "label": (x + side, -y - 1.0, "start" if side > 0 else "end"),
        "end": _down(path[0]), "site": attachment.site,
        "moves": {"crrttuin": "access", "crrttuout": "return"}.get(attachment.name, ""),
    }  # fmt: skip


def _assist(circuit: Circuit, page: Layout) -> list[dict[str, Any]]:
    """The LVAD inside the ring of the patient."""
    from eclsim.plotting.schematic_layout import MIDDLE
    from eclsim.plotting.schematic_routes import PUMP_RADIUS, pump_paths

    pump = next((c for c in circuit.connections if c.name == "lvadpump"), None)
    if pump is None or not isinstance(pump.source, str) or not isinstance(pump.target, str):
        return []
    paths = pump_paths(pump.source, pump.target, page)
    if paths is None:
        return []
    inlet, outlet = paths
    x, y = outlet[0][0], outlet[0][1] + PUMP_RADIUS
    return [{
        "name": "lvadpump", "group": "lvad", "words": "LVAD", "symbol": "pump",
        "path": [_down(p) for p in inlet], "more": [_down(p) for p in outlet], "at": [x, -y],
        "label": (MIDDLE + 5.5, -y - 1.0, "start"), "end": _down(inlet[0]), "site": pump.source, "moves": "",
    }]  # fmt: skip


def _between(first: Any, second: Any) -> tuple[Any, Any]:
    """The straight piece between two boxes that stand beside or above each other."""
    (l1, b1, r1, t1), (l2, b2, r2, t2) = first, second
    if abs((b1 + t1) - (b2 + t2)) < 1e-6:
        y = 0.5 * (b1 + t1)
        return ((r1, y), (l2, y)) if l2 > r1 else ((l1, y), (r2, y))
    x = 0.5 * (l1 + r1)
    return ((x, t1), (x, b2)) if b2 > t1 else ((x, b1), (x, t2))


def _down(point: Any) -> list[float]:
    return [round(point[0], 2), round(-point[1], 2)]
