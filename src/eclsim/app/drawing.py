"""Geometry of the schematic as plain data: the layout of the printed figure with room for larger text."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from functools import lru_cache
from typing import Any

from eclsim.app.display import PATIENT, ink
from eclsim.app.texts import ENGLISH, text
from eclsim.cases.case import Case
from eclsim.cases.resolve import circuit_of
from eclsim.circuit import Circuit
from eclsim.circuit.network import Connection
from eclsim.devices.registry import instances_in, naming_of
from eclsim.outputs.registry import all_outputs, outputs_of_mean, saturations_in
from eclsim.reporting import schematic_layout as layout
from eclsim.reporting import schematic_routes as routes
from eclsim.reporting.schematic_layout import Attachment, Bridge, HousedBox, Layout, Plan, Wire
from eclsim.reporting.schematic_routes import Path

BOX_MARGIN_MM = 1.5
"""Additional width of boxes on either side compared with the printed figure [mm]."""
HEIGHT_OVER_WIDTH = 1.35
"""Aspect ratio (height / width) of the page's pane; with few devices, rows are spread until it is filled."""
MOST_STRETCH = 1.7
TITLE_SHIFT_MM, LABEL_MM = 40.0, 30.0
"""Shift of a frame title left of the centre, and distance of a line from the centre that causes it [mm]."""
WIDTH_WITHOUT_DEVICES = 0.75
"""Factor by which the patient's ring is narrowed without device lines, and so drawn larger."""
_FIRST_ROW_MM, _LAST_ROW_MM = (2.5, 0.0), (0.0, 3.5)
"""Additional space [mm] above and below for larger text, in each frame's first row and the patient's last."""


def drawing_of(case: Case) -> dict[str, Any]:
    """Return boxes, lines, symbols and frames of a case's circuit, in millimetres, with y downwards."""
    return drawing_of_circuit(circuit_of(case))


@lru_cache(maxsize=512)
def drawing_of_circuit(circuit: Circuit) -> dict[str, Any]:
    """Return the drawing of a circuit with fixed sites."""
    plan = layout.plan_of(circuit)
    page, sides = _page(plan)
    paths = routes.route(plan, page)
    reach = [x for path in paths.values() for x, _ in path]
    left, right = min([sides[0], *reach]) - 2.0, max([sides[1], *reach]) + 2.0
    top = layout.TITLE_HEIGHT - 2.0
    groups = {c.name: c.group for c in circuit.connections}
    silent = layout.without_flow(circuit)
    lines = [
        _line(line, plan, groups[line.name], paths[line.name], page) | {"silent": line.name in silent}
        for line in plan.lines
    ]
    still = {line.frame for line in plan.lines if line.name in silent}
    return {
        "view": [left, top, right - left, page.height - top + 1.0],
        "frames": [
            {"group": g, "x": sides[0], "y": -y1 + 1.0, "w": sides[1] - sides[0], "h": y1 - y0 - 2.0,
             "title": [_title_side(plan, page, g), _title_height(plan, page, g)], "ink": ink(g),
             **_frame_texts(g, g in still)}
            for g, (y0, y1) in page.frames.items()
        ],
        "boxes": _boxes(circuit, plan, page),
        "housed": [_housed(plan, page, box) for box in plan.housed],
        "wires": [_wire(wire, plan, groups[wire.name], page) for wire in plan.wires],
        "lines": [
            *lines,
            *(_bridge(bridge, plan, groups[bridge.name], page) for bridge in plan.bridges),
            *(_arc(c, plan, page) for c in circuit.connections if c.name in plan.others),
        ],
    }  # fmt: skip


def _page(plan: Plan) -> tuple[Layout, tuple[float, float]]:
    """Return the page, stretched to fill the pane, and the left and right edges of its frames."""
    more = {row: _FIRST_ROW_MM if row[1] == 0 else (0.0, 0.0) for row in plan.heights}
    more |= {layout.BODY: _LAST_ROW_MM, layout.LOWER_BODY: _LAST_ROW_MM}
    rows = {row: (up + more[row][0], down + more[row][1]) for row, (up, down) in plan.heights.items()}
    page, sides = layout.arrange(plan, rows), layout.FRAME
    bronchial = any(wire.name == "bronchial" for wire in plan.wires)
    if not (plan.lines or plan.bridges or plan.spare or bronchial or layout.LOWER_BODY in plan.heights):
        half = WIDTH_WITHOUT_DEVICES * (layout.MIDDLE - 30.0) + 0.5 * layout.BOX_WIDTH + BOX_MARGIN_MM + 2.0
        sides = (layout.MIDDLE - half, layout.MIDDLE + half)
    stretch = min(max(HEIGHT_OVER_WIDTH * (sides[1] - sides[0]) / page.height, 1.0), MOST_STRETCH)
    page = layout.arrange(plan, {row: (stretch * up, stretch * down) for row, (up, down) in rows.items()})
    if sides is not layout.FRAME:
        page.places = {
            n: (layout.MIDDLE + WIDTH_WITHOUT_DEVICES * (x - layout.MIDDLE), y)
            for n, (x, y) in page.places.items()
        }
    return page, sides


def _frame_texts(group: str, still: bool) -> dict[str, str]:
    """Return the title of a frame and the units of its pressures and, unless none is shown, its flows."""
    names = naming_of(group)
    label = ENGLISH.get(f"frame_{group}", group) if names is None else names.label
    unit = (PATIENT if names is None else names.views()).flow_unit.unit
    units = text("frame_pressures") if still else text("frame_units", unit=unit)
    return {"label": label, "flows": "" if group == "spare" else units}


def _flow(group: str, name: str) -> dict[str, Any]:
    """Return the format of a connection's flow, and the outputs whose limits mark it."""
    names = naming_of(group)
    views = PATIENT if names is None else names.views()
    outputs = [*filter(None, [views.flow_outputs.get(name)]), *outputs_of_mean(f"Q{name}", group)]
    return {"ink": ink(group), **asdict(views.flow_unit), "outputs": list(dict.fromkeys(outputs))}


def _moved(line: Attachment) -> dict[str, str]:
    """Return the knob that moves a line, the letter on its handle, and its description."""
    names = naming_of(line.frame)
    lines = {} if names is None else {names.place(line): key for key, line in names.device.lines.items()}
    if names is None or line.name not in lines:
        return {"moves": ""}
    key = lines[line.name]
    about = text("schematic_line", device=names.label, line=line.mark.label)
    return {"moves": f"{names.key}.{key}", "letter": key[0].upper(), "about": about}


def _title_side(plan: Plan, page: Layout, group: str) -> float:
    """Return the x position of a frame's title: the centre, or left of it if a line has its label there."""
    lines = [routes.stub_middle(page, line)[0] for line in plan.lines if line.frame == group]
    has_label = any(abs(x - layout.MIDDLE) < LABEL_MM for x in lines)
    return layout.MIDDLE - TITLE_SHIFT_MM * has_label


def _title_height(plan: Plan, page: Layout, group: str) -> float:
    """Return the y position of a frame's title, clear of labels and lines."""
    if group == layout.SPARE or (group == layout.PATIENT and layout.HEART_UPPER not in page.rows):
        return -page.frames[group][1] + 4.6
    if group == layout.PATIENT:
        return -page.rows[layout.HEART_UPPER] - 1.0 - layout.PER_BRIDGE * max(len(plan.bridges) - 1, 0)
    return -page.rows[group, 0] + (13.0 if (group, 1) in page.rows else 10.5)


def _boxes(circuit: Circuit, plan: Plan, page: Layout) -> list[dict[str, Any]]:
    positions = {node: site for names in instances_in(circuit) for site, node in names.sites().items()}
    result = []
    for compartment in (c for c in circuit.compartments if layout.drawn_as(c.name) == c.name):
        left, bottom, right, top = page.box(compartment.name)
        names = naming_of(compartment.group)
        place = compartment.name if names is None else names.device_place(compartment.name)
        label = plan.places[compartment.name].label if compartment.name in plan.places else compartment.name
        box = None if names is None else names.device.boxes.get(place or "")
        result.append({
            "name": compartment.name, "group": compartment.group,
            "position": positions.get(compartment.name, ""),
            "text": label, "short": ENGLISH.get(f"box_{place}", (box and box.short) or label),
            "ink": ink(compartment.group),
            "saturation": list(saturations_in(compartment.name, compartment.group)),
            "x": left - BOX_MARGIN_MM, "y": -top, "w": right - left + 2 * BOX_MARGIN_MM, "h": top - bottom,
        })  # fmt: skip
    return result


def _housed(plan: Plan, page: Layout, box: HousedBox) -> dict[str, Any]:
    """Return the box of a device in the housing of another one's part, and its line to that part's symbol."""
    left, bottom, right, top = layout.housed_box(plan, page, box)
    names, outputs = naming_of(box.group), all_outputs()
    limited = () if names is None else tuple(names.output(limit.quantity) for limit in names.device.limits)
    return {
        "name": box.group, "text": box.label, "ink": ink(box.group),
        "x": left, "y": -top, "w": right - left, "h": top - bottom,
        "path": [_down(p) for p in layout.housed_path(plan, page, box)],
        "readings": [
            {"output": name, "unit": outputs[name].unit, "text": outputs[name].long_name}
            for name in box.readings
        ],
        "limited": list(dict.fromkeys(limited)),
    }  # fmt: skip


def _wire(wire: Wire, plan: Plan, group: str, page: Layout) -> dict[str, Any]:
    """Return a line between neighbours."""
    way = routes.detour(plan, page, wire, BOX_MARGIN_MM)
    path = way.path if way else list(page.between(wire.source, wire.target))
    start, stop = path[0], path[-1]
    x, y = 0.5 * (start[0] + stop[0]), -0.5 * (start[1] + stop[1])
    frame, row = plan.places[wire.source].row
    body = frame == layout.BODY[0] and row >= layout.BODY[1]  # labels are below the lines
    if way:
        label = (way.label[0], -way.label[1] - 1.0, "start" if way.align == "left" else "end")
        x, y = path[1][0], -0.5 * (path[1][1] + path[2][1])
    elif start[1] == stop[1]:
        label = (x, y + 10.2 if body else y - 11.8, "middle")
    else:
        right = x < layout.MIDDLE or body
        down = body and stop[1] < start[1]  # below the label of the wire above
        label = (x + (5.0 if right else -5.0), y + (2.0 if down else -1.0), "start" if right else "end")
    return {
        "name": wire.name, "text": ENGLISH.get(f"wire_{wire.name}", wire.mark.label),
        "ends": [wire.source, wire.target],
        "symbol": wire.mark.symbol, "path": [_down(p) for p in path], "at": [x, y], "label": label,
        **_flow(group, wire.name),
    }  # fmt: skip


def _line(line: Attachment, plan: Plan, group: str, path: Path, page: Layout) -> dict[str, Any]:
    """Return a device's line to its site, in the direction of flow; `site` is the end that can be moved."""
    points = [_down(p) for p in (path if line.into_device else path[::-1])]
    x, y = routes.stub_middle(page, line)
    (beside, _), align = routes.stub_label(plan, page, line)
    return {
        "name": line.name, "text": line.mark.label, "symbol": line.mark.symbol, "path": points,
        "ends": [line.site, line.node] if line.into_device else [line.node, line.site],
        "at": [x, -y], "label": (beside, -y - 1.0, "start" if align == "left" else "end"),
        "end": _down(path[0]), "site": line.site, **_moved(line), **_flow(group, line.name),
    }  # fmt: skip


def _bridge(bridge: Bridge, plan: Plan, group: str, page: Layout) -> dict[str, Any]:
    """Return a pump or shunt inside the ring of the patient."""
    into, out = routes.bridge_paths(plan, page, bridge)
    (x, y), align = routes.bridge_label(plan, page, bridge)
    names = naming_of(group)
    return {
        "name": bridge.name, "text": names.label if names else bridge.name, "symbol": bridge.mark.symbol,
        **_flow(group, bridge.name), "path": [_down(p) for p in into], "more": [_down(p) for p in out],
        "at": [into[-1][0], -y], "label": (x, -y - 1.0, "start" if align == "left" else "end"),
        "end": _down(into[0]), "site": bridge.source, "moves": "", "ends": [bridge.source, bridge.target],
    }  # fmt: skip


def _arc(connection: Connection, plan: Plan, page: Layout) -> dict[str, Any]:
    """Return a connection without a place, as the arc of the printed figure."""
    ends = [layout.drawn_as(str(end)) for end in (connection.source, connection.target)]
    source, target = ends
    _, path = routes.arc(page.box(source), page.box(target), [page.box(name) for name in page.places])
    x, y = path[len(path) // 2]
    names = naming_of(connection.group)
    place = names and names.device_place(connection.name)
    label = names.device.connections.get(place, place) if names and place else connection.name
    return {
        "name": connection.name, "text": label, "symbol": "tube", "path": [_down(p) for p in path],
        "ends": ends, "at": _down((x, y)), "label": (x + 3.0, -y - 1.0, "start"), "end": _down(path[0]),
        "site": source, "moves": "", **_flow(connection.group, connection.name),
    }  # fmt: skip


def _down(point: Sequence[float]) -> list[float]:
    return [round(point[0], 2), round(-point[1], 2)]
