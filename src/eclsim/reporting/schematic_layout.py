"""Layout of the schematic: positions of compartments and connections, and page dimensions, in millimetres.

The patient is a ring: right heart on the left side, lungs at the top, left heart on the right side, body at
the bottom. Devices are in frames above the patient. Lines between devices and sites run in lanes around the
frames. A device without compartments of its own, such as an assist pump, is inside the ring.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal

from eclsim.devices.description import Box, Mark
from eclsim.devices.device import Naming
from eclsim.devices.registry import instances_in, naming_of
from eclsim.patient.sites import DRAINED

if TYPE_CHECKING:
    from eclsim.circuit import Circuit
    from eclsim.circuit.network import Connection

Side = Literal["left", "right", "up", "down"]
Row = tuple[str, int]
"""Name of the frame, and number of the row counted from the frame's top."""

BOX_WIDTH = 28.5
BOX_HEIGHT = 12.0
HOUSED_WIDTH = 48.0
LANE_PITCH = 3.8
COLUMNS = (30.0, 70.0, 110.0, 150.0)
MIDDLE = 90.0
LEFT_LANE, RIGHT_LANE = 10.0, 170.0
FRAME = (13.0, 167.0)
TITLE_HEIGHT = 12.0
STUB = 12.5
PATIENT, SPARE = "patient", "spare"
LUNGS, HEART_UPPER, HEART_LOWER, BODY, LOWER_BODY = ((PATIENT, row) for row in range(5))
PER_BRIDGE = 27.0
"""Height [mm] required by each further pump inside the ring."""
_SPARE_ROW = 22.0
_PATIENT_HEIGHTS = {
    LUNGS: (15.0, 6.0),
    HEART_UPPER: (19.0, 6.0),
    HEART_LOWER: (19.0, 6.0),
    BODY: (19.0, 14.5),
    LOWER_BODY: (19.0, 14.5),
}
"""Space [mm] above and below the centre line of each row, which also holds the labels of wires."""


@dataclass(frozen=True)
class BoxPosition:
    """Position of a compartment's box: row, centre of its column [mm], label, and side facing the lanes."""

    row: Row
    x: float
    label: str
    side: Side


@dataclass(frozen=True)
class Wire:
    """A connection between two neighbours."""

    name: str
    source: str
    target: str
    mark: Mark


@dataclass(frozen=True)
class Attachment:
    """A line in lanes, between a compartment of a device and a site.

    A vent, which has no compartment, is a line of the device into which it drains.

    Args:
        name: name of the connection.
        site: compartment outside the device.
        node: compartment of the device.
        frame: frame of the device with this compartment.
        into_device: whether blood flows from the site into the device.
        mark: symbol and label at the device's end.
        port: number of lines placed before this one at the same compartment of the device.
    """

    name: str
    site: str
    node: str
    frame: str
    into_device: bool
    mark: Mark
    port: int = 0


@dataclass(frozen=True)
class Bridge:
    """A connection of a device without compartments, between two sites of the patient."""

    name: str
    source: str
    target: str
    mark: Mark


@dataclass(frozen=True)
class HousedBox:
    """Box of a device that lies in the housing of a connection of another device.

    Args:
        group: group of the device.
        label: text in the box.
        wire: the connection.
        readings: outputs whose numbers are in the box.
    """

    group: str
    label: str
    wire: Wire
    readings: tuple[str, ...]


PATIENT_PLACES: Mapping[str, BoxPosition] = {
    "pas": BoxPosition(LUNGS, 30, "Pulmonary sinus", "left"),
    "part": BoxPosition(LUNGS, 90, "Pulmonary arteries", "up"),
    "pvn": BoxPosition(LUNGS, 150, "Pulmonary veins", "right"),
    "rv": BoxPosition(HEART_UPPER, 30, "Right ventricle", "left"),
    "la": BoxPosition(HEART_UPPER, 150, "Left atrium", "right"),
    "ra": BoxPosition(HEART_LOWER, 30, "Right atrium", "left"),
    "lv": BoxPosition(HEART_LOWER, 150, "Left ventricle", "right"),
    "svn": BoxPosition(BODY, 30, "Systemic veins", "left"),
    "sart": BoxPosition(BODY, 90, "Systemic arteries", "down"),
    "ao": BoxPosition(BODY, 150, "Aorta", "right"),
    "arch": BoxPosition(BODY, 110, "Aortic arch", "up"),
    "upper": BoxPosition(BODY, 70, "Upper body", "up"),
    "svc": BoxPosition(BODY, 30, "Superior cava", "left"),
    "descending": BoxPosition(LOWER_BODY, 110, "Descending aorta", "right"),
    "lower": BoxPosition(LOWER_BODY, 70, "Lower body", "down"),
    "ivc": BoxPosition(LOWER_BODY, 30, "Inferior cava", "left"),
}
_PATIENT_WIRES = (
    Wire("ra", "ra", "rv", Mark("valve", "tricuspid valve")),
    Wire("rv", "rv", "pas", Mark("valve", "pulmonary valve")),
    Wire("pas", "pas", "part", Mark("tube", "pulmonary artery")),
    Wire("part", "part", "pvn", Mark("resistance", "lungs")),
    Wire("pvn", "pvn", "la", Mark("tube", "pulmonary veins")),
    Wire("la", "la", "lv", Mark("valve", "mitral valve")),
    Wire("lv", "lv", "ao", Mark("valve", "aortic valve")),
    Wire("ao", "ao", "sart", Mark("tube", "aorta")),
    Wire("sart", "sart", "svn", Mark("resistance", "organs")),
    Wire("svn", "svn", "ra", Mark("tube", "venous return")),
    Wire("ao", "ao", "arch", Mark("tube", "aorta")),
    Wire("archupper", "arch", "upper", Mark("tube", "arch vessels")),
    Wire("arch", "arch", "descending", Mark("tube", "descending aorta")),
    Wire("descending", "descending", "lower", Mark("tube", "aorta")),
    Wire("upper", "upper", "svc", Mark("resistance", "organs")),
    Wire("lower", "lower", "ivc", Mark("resistance", "organs")),
    Wire("svc", "svc", "ra", Mark("tube", "venous return")),
    Wire("ivc", "ivc", "ra", Mark("tube", "venous return")),
    *(Wire(cava, vein, "ra", Mark("tube", "venous return")) for vein, cava in DRAINED.items()),
    Wire("bronchial", "sart", "pvn", Mark("tube", "bronchial return")),
    Wire("bronchial", "descending", "pvn", Mark("tube", "bronchial return")),
)


_DRAWN_AS = MappingProxyType({cava: vein for vein, cava in DRAINED.items()})
"""A collapsible vein's vena cava is drawn in the same box as the vein."""


def drawn_as(place: str) -> str:
    """Return the compartment in whose box a compartment is drawn."""
    return _DRAWN_AS.get(place, place)


@dataclass
class Plan:
    """Topology of a schematic: the elements in each frame, row and lane, before positions are computed.

    Args:
        frames: title of each frame, from the top; the patient's frame is the last.
        places: position of the box of each compartment.
        spare: compartments without a place, drawn in rows of their own.
        wires: connections between neighbours.
        lines: connections in lanes.
        bridges: connections inside the patient's ring.
        housed: devices in the housing of a connection between neighbours.
        others: names of connections drawn as arcs.
        undrawn: names of connections whose site is chosen by a parameter.
    """

    frames: dict[str, str] = field(default_factory=dict)
    places: dict[str, BoxPosition] = field(default_factory=dict)
    spare: list[str] = field(default_factory=list)
    wires: list[Wire] = field(default_factory=list)
    lines: list[Attachment] = field(default_factory=list)
    bridges: list[Bridge] = field(default_factory=list)
    housed: list[HousedBox] = field(default_factory=list)
    others: list[str] = field(default_factory=list)
    undrawn: list[str] = field(default_factory=list)

    @cached_property
    def heights(self) -> dict[Row, tuple[float, float]]:
        """Space [mm] above and below the centre line of each row."""
        rows = dict.fromkeys(sorted(place.row for place in self.places.values()))
        result: dict[Row, tuple[float, float]] = {}
        for frame, number in rows:
            last = max(row for of, row in rows if of == frame)
            ports = [1 + line.port for line in self.lines if line.frame == frame]
            stub = STUB * max(ports, default=1) if number == last else 0.0
            result[frame, number] = (15.0 if number == 0 else 19.0, 6.0 + stub)
        result |= {row: height for row, height in _PATIENT_HEIGHTS.items() if row in rows}
        if HEART_UPPER in result:
            above, below = result[HEART_UPPER]
            result[HEART_UPPER] = (above + PER_BRIDGE * max(len(self.bridges) - 1, 0), below)
        return result

    def bands(self, line: Attachment) -> tuple[str, ...]:
        """Return the bands of lanes that a line runs through, from its site on; each is below a frame."""
        place = self.places[line.site]
        if place.side == "down":
            return place.row[0], line.frame
        if place.side == "up" and (above := self._above(place.row[0])) != line.frame:
            return above, line.frame
        return (line.frame,)

    def lanes(self) -> dict[str, int]:
        """Return the number of lines in each band."""
        result: dict[str, int] = {}
        for line in self.lines:
            for band in self.bands(line):
                result[band] = result.get(band, 0) + 1
        return result

    def _above(self, frame: str) -> str:
        order = list(self.frames)
        return order[max(order.index(frame) - 1, 0)]


def plan_of(circuit: Circuit) -> Plan:
    """Plan the schematic of a circuit with fixed sites."""
    plan = Plan()
    instances = instances_in(circuit)
    groups = {c.name: c.group for c in circuit.compartments}
    for names in reversed(instances):
        members = [c.name for c in circuit.compartments if c.group == names.key]
        if members:
            plan.frames[names.key] = f"{names.device.name} circuit {names.name}".strip()
            plan.places |= _device_places(names, members)
    known = {name: place for name, place in PATIENT_PLACES.items() if name in groups}
    if known:
        plan.frames[PATIENT] = "Patient"
        plan.places |= known
    plan.spare = [name for name in groups if drawn_as(name) not in plan.places]
    by_group = {names.key: names for names in instances}
    for connection in circuit.connections:
        _add(plan, connection, by_group.get(connection.group), groups)
    plan.housed = _housed(plan, circuit)
    return plan


@lru_cache(maxsize=256)
def dead_ends(circuit: Circuit) -> frozenset[str]:
    """Return compartments with one connection, such as a balloon; its mean flow is 0 in a steady beat."""
    sites = [site for c in circuit.connections for site in (c.source, c.target)]
    touched = Counter(name for site in sites for name in ((site,) if isinstance(site, str) else site.sites))
    return frozenset(name for name, count in touched.items() if count == 1)


def without_flow(circuit: Circuit) -> frozenset[str]:
    """Return the connections to dead ends, whose mean flow is always 0."""
    ends = dead_ends(circuit)
    return frozenset(c.name for c in circuit.connections if {c.source, c.target} & ends)


def fixed_site(site: object) -> str | None:
    """Return the compartment that a site denotes; None if it is one of several, chosen by a parameter."""
    if isinstance(site, str):
        return site
    sites = getattr(site, "sites", ())
    return sites[0] if len(sites) == 1 else None


def _add(plan: Plan, connection: Connection, names: Naming | None, groups: Mapping[str, str]) -> None:
    """Add a connection to the matching list of a plan."""
    name = connection.name
    source, target = fixed_site(connection.source), fixed_site(connection.target)
    if source is None or target is None:
        plan.undrawn.append(name)
        return
    source, target = drawn_as(source), drawn_as(target)
    if source == target:
        return
    if names is None:
        wires = (w for w in _PATIENT_WIRES if (w.name, w.source, w.target) == (name, source, target))
        if wire := next(wires, None):
            plan.wires.append(wire)
        else:
            plan.others.append(name)
        return
    mark, frame = _mark(names, connection), _frame_of(plan, names, (source, target))
    inside = [end for end in (source, target) if groups.get(end) == frame]
    site = next((end for end in (source, target) if end not in inside), "")
    if len(inside) == 2 and _neighbours(plan, source, target):
        plan.wires.append(Wire(name, source, target, mark))
    elif len(inside) == 1 and site in plan.places and _can_leave(plan, inside[0], site):
        port = sum(line.node == inside[0] for line in plan.lines)
        plan.lines.append(Attachment(name, site, inside[0], frame, target in inside, mark, port))
    elif not inside and source != target and {source, target} <= set(PATIENT_PLACES) & set(plan.places):
        plan.bridges.append(Bridge(name, source, target, mark))
    else:
        plan.others.append(name)


def _frame_of(plan: Plan, names: Naming, ends: Sequence[str]) -> str:
    """Return a device's frame; if it has no compartments, as a vent, that of the device at its end."""
    if names.key in plan.frames:
        return names.key
    frames = (plan.places[end].row[0] for end in ends if end in plan.places)
    return next((frame for frame in frames if frame != PATIENT), names.key)


def _housed(plan: Plan, circuit: Circuit) -> list[HousedBox]:
    """Return the boxes of devices in the housing of a connection, the first along which they exchange."""
    wires = {wire.name: wire for wire in plan.wires}
    result: dict[str, HousedBox] = {}
    for exchange in circuit.exchanges:
        names, wire = naming_of(exchange.group), wires.get(exchange.at)
        if names is None or wire is None or (box := names.device.housed) is None or names.key in result:
            continue
        readings = tuple(map(names.output, box.readings))
        result[names.key] = HousedBox(names.key, f"{names.label}: {box.label}", wire, readings)
    return list(result.values())


def _device_places(names: Naming, compartments: Sequence[str]) -> dict[str, BoxPosition]:
    """Return the positions of a device's compartments: as the device defines them, else in flow direction."""
    places = {name: names.device_place(name) or name for name in compartments}
    boxes = {name: names.device.boxes.get(places[name]) for name in compartments}
    if any(box is None for box in boxes.values()):
        labels = [names.device.compartments.get(places[name], places[name]) for name in compartments]
        capitalised = [text[:1].upper() + text[1:] for text in labels]
        boxes = dict(zip(compartments, _in_flow_direction(capitalised), strict=True))
    result = {}
    for name, box in boxes.items():
        assert box is not None  # all have one
        side: Side = "up" if box.row == 0 else "left" if box.column == 0 else "right"
        result[name] = BoxPosition((names.key, box.row), COLUMNS[box.column], box.label, side)
    return result


def _in_flow_direction(labels: Sequence[str]) -> list[Box]:
    """Arrange boxes in a row; of five or six, the first and last go below it, where lines begin and end."""
    columns = {1: (1,), 2: (0, 3), 3: (0, 1, 3)}
    if len(labels) <= 4:
        places = [(column, 0) for column in columns.get(len(labels), (0, 1, 2, 3))]
    elif len(labels) <= 6:
        upper = columns.get(len(labels) - 2, (0, 1, 2, 3))
        places = [(0, 1), *((column, 0) for column in upper), (3, 1)]
    else:
        places = [(k % 4 if k // 4 % 2 == 0 else 3 - k % 4, k // 4) for k in range(len(labels))]
    return [Box(*place, text) for place, text in zip(places, labels, strict=True)]


def _mark(names: Naming, connection: Connection) -> Mark:
    """Return symbol and label of a device's connection; a named instance's name follows the label."""
    place = names.device_place(connection.name) or connection.name
    law = connection.component
    symbol = "roller" if law.given_flow else "valve" if law.one_way else "tube"
    mark = names.device.marks.get(place) or Mark(symbol, names.device.connections.get(place, place))
    single = not names.device.compartments
    label = f"{mark.label} {names.name}".strip() if single else mark.label
    return Mark("roller" if law.given_flow else mark.symbol, label)


def _neighbours(plan: Plan, first: str, second: str) -> bool:
    """Whether two boxes of a frame are adjacent in a row or column."""
    a, b = plan.places[first], plan.places[second]
    if a.row == b.row:
        low, high = sorted((a.x, b.x))
        return low < high and not any(p.row == a.row and low < p.x < high for p in plan.places.values())
    return a.x == b.x and abs(a.row[1] - b.row[1]) == 1


def _can_leave(plan: Plan, node: str, site: str) -> bool:
    """Whether a line can run from the bottom of a device's box to a site."""
    frame, row = plan.places[node].row
    lowest = max(place.row[1] for place in plan.places.values() if place.row[0] == frame)
    target = plan.places[site]
    topmost = target.side == "up" and next(iter(plan.frames)) == target.row[0]
    return row == lowest and not topmost


@dataclass
class Layout:
    """Page of one plan [mm]: heights of rows and bands of lanes, extents of frames, centres of boxes."""

    rows: dict[Row, float] = field(default_factory=dict)
    bands: dict[str, float] = field(default_factory=dict)
    frames: dict[str, tuple[float, float]] = field(default_factory=dict)
    places: dict[str, tuple[float, float]] = field(default_factory=dict)
    height: float = 0.0

    def box(self, name: str) -> tuple[float, float, float, float]:
        """Return left, bottom, right and top of the box of a compartment [mm]."""
        x, y = self.places[name]
        return x - BOX_WIDTH / 2, y - BOX_HEIGHT / 2, x + BOX_WIDTH / 2, y + BOX_HEIGHT / 2

    def between(self, first: str, second: str) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return the ends of a straight line between the boxes of neighbours in a row or column [mm]."""
        (l1, b1, r1, t1), (l2, b2, r2, t2) = self.box(first), self.box(second)
        x, y = 0.5 * (l1 + r1), 0.5 * (b1 + t1)
        if abs(0.5 * (b2 + t2) - y) < 0.5:
            return ((r1, y), (l2, y)) if l2 > r1 else ((l1, y), (r2, y))
        return ((x, t1), (x, b2)) if b2 > t1 else ((x, b1), (x, t2))


def housed_path(plan: Plan, page: Layout, box: HousedBox) -> list[tuple[float, float]]:
    """Return the line from the symbol of a connection to the box of a device in its housing [mm].

    The box is in the next row of the frame, beside which this row has boxes at both ends alone.
    """
    (x0, y), (x1, _) = page.between(box.wire.source, box.wire.target)
    frame, row = plan.places[box.wire.source].row
    below = page.rows.get((frame, row + 1), y - BOX_HEIGHT - 10.0)
    x, bend = 0.5 * (x0 + x1), y - BOX_HEIGHT / 2 - 1.5
    aside = x - 6.0  # clear of the label beside the next connection
    return [(x, y - 3.0), (x, bend), (aside, bend), (aside, below + BOX_HEIGHT / 2)]


def housed_box(plan: Plan, page: Layout, box: HousedBox) -> tuple[float, float, float, float]:
    """Return left, bottom, right and top of the box of a device in the housing of a connection [mm]."""
    *_, (x, top) = housed_path(plan, page, box)
    return x + 8.0 - HOUSED_WIDTH, top - BOX_HEIGHT, x + 8.0, top


def arrange(plan: Plan, heights: Mapping[Row, tuple[float, float]] | None = None) -> Layout:
    """Place the compartments of a plan on a page that extends downwards from 0.

    Args:
        plan: plan of the schematic; compartments without a place go to spare rows at the bottom.
        heights: space [mm] above and below the centre line of each row; None for the plan's.
    """
    heights = plan.heights if heights is None else heights
    lanes = plan.lanes()
    page = Layout()
    y = -TITLE_HEIGHT
    for frame in plan.frames:
        top = y
        for row in (row for row in heights if row[0] == frame):
            above, below = heights[row]
            page.rows[row] = y - above
            y -= above + below
        page.frames[frame] = (y, top)
        page.bands[frame] = y - 2.0
        y -= 3.0 + LANE_PITCH * lanes.get(frame, 0)
    page.places = {name: (place.x, page.rows[place.row]) for name, place in plan.places.items()}
    for index, name in enumerate(plan.spare):
        row, column = divmod(index, len(COLUMNS))
        page.places[name] = (COLUMNS[column], y - 10.0 - BOX_HEIGHT / 2 - row * _SPARE_ROW)
    if rows := -(-len(plan.spare) // len(COLUMNS)):
        page.frames[SPARE] = (y - 4.0 - rows * _SPARE_ROW, y - 2.0)
        y -= 6.0 + rows * _SPARE_ROW
    page.height = -y
    return page
