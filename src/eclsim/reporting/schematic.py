"""Schematic of the circuit: patient and devices, with mean pressures and flows."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eclsim.arguments import Kind
from eclsim.circuit.network import Circuit
from eclsim.devices.registry import device_of, naming_of
from eclsim.outputs.registry import all_outputs, saturations_in
from eclsim.reporting import schematic_layout as layout
from eclsim.reporting import schematic_routes as routes
from eclsim.reporting.beat_values import (
    beat_mean,
    case_title,
    check_beat,
    figure_marks_at,
    figure_marks_of,
    in_unit,
    legend_of_figure_marks,
    marked,
    scalar,
    summary_lines,
    summary_marks,
)
from eclsim.reporting.numbers import MINUS, number
from eclsim.reporting.schematic_layout import HousedBox, Layout, Plan
from eclsim.reporting.schematic_pen import Pen, look_of
from eclsim.reporting.schematic_routes import Path, Point
from eclsim.reporting.style import GREY, MM_PER_INCH, figure_style, plain_text

if TYPE_CHECKING:
    import xarray as xr

_SATURATION_WIDTH = 7.6
"""Width [mm] of the field that shows a saturation."""
_TITLE_WIDTH = layout.FRAME[1] - layout.FRAME[0] + 6.0
"""Width that the title may have [mm]; it begins left of the frames."""
_BESIDE_SATURATION = 11
"""Number of characters that fit beside a saturation."""
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
    """Draw a circuit as a schematic in which the lines of devices lead to the sites where they are attached.

    Args:
        circuit: any circuit. Compartments that belong to no device and have no place in the patient are drawn
            in a spare row; connections without a place are drawn as arcs.
        result: the simulated case; its mean pressures [mmHg] and flows [L/min, CRRT mL/min] are written at
            compartments and connections. Without it, only names are drawn.
        values: values of the parameters that choose sites (`Choice`), such as `model.values`; the chosen
            sites are drawn. Without them, a note lists the connections whose site is not known.
        ax: axes to draw into, whose size determines the text size; None for a new A4-sized figure.
        title: heading; None for the id of the case.

    Returns:
        The figure that was drawn into.
    """
    Kind(Circuit, "a Circuit, such as eclsim.model_of(case).circuit")("circuit", circuit)
    if result is not None:
        check_beat(result)
    circuit = circuit.with_chosen_sites(values or {})
    plan = layout.plan_of(circuit)
    page = layout.arrange(plan)
    paths = routes.route(plan, page)
    groups = {part.name: part.group for part in (*circuit.compartments, *circuit.connections)}
    labels = Labels(result, groups, layout.without_flow(circuit))
    with_gas = any(labels.saturation(name) is not None for name in page.places)
    note, scale = 5.0 if plan.undrawn else 0.0, 5.0 if with_gas else 0.0
    legend = labels.legend(plan)
    pen = _pen(ax, page, paths.values(), extra=note + scale + 5.0 * bool(legend))
    _draw_frames(pen, plan, page, labels, title)
    _draw_wires(pen, plan, page, labels)
    _draw_lines(pen, plan, page, labels, paths)
    _draw_bridges(pen, plan, page, labels)
    _draw_boxes(pen, plan, page, labels)
    _draw_housed(pen, plan, page, labels)
    _draw_others(pen, plan, page, labels, circuit)
    _note_undrawn(pen, page, plan.undrawn)
    if with_gas:
        pen.saturation_scale(layout.FRAME[1], -page.height - note - 2.0)
    left = pen.ax.get_xlim()[0] + 3.0
    pen.text(left, -page.height - note - scale - 2.0, legend, size=6.5, ha="left", color=GREY)
    return pen.figure


@dataclass(frozen=True)
class Labels:
    """Numbers and texts on the schematic of one circuit; without a result, only names.

    Args:
        result: the simulated case.
        groups: group of each compartment and connection, "patient" or a device, by name.
        silent: connections whose mean flow is not shown, as it is always 0.
    """

    result: "xr.Dataset | None"
    groups: Mapping[str, str]
    silent: frozenset[str] = frozenset()

    def box(self, plan: Plan, name: str) -> tuple[str, str, str]:
        """Return label, key and mean pressure of a compartment; the pressure is empty without a result."""
        pressure = self._mean(f"P{name}", "mmHg", 1)
        if name not in plan.places:
            return plain_text(name, 18), "", pressure
        names = naming_of(self.groups[name])
        place = names.device_place(name) or name if names else name
        positions = {} if names is None else {node: at for at, node in names.device.positions.items()}
        key = f"{positions[place]} ({place})" if place in positions else place
        return plain_text(plan.places[name].label, 22), plain_text(key, 24), pressure

    def marks(self, signal: str) -> str:
        """Return the marks of a mean pressure or flow: limits that it breaks, and cautions."""
        if self.result is None or signal[1:] in self.silent:
            return ""
        return figure_marks_at(self.result, signal, self.groups[signal[1:]])

    def saturation_marks(self, name: str) -> str:
        """Return the marks of the saturation in a compartment."""
        if self.result is None:
            return ""
        return figure_marks_of(self.result, *saturations_in(name, self.groups[name]))

    def legend(self, plan: Plan) -> str:
        """Return the meaning of the marks on the schematic and where their reasons are; empty without any."""
        if self.result is None:
            return ""
        places = [name for name in (*plan.places, *plan.spare) if name in self.groups]
        marks = [
            *summary_marks(self.result),
            *map(self.marks, (f"{kind}{name}" for name in self.groups for kind in "PQ")),
            *(self.saturation_marks(name) for name in places if self.saturation(name) is not None),
            *(self._marks_of_readings(housed) for housed in plan.housed),
        ]
        return legend_of_figure_marks(marks)

    def saturation(self, name: str) -> float | None:
        """Return the oxygen saturation [%] in a compartment; None if gases are not computed."""
        waveform = f"P{name}"
        if self.result is None or waveform not in self.result:
            return None
        return self.result[waveform].attrs.get("SO2")

    def flow(self, name: str) -> str:
        """Return the mean flow of a connection in its device's unit; empty without a result or if silent."""
        if name in self.silent:
            return ""
        device = device_of(self.groups[name])
        unit = "L/min" if device is None else device.views.flow_unit.unit
        return self._mean(f"Q{name}", unit, 2 if unit == "L/min" else 0)

    def head(self, pump: str) -> str:
        """Return the text for the mean pressure rise over a pump, or the drop; empty without a result."""
        mean = self._mean(f"P{pump}", "mmHg", 0)
        word = "drop" if MINUS in mean else "rise"
        return f"{word} {mean.replace(MINUS, '')}" if mean else ""

    def title(self, title: str | None) -> str:
        """Return the given title, or the name of the case."""
        if title is not None:
            return plain_text(title, 60)
        return "Circuit" if self.result is None else case_title(self.result, width_mm=_TITLE_WIDTH)

    def subtitle(self) -> str:
        """Return a description of the numbers, with the blood volume policy."""
        if self.result is None:
            return "Compartments (boxes) and connections (arrows)"
        policy = self.result.attrs.get("blood_volume_policy")
        means = "Mean pressures and mean flows over one beat"
        return f"{means}; blood volume: {plain_text(policy).replace('_', ' ')}" if policy else means

    def summary(self) -> Iterator[str]:
        """Yield the main outputs, one per line."""
        return iter(()) if self.result is None else iter(summary_lines(self.result))

    def readings(self, housed: HousedBox) -> str:
        """Return the outputs in the box of a device with their units; empty without a result."""
        names = housed.readings
        known = {} if self.result is None else {name: scalar(self.result, name) for name in names}
        units = {name: all_outputs()[name].unit for name in names}
        shown = ", ".join(f"{number(v, 0)} {units[name]}" for name, v in known.items() if v is not None)
        return marked(self._marks_of_readings(housed), shown)

    def _marks_of_readings(self, housed: HousedBox) -> str:
        """Return the marks of a device in a housing: also of its limits whose outputs are not in the box."""
        names = naming_of(housed.group)
        limited = () if names is None else (names.output(limit.quantity) for limit in names.device.limits)
        return "" if self.result is None else figure_marks_of(self.result, *housed.readings, *limited)

    def _mean(self, name: str, unit: str, digits: int) -> str:
        if self.result is None or name not in self.result:
            return ""
        value = f"{number(in_unit(beat_mean(self.result, name), unit), digits)} {unit}"
        return marked(self.marks(name), value)


def _pen(ax: Axes | None, page: Layout, paths: Iterable[Path], extra: float) -> Pen:
    reach = [x for path in paths for x, _ in path]
    left, right = min([layout.FRAME[0], *reach]) - 3.0, max([layout.FRAME[1], *reach]) + 3.0
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


_TITLE_CHARACTERS = 34
"""Length of a device's title that ends before the label of the connection between its first two boxes."""


def _draw_frames(pen: Pen, plan: Plan, page: Layout, labels: Labels, title: str | None) -> None:
    left = pen.ax.get_xlim()[0] + 3.0
    pen.text(left, -4.0, labels.title(title), size=9.5, weight="bold", ha="left")
    pen.text(left, -layout.TITLE_HEIGHT + 3.4, labels.subtitle(), size=7, ha="left", color=GREY)
    for frame, (bottom, top) in page.frames.items():
        look = look_of(frame)
        pen.frame(layout.FRAME[0], bottom + 1.0, layout.FRAME[1], top - 1.0, look)
        label = "Further compartments" if frame == layout.SPARE else plan.frames[frame]
        names = naming_of(frame)
        label = label if names is None else names.cut(label, _TITLE_CHARACTERS)
        x, y, align = _title_place(plan, page, frame)
        pen.text(x, y, plain_text(label, 40), size=8, weight="bold", ha=align, color=look.colour)
    for upper, lower in _HEART_SIDES:
        if upper in page.places and lower in page.places:
            left, bottom, _, _ = page.box(lower)
            _, _, right, top = page.box(upper)
            pen.shade(left - 1.5, bottom - 1.5, right + 1.5, top + 1.5)
    if layout.HEART_UPPER in page.rows:
        y = page.rows[layout.HEART_UPPER] + 9.0 + layout.PER_BRIDGE * max(len(plan.bridges) - 1, 0)
        sites = {site for bridge in plan.bridges[1:] for site in (bridge.source, bridge.target)}
        beside = any(page.places[site][0] < layout.MIDDLE for site in sites)
        for line, text in enumerate(labels.summary()):
            pen.text(layout.MIDDLE + (4.0 if beside else 0.0), y - 3.9 * line, text, size=7)


def _title_place(plan: Plan, page: Layout, frame: str) -> tuple[float, float, str]:
    """Return position and alignment of a frame's title: in its second row if there is room, else top left."""
    second = [place.x for place in plan.places.values() if place.row == (frame, 1)]
    if frame != layout.PATIENT and second and all(abs(x - layout.MIDDLE) > 30.0 for x in second):
        beside = any(plan.places[housed.wire.source].row[0] == frame for housed in plan.housed)
        return layout.MIDDLE - 24.0 * beside, page.rows[frame, 1], "center"
    return 15.5, page.frames[frame][1] - 4.2, "left"


def _draw_boxes(pen: Pen, plan: Plan, page: Layout, labels: Labels) -> None:
    for name, (x, y) in page.places.items():
        pen.box(page.box(name), look_of(labels.groups[name]), gid=f"node-{name}")
        label, key, pressure = labels.box(plan, name)
        plain, small = (label, 7.0, "normal", "black"), (key, 6.0, "normal", GREY)
        shown = [line for line in (plain, small, (pressure, 7.0, "bold", "black")) if line[0]]
        saturation = labels.saturation(name)
        for index, (text, size, weight, colour) in enumerate(shown):
            height = y + 3.5 * ((len(shown) - 1) / 2 - index)
            style = {"size": size, "weight": weight, "color": colour}
            if saturation is None or text != pressure:
                pen.text(x, height, text, **style)
                continue
            small = {"size": min(6.3, 6.3 * _BESIDE_SATURATION / len(text))}
            pen.text(x - layout.BOX_WIDTH / 2 + 0.9, height, text, ha="left", **style | small)
            right = x + layout.BOX_WIDTH / 2 - _SATURATION_WIDTH / 2 - 0.7
            pen.saturation((right, height), saturation, _SATURATION_WIDTH, labels.saturation_marks(name))


def _draw_housed(pen: Pen, plan: Plan, page: Layout, labels: Labels) -> None:
    """Draw the boxes of devices that lie in the housing of another device's part."""
    for housed in plan.housed:
        look, box = look_of(housed.group), layout.housed_box(plan, page, housed)
        pen.line(layout.housed_path(plan, page, housed), look, gid=f"line-{housed.group}")
        pen.box(box, look, gid=f"housed-{housed.group}")
        x, y = 0.5 * (box[0] + box[2]), 0.5 * (box[1] + box[3])
        readings = labels.readings(housed)
        pen.text(x, y + 1.75 * bool(readings), plain_text(housed.label, 40), size=7)
        pen.text(x, y - 1.75, readings, size=7, weight="bold")


def _draw_wires(pen: Pen, plan: Plan, page: Layout, labels: Labels) -> None:
    """Draw the connections between neighbours."""
    for wire in plan.wires:
        if way := routes.detour(plan, page, wire):
            pen.line(way.path, look_of(labels.groups[wire.name]))
            pen.label_beside(way.label, [wire.mark.label, labels.flow(wire.name)], way.align)
            continue
        start, stop = page.between(wire.source, wire.target)
        middle = (0.5 * (start[0] + stop[0]), 0.5 * (start[1] + stop[1]))
        look = look_of(labels.groups[wire.name])
        pen.line([start, stop], look)
        pen.symbol(wire.mark.symbol, middle, (stop[0] - start[0], stop[1] - start[1]), look)
        below = wire.source in layout.PATIENT_PLACES and plan.places[wire.source].row[1] >= layout.BODY[1]
        _label_wire(
            pen, middle, wire.mark.label, labels.flow(wire.name), level=start[1] == stop[1], below=below
        )


def _label_wire(pen: Pen, middle: Point, label: str, flow: str, *, level: bool, below: bool) -> None:
    x, y = middle
    if not level:
        beside = x < layout.MIDDLE or below
        pen.label_beside((x + (5.0 if beside else -5.0), y), [label, flow], "left" if beside else "right")
    elif below:
        pen.text(x, y - layout.BOX_HEIGHT / 2 - 2.6, label, size=6.5)
        pen.text(x, y - layout.BOX_HEIGHT / 2 - 5.9, flow, size=7, weight="bold")
    else:
        pen.text(x, y + layout.BOX_HEIGHT / 2 + 5.6, label, size=6.5)
        pen.text(x, y + layout.BOX_HEIGHT / 2 + 2.3, flow, size=7, weight="bold")


def _draw_lines(pen: Pen, plan: Plan, page: Layout, labels: Labels, paths: Mapping[str, Path]) -> None:
    """Draw the lines that run in lanes."""
    for line in plan.lines:
        look = look_of(labels.groups[line.name])
        path = paths[line.name] if line.into_device else paths[line.name][::-1]
        pen.line(path, look, gid=f"line-{line.name}")
        # The tips of cannulae point to the patient.
        pen.symbol(line.mark.symbol, routes.stub_middle(page, line), (0.0, -1.0), look)
        at, align = routes.stub_label(plan, page, line)
        pen.label_beside(at, [line.mark.label, labels.flow(line.name)], align)


def _draw_bridges(pen: Pen, plan: Plan, page: Layout, labels: Labels) -> None:
    """Draw assist pumps and shunts inside the ring of the patient."""
    for bridge in plan.bridges:
        look = look_of(labels.groups[bridge.name])
        into, out = routes.bridge_paths(plan, page, bridge)
        for path in ([*into, *out],) if bridge.mark.symbol == "tube" else (into, out):
            pen.line(path, look, gid=f"line-{bridge.name}")
        direction = out[0][1] - into[-1][1]
        middle = (layout.MIDDLE, into[-1][1] + routes.PUMP_RADIUS * (1.0 if direction > 0 else -1.0))
        pen.symbol(bridge.mark.symbol, middle, (0.0, direction), look)
        at, align = routes.bridge_label(plan, page, bridge)
        lines = [plain_text(bridge.mark.label, 24), labels.flow(bridge.name), labels.head(bridge.name)]
        pen.label_beside(at, lines, align)


def _draw_others(pen: Pen, plan: Plan, page: Layout, labels: Labels, circuit: "Circuit") -> None:
    """Draw connections without a place as arcs, with labels where there is room."""
    blocked = [page.box(name) for name in page.places]
    for connection in (c for c in circuit.connections if c.name in plan.others):
        source, target = layout.fixed_site(connection.source), layout.fixed_site(connection.target)
        if source not in page.places or target not in page.places or source == target:
            continue
        look = look_of(connection.group)
        middle = pen.arc(page.box(source), page.box(target), look, blocked)
        text = " ".join([plain_text(connection.name, 18), labels.flow(connection.name)]).strip()
        pen.text_where_free(middle, text, blocked, size=6.5, colour=look.colour)


def _note_undrawn(pen: Pen, page: Layout, connections: Sequence[str]) -> None:
    if connections:
        names = ", ".join(plain_text(name, 18) for name in connections)
        note = plain_text(f"Not drawn, site chosen by a parameter: {names}", 120)
        left = pen.ax.get_xlim()[0] + 3.0
        pen.text(left, -page.height - 2.0, note, size=6.5, ha="left", color=GREY)
