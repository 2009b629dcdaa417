"""The lines of the schematic between devices and the sites they are attached to.

Every line has a lane of its own beside and between the blocks; of all ways to share out the lanes the one
with the fewest crossings is taken.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise, permutations, product
from typing import TYPE_CHECKING

from eclsim.reporting.schematic_layout import (
    BOX_HEIGHT,
    BOX_WIDTH,
    LANE_PITCH,
    LEFT_LANE,
    MIDDLE,
    NODES,
    PORTS,
    RIGHT_LANE,
    STUB,
    Layout,
    PortPlace,
    Side,
)

if TYPE_CHECKING:
    from eclsim.circuit import Connection

Point = tuple[float, float]
Path = list[Point]
_OVERLAP_PENALTY = 50.0
_LONGEST_SEARCH = 4
PUMP_RADIUS = 3.3


@dataclass(frozen=True)
class Attachment:
    """One line of a device: the connection's name, the site, and the device's port."""

    name: str
    site: str
    port: PortPlace


def fixed_site(site: object) -> str | None:
    """The compartment a site names; None where it is chosen per patient among several."""
    if isinstance(site, str):
        return site
    sites = getattr(site, "sites", ())
    return sites[0] if len(sites) == 1 else None


def attachments_of(connections: "Iterable[Connection]", names: Sequence[str]) -> list[Attachment]:
    """The lines of devices that run in lanes: a device's own end, and a site with a place in the layout."""
    found = []
    for connection in connections:
        port = PORTS.get(connection.name)
        if port is None:
            continue
        source, target = fixed_site(connection.source), fixed_site(connection.target)
        site, end = (source, target) if port.into_device else (target, source)
        if (
            end == port.node
            and site is not None
            and site in NODES
            and {site, end} <= set(names)
            and site != end
        ):
            found.append(Attachment(connection.name, site, port))
    return found


def lanes_needed(attachments: Sequence[Attachment], device_bands: Sequence[str]) -> dict[str, int]:
    """How many lines run through each band of lanes."""
    count: dict[str, int] = {}
    for attachment in attachments:
        for band in _bands_of(attachment, device_bands):
            count[band] = count.get(band, 0) + 1
    return count


def route(attachments: Sequence[Attachment], page: Layout) -> dict[str, Path]:
    """Corner points of each line, from the site to the device's port."""
    if not attachments:
        return {}
    best: tuple[float, dict[str, Path]] = (float("inf"), {})
    for order, flips in _choices(len(attachments)):
        paths = _paths([attachments[i] for i in order], page, flips)
        cost = _cost(list(paths.values()))
        if cost < best[0]:
            best = (cost, paths)
    return best[1]


def _choices(count: int) -> Iterator[tuple[Sequence[int], tuple[bool, ...]]]:
    orders = permutations(range(count)) if count <= _LONGEST_SEARCH else [tuple(range(count))]
    return product(orders, product((False, True), repeat=3))


def _side(attachment: Attachment) -> Side:
    return NODES[attachment.site].side


def _lane_side(attachment: Attachment) -> Side:
    """The side a line goes round the blocks: its site's, or its port's where the site faces up or down."""
    side = _side(attachment)
    if side in ("left", "right"):
        return side
    return "left" if NODES[attachment.port.node].x < MIDDLE else "right"


def _bands_of(attachment: Attachment, device_bands: Sequence[str]) -> tuple[str, ...]:
    """Bands a line runs through, nearest to its site first."""
    if _side(attachment) == "down":
        return ("below_patient", attachment.port.band)
    if _side(attachment) == "up":
        first = "below_crrt" if NODES[attachment.site].row == "ecmo_upper" else device_bands[-1]
        if first != attachment.port.band:
            return (first, attachment.port.band)
    return (attachment.port.band,)


def _paths(ordered: Sequence[Attachment], page: Layout, flips: tuple[bool, ...]) -> dict[str, Path]:
    bands = [band for band in ("below_crrt", "below_ecmo") if band in page.bands]
    flip_left, flip_right, flip_bands = flips
    users: dict[str, list[Attachment]] = {}
    for attachment in ordered:
        for key in (*_bands_of(attachment, bands), _lane_side(attachment), attachment.site):
            users.setdefault(key, []).append(attachment)

    def rank(key: str, attachment: Attachment, flip: bool) -> int:
        order = users[key].index(attachment)
        return len(users[key]) - 1 - order if flip else order

    paths = {}
    for attachment in ordered:
        side = _lane_side(attachment)
        lane = rank(side, attachment, flip_left if side == "left" else flip_right)
        lane_x = LEFT_LANE - LANE_PITCH * lane if side == "left" else RIGHT_LANE + LANE_PITCH * lane
        heights = [
            page.bands[band] - LANE_PITCH * (0.5 + rank(band, attachment, flip_bands))
            for band in _bands_of(attachment, bands)
        ]
        slot = rank(attachment.site, attachment, flip_left) - 0.5 * (len(users[attachment.site]) - 1)
        paths[attachment.name] = _path(attachment, page, lane_x, heights, slot)
    return paths


def _path(attachment: Attachment, page: Layout, lane_x: float, heights: list[float], slot: float) -> Path:
    x, y = page.places[attachment.site]
    port_x, port_y = page.places[attachment.port.node]
    end = [(port_x, heights[-1]), (port_x, port_y - BOX_HEIGHT / 2)]
    side = _side(attachment)
    if side in ("left", "right"):
        edge = x - BOX_WIDTH / 2 if side == "left" else x + BOX_WIDTH / 2
        level = y + 3.0 * slot
        return [(edge, level), (lane_x, level), (lane_x, heights[-1]), *end]
    start_x = x + 5.0 * slot + _clearance(attachment, x, port_x, slot)
    start_y = y + BOX_HEIGHT / 2 if side == "up" else y - BOX_HEIGHT / 2
    path = [(start_x, start_y), (start_x, heights[0])]
    if len(heights) > 1:
        path += [(lane_x, heights[0]), (lane_x, heights[-1])]
    return path + end


def _clearance(attachment: Attachment, x: float, port_x: float, slot: float) -> float:
    """Moves a line aside where another device's line comes down over the same box."""
    if x == port_x or slot or x not in (30.0, 150.0):
        return 0.0
    return 5.0 if x == 30.0 else -5.0


def stub_middle(page: Layout, port: PortPlace) -> Point:
    """Middle of the straight piece below a device's port, where its symbol and label stand."""
    x, y = page.places[port.node]
    return x, y - BOX_HEIGHT / 2 - STUB / 2


def _cost(paths: Sequence[Path]) -> float:
    """Crossings, lines on top of each other (much worse) and, last, length."""
    cost = 0.0
    pieces = [list(pairwise(path)) for path in paths]
    for index, first in enumerate(pieces):
        cost += 1e-4 * sum(abs(a[0] - b[0]) + abs(a[1] - b[1]) for a, b in first)
        for second in pieces[index + 1 :]:
            cost += sum(_meeting(p, q) for p in first for q in second)
    return cost


def _meeting(p: tuple[Point, Point], q: tuple[Point, Point]) -> float:
    """1 for a crossing, a penalty for two lines on top of each other, 0 for no contact."""
    (px0, px1), (py0, py1) = _span(p, 0), _span(p, 1)
    (qx0, qx1), (qy0, qy1) = _span(q, 0), _span(q, 1)
    if px0 > qx1 or qx0 > px1 or py0 > qy1 or qy0 > py1:
        return 0.0
    parallel = (px0 == px1) == (qx0 == qx1)
    return _OVERLAP_PENALTY if parallel else 1.0


def _span(piece: tuple[Point, Point], axis: int) -> tuple[float, float]:
    low, high = sorted((piece[0][axis], piece[1][axis]))
    return low, high


def pump_paths(inlet: str, outlet: str, page: Layout) -> tuple[Path, Path] | None:
    """Inlet and outlet line of a pump inside the patient's ring; None where a site is not on the ring.

    The outlet line starts at the pump's lower end, the inlet line ends at its upper end.
    """
    if inlet == outlet or not {inlet, outlet} <= set(_RING) or not {inlet, outlet} <= set(page.places):
        return None
    middle = page.rows["heart_lower"]
    inlet_path = [*_inner_path(inlet, page, middle + 8.0, spare=0.0), (MIDDLE, middle + PUMP_RADIUS)]
    outlet_path = [*_inner_path(outlet, page, middle - 8.0, spare=4.0), (MIDDLE, middle - PUMP_RADIUS)]
    return inlet_path, outlet_path[::-1]


_RING = ("pas", "part", "pvn", "rv", "la", "ra", "lv", "svn", "sart", "ao")


def _inner_path(site: str, page: Layout, level: float, spare: float) -> Path:
    """From the inner side of a box of the ring to the middle of the page at the given height."""
    x, y = page.places[site]
    if site == "sart":
        return [(x - 8.0, y + BOX_HEIGHT / 2), (x - 8.0, level), (MIDDLE, level)]
    if site == "part":
        below = y - BOX_HEIGHT / 2
        channel = MIDDLE - 28.0 - spare
        return [
            (x - 8.0, below),
            (x - 8.0, below - 3.0),
            (channel, below - 3.0),
            (channel, level),
            (MIDDLE, level),
        ]
    row = NODES[site].row
    height = y + {"lungs": -4.0, "body": 4.0}.get(row, 0.0)
    inwards = 1.0 if x < MIDDLE else -1.0
    channel = MIDDLE - inwards * (28.0 + spare)
    return [(x + inwards * BOX_WIDTH / 2, height), (channel, height), (channel, level), (MIDDLE, level)]
