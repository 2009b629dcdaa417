"""The circuit as a schematic: patient, ECMO, CRRT and LVAD, with mean pressures and flows."""

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eclsim.reporting.schematic_labels import Labels
from eclsim.reporting.schematic_layout import (
    BOX_HEIGHT,
    FRAME,
    MIDDLE,
    NODES,
    TITLE_HEIGHT,
    WIRES,
    Layout,
    arrange,
)
from eclsim.reporting.schematic_pen import Pen, stroke_of
from eclsim.reporting.schematic_routes import (
    PUMP_RADIUS,
    Attachment,
    Path,
    Point,
    attachments_of,
    fixed_site,
    lanes_needed,
    pump_paths,
    route,
    stub_middle,
)
from eclsim.reporting.style import GREY, MM_PER_INCH, figure_style, plain_text

if TYPE_CHECKING:
    import xarray as xr

    from eclsim.circuit import Circuit
    from eclsim.circuit.network import Connection

_FRAME_WORDS = {
    "patient": "Patient",
    "ecmo": "ECMO circuit",
    "crrt": "CRRT circuit",
    "spare": "Further compartments",
}
_HEART_SIDES = (("rv", "ra"), ("la", "lv"))


@figure_style()
def draw_circuit(
    circuit: "Circuit",
    result: "xr.Dataset | None" = None,
    *,
    values: Mapping[str, float] | None = None,
    ax: Axes | None = None,
    title: str | None = None,
) -> Figure:
    """Draws a circuit as a schematic, lines of devices leading to the sites they are attached to.

    Args:
        circuit: any circuit. Compartments without a place in the layout tables stand in a spare row;
            connections without one are drawn as arcs.
        result: the simulated case; its mean pressures [mmHg] and flows [L/min, CRRT mL/min] are written at
            the compartments and connections. Without it names alone are drawn.
        values: of the parameters that choose sites (`Choice`), such as `model.values`: the chosen sites are
            drawn. Without them a note names the connections whose site is not known.
        ax: axes to draw into, whose size then sets the size of the text; a new A4-sized figure if left out.
        title: heading; the id of the case if left out.

    Returns:
        The figure that was drawn into.
    """
    circuit = circuit.with_chosen_sites(values or {})
    names = [compartment.name for compartment in circuit.compartments]
    attachments = attachments_of(circuit.connections, names)
    devices = [
        band for band, node in (("below_crrt", "crrttuin"), ("below_ecmo", "ecmodrain")) if node in names
    ]
    page = arrange(names, lanes_needed(attachments, devices))
    paths = route(attachments, page)
    undrawn = [c for c in circuit.connections if fixed_site(c.source) is None or fixed_site(c.target) is None]
    pen = _pen(ax, page, paths.values(), extra=5.0 if undrawn else 0.0)
    labels = Labels(result)
    _draw_frames(pen, page, labels, title)
    rest = _draw_wires(pen, page, labels, [c for c in circuit.connections if c not in undrawn])
    rest = _draw_attachments(pen, page, labels, attachments, paths, rest)
    rest = _draw_assist_pump(pen, page, labels, rest)
    _draw_nodes(pen, page, labels, circuit)
    _draw_others(pen, page, labels, rest)
    _note_undrawn(pen, page, undrawn)
    return pen.figure


def _pen(ax: Axes | None, page: Layout, paths: Iterable[Path], extra: float) -> Pen:
    reach = [x for path in paths for x, _ in path]
    left, right = min([FRAME[0], *reach]) - 3.0, max([FRAME[1], *reach]) + 3.0
    width, height = right - left, page.height + 2.0 + extra
    if ax is None:
        figure = Figure(figsize=(width / MM_PER_INCH, height / MM_PER_INCH))
        ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        scale = 1.0
    else:
        box = ax.get_window_extent()
        dots_per_mm = ax.get_figure(root=True).dpi / MM_PER_INCH  # pyright: ignore[reportOptionalMemberAccess] - axes of a figure
        scale = min(box.width / width, box.height / height) / dots_per_mm
    ax.set_xlim(left, right)
    ax.set_ylim(-height, 0.0)
    ax.set_aspect("equal")
    ax.set_axis_off()
    return Pen(ax, scale)


def _draw_frames(pen: Pen, page: Layout, labels: Labels, title: str | None) -> None:
    left = pen.ax.get_xlim()[0] + 3.0
    pen.text(left, -4.0, labels.title(title), size=9.5, weight="bold", ha="left")
    pen.text(left, -TITLE_HEIGHT + 3.4, labels.subtitle(), size=7, ha="left", color=GREY)
    for group, (bottom, top) in page.frames.items():
        pen.frame(FRAME[0], bottom + 1.0, FRAME[1], top - 1.0, stroke_of(group))
        x, y = (MIDDLE, page.rows["ecmo_lower"]) if group == "ecmo" else (15.5, top - 4.2)
        pen.text(
            x,
            y,
            _FRAME_WORDS[group],
            size=8,
            weight="bold",
            ha="center" if group == "ecmo" else "left",
            color=stroke_of(group).colour,
        )
    for upper, lower in _HEART_SIDES:
        if upper in page.places and lower in page.places:
            left, bottom, _, _ = page.box(lower)
            _, _, right, top = page.box(upper)
            pen.shade(left - 1.5, bottom - 1.5, right + 1.5, top + 1.5)
    if "heart_upper" in page.rows:
        for line, text in enumerate(labels.summary()):
            pen.text(MIDDLE, page.rows["heart_upper"] + 9.0 - 3.9 * line, text, size=7)


def _draw_nodes(pen: Pen, page: Layout, labels: Labels, circuit: "Circuit") -> None:
    for compartment in circuit.compartments:
        x, y = page.places[compartment.name]
        pen.box(page.box(compartment.name), stroke_of(compartment.group), gid=f"node-{compartment.name}")
        words, key, pressure = labels.node(compartment.name)
        lines = [
            (words, 7.0, "normal", "black"),
            (key, 6.0, "normal", GREY),
            (pressure, 7.0, "bold", "black"),
        ]
        shown = [line for line in lines if line[0]]
        for index, (text, size, weight, colour) in enumerate(shown):
            pen.text(
                x, y + 3.5 * ((len(shown) - 1) / 2 - index), text, size=size, weight=weight, color=colour
            )


def _draw_wires(
    pen: Pen, page: Layout, labels: Labels, connections: "Sequence[Connection]"
) -> "list[Connection]":
    """Draws the connections between neighbours; returns the others."""
    rest = []
    for connection in connections:
        wire = WIRES.get(connection.name)
        ends = (fixed_site(connection.source), fixed_site(connection.target))
        if wire is None or ends != (wire.source, wire.target) or not set(ends) <= set(page.places):
            rest.append(connection)
            continue
        start, stop = pen.between(page.box(wire.source), page.box(wire.target))
        middle = (0.5 * (start[0] + stop[0]), 0.5 * (start[1] + stop[1]))
        stroke = stroke_of(connection.group)
        pen.line([start, stop], stroke)
        symbol = "roller" if connection.component.given_flow else wire.symbol
        pen.symbol(symbol, middle, (stop[0] - start[0], stop[1] - start[1]), stroke)
        _label_wire(
            pen,
            middle,
            wire.words,
            labels.flow(connection.name),
            NODES[wire.source].row,
            level=start[1] == stop[1],
        )
    return rest


def _label_wire(pen: Pen, middle: Point, words: str, flow: str, row: str, *, level: bool) -> None:
    x, y = middle
    if not level:
        pen.label_beside(
            (x + (5.0 if x < MIDDLE else -5.0), y), [words, flow], "left" if x < MIDDLE else "right"
        )
    elif row == "body":
        pen.text(x, y - BOX_HEIGHT / 2 - 2.6, words, size=6.5)
        pen.text(x, y - BOX_HEIGHT / 2 - 5.9, flow, size=7, weight="bold")
    else:
        pen.text(x, y + BOX_HEIGHT / 2 + 5.6, words, size=6.5)
        pen.text(x, y + BOX_HEIGHT / 2 + 2.3, flow, size=7, weight="bold")


def _draw_attachments(
    pen: Pen,
    page: Layout,
    labels: Labels,
    attachments: Sequence[Attachment],
    paths: Mapping[str, Path],
    connections: "Sequence[Connection]",
) -> "list[Connection]":
    groups = {connection.name: connection.group for connection in connections}
    for attachment in attachments:
        port = attachment.port
        stroke = stroke_of(groups[attachment.name])
        path = paths[attachment.name] if port.into_device else paths[attachment.name][::-1]
        pen.line(path, stroke, gid=f"line-{attachment.name}")
        middle = stub_middle(page, port)
        pen.symbol(port.symbol, middle, (0.0, -1.0), stroke)  # cannula tips point to the patient
        x, y = middle
        side = 5.0 if x < MIDDLE else -5.0
        pen.label_beside(
            (x + side, y), [port.words, labels.flow(attachment.name)], "left" if side > 0 else "right"
        )
    drawn = {attachment.name for attachment in attachments}
    return [connection for connection in connections if connection.name not in drawn]


def _draw_assist_pump(
    pen: Pen, page: Layout, labels: Labels, connections: "Sequence[Connection]"
) -> "list[Connection]":
    """Draws the LVAD inside the ring of the patient; returns the other connections."""
    pump = next((c for c in connections if c.name == "lvadpump"), None)
    if pump is None:
        return list(connections)
    inlet, outlet = fixed_site(pump.source), fixed_site(pump.target)
    paths = pump_paths(inlet, outlet, page) if inlet and outlet else None
    if paths is None:
        return list(connections)
    stroke = stroke_of("lvad")
    for path in paths:
        pen.line(path, stroke, gid="line-lvadpump")
    at = paths[1][0]
    pen.symbol("pump", (at[0], at[1] + PUMP_RADIUS), (0.0, -1.0), stroke)
    lines = ["LVAD pump", labels.flow("lvadpump"), labels.head("lvadpump")]
    pen.label_beside((MIDDLE + 5.5, at[1] + PUMP_RADIUS), [line for line in lines if line], "left")
    return [connection for connection in connections if connection is not pump]


def _draw_others(pen: Pen, page: Layout, labels: Labels, connections: "Sequence[Connection]") -> None:
    """Draws connections that the layout does not know as arcs, labels where there is room."""
    blocked = [page.box(name) for name in page.places]
    for connection in connections:
        source, target = fixed_site(connection.source), fixed_site(connection.target)
        if source not in page.places or target not in page.places or source == target:
            continue
        stroke = stroke_of(connection.group)
        middle = pen.arc(page.box(source), page.box(target), stroke, blocked)
        text = " ".join([plain_text(connection.name, 18), labels.flow(connection.name)]).strip()
        pen.text_where_free(middle, text, blocked, size=6.5, colour=stroke.colour)


def _note_undrawn(pen: Pen, page: Layout, connections: "Sequence[Connection]") -> None:
    if connections:
        names = ", ".join(plain_text(c.name, 18) for c in connections)
        note = plain_text(f"Not drawn, site chosen by a parameter: {names}", 120)
        left = pen.ax.get_xlim()[0] + 3.0
        pen.text(left, -page.height - 2.0, note, size=6.5, ha="left", color=GREY)
