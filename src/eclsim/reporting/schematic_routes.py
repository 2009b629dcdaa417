"""Routes of the schematic's lines between devices and the sites where they are attached.

Each line has its own lane beside and between the blocks. Of the possible assignments of lanes, the one with
the fewest crossings is used.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise, permutations, product
from typing import NamedTuple

from eclsim.reporting.schematic_layout import (
    BODY,
    BOX_HEIGHT,
    BOX_WIDTH,
    HEART_LOWER,
    LANE_PITCH,
    LEFT_LANE,
    LUNGS,
    MIDDLE,
    PER_BRIDGE,
    RIGHT_LANE,
    STUB,
    Attachment,
    Bridge,
    Layout,
    Plan,
    Side,
    Wire,
)

Point = tuple[float, float]
Path = list[Point]
Box = tuple[float, float, float, float]
"""Left, bottom, right and top."""
_OVERLAP_PENALTY = 50.0
_LONGEST_SEARCH = 4
PUMP_RADIUS = 3.3
# Tried in this order; the first arc that crosses the fewest boxes and texts is used.
_ARC_BENDS = (0.0, 0.12, -0.12, 0.24, -0.24, 0.36, -0.36, 0.5, -0.5)
_BESIDE_NEIGHBOUR = 1.4
"""Distance [mm] of a line from the box that stands between it and the centre."""
_CHANNEL, _CHANNEL_PITCH = 25.0, 3.5
"""Distance [mm] of the first inner pump's lines from the centre, and between lines."""


def route(plan: Plan, page: Layout) -> dict[str, Path]:
    """Return the corner points of each line, from the site to the device."""
    if not plan.lines:
        return {}
    best: tuple[float, dict[str, Path]] = (float("inf"), {})
    for order, flips in _choices(len(plan.lines)):
        paths = _paths(plan, page, [plan.lines[i] for i in order], flips)
        cost = _cost(list(paths.values()))
        if cost < best[0]:
            best = (cost, paths)
    return best[1]


def _choices(count: int) -> Iterator[tuple[Sequence[int], tuple[bool, ...]]]:
    orders = permutations(range(count)) if count <= _LONGEST_SEARCH else [tuple(range(count))]
    return product(orders, product((False, True), repeat=3))


def _lane_side(plan: Plan, line: Attachment) -> Side:
    """Return the side on which a line passes the blocks: its site's if left or right, else its device's."""
    side = plan.places[line.site].side
    if side in ("left", "right"):
        return side
    return "left" if plan.places[line.node].x < MIDDLE else "right"


def _paths(
    plan: Plan, page: Layout, ordered: Sequence[Attachment], flips: tuple[bool, ...]
) -> dict[str, Path]:
    flip_left, flip_right, flip_bands = flips
    users: dict[str, list[Attachment]] = {}
    for line in ordered:
        keys = (*(f"below {band}" for band in plan.bands(line)), _lane_side(plan, line), f"at {line.site}")
        for key in keys:
            users.setdefault(key, []).append(line)

    def rank(key: str, line: Attachment, flip: bool) -> int:
        order = users[key].index(line)
        return len(users[key]) - 1 - order if flip else order

    paths = {}
    for line in ordered:
        side = _lane_side(plan, line)
        lane = rank(side, line, flip_left if side == "left" else flip_right)
        lane_x = LEFT_LANE - LANE_PITCH * lane if side == "left" else RIGHT_LANE + LANE_PITCH * lane
        heights = [
            page.bands[band] - LANE_PITCH * (0.5 + rank(f"below {band}", line, flip_bands))
            for band in plan.bands(line)
        ]
        at_site = f"at {line.site}"
        slot = rank(at_site, line, flip_left) - 0.5 * (len(users[at_site]) - 1)
        paths[line.name] = _path(plan, page, line, lane_x, heights, slot)
    return paths


def _path(
    plan: Plan, page: Layout, line: Attachment, lane_x: float, heights: list[float], slot: float
) -> Path:
    x, y = page.places[line.site]
    port_x, port_y = port_of(page, line)
    end = [(port_x, heights[-1]), (port_x, port_y - BOX_HEIGHT / 2)]
    side = plan.places[line.site].side
    if side in ("left", "right"):
        edge = x - BOX_WIDTH / 2 if side == "left" else x + BOX_WIDTH / 2
        level = y + 3.0 * slot
        return [(edge, level), (lane_x, level), (lane_x, heights[-1]), *end]
    start_x = x + 5.0 * slot + _shifted_aside(x, port_x, slot)
    start_y = y + BOX_HEIGHT / 2 if side == "up" else y - BOX_HEIGHT / 2
    path = [(start_x, start_y), (start_x, heights[0])]
    if len(heights) > 1:
        path += [(lane_x, heights[0]), (lane_x, heights[-1])]
    return path + end


def _shifted_aside(x: float, port_x: float, slot: float) -> float:
    """Return a shift that keeps a line clear of another device's line, which comes down over the same box."""
    if x == port_x or slot or x not in (30.0, 150.0):
        return 0.0
    return 5.0 if x == 30.0 else -5.0


class Detour(NamedTuple):
    """Route of a connection between boxes that are not neighbours.

    Attributes:
        path: Corner points.
        label: Anchor point of the label, at half its height.
        align: End of the label at the anchor point, "left" or "right".
    """

    path: Path
    label: Point
    align: str


def detour(plan: Plan, page: Layout, wire: Wire, margin: float = 0.0) -> Detour | None:
    """Return the route of a connection past the boxes between its ends; None if there are none.

    Args:
        plan: plan of the circuit.
        page: page with the positions of the boxes.
        wire: the connection.
        margin: extra width with which the boxes are drawn on either side [mm].
    """
    (x, low), (other, high) = page.places[wire.source], page.places[wire.target]
    half = BOX_WIDTH / 2 + margin
    if wire.source == "sart" and wire.target == "pvn":  # inside the ring
        # Between the elements in the middle and the heart's labels, which are wider on the page.
        beside = 19.5 if margin else 26.0
        channel = MIDDLE + (30.0 if plan.bridges else beside)
        start, end = low + BOX_HEIGHT / 2, high - 4.0
        inside = [(x + 8.0, start), (x + 8.0, start + 3.0), (channel, start + 3.0)]
        label = (channel - 1.5, high - 10.0 if plan.bridges else start + 9.0)
        return Detour([*inside, (channel, end), (other - half, end)], label, "right")
    if wire.target == "pvn" and low < high:  # outside of the left heart
        edge, aside = other + half, other + half + 1.4 - 0.4 * margin
        path = [(x + half, low + 2.0), (aside, low + 2.0), (aside, high - 3.0), (edge, high - 3.0)]
        return Detour(path, (x + half + 2.5, low + 6.5), "left")
    if x != other or not any(x == at and low < y < high for at, y in page.places.values()):
        return None
    edge = x - half
    aside = edge - 1.4 + 0.4 * margin
    path = [(edge, low + 3.0), (aside, low + 3.0), (aside, high - 3.0), (edge, high - 3.0)]
    return Detour(path, (edge + 1.0, low + 6.0 + BOX_HEIGHT / 2), "left")


_PORT = 7.0
"""Distance [mm] between the first and second line at a device's box."""


def port_of(page: Layout, line: Attachment) -> Point:
    """Return the point where a line reaches its device's box, at the height of the box's centre."""
    x, y = page.places[line.node]
    return x + line.port * (_PORT if x < MIDDLE else -_PORT), y


def stub_middle(page: Layout, line: Attachment) -> Point:
    """Return the position of a line's symbol, on the straight segment below its device's box."""
    x, y = port_of(page, line)
    return x, y - BOX_HEIGHT / 2 - STUB * (0.5 + line.port)


def stub_label(plan: Plan, page: Layout, line: Attachment) -> tuple[Point, str]:
    """Return position and alignment of a line's label, beside its symbol and all lines of the same box."""
    x, y = stub_middle(page, line)
    beside = max(other.port for other in plan.lines if other.node == line.node) - line.port
    away = 5.0 + _PORT * beside
    return ((x + away, y), "left") if x < MIDDLE else ((x - away, y), "right")


def _cost(paths: Sequence[Path]) -> float:
    """Return the cost of a routing: crossings, overlapping lines (much worse) and, last, length."""
    cost = 0.0
    pieces = [list(pairwise(path)) for path in paths]
    for index, first in enumerate(pieces):
        cost += 1e-4 * sum(abs(a[0] - b[0]) + abs(a[1] - b[1]) for a, b in first)
        for second in pieces[index + 1 :]:
            cost += sum(_crossing_cost(p, q) for p in first for q in second)
    return cost


def _crossing_cost(p: tuple[Point, Point], q: tuple[Point, Point]) -> float:
    """Return 1 for a crossing, a penalty for overlapping parallel lines, and 0 for no contact."""
    (px0, px1), (py0, py1) = _span(p, 0), _span(p, 1)
    (qx0, qx1), (qy0, qy1) = _span(q, 0), _span(q, 1)
    if px0 > qx1 or qx0 > px1 or py0 > qy1 or qy0 > py1:
        return 0.0
    parallel = (px0 == px1) == (qx0 == qx1)
    return _OVERLAP_PENALTY if parallel else 1.0


def _span(piece: tuple[Point, Point], axis: int) -> tuple[float, float]:
    low, high = sorted((piece[0][axis], piece[1][axis]))
    return low, high


def bridge_paths(plan: Plan, page: Layout, bridge: Bridge) -> tuple[Path, Path]:
    """Return the lines into and out of a symbol inside the patient's ring, which lies between their ends.

    With several symbols, each is above the previous one and its lines are nearer to the centre.
    """
    number = plan.bridges.index(bridge)
    middle = page.rows[HEART_LOWER] + PER_BRIDGE * number
    channel = _CHANNEL - 8.0 * number
    upwards = number > 0 and page.places[bridge.target][1] > page.places[bridge.source][1]
    sign = -1.0 if upwards else 1.0
    earlier = [site for other in plan.bridges[:number] for site in (other.source, other.target)]
    into, out = (
        _inner_path(plan, page, site, level, distance, earlier.count(site))
        for site, level, distance in (
            (bridge.source, middle + 8.0 * sign, channel),
            (bridge.target, middle - 8.0 * sign, channel + _CHANNEL_PITCH),
        )
    )
    into.append((MIDDLE, middle + PUMP_RADIUS * sign))
    out.append((MIDDLE, middle - PUMP_RADIUS * sign))
    return into, out[::-1]


def bridge_label(plan: Plan, page: Layout, bridge: Bridge) -> tuple[Point, str]:
    """Return position and alignment of a bridge's label: left of the symbol if all lines are on the right."""
    sites = [site for other in plan.bridges for site in (other.source, other.target)]
    on_the_right = len(plan.bridges) > 1 and all(page.places[site][0] > MIDDLE for site in sites)
    height = page.rows[HEART_LOWER] + PER_BRIDGE * plan.bridges.index(bridge)
    return ((MIDDLE - 5.5, height), "right") if on_the_right else ((MIDDLE + 5.5, height), "left")


def _inner_path(plan: Plan, page: Layout, site: str, level: float, distance: float, earlier: int) -> Path:
    """Return the path from a box's inner side, clear of earlier lines there, to the centre at a height."""
    x, y = page.places[site]
    if site == "sart":
        return [(x - 8.0, y + BOX_HEIGHT / 2), (x - 8.0, level), (MIDDLE, level)]
    if site == "part":
        below = y - BOX_HEIGHT / 2
        channel = MIDDLE - distance
        return [
            (x - 8.0, below),
            (x - 8.0, below - 3.0),
            (channel, below - 3.0),
            (channel, level),
            (MIDDLE, level),
        ]
    row = plan.places[site].row
    height = y + {LUNGS: 2.5 * earlier - 4.5, BODY: 4.5 - 2.5 * earlier}.get(row, -3.0 * earlier)
    inwards = 1.0 if x < MIDDLE else -1.0
    channel = _beside_neighbour(page, site, MIDDLE - inwards * distance, inwards, earlier)
    return [(x + inwards * BOX_WIDTH / 2, height), (channel, height), (channel, level), (MIDDLE, level)]


def _beside_neighbour(page: Layout, site: str, channel: float, inwards: float, earlier: int) -> float:
    """Where a line goes down to a box: in its channel, or between the box and a neighbour there."""
    x, y = page.places[site]
    half = BOX_WIDTH / 2
    for other, height in page.places.values():
        if height == y and abs(other - x) > half and abs(other - channel) <= half:
            return other - inwards * (half + _BESIDE_NEIGHBOUR + 2.0 * earlier)
    return channel


def arc(first: Box, second: Box, blocked: Sequence[Sequence[float]]) -> tuple[float, Path]:
    """Return bend and points of an arc between any two boxes that crosses the fewest of the blocked boxes."""
    start, stop = _border(first, _middle(second)), _border(second, _middle(first))
    curves = {bend: _curve(start, stop, bend) for bend in _ARC_BENDS}

    def crossed(bend: float) -> int:
        return sum(
            left <= x <= right and bottom <= y <= top
            for x, y in curves[bend]
            for left, bottom, right, top in blocked
        )

    bend = min(_ARC_BENDS, key=crossed)
    return bend, curves[bend]


def _middle(box: Box) -> Point:
    return 0.5 * (box[0] + box[2]), 0.5 * (box[1] + box[3])


def _curve(start: Point, stop: Point, bend: float) -> list[Point]:
    """Return points of the arc drawn by `arc3`: a parabola with a control point beside the middle."""
    dx, dy = stop[0] - start[0], stop[1] - start[1]
    side = (0.5 * (start[0] + stop[0]) + bend * dy, 0.5 * (start[1] + stop[1]) - bend * dx)
    weights = [((1 - t) ** 2, 2 * t * (1 - t), t**2) for t in (i / 40 for i in range(41))]
    return [
        (a * start[0] + b * side[0] + c * stop[0], a * start[1] + b * side[1] + c * stop[1])
        for a, b, c in weights
    ]


def _border(box: Box, towards: Point) -> Point:
    """Return the point where the line from the centre of a box towards a point leaves the box."""
    x, y = _middle(box)
    dx, dy = towards[0] - x, towards[1] - y
    reach = max(abs(dx) / (0.5 * (box[2] - box[0])), abs(dy) / (0.5 * (box[3] - box[1])), 1e-9)
    return x + dx / reach, y + dy / reach
