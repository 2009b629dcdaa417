"""Draws boxes, lines and labels in millimetres onto axes of any size."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch, Rectangle
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from eclsim.reporting.schematic_symbols import draw_arrow_head, draw_symbol
from eclsim.reporting.style import OKABE_ITO

Point = tuple[float, float]
Box = tuple[float, float, float, float]

# Tried in this order: the straightest arc that runs past all boxes and text.
_BENDS = (0.0, 0.12, -0.12, 0.24, -0.24, 0.36, -0.36, 0.5, -0.5)


@dataclass(frozen=True)
class Stroke:
    """Look of one group's lines; dash patterns tell the groups apart in grey print."""

    colour: str
    width: float
    dash: object
    fill: str


_STROKES = {
    "patient": Stroke("#222222", 1.3, "-", "#F7F7F7"),
    "ecmo": Stroke(OKABE_ITO["blue"], 2.0, "-", "#EEF5FA"),
    "crrt": Stroke("#00734F", 1.5, (0, (4, 1.5)), "#EDF7F3"),
    "lvad": Stroke("#A84A00", 2.0, (0, (6, 1.3, 1.2, 1.3)), "#FBF1EA"),
}
_OTHER = Stroke("#7A4A72", 1.3, (0, (1.5, 1.2)), "#F8F2F6")


def stroke_of(group: str) -> Stroke:
    """The look of a group; groups of a user's own share one."""
    return _STROKES.get(group, _OTHER)


@dataclass
class Pen:
    """Axes whose data units are millimetres, and the factor by which text and lines are scaled."""

    ax: Axes
    scale: float
    _measured: dict[Text, Bbox] = field(default_factory=dict)

    @property
    def figure(self) -> Figure:
        """The figure drawn into."""
        figure = self.ax.get_figure(root=True)
        assert figure is not None  # axes drawn into always belong to a figure
        return figure

    def text(self, x: float, y: float, words: str, size: float, **options: object) -> Text:
        """Text centred on a point unless told otherwise; `size` in points on the full page."""
        options = {"ha": "center", "va": "center", "zorder": 8, **options}
        return self.ax.text(x, y, words, fontsize=size * self.scale, **options)  # pyright: ignore[reportArgumentType] - dict of keywords

    def label_beside(self, at: Point, lines: Sequence[str], align: str) -> None:
        """Lines of text beside a point; from the second on bold, since they are numbers."""
        shown = [line for line in lines if line]
        for index, line in enumerate(shown):
            y = at[1] + 3.3 * ((len(shown) - 1) / 2 - index)
            self.text(
                at[0], y, line, size=7 if index else 6.5, weight="bold" if index else "normal", ha=align
            )

    def frame(self, left: float, bottom: float, right: float, top: float, stroke: Stroke) -> None:
        """Tinted background of one group."""
        style = "round,pad=0,rounding_size=2.5"
        self.ax.add_patch(
            FancyBboxPatch(
                (left, bottom),
                right - left,
                top - bottom,
                boxstyle=style,
                zorder=0,
                facecolor=stroke.fill,
                edgecolor="#C9C9C9",
                linewidth=0.6 * self.scale,
            )
        )

    def shade(self, left: float, bottom: float, right: float, top: float) -> None:
        """Grey ground behind the chambers of one side of the heart."""
        self.ax.add_patch(
            Rectangle(
                (left, bottom), right - left, top - bottom, zorder=1, facecolor="#E6E6E6", edgecolor="none"
            )
        )

    def box(self, box: Box, stroke: Stroke, gid: str) -> None:
        """A white box with rounded corners."""
        left, bottom, right, top = box
        patch = FancyBboxPatch(
            (left, bottom),
            right - left,
            top - bottom,
            boxstyle="round,pad=0,rounding_size=1.5",
            facecolor="white",
            edgecolor=stroke.colour,
            linewidth=0.9 * self.scale,
            zorder=4,
        )
        patch.set_gid(gid)
        self.ax.add_patch(patch)

    def line(self, points: Sequence[Point], stroke: Stroke, gid: str | None = None) -> None:
        """A line with an arrow head at its end; a white outline shows where it crosses others."""
        (x0, y0), (x1, y1) = points[-2], points[-1]
        length = math.hypot(x1 - x0, y1 - y0) or 1.0
        direction = ((x1 - x0) / length, (y1 - y0) / length)
        size = 2.6 if stroke.width < 1.8 else 3.2
        end = (x1 - 0.8 * size * direction[0], y1 - 0.8 * size * direction[1])
        xs, ys = zip(*points[:-1], end, strict=True)
        (line,) = self.ax.plot(
            xs,
            ys,
            color=stroke.colour,
            linewidth=stroke.width * self.scale,
            zorder=3,
            linestyle=stroke.dash,
            solid_joinstyle="round",
            solid_capstyle="butt",
        )
        line.set_path_effects(
            [
                patheffects.Stroke(
                    linewidth=(stroke.width + 2.2) * self.scale, foreground="white", capstyle="butt"
                ),
                patheffects.Normal(),
            ]
        )
        line.set_gid(gid)
        draw_arrow_head(self.ax, (x1, y1), direction, stroke.colour, size)

    def symbol(self, kind: str, at: Point, direction: Point, stroke: Stroke) -> None:
        """A symbol over a line, pointing along it."""
        draw_symbol(self.ax, kind, at, direction, stroke.colour, 1.1 * self.scale)

    def between(self, first: Box, second: Box) -> tuple[Point, Point]:
        """Ends of a straight line between two boxes of one row or one column."""
        x, y = 0.5 * (first[0] + first[2]), 0.5 * (first[1] + first[3])
        if abs(0.5 * (second[1] + second[3]) - y) < 0.5:
            return (
                ((first[2], y), (second[0], y)) if second[0] > first[2] else ((first[0], y), (second[2], y))
            )
        return ((x, first[3]), (x, second[1])) if second[1] > first[3] else ((x, first[1]), (x, second[3]))

    def arc(self, first: Box, second: Box, stroke: Stroke, blocked: Sequence[Box]) -> Point:
        """A bent arrow between two boxes anywhere on the page, past boxes and text; returns its middle."""
        start, stop = _border(first, _middle(second)), _border(second, _middle(first))
        obstacles = [*self._texts(), *(Bbox.from_extents(*box) for box in blocked)]
        curves = {bend: _curve(start, stop, bend) for bend in _BENDS}
        bend = min(_BENDS, key=lambda b: sum(box.contains(*p) for p in curves[b] for box in obstacles))
        arrow = FancyArrowPatch(
            start, stop, connectionstyle=f"arc3,rad={bend}", arrowstyle="-|>", zorder=3, shrinkA=0, shrinkB=0
        )
        arrow.set(color=stroke.colour, linestyle=stroke.dash, linewidth=stroke.width * self.scale)
        arrow.set_mutation_scale(8 * self.scale)
        self.ax.add_patch(arrow)
        return curves[bend][len(curves[bend]) // 2]

    def text_where_free(
        self, at: Point, words: str, blocked: Sequence[Box], size: float, colour: str
    ) -> None:
        """Text near a point, at the nearest place where it covers no box and no other text."""
        others = [*self._texts(), *self._lines(), *(Bbox.from_extents(*box) for box in blocked)]
        ground = {"facecolor": "white", "edgecolor": "none", "pad": 0.8, "alpha": 0.8}
        text = self.text(*at, words, size, color=colour, bbox=ground)
        extent = self._extent(text)
        steps = ((dx, dy) for dx in range(-60, 61, 4) for dy in range(-60, 61, 2))
        for dx, dy in sorted(steps, key=lambda step: math.hypot(*step)):
            if not any(extent.translated(dx, dy).overlaps(other) for other in others):
                text.set_position((at[0] + dx, at[1] + dy))
                return

    def _texts(self) -> list[Bbox]:
        """Extents of all text so far; each is measured once, since measuring is slow."""
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


def _middle(box: Box) -> Point:
    return 0.5 * (box[0] + box[2]), 0.5 * (box[1] + box[3])


def _curve(start: Point, stop: Point, bend: float) -> list[Point]:
    """Points of the arc that `arc3` draws: a parabola through a point beside the middle."""
    dx, dy = stop[0] - start[0], stop[1] - start[1]
    side = (0.5 * (start[0] + stop[0]) + bend * dy, 0.5 * (start[1] + stop[1]) - bend * dx)
    weights = [((1 - t) ** 2, 2 * t * (1 - t), t**2) for t in (i / 40 for i in range(41))]
    return [
        (a * start[0] + b * side[0] + c * stop[0], a * start[1] + b * side[1] + c * stop[1])
        for a, b, c in weights
    ]


def _border(box: Box, towards: Point) -> Point:
    """Where the line from the middle of a box towards a point leaves the box."""
    x, y = _middle(box)
    dx, dy = towards[0] - x, towards[1] - y
    reach = max(abs(dx) / (0.5 * (box[2] - box[0])), abs(dy) / (0.5 * (box[3] - box[1])), 1e-9)
    return x + dx / reach, y + dy / reach
