"""The connection schemes as small drawings: the ECMO circuit in flow direction, the CRRT below."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch, Rectangle

from eclsim.reporting.style import GREY, OKABE_ITO, PAGE_WIDTH_MM, figure_style, new_figure, plain_text

if TYPE_CHECKING:
    from eclsim.crrt_study.schemes import Scheme

POSITIONS = {
    "post_dc": 1.0, "pre_pump": 2.4, "post_pump": 4.0, "pre_oxy": 5.2, "post_oxy": 7.2, "pre_rc": 8.6,
}  # fmt: skip
PUMP, OXYGENATOR = 3.2, 6.2
ECMO_COLOUR, CRRT_COLOUR, RETURN_COLOUR = GREY, OKABE_ITO["blue"], OKABE_ITO["vermillion"]
COLUMNS = 3
MOST_DRAWN = 18


@figure_style()
def draw_schemes(schemes: Sequence[Scheme], places: Mapping[str, str] | None = None) -> Figure:
    """Small drawings of schemes, three in a row.

    Args:
        schemes: up to 18 are drawn; of more, the 18 that rank best.
        places: rank of each by letter, best first, written in the title; "–" where it is not known.
    """
    shown = list(schemes)
    if len(shown) > MOST_DRAWN:
        order = {letter: k for k, letter in enumerate(places or ())}
        shown = sorted(shown, key=lambda scheme: order.get(scheme.letter, 0))[:MOST_DRAWN]
    rows = -(-len(shown) // COLUMNS)
    fig = new_figure(PAGE_WIDTH_MM, 4 + 31 * rows)
    fig.set_layout_engine(None)
    edges = {"left": 0.005, "right": 0.995, "bottom": 0.005, "top": 0.995, "wspace": 0.03, "hspace": 0.03}
    grid = fig.subplots(rows, COLUMNS, squeeze=False, gridspec_kw=edges)
    for index, ax in enumerate(grid.flat):
        ax.set_axis_off()
        if index < len(shown):
            draw_scheme(ax, shown[index], None if places is None else places.get(shown[index].letter))
    return fig


def draw_scheme(ax: Axes, scheme: Scheme, place: str | None = None) -> None:
    """One scheme: drainage cannula, pump, oxygenator and return cannula from left to right, CRRT below."""
    ax.set_xlim(-0.4, 10.0)
    ax.set_ylim(-3.7, 2.2)
    ax.set_aspect("equal")
    title = f"{plain_text(scheme.letter, 20)})" + _rank(place)
    ax.text(-0.3, 1.85, title, fontsize=8.5, fontweight="bold", va="center")
    ax.text(-0.3, 1.2, plain_text(scheme.name, 46), fontsize=6.4, va="center", color="black")
    ax.annotate(
        "", (9.9, 0), (-0.3, 0), arrowprops={"arrowstyle": "->", "color": ECMO_COLOUR, "linewidth": 1.6}
    )
    ax.add_patch(Circle((PUMP, 0), 0.45, facecolor="white", edgecolor=ECMO_COLOUR, linewidth=1.2, zorder=3))
    ax.text(PUMP, 0, "P", ha="center", va="center", fontsize=6.5, zorder=4)
    box = Rectangle((OXYGENATOR - 0.55, -0.42), 1.1, 0.84, facecolor="white", edgecolor=ECMO_COLOUR, zorder=3)
    ax.add_patch(box)
    ax.text(OXYGENATOR, 0, "Oxy", ha="center", va="center", fontsize=6, zorder=4)
    for x, text in ((0.1, "DC"), (9.4, "RC")):
        ax.text(x, 0.3, text, ha="center", fontsize=6, color=ECMO_COLOUR)
    _draw_crrt(ax, scheme)


def _rank(place: str | None) -> str:
    if place is None:
        return ""
    return "  rank not known" if place == "–" else f"  rank {place}"


def _draw_crrt(ax: Axes, scheme: Scheme) -> None:
    access, giving = _x(scheme.access_site, -0.1), _x(scheme.return_site, 0.1)
    if abs(access - giving) < 0.5:
        access, giving = access - 0.22, giving + 0.22
    middle = min(max(0.5 * (access + giving), 2.2), 7.4)
    low, wide = -2.75, 1.15
    forward = access <= giving
    left, right = middle - wide, middle + wide
    enter, leave = (left, right) if forward else (right, left)
    body = FancyBboxPatch((left, low - 0.42), 2 * wide, 0.84, boxstyle="round,pad=0.02", facecolor="white",
                          edgecolor=CRRT_COLOUR, linewidth=1.2, zorder=3)  # fmt: skip
    ax.add_patch(body)
    ax.text(middle, low, "CRRT", ha="center", va="center", fontsize=6.5, color=CRRT_COLOUR, zorder=4)
    inwards = [(access, 0.0), (access, -1.35), (enter, -1.35), (enter, low)]
    outwards = [(leave, low), (leave, -1.35), (giving, -1.35)]
    ax.plot(*zip(*inwards, strict=True), color=CRRT_COLOUR, linewidth=1.2, zorder=2)
    ax.plot(
        *zip(*outwards, strict=True), color=RETURN_COLOUR, linewidth=1.2, linestyle=(0, (4, 1.2)), zorder=2
    )
    arrow = {"arrowstyle": "->", "color": RETURN_COLOUR, "linewidth": 1.2, "shrinkA": 0, "shrinkB": 0}
    ax.annotate("", (giving, 0.02), (giving, outwards[2][1]), arrowprops=arrow, zorder=2)
    ax.plot([access], [0], "o", markersize=3.5, color=CRRT_COLOUR, zorder=5)
    ax.plot([giving], [0], "s", markersize=3.2, color=RETURN_COLOUR, zorder=5)


def _x(site: str, shift: float) -> float:
    """Place of a site along the ECMO circuit; the patient's compartments lie beyond its ends."""
    return POSITIONS.get(site, -0.1 + shift)
