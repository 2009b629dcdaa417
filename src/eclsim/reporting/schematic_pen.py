"""Drawing of boxes, lines, symbols and labels in millimetres on axes of any size."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyArrowPatch, FancyBboxPatch, Patch, Polygon, Rectangle
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from eclsim.devices.description import Look
from eclsim.devices.device import Device
from eclsim.devices.registry import device_of
from eclsim.reporting.saturation import COLOUR_STOPS, colour_of, text_colour_on
from eclsim.reporting.schematic_routes import Box, Point, arc

_PATIENT = Look("#222222", "#F7F7F7", 1.3)


def look_of(group: str) -> Look:
    """Return the look of the patient or of a device; groups defined by users share one look."""
    device = device_of(group)
    return _PATIENT if group == "patient" else Device.look if device is None else device.look


@dataclass
class Pen:
    """Axes whose data units are millimetres, with the scale factor for text and lines."""

    ax: Axes
    scale: float
    _measured: dict[Text, Bbox] = field(default_factory=dict)

    @property
    def figure(self) -> Figure:
        """The figure drawn into."""
        figure = self.ax.get_figure(root=True)
        assert figure is not None  # axes drawn into always belong to a figure
        return figure

    def text(self, x: float, y: float, content: str, size: float, **options: object) -> Text:
        """Draw text, centred on a point by default; `size` is in points on the full page."""
        options = {"ha": "center", "va": "center", "zorder": 8, **options}
        return self.ax.text(x, y, content, fontsize=size * self.scale, **options)  # pyright: ignore[reportArgumentType] - dict of keywords

    def label_beside(self, at: Point, lines: Sequence[str], align: str) -> None:
        """Draw lines of text beside a point; lines after the first are numbers and drawn in bold."""
        shown = [line for line in lines if line]
        for index, line in enumerate(shown):
            y = at[1] + 3.3 * ((len(shown) - 1) / 2 - index)
            self.text(
                at[0], y, line, size=7 if index else 6.5, weight="bold" if index else "normal", ha=align
            )

    def frame(self, left: float, bottom: float, right: float, top: float, look: Look) -> None:
        """Draw the tinted background of a frame."""
        self._rounded(
            (left, bottom, right, top), 2.5, zorder=0, facecolor=look.fill, edgecolor="#C9C9C9",
            linewidth=0.6 * self.scale,
        )  # fmt: skip

    def shade(self, left: float, bottom: float, right: float, top: float) -> None:
        """Draw a grey background behind the chambers of one side of the heart."""
        self.ax.add_patch(
            Rectangle(
                (left, bottom), right - left, top - bottom, zorder=1, facecolor="#E6E6E6", edgecolor="none"
            )
        )

    def box(self, box: Box, look: Look, gid: str) -> None:
        """Draw a white box with rounded corners."""
        look_of_box = {"facecolor": "white", "edgecolor": look.colour, "linewidth": 0.9 * self.scale}
        self._rounded(box, 1.5, zorder=4, **look_of_box).set_gid(gid)

    def _rounded(self, box: Box, radius: float, **look: object) -> FancyBboxPatch:
        """Draw a box with rounded corners."""
        left, bottom, right, top = box
        style = f"round,pad=0,rounding_size={radius}"
        patch = FancyBboxPatch((left, bottom), right - left, top - bottom, boxstyle=style, **look)  # pyright: ignore[reportArgumentType] - keywords of a patch
        self.ax.add_patch(patch)
        return patch

    def line(self, points: Sequence[Point], look: Look, gid: str | None = None) -> None:
        """Draw a line with an arrow head at its end, and a white outline where it crosses other lines."""
        (x0, y0), (x1, y1) = points[-2], points[-1]
        length = math.hypot(x1 - x0, y1 - y0) or 1.0
        direction = ((x1 - x0) / length, (y1 - y0) / length)
        size = 2.6 if look.width < 1.8 else 3.2
        end = (x1 - 0.8 * size * direction[0], y1 - 0.8 * size * direction[1])
        xs, ys = zip(*points[:-1], end, strict=True)
        (line,) = self.ax.plot(
            xs, ys, color=look.colour, linewidth=look.width * self.scale, zorder=3, linestyle=look.dash,
            solid_joinstyle="round", solid_capstyle="butt",
        )  # fmt: skip
        outline = {"linewidth": (look.width + 2.2) * self.scale, "foreground": "white", "capstyle": "butt"}
        line.set_path_effects([patheffects.Stroke(**outline), patheffects.Normal()])
        line.set_gid(gid)
        head = _turned([(0.0, 0.0), (-size, 0.42 * size), (-size, -0.42 * size)], (x1, y1), direction)
        self.ax.add_patch(Polygon(head, closed=True, facecolor=look.colour, edgecolor="none", zorder=6))

    def symbol(self, kind: str, at: Point, direction: Point, look: Look) -> None:
        """Draw a symbol over a line, pointing along it."""
        for patch in _patches(kind, at, direction, look.colour):
            patch.set_linewidth(1.1 * self.scale)
            patch.set_zorder(5)
            self.ax.add_patch(patch)

    def saturation(self, at: Point, percent: float, width: float, marks: str = "") -> None:
        """Draw an oxygen saturation [%] with its marks on a field of its colour."""
        (x, y), colour = at, colour_of(percent)
        corner, style = (x - width / 2, y - 1.55), "round,pad=0,rounding_size=1.0"
        patch = FancyBboxPatch(corner, width, 3.1, boxstyle=style, facecolor=colour, edgecolor="none")
        patch.set_zorder(7)
        self.ax.add_patch(patch)
        words = f"{marks}{percent:.0f}%" if marks else f"{percent:.0f} %"
        size = 4.8 if marks else 6
        self.text(x, y - 0.1, words, size=size, weight="bold", color=text_colour_on(percent))

    def saturation_scale(self, right: float, y: float) -> None:
        """Draw the colour scale of saturations, from low to high, ending at `right`."""
        for index, (percent, _) in enumerate(reversed(COLOUR_STOPS)):
            self.saturation((right - 4.5 - 9.0 * index, y), percent, 9.0)
        self.text(right - 9.0 * len(COLOUR_STOPS) - 1.5, y, "oxygen saturation", size=6.5, ha="right")

    def arc(self, first: Box, second: Box, look: Look, blocked: Sequence[Box]) -> Point:
        """Draw a curved arrow between any two boxes, avoiding boxes and text, and return its middle."""
        bend, path = arc(first, second, [*(box.extents for box in self._texts()), *blocked])
        arrow = FancyArrowPatch(
            path[0],
            path[-1],
            connectionstyle=f"arc3,rad={bend}",
            arrowstyle="-|>",
            zorder=3,
            shrinkA=0,
            shrinkB=0,
        )
        arrow.set(color=look.colour, linestyle=look.dash, linewidth=look.width * self.scale)
        arrow.set_mutation_scale(8 * self.scale)
        self.ax.add_patch(arrow)
        return path[len(path) // 2]

    def text_where_free(
        self, at: Point, content: str, blocked: Sequence[Box], size: float, colour: str
    ) -> None:
        """Draw text at the place nearest to a point where it covers no box, line or other text."""
        others = [*self._texts(), *self._lines(), *(Bbox.from_extents(*box) for box in blocked)]
        ground = {"facecolor": "white", "edgecolor": "none", "pad": 0.8, "alpha": 0.8}
        text = self.text(*at, content, size, color=colour, bbox=ground)
        extent = self._extent(text)
        steps = ((dx, dy) for dx in range(-60, 61, 4) for dy in range(-60, 61, 2))
        for dx, dy in sorted(steps, key=lambda step: math.hypot(*step)):
            if not any(extent.translated(dx, dy).overlaps(other) for other in others):
                text.set_position((at[0] + dx, at[1] + dy))
                return

    def _texts(self) -> list[Bbox]:
        """Return the extents of all text so far; each is measured only once, as measuring is slow."""
        for text in self.ax.texts:
            if text not in self._measured and text.get_text():
                self._measured[text] = self._extent(text)
        return list(self._measured.values())

    def _lines(self) -> list[Bbox]:
        paths = [np.asarray(line.get_xydata()) for line in self.ax.get_lines()]
        return [
            Bbox.from_extents(*np.minimum(a, b), *np.maximum(a, b))
            for path in paths
            for a, b in pairwise(path)
        ]

    def _extent(self, text: Text) -> Bbox:
        return text.get_window_extent().transformed(self.ax.transData.inverted())


def _patches(kind: str, at: Point, direction: Point, colour: str) -> list[Patch]:
    """Return the patches of a symbol at a point, oriented along the flow."""

    def shape(points: list[Point], face: str = "white", closed: bool = True) -> Polygon:
        corners, fill = _turned(points, at, direction), face != "none"
        return Polygon(corners, closed=closed, fill=fill, facecolor=face, edgecolor=colour)

    match kind:
        case "valve":
            flap = [(-2.4, 2.2), (2.4, 0.0), (-2.4, -2.2)]
            return [shape(flap), shape([(2.4, 2.2), (2.4, -2.2)], "none", closed=False)]
        case "pump":
            return [
                Circle(at, 3.3, facecolor="white", edgecolor=colour),
                shape([(-1.7, 2.83), (3.3, 0.0), (-1.7, -2.83)]),
            ]
        case "roller":
            rollers = _turned([(0.0, 2.1), (0.0, -2.1)], at, direction)
            arm = shape([(0.0, 2.1), (0.0, -2.1)], "none", closed=False)
            ring = Circle(at, 3.3, facecolor="white", edgecolor=colour)
            return [ring, arm, *(Circle(p, 1.0, facecolor=colour, edgecolor=colour) for p in rollers)]
        case "exchanger":
            membrane = shape([(-3.3, -3.0), (3.3, 3.0)], "none", closed=False)
            return [shape([(-3.3, -3.0), (3.3, -3.0), (3.3, 3.0), (-3.3, 3.0)]), membrane]
        case "cannula":
            return [shape([(-2.8, 1.6), (2.8, 0.7), (2.8, -0.7), (-2.8, -1.6)])]
        case "resistance":
            return [shape([(-3.3, 1.3), (3.3, 1.3), (3.3, -1.3), (-3.3, -1.3)])]
        case _:
            return []


def _turned(points: list[Point], at: Point, direction: Point) -> list[Point]:
    length = math.hypot(*direction) or 1.0
    c, s = direction[0] / length, direction[1] / length
    return [(at[0] + c * x - s * y, at[1] + s * x + c * y) for x, y in points]
