"""Geometry of the schematic: the printed figure's layout with room for larger letters, as plain data."""

from __future__ import annotations

from dataclasses import asdict
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from eclsim.app.display import PATIENT, ink
from eclsim.app.texts import ENGLISH, text
from eclsim.devices.device import Naming
from eclsim.devices.ecmo import POSITIONS
from eclsim.devices.registry import device_of
from eclsim.orbit.model import circuit_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eclsim.cases.case import Case
    from eclsim.circuit import Circuit
    from eclsim.circuit.network import Connection
    from eclsim.reporting.schematic_layout import Layout

WIDER_MM = 1.5
"""Boxes are wider by this on either side than those of the printed figure."""
TALLNESS = 1.35
"""Height over width that the page's pane has: with few devices the rows move apart until it is filled."""
MOST_STRETCH = 1.7
NARROWER = 0.75
"""Without lines of devices the patient's ring is drawn narrower, and so larger."""
_ROOM: dict[str, tuple[float, float]] = {
    "crrt": (2.5, 0.0), "ecmo_upper": (3.0, 0.0), "lungs": (2.5, 0.0), "body": (0.0, 3.5),
}  # fmt: skip
"""Space [mm] above and below a row that larger letters take beyond the printed figure's."""


def drawing_of(case: Case) -> dict[str, Any]:
    """Boxes, lines, symbols and frames of a case's circuit, in millimetres, y downwards."""
    return _drawing(circuit_of(case))


@lru_cache(maxsize=512)
def _drawing(circuit: Circuit) -> dict[str, Any]:
    from eclsim.reporting.schematic_layout import MIDDLE, TITLE_HEIGHT
    from eclsim.reporting.schematic_routes import attachments_of, lanes_needed, route

    names = [c.name for c in circuit.compartments]
    attachments = attachments_of(circuit.connections, names)
    bands = [b for b, node in (("below_crrt", "crrttuin"), ("below_ecmo", "ecmodrain")) if node in names]
    page, sides = _page(names, lanes_needed(attachments, bands), bool(attachments or _pumps(circuit)))
    paths = route(attachments, page)
    reach = [x for path in paths.values() for x, _ in path]
    left, right = min([sides[0], *reach]) - 2.0, max([sides[1], *reach]) + 2.0
    top = TITLE_HEIGHT - 2.0
    groups = {c.name: c.group for c in circuit.connections}
    return {
        "view": [left, top, right - left, page.height - top + 1.0],
        "frames": [
            {"group": g, "x": sides[0], "y": -y1 + 1.0, "w": sides[1] - sides[0], "h": y1 - y0 - 2.0,
             "title": [MIDDLE, _title_height(page, g)], "ink": ink(g), **_frame_texts(g)}
            for g, (y0, y1) in page.frames.items()
        ],
        "boxes": _boxes(circuit, page),
        "wires": _wires(circuit.connections, page),
        "lines": [_line(a, groups[a.name], paths[a.name], page) for a in attachments]
        + _assist(circuit, page),
    }  # fmt: skip


def _page(names: Sequence[str], lanes: dict[str, int], wide: bool) -> tuple[Layout, tuple[float, float]]:
    """The page, stretched to fill the pane, and the left and right side of its frames."""
    from eclsim.reporting.schematic_layout import BOX_WIDTH, FRAME, MIDDLE, ROWS, arrange

    extra = {row: _ROOM.get(row, (0.0, 0.0)) for row in ROWS}
    rows = {row: (above + extra[row][0], below + extra[row][1]) for row, (above, below) in ROWS.items()}
    page, sides = arrange(names, lanes, rows), FRAME
    if not wide and "spare" not in page.frames:
        half = NARROWER * (MIDDLE - 30.0) + 0.5 * BOX_WIDTH + WIDER_MM + 2.0
        sides = (MIDDLE - half, MIDDLE + half)
    stretch = min(max(TALLNESS * (sides[1] - sides[0]) / page.height, 1.0), MOST_STRETCH)
    page = arrange(names, lanes, {row: (stretch * up, stretch * down) for row, (up, down) in rows.items()})
    if sides is not FRAME:
        page.places = {n: (MIDDLE + NARROWER * (x - MIDDLE), y) for n, (x, y) in page.places.items()}
    return page, sides


def _naming(group: str) -> Naming | None:
    """The device that a group of the circuit is, with its instance; None of the patient."""
    device = device_of(group)
    return Naming(device, group.partition(".")[2]) if device else None


def _frame_texts(group: str) -> dict[str, str]:
    """Title of a frame and the unit of its flows."""
    device = _naming(group)
    label = device.label if device else ENGLISH.get(f"frame_{group}", group)
    unit = (device.views() if device else PATIENT).flow_unit.unit
    return {"label": label, "flows": "" if group == "spare" else text("frame_flows", unit=unit)}


def _flow(group: str, name: str) -> dict[str, Any]:
    """How the flow of a connection is written, and the output whose limits mark it."""
    device = _naming(group)
    views = device.views() if device else PATIENT
    return {"ink": ink(group), **asdict(views.flow_unit), "output": views.flow_outputs.get(name, "")}


def _moved(group: str, name: str) -> dict[str, str]:
    """The knob that a line is moved by, the letter on its handle and what it is called."""
    device = _naming(group)
    own = device and device.own(name)
    if not device or not own or not device.device.lines:
        return {"moves": ""}
    connections = list(device.device.connections)
    line = dict(zip((connections[0], connections[-1]), device.device.lines, strict=True)).get(own)
    if line is None:
        return {"moves": ""}
    about = text("schematic_line", device=device.label, line=device.device.connections[own])
    return {"moves": f"{group}.{line}", "letter": line[0].upper(), "about": about}


def _title_height(page: Layout, group: str) -> float:
    """Where a frame's title stands: in the middle, where there is neither label nor line."""
    places = {"crrt": ("crrt", 10.5), "ecmo": ("ecmo_upper", 13.0), "patient": ("heart_upper", -1.0)}
    if group not in places:
        return -page.frames[group][1] + 4.6
    row, below = places[group]
    return -page.rows[row] + below


def _pumps(circuit: Circuit) -> bool:
    return any(c.name == "lvadpump" for c in circuit.connections)


def _boxes(circuit: Circuit, page: Layout) -> list[dict[str, Any]]:
    from eclsim.reporting.schematic_layout import NODES

    positions = {node: position for position, node in POSITIONS.items()}
    found = []
    for compartment in circuit.compartments:
        left, bottom, right, top = page.box(compartment.name)
        place = NODES.get(compartment.name)
        found.append({
            "name": compartment.name, "group": compartment.group,
            "position": positions.get(compartment.name, ""),
            "text": place.words if place else compartment.name, "ink": ink(compartment.group),
            "short": ENGLISH.get(f"box_{compartment.name}", place.words if place else compartment.name),
            "x": left - WIDER_MM, "y": -top, "w": right - left + 2 * WIDER_MM, "h": top - bottom,
        })  # fmt: skip
    return found


def _wires(connections: Sequence[Connection], page: Layout) -> list[dict[str, Any]]:
    """Lines between neighbours."""
    from eclsim.reporting.schematic_layout import MIDDLE, NODES, WIRES

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
            label = (x, y + 10.2 if row == "body" else y - 11.8, "middle")
        else:
            label = (x + (5.0 if x < MIDDLE else -5.0), y - 1.0, "start" if x < MIDDLE else "end")
        found.append({
            "name": connection.name, "text": ENGLISH.get(f"wire_{connection.name}", wire.words),
            **_flow(connection.group, connection.name),
            "symbol": "roller" if connection.component.given_flow else wire.symbol,
            "path": [_down(start), _down(stop)], "at": [x, y], "label": label,
        })  # fmt: skip
    return found


def _line(attachment: Any, group: str, path: Any, page: Layout) -> dict[str, Any]:
    """A device's line to its site, in the direction of flow; `site` is the end that can be moved."""
    from eclsim.reporting.schematic_layout import MIDDLE
    from eclsim.reporting.schematic_routes import stub_middle

    port = attachment.port
    points = [_down(p) for p in (path if port.into_device else path[::-1])]
    x, y = stub_middle(page, port)
    side = 5.0 if x < MIDDLE else -5.0
    return {
        "name": attachment.name, "text": port.words, "symbol": port.symbol, "path": points,
        "at": [x, -y], "label": (x + side, -y - 1.0, "start" if side > 0 else "end"),
        "end": _down(path[0]), "site": attachment.site,
        **_moved(group, attachment.name), **_flow(group, attachment.name),
    }  # fmt: skip


def _assist(circuit: Circuit, page: Layout) -> list[dict[str, Any]]:
    """The LVAD inside the ring of the patient."""
    from eclsim.reporting.schematic_layout import MIDDLE
    from eclsim.reporting.schematic_routes import PUMP_RADIUS, pump_paths

    pump = next((c for c in circuit.connections if c.name == "lvadpump"), None)
    if pump is None or not isinstance(pump.source, str) or not isinstance(pump.target, str):
        return []
    paths = pump_paths(pump.source, pump.target, page)
    if paths is None:
        return []
    inlet, outlet = paths
    x, y = outlet[0][0], outlet[0][1] + PUMP_RADIUS
    return [{
        "name": "lvadpump", "text": "LVAD", "symbol": "pump", **_flow("lvad", "lvadpump"),
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
