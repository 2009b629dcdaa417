"""Where the schematic puts each compartment and connection: tables in millimetres, and the page made of them.

The patient is a ring: right heart up the left side, lungs at the top, left heart down the right side, body at
the bottom. Devices stand above the patient, ECMO below CRRT. Lines between devices and sites run in lanes
around them.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal

Side = Literal["left", "right", "up", "down"]

BOX_WIDTH = 28.5
BOX_HEIGHT = 12.0
LANE_PITCH = 3.8
COLUMNS = (30.0, 70.0, 110.0, 150.0)
MIDDLE = 90.0
LEFT_LANE, RIGHT_LANE = 10.0, 170.0
FRAME = (13.0, 167.0)
TITLE_HEIGHT = 12.0
STUB = 12.5


@dataclass(frozen=True)
class NodePlace:
    """Place of one compartment: column centre [mm], row, its words, and the side that faces the lanes."""

    x: float
    row: str
    words: str
    side: Side


@dataclass(frozen=True)
class WirePlace:
    """How the connection between two neighbouring compartments is drawn: its ends, symbol and words."""

    source: str
    target: str
    symbol: str
    words: str


@dataclass(frozen=True)
class PortPlace:
    """A device's line to a site: the device's compartment, which way blood flows, its words."""

    node: str
    symbol: str
    words: str
    into_device: bool
    band: str


NODES: Mapping[str, NodePlace] = {
    "pas": NodePlace(30, "lungs", "Pulmonary sinus", "left"),
    "part": NodePlace(90, "lungs", "Pulmonary arteries", "up"),
    "pvn": NodePlace(150, "lungs", "Pulmonary veins", "right"),
    "rv": NodePlace(30, "heart_upper", "Right ventricle", "left"),
    "la": NodePlace(150, "heart_upper", "Left atrium", "right"),
    "ra": NodePlace(30, "heart_lower", "Right atrium", "left"),
    "lv": NodePlace(150, "heart_lower", "Left ventricle", "right"),
    "svn": NodePlace(30, "body", "Systemic veins", "left"),
    "sart": NodePlace(90, "body", "Systemic arteries", "down"),
    "ao": NodePlace(150, "body", "Aorta", "right"),
    "ecmodrain": NodePlace(30, "ecmo_lower", "After drainage", "left"),
    "ecmotudp": NodePlace(30, "ecmo_upper", "Before pump", "up"),
    "ecmotupo": NodePlace(70, "ecmo_upper", "After pump", "up"),
    "ecmooxy": NodePlace(110, "ecmo_upper", "Before oxygenator", "up"),
    "ecmotuor": NodePlace(150, "ecmo_upper", "After oxygenator", "up"),
    "ecmoreturn": NodePlace(150, "ecmo_lower", "Before return", "right"),
    "crrttuin": NodePlace(30, "crrt", "Before pump", "up"),
    "crrttupf": NodePlace(70, "crrt", "After pump", "up"),
    "crrtfil": NodePlace(110, "crrt", "Before dialyzer", "up"),
    "crrttuout": NodePlace(150, "crrt", "After dialyzer", "up"),
}

WIRES: Mapping[str, WirePlace] = {
    "ra": WirePlace("ra", "rv", "valve", "tricuspid valve"),
    "rv": WirePlace("rv", "pas", "valve", "pulmonary valve"),
    "pas": WirePlace("pas", "part", "tube", "pulmonary artery"),
    "part": WirePlace("part", "pvn", "resistance", "lungs"),
    "pvn": WirePlace("pvn", "la", "tube", "pulmonary veins"),
    "la": WirePlace("la", "lv", "valve", "mitral valve"),
    "lv": WirePlace("lv", "ao", "valve", "aortic valve"),
    "ao": WirePlace("ao", "sart", "tube", "aorta"),
    "sart": WirePlace("sart", "svn", "resistance", "organs"),
    "svn": WirePlace("svn", "ra", "tube", "venous return"),
    "ecmotudp": WirePlace("ecmodrain", "ecmotudp", "tube", "tube"),
    "ecmopump": WirePlace("ecmotudp", "ecmotupo", "pump", "pump"),
    "ecmotupo": WirePlace("ecmotupo", "ecmooxy", "tube", "tube"),
    "ecmooxy": WirePlace("ecmooxy", "ecmotuor", "exchanger", "oxygenator"),
    "ecmotuor": WirePlace("ecmotuor", "ecmoreturn", "tube", "tube"),
    "crrtpump": WirePlace("crrttuin", "crrttupf", "roller", "roller pump"),
    "crrttupf": WirePlace("crrttupf", "crrtfil", "tube", "tube"),
    "crrtfil": WirePlace("crrtfil", "crrttuout", "exchanger", "dialyzer"),
}

PORTS: Mapping[str, PortPlace] = {
    "ecmodrain": PortPlace("ecmodrain", "cannula", "drainage cannula", True, "below_ecmo"),
    "ecmoreturn": PortPlace("ecmoreturn", "cannula", "return cannula", False, "below_ecmo"),
    "crrttuin": PortPlace("crrttuin", "tube", "access line", True, "below_crrt"),
    "crrttuout": PortPlace("crrttuout", "tube", "return line", False, "below_crrt"),
}

# Row or band of lanes -> space [mm] above and below its middle line. Labels of wires stand in that space.
ROWS: Mapping[str, tuple[float, float]] = {
    "crrt": (15.0, 6.0 + STUB),
    "ecmo_upper": (14.5, 6.0),
    "ecmo_lower": (19.0, 6.0 + STUB),
    "lungs": (15.0, 6.0),
    "heart_upper": (19.0, 6.0),
    "heart_lower": (19.0, 6.0),
    "body": (19.0, 14.5),
}
_GROUPS = (
    ("crrt", ("crrt",)),
    ("ecmo", ("ecmo_upper", "ecmo_lower")),
    ("patient", ("lungs", "heart_upper", "heart_lower", "body")),
)
_SPARE_ROW = 22.0


@dataclass
class Layout:
    """The page of one circuit: heights of rows and bands of lanes, frames of groups, places of all boxes."""

    rows: dict[str, float] = field(default_factory=dict)
    bands: dict[str, float] = field(default_factory=dict)
    frames: dict[str, tuple[float, float]] = field(default_factory=dict)
    places: dict[str, tuple[float, float]] = field(default_factory=dict)
    height: float = 0.0

    def box(self, name: str) -> tuple[float, float, float, float]:
        """Left, bottom, right and top of the box of a compartment [mm]."""
        x, y = self.places[name]
        return x - BOX_WIDTH / 2, y - BOX_HEIGHT / 2, x + BOX_WIDTH / 2, y + BOX_HEIGHT / 2


def arrange(
    names: Iterable[str], lanes: Mapping[str, int], heights: Mapping[str, tuple[float, float]] = ROWS
) -> Layout:
    """Places compartments on a page that grows downwards from 0.

    Args:
        names: the compartments; those without a place of their own go to spare rows at the bottom.
        lanes: how many lines run through each band ("below_crrt", "below_ecmo", "below_patient").
        heights: space [mm] above and below the middle line of each row.
    """
    names = list(names)
    used = {NODES[name].row for name in names if name in NODES}
    page = Layout()
    y = -TITLE_HEIGHT
    for group, rows in _GROUPS:
        if not used & set(rows):
            continue
        top = y
        for row in rows:
            above, below = heights[row]
            page.rows[row] = y - above
            y -= above + below
        page.frames[group] = (y, top)
        band = f"below_{group}"
        page.bands[band] = y - 2.0
        y -= 3.0 + LANE_PITCH * lanes.get(band, 0)
    page.places = {name: (NODES[name].x, page.rows[NODES[name].row]) for name in names if name in NODES}
    y = _place_spare(page, [name for name in names if name not in NODES], y)
    page.height = -y
    return page


def _place_spare(page: Layout, spare: list[str], y: float) -> float:
    for index, name in enumerate(spare):
        row, column = divmod(index, len(COLUMNS))
        page.places[name] = (COLUMNS[column], y - 10.0 - BOX_HEIGHT / 2 - row * _SPARE_ROW)
    rows = -(-len(spare) // len(COLUMNS))
    if rows:
        page.frames["spare"] = (y - 4.0 - rows * _SPARE_ROW, y - 2.0)
        y -= 6.0 + rows * _SPARE_ROW
    return y
