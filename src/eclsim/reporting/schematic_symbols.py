"""Symbols of the schematic, each drawn around a point and along a direction of flow."""

import math
from typing import TYPE_CHECKING

from matplotlib.patches import Circle, Polygon

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.patches import Patch

    Point = tuple[float, float]


def draw_symbol(ax: "Axes", kind: str, at: "Point", direction: "Point", colour: str, width: float) -> None:
    """Draws one symbol [mm], pointing along `direction` (a unit vector), over the line it belongs to."""
    for patch in _patches(kind, at, direction, colour):
        patch.set_linewidth(width)
        patch.set_zorder(5)
        ax.add_patch(patch)


def draw_arrow_head(ax: "Axes", tip: "Point", direction: "Point", colour: str, size: float = 2.6) -> None:
    """Draws a filled triangle with its tip at a point [mm]."""
    shape = [(0.0, 0.0), (-size, 0.42 * size), (-size, -0.42 * size)]
    ax.add_patch(
        Polygon(_turned(shape, tip, direction), closed=True, facecolor=colour, edgecolor="none", zorder=6)
    )


def _patches(kind: str, at: "Point", direction: "Point", colour: str) -> "list[Patch]":
    def shape(points: "list[Point]", face: str = "white", closed: bool = True) -> Polygon:
        return Polygon(
            _turned(points, at, direction),
            closed=closed,
            fill=face != "none",
            facecolor=face,
            edgecolor=colour,
        )

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


def _turned(points: "list[Point]", at: "Point", direction: "Point") -> "list[Point]":
    length = math.hypot(*direction) or 1.0
    c, s = direction[0] / length, direction[1] / length
    return [(at[0] + c * x - s * y, at[1] + s * x + c * y) for x, y in points]
