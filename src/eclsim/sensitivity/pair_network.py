"""The network of pairs: which factors act together, from second-order indices."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from eclsim.reporting.style import GREY, OKABE_ITO, figure_style, new_figure

MOST_FACTORS = 10
FAINTEST = 0.005


def plot_pairs(result: Any) -> Figure:
    """A circle for each factor (area: first order), a line for each pair (width: second order) per output.

    Pairs are drawn where the index exceeds its own 95 % half width and 0.005; the ten leading factors are
    shown.
    """
    leading = [result.factors.index(n) for n in list(result.sums)[:MOST_FACTORS]]
    leading.sort()
    angle = np.linspace(0.5 * np.pi, 2.5 * np.pi, len(leading), endpoint=False)
    place = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    with figure_style():
        columns = min(4, len(result.outputs) + 1)
        rows = -(-(len(result.outputs) + 1) // columns)
        fig = new_figure(height_mm=46 * rows)
        grid = fig.subplots(rows, columns, squeeze=False)
        right = 2.6 if any("." in result.factors[i] for i in leading) else 1.95
        for axes in grid.flat:
            axes.set_axis_off()
            axes.set_aspect("equal")
            axes.set(xlim=(-1.95, right), ylim=(-1.55, 1.55))
        drawn = 0
        for k, output in enumerate(result.outputs):
            drawn += _draw(grid.flat[k], result, k, leading, place)
            grid.flat[k].set_title(output)
        _explain(grid.flat[len(result.outputs)], drawn)
    return fig


def _draw(axes: Any, result: Any, k: int, leading: list[int], place: np.ndarray) -> int:
    """One output; returns the number of pairs drawn."""
    e = result.estimates
    drawn = 0
    for a, i in enumerate(leading):
        for b, j in enumerate(leading[a + 1 :], a + 1):
            index, width = e.S2[k, i, j], e.S2_conf[k, i, j]
            if index > max(width, FAINTEST):
                look = {"color": OKABE_ITO["vermillion"], "linewidth": _line(index)}
                axes.plot(*place[[a, b]].T, solid_capstyle="round", zorder=1, **look)
                drawn += 1
    for a, i in enumerate(leading):
        area = _area(e.S1[k, i])
        axes.scatter(*place[a], s=area, color=OKABE_ITO["blue"], zorder=2)
        _label(axes, result.factors[i], place[a], 0.5 * np.sqrt(area) + 2.0)
    return drawn


def _label(axes: Any, name: str, place: np.ndarray, away: float) -> None:
    """The factor's name outside its circle, `away` points from its centre."""
    across, up = (int(np.sign(np.round(x, 2))) * (abs(x) > 0.3) for x in place)
    align = {"ha": ("center", "left", "right")[across], "va": ("center", "bottom", "top")[up]}
    if across:
        align["va"] = "center"
    # Text makes no room for itself: the panels of all outputs have the same size.
    text = axes.annotate(
        name.replace(".", ".\n", 1),
        place,
        xytext=away * place,
        textcoords="offset points",
        fontsize=6,
        **align,
    )
    text.set_in_layout(False)


def _line(index: float) -> float:
    return 40.0 * index


def _area(index: float) -> float:
    return 4.0 + 260.0 * max(index, 0.0)


def _explain(axes: Any, drawn: int) -> None:
    for height, index in zip((1.3, 0.8, 0.45), (0.5, 0.1, 0.0), strict=True):
        axes.scatter(-1.4, height, s=_area(index), color=OKABE_ITO["blue"])
        axes.text(-0.9, height, f"$S_1$ = {index:g}", va="center", fontsize=7)
    for height, index in zip((0.05, -0.3, -0.65), (0.1, 0.05, 0.01), strict=True):
        axes.plot((-1.7, -1.1), (height, height), color=OKABE_ITO["vermillion"], linewidth=_line(index))
        axes.text(-0.9, height, f"$S_2$ = {index:g}", va="center", fontsize=7)
    said = "lines: pairs beyond\ntheir 95 % half width" if drawn else "no pair is beyond its\n95 % half width"
    axes.text(-1.7, -0.95, said, va="top", fontsize=7, color=GREY)
